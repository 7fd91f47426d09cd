"""The frozen part: the global network's maps of a photo, and the trunk's feature maps, computed once a photo."""

from __future__ import annotations

from pathlib import Path

import torch
import torch.nn.functional as F
from torch import Tensor

from .. import METAL, checkpoint
from ..data.pool import srgb_decode, srgb_encode
from ..model import Network, NetworkConfig
from ..slopes import slopes_of
from .inputs import GlobalMaps
from .network import TRUNK_BLOCKS

#: Side at which the global network sees a photo.
GLOBAL_SIZE = 128


def load_global(path: Path) -> Network:
    """The averaged network of a checkpoint of `train`, `classifier` or `import-model`, frozen; SystemExit without a
    trunk, which the detail network reads."""
    state = checkpoint.load(path)
    network = Network(NetworkConfig.fromdict(state["config"]))
    network.load_state_dict({k: v for k, v in network.state_dict().items() if k.startswith("room.")} | state["ema"])
    if network.trunk is None:
        raise SystemExit(f"{path}: its classifier reads no pretrained trunk; see the stage `classifier`")
    network.requires_grad_(False)
    return network.eval().to(memory_format=torch.channels_last)


def shrunk(photo: Tensor, size: int = GLOBAL_SIZE) -> Tensor:
    """A network input (B,6,n,n) at side `size`, which divides n; colours are averaged in linear light."""
    k = photo.shape[-1] // size
    if k * size != photo.shape[-1]:
        raise ValueError(f"a photo of {photo.shape[-1]} pixels cannot be averaged to {size}")
    if k == 1:
        return photo
    return torch.cat((srgb_encode(F.avg_pool2d(srgb_decode(photo[:, :3]), k)), F.avg_pool2d(photo[:, 3:], k)), dim=1)


@torch.no_grad()
def global_maps(network: Network, photo: Tensor, looks: int = 1) -> GlobalMaps:
    """What the global network says of photos (B,6,n,n), up-sampled to their size; with two looks the mean of what it
    says of the photo and of its mirror image (the class is of the first)."""
    seen = shrunk(photo).contiguous(memory_format=torch.channels_last)
    out = {k: v.float() for k, v in network(seen).items()}
    albedo, normal, rough = out["albedo"], out["normal"], out["roughness"]
    metal = out["class_logits"].softmax(dim=1)[:, METAL]
    if looks == 2:
        mirrored = seen.flip(3)
        mirrored[:, 3] = seen[:, 3]  # x is a pixel's place, not part of the picture
        other = {k: v.float().flip(3) for k, v in network(mirrored).items() if v.ndim == 4}
        turned = torch.cat((-other["normal"][:, :1], other["normal"][:, 1:]), dim=1)
        albedo, rough = (albedo + other["albedo"]) / 2, (rough + other["roughness"]) / 2
        normal = normal + turned
        normal = normal / normal.norm(dim=1, keepdim=True)

    def up(x: Tensor) -> Tensor:
        return F.interpolate(x, size=photo.shape[2:], mode="bilinear", align_corners=False)

    return GlobalMaps(up(albedo), slopes_of(up(normal)), up(rough), metal)


@torch.no_grad()
def trunk_features(network: Network, photo: Tensor) -> list[Tensor]:
    """Outputs of the trunk's blocks 0, 2, 4 and 9 of photos at their own size: 16, 24, 40 and 112 channels at 1/2, 1/4,
    1/8 and 1/16: the projections' outputs, with the block's input added where the shapes agree, without ReLU."""
    y, out = network.trunk.stem(photo.float()), []
    for i, block in enumerate(network.trunk.blocks[: TRUNK_BLOCKS[-1] + 1]):
        y, _ = block(y)
        if i in TRUNK_BLOCKS:
            out.append(y)
    return out
