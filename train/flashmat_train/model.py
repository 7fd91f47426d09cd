"""The network: one encoder of seven stride-2 convolutions, three decoders with skips, a classifier whose softmax
mixes the per-class last layers (paper, "Network Design"). Presets are the widths; every layer folds to int8.

The heads also read a convolution of the photo itself ("detail"): what is in the albedo is in the photo, pixel by pixel.
The classifier reads a trunk of its own (`trunk.py`), or, without one, the means of some of the encoder's stages.

Input (B,6,n,n): sRGB-encoded R, G, B in [0,1]; then where the pixel's ray meets the plane at distance 1, x and y, as
(x / COORDINATE_REACH + 1) / 2, so that the network knows the field of view and with it the flash's falloff; then 1
where the flash's strength is known (the photo is then in its units: a flat white Lambertian at the centre would be 1)
or 0. n is a multiple of 128.
"""

from __future__ import annotations

import itertools
from dataclasses import asdict, dataclass

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from . import CLASSES
from . import trunk as pretrained
from .render.flash import FOV_DEG, pixel_positions

HEADS = {"albedo": 3, "normal": 3, "roughness": 1}
INPUT_CHANNELS = 6
STAGES = 7
Z_EPS = 1e-2
#: The plane's x or y whose coordinate is 1: half the tangent-width of a field of view of 73.7 degrees. Beyond: 1.
COORDINATE_REACH = 0.75


@dataclass(frozen=True)
class NetworkConfig:
    """Widths of a network. `decoder` runs from the deepest (4x4 at 256²) to half resolution."""

    name: str
    encoder: tuple[int, ...]
    decoder: tuple[int, ...]
    classifier: int = 128
    trunk: int = 0  # blocks of the pretrained trunk that the classifier reads; 0: it reads the encoder's stages
    texture: tuple[int, ...] = (3, 4, 5)  # stages whose means are read beside the deepest's (classifier, room)
    room: int = 0  # hidden width of the guess of the room's light, a help in training that is not exported; 0: none
    detail: int = 0  # channels at half resolution, straight from the photo, that the heads read too; 0: none
    encoder_kernel: int = 4
    mixing: bool = True  # K per-class heads mixed by the classifier; off: one head (variant `basic`)
    classify: bool = True

    def asdict(self) -> dict:
        return asdict(self)

    @staticmethod
    def fromdict(d: dict) -> NetworkConfig:
        d = {k: tuple(v) if isinstance(v, list) else v for k, v in d.items()}
        if isinstance(d.get("texture"), int):  # checkpoints of one stage
            d["texture"] = (d["texture"],)
        return NetworkConfig(**d)


PRESETS = {
    "phone": NetworkConfig(
        "phone", (32, 48, 64, 128, 192, 256, 256), (128, 128, 96, 64, 40, 32), 48, trunk=11, room=64, detail=32
    ),
    "paper": NetworkConfig(
        "paper", (64, 128, 256, 256, 512, 512, 512), (512, 256, 256, 128, 96, 64), room=64, detail=32
    ),
    "tiny": NetworkConfig("tiny", (8, 12, 16, 16, 24, 24, 32), (16, 16, 16, 12, 8, 8), 16, room=8, detail=12),
}


