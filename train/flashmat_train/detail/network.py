"""The detail network: a U-Net of four levels whose skips also read the frozen ImageNet trunk's feature maps.

It reads the inputs of `inputs.py` at the photo's own resolution and gives what is to be added to the global network's
maps: to the slopes, to the logits of albedo and roughness, and, if asked for, to the logit of "metal". It is fully
convolutional: sides are multiples of 16, and a pixel's answer depends on at most `reach()` pixels to each side, so a
photo of any size is computed in tiles.

Layers, in the order in which they run (n the side of the photo; all convolutions pad with zeros to keep the side, or to
halve it where the stride is 2; all but the two heads are followed by batch norm and ReLU):

    full          3x3          inputs           -> `fine`        n
    down.0        4x4 stride 2 inputs           -> widths[0]     n/2
    mix.0         3x3          down.0, trunk.0  -> widths[0]     n/2
    down.i, mix.i the same from mix.(i-1), at n/2^(i+1), i = 1, 2, 3
    up.0          3x3          mix.3 twice as large (nearest), mix.2 -> widths[2], n/8
    up.1          3x3          up.0 twice as large, mix.1 -> widths[1], n/4
    up.2          3x3          up.1 twice as large, mix.0 -> widths[0], n/2
    half_head     3x3          up.2 -> 4 x outputs, to n by depth-to-space (channel c*4 + 2*dy + dx)
    full_head     3x3          full -> outputs, n; added to the other head's

Trunk features are multiplied by a fixed factor for each channel (`skip.i.scale`) and not shifted: a factor folds into
the weights that read the channel, zeros stay zeros at the border, and int8 reads the trunk's own tensors.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from .. import trunk as pretrained
from ..model import ConvBlock
from ..slopes import normals_of
from .inputs import NAMES, GlobalMaps

#: Channels that are added to slopes x and y, to the logits of albedo's R, G, B, and to roughness's; then metal's.
OUTPUTS = ("slope_x", "slope_y", "red", "green", "blue", "roughness")
#: Blocks of the trunk whose outputs are the skips at 1/2, 1/4, 1/8 and 1/16.
TRUNK_BLOCKS = (0, 2, 4, 9)
#: Logits are taken of albedo and roughness no nearer to 0 and 1 than this.
ALBEDO_MARGIN, GREY_MARGIN = 0.003, 0.01


@dataclass(frozen=True)
class DetailConfig:
    """Widths of a detail network; `widths` from half resolution to the deepest."""

    widths: tuple[int, ...] = (48, 64, 96, 128)
    fine: int = 16  # channels at full resolution
    trunk: bool = True  # reads the trunk's feature maps
    metallic: bool = False  # has an output for "metal"

    def asdict(self) -> dict:
        return asdict(self)

    @staticmethod
    def fromdict(d: dict) -> DetailConfig:
        return DetailConfig(**{k: tuple(v) if isinstance(v, list) else v for k, v in d.items()})

    @property
    def outputs(self) -> int:
        return len(OUTPUTS) + self.metallic

    @property
    def skips(self) -> tuple[int, ...]:
        """Channels of the trunk at each level."""
        if not self.trunk:
            return (0,) * len(self.widths)
        return tuple(pretrained.BLOCKS[i][3] for i in TRUNK_BLOCKS[: len(self.widths)])


class Skip(nn.Module):
    """Trunk features times a fixed factor for each channel."""

    def __init__(self, channels: int):
        super().__init__()
        self.register_buffer("scale", torch.ones(channels))

    def forward(self, x: Tensor) -> Tensor:
        return x * self.scale[:, None, None]


class DetailNetwork(nn.Module):
    """Inputs (B,20,n,n) and trunk features in; corrections (B,outputs,n,n) out, float."""

    def __init__(self, config: DetailConfig):
        super().__init__()
        self.config = config
        inputs, w = len(NAMES), config.widths
        self.full = ConvBlock(inputs, config.fine, 3, 1)
        self.down, self.mix, self.skip = nn.ModuleList(), nn.ModuleList(), nn.ModuleList()
        cin = inputs
        for width, extra in zip(w, config.skips, strict=True):
            self.down.append(ConvBlock(cin, width, 4, 2))
            self.mix.append(ConvBlock(width + extra, width, 3, 1))
            self.skip.append(Skip(extra))
            cin = width
        self.up = nn.ModuleList()
        for width in w[-2::-1]:
            self.up.append(ConvBlock(cin + width, width, 3, 1))
            cin = width
        self.half_head = nn.Conv2d(cin, 4 * config.outputs, 3, padding=1)
        self.full_head = nn.Conv2d(config.fine, config.outputs, 3, padding=1)
        with torch.no_grad():  # at first the global maps stay nearly as they are
            for head in (self.half_head, self.full_head):
                head.bias.zero_()
                head.weight.mul_(0.1)

    def forward(self, x: Tensor, trunk: list[Tensor]) -> Tensor:
        features, y = [], x
        for i, (down, mix, skip) in enumerate(zip(self.down, self.mix, self.skip, strict=True)):
            y = down(y)
            y = mix(torch.cat((y, skip(trunk[i]).to(y.dtype)), dim=1) if self.config.trunk else y)
            features.append(y)
        for up, skip in zip(self.up, features[-2::-1], strict=True):
            y = up(torch.cat((F.interpolate(y, scale_factor=2, mode="nearest"), skip), dim=1))
        return F.pixel_shuffle(self.half_head(y).float(), 2) + self.full_head(self.full(x)).float()

    def hidden(self) -> set[str]:
        """Names of the weights that Muon steps: all convolutions but those that read the inputs and the two heads."""
        outer = ("full.", "full_head.", "half_head.", "down.0.")
        return {name for name, p in self.named_parameters() if p.ndim == 4 and not name.startswith(outer)}


def corrected(raw: Tensor, base: GlobalMaps) -> dict[str, Tensor]:
    """The global maps with the network's answer added: `albedo` (B,3,n,n), `normal` (unit), `roughness` (B,1,n,n) and,
    where the network has that output, `metallic` (B,1,n,n)."""

    def added(x: Tensor, more: Tensor, margin: float) -> Tensor:
        return torch.sigmoid(torch.logit(x.clamp(margin, 1 - margin)) + more)

    out = {
        "albedo": added(base.albedo, raw[:, 2:5], ALBEDO_MARGIN),
        "normal": normals_of(base.slopes + raw[:, :2]),
        "roughness": added(base.roughness, raw[:, 5:6], GREY_MARGIN),
    }
    if raw.shape[1] > len(OUTPUTS):
        out["metallic"] = added(base.metal[:, None, None, None], raw[:, 6:7], GREY_MARGIN)
    return out


def gmacs(config: DetailConfig, size: int = 256) -> float:
    """Multiply-accumulates of one run, trunk left out, in units of 1e9."""
    inputs, w, side = len(NAMES), config.widths, size
    total = (inputs * config.fine + config.fine * config.outputs) * 9 * side * side
    cin = inputs
    for width, extra in zip(w, config.skips, strict=True):
        side //= 2
        total += (cin * width * 16 + (width + extra) * width * 9) * side * side
        cin = width
    for width in w[-2::-1]:
        side *= 2
        total += (cin + width) * width * 9 * side * side
        cin = width
    return (total + cin * 4 * config.outputs * 9 * side * side) / 1e9


def reach(config: DetailConfig) -> int:
    """How many pixels to each side of a pixel its answer depends on, the trunk's features taken as given."""
    levels = len(config.widths)
    grow, step = 0, 1
    for _ in range(levels):
        grow += step  # 4x4 with stride 2: from one pixel before the pair to one after it
        step *= 2
        grow += step
    for _ in range(levels - 1):
        step //= 2
        grow += step + step  # nearest: the pixel beside may belong to the next coarse one
    return grow + step + 1