class ConvBlock(nn.Module):
    """Convolution, batch norm, ReLU: one int8 layer after folding."""

    def __init__(self, cin: int, cout: int, kernel: int, stride: int):
        super().__init__()
        self.conv = nn.Conv2d(cin, cout, kernel, stride, padding=(kernel - stride + 1) // 2, bias=False)
        self.norm = nn.BatchNorm2d(cout, momentum=0.02)

    def forward(self, x: Tensor) -> Tensor:
        return F.relu(self.norm(self.conv(x)))


class MixHead(nn.Module):
    """K per-class 3x3 convolutions to N maps at twice the resolution, mixed before the non-linearity.

    Mixing is linear, so the mixed weights are one convolution per photo: `forward` mixes the weights first when that
    is cheaper (one photo), and the outputs otherwise; both are the same function.
    """

    def __init__(self, cin: int, maps: int, classes: int):
        super().__init__()
        self.maps, self.classes = maps, classes
        self.conv = nn.Conv2d(cin, classes * maps * 4, 3, padding=1)

    def forward(self, x: Tensor, probabilities: Tensor) -> Tensor:
        b, k, c = x.shape[0], self.classes, self.maps * 4
        if k == 1:
            return F.pixel_shuffle(self.conv(x).float(), 2)
        weight = self.conv.weight.reshape(k, -1)
        mixed = (probabilities.float() @ weight.float()).view(b * c, -1, 3, 3)
        bias = (probabilities.float() @ self.conv.bias.float().view(k, c)).reshape(b, c)
        out = torch.cat([F.conv2d(xi[None], mixed[i * c : (i + 1) * c], bias[i], padding=1) for i, xi in enumerate(x)])
        return F.pixel_shuffle(out.float(), 2)


class Decoder(nn.Module):
    """Six times x2 nearest up-sampling, concatenation with the encoder's features, 3x3 convolution; then the head."""

    def __init__(self, config: NetworkConfig, maps: int):
        super().__init__()
        skips = config.encoder[-2::-1]
        blocks, cin = [], config.encoder[-1]
        for width, skip in zip(config.decoder, skips, strict=True):
            blocks.append(ConvBlock(cin + skip, width, 3, 1))
            cin = width
        self.blocks = nn.ModuleList(blocks)
        self.head = MixHead(cin + config.detail, maps, len(CLASSES) if config.mixing else 1)

    def forward(self, features: list[Tensor], detail: Tensor | None, probabilities: Tensor) -> Tensor:
        x = features[-1]
        for block, skip in zip(self.blocks, features[-2::-1], strict=True):
            x = block(torch.cat((F.interpolate(x, scale_factor=2, mode="nearest"), skip), dim=1))
        return self.head(x if detail is None else torch.cat((x, detail), dim=1), probabilities)


class Network(nn.Module):
    """Photo in, maps and class logits out."""

    def __init__(self, config: NetworkConfig):
        super().__init__()
        self.config = config
        widths = (INPUT_CHANNELS, *config.encoder)
        self.encoder = nn.ModuleList(ConvBlock(a, b, config.encoder_kernel, 2) for a, b in itertools.pairwise(widths))
        self.detail = ConvBlock(INPUT_CHANNELS, config.detail, 2, 2) if config.detail else None
        self.decoders = nn.ModuleDict({name: Decoder(config, n) for name, n in HEADS.items()})
        pooled = config.encoder[-1] + sum(config.encoder[i] for i in config.texture)
        self.trunk = pretrained.Trunk(config.trunk, INPUT_CHANNELS) if config.trunk else None
        self.classifier = nn.Sequential(
            nn.Linear(pretrained.width(config.trunk) if config.trunk else pooled, config.classifier),
            nn.ReLU(),
            nn.Linear(config.classifier, len(CLASSES)),
        )
        self.room = None
        if config.room:
            self.room = nn.Sequential(nn.Linear(pooled, config.room), nn.ReLU(), nn.Linear(config.room, 1))

    def encode(self, x: Tensor) -> tuple[list[Tensor], Tensor]:
        """The features of every stage, and the means of those that `texture` names and of the deepest."""
        features = []
        for block in self.encoder:
            x = block(x)
            features.append(x)
        return features, self.pooled(features)

    def pooled(self, features: list[Tensor]) -> Tensor:
        """Means over space of the deepest features and of the texture stages'."""
        read = (features[-1], *(features[i] for i in self.config.texture))
        return torch.cat([f.float().mean(dim=(2, 3)) for f in read], dim=1)

    def evidence(self, x: Tensor, pooled: Tensor | None) -> Tensor:
        """What the classifier reads: the trunk's means, else the encoder's. The trunk runs in single precision: where
        the CPU has no bf16 instructions, depthwise convolutions in bf16 take ten times as long."""
        if self.trunk is None:
            return pooled
        with torch.autocast(x.device.type, enabled=False):
            return self.trunk(x.float())

    def classify(self, x: Tensor) -> Tensor:
        """Class logits alone (variant `clsOnly`)."""
        return self.classifier(self.evidence(x, self.encode(x)[1] if self.trunk is None else None))

    def forward(self, x: Tensor) -> dict[str, Tensor]:
        """`albedo` (B,3,n,n), `normal` (B,3,n,n) unit, `roughness` (B,1,n,n), `class_logits` (B,8); with `config.room`
        also `room` (B,), the guess of the room's light over the flash's."""
        features, pooled = self.encode(x)
        logits = self.classifier(self.evidence(x, pooled))
        detail = self.detail(x) if self.detail is not None else None
        probabilities = logits.softmax(dim=1)
        raw = {name: decoder(features, detail, probabilities) for name, decoder in self.decoders.items()}
        out = {**activate(raw), "class_logits": logits}
        return out if self.room is None else {**out, "room": self.room(pooled)[:, 0]}


def activate(raw: dict[str, Tensor]) -> dict[str, Tensor]:
    """The heads' non-linearities: sigmoid for albedo and roughness; tanh x, y, positive z, normalised for normals."""
    n = raw["normal"]
    v = torch.cat((torch.tanh(n[:, :2]), torch.sigmoid(n[:, 2:]) + Z_EPS), dim=1)
    return {
        "albedo": torch.sigmoid(raw["albedo"]),
        "normal": v / v.square().sum(dim=1, keepdim=True).sqrt(),
        "roughness": torch.sigmoid(raw["roughness"]),
    }


def network_input(photo_srgb: Tensor, known: Tensor, fov_deg: Tensor | None = None) -> Tensor:
    """Appends to sRGB-encoded photos (B,3,n,n) the coordinates and `known` (B,), 1 or 0: the flash's strength is.

    `fov_deg` (B,), degrees from side to side; None: the paper's.
    """
    b, _, n, _ = photo_srgb.shape
    fov = torch.full((b,), FOV_DEG, device=photo_srgb.device) if fov_deg is None else fov_deg.to(photo_srgb)
    reach = torch.tan(torch.deg2rad(fov) / 2)[:, None, None, None] / COORDINATE_REACH
    p = (pixel_positions(n, photo_srgb.device) * reach + 1.0).clamp(0, 2) / 2.0
    flag = known.to(photo_srgb)[:, None, None, None].expand(b, 1, n, n)
    return torch.cat((photo_srgb, p, flag), dim=1)


def gmacs(config: NetworkConfig, size: int = 256) -> float:
    """Multiply-accumulates of one run with folded heads, in units of 1e9."""
    macs, res = 0.0, size
    widths = (INPUT_CHANNELS, *config.encoder)
    for a, b in itertools.pairwise(widths):
        res //= 2
        macs += a * b * config.encoder_kernel**2 * res * res
    macs += INPUT_CHANNELS * config.detail * 4 * (size // 2) ** 2
    macs += pretrained.macs(config.trunk, INPUT_CHANNELS, size)
    for maps in HEADS.values():
        res, cin = size // 2**STAGES, config.encoder[-1]
        for width, skip in zip(config.decoder, config.encoder[-2::-1], strict=True):
            res *= 2
            macs += (cin + skip) * width * 9 * res * res
            cin = width
        macs += (cin + config.detail) * maps * 4 * 9 * res * res
    return macs / 1e9
