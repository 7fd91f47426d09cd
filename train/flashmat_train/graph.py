"""The model file's graph: tensors, layers, and how float weights become int8 ones (`docs/model-format.md`)."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

CRF_COEFFICIENTS = 12

Array = np.ndarray


class ModelFileError(ValueError):
    """The file or the model does not keep the format's rules."""


@dataclass(frozen=True)
class Tensor:
    """A value of the graph. `divisor` d: n/d pixels a side for n of input; real = scale * (q - zero_point).

    `divisor` 0: a float vector (the classifier's); scale and zero point are then 1 and 0.
    """

    name: str
    channels: int
    divisor: int
    scale: float = 1.0
    zero_point: int = 0


@dataclass(frozen=True)
class Source:
    """A tensor as a layer reads it: by its name, through x2 nearest up-sampling or not."""

    tensor: str
    upsample: bool = False


Pad = tuple[int, int, int, int]  # top, left, bottom, right


@dataclass
class Conv:
    """Convolution over one or two concatenated sources; see docs/model-format.md for its exact arithmetic."""

    name: str
    sources: tuple[Source, ...]
    output: str
    weight_q: Array  # i8 [cout][kh][kw][cin_total], in [-127, 127]
    weight_scale: Array  # f32 [cout]: real = weight_scale * (sum weight_q * (q - zero_point) + bias_q)
    bias_q: Array  # i32 [cout]
    stride: int = 1
    pad: Pad = (1, 1, 1, 1)
    relu: bool = True
    # The float engine's: f32 [cout][kh][kw][cin_total], real units, batch norm folded.
    weight: Array | None = None
    bias: Array | None = None  # f32 [cout]
    relu6: bool = False  # as `relu`, and nothing is above 6: int8 codes end there, the float engine must be told


@dataclass
class Depthwise:
    """Convolution of every channel with a kernel of its own, over one source read as it is."""

    name: str
    source: str
    output: str
    weight_q: Array  # i8 [kh][kw][channels], in [-127, 127]
    weight_scale: Array  # f32 [channels]: real = weight_scale * (sum weight_q * (q - zero_point) + bias_q)
    bias_q: Array  # i32 [channels]
    stride: int = 1
    pad: Pad = (1, 1, 1, 1)
    relu: bool = True
    # The float engine's: f32 [kh][kw][channels], real units, batch norm folded.
    weight: Array | None = None
    bias: Array | None = None  # f32 [channels]
    relu6: bool = False  # as `Conv`'s


@dataclass
class MeanPool:
    """Mean over space of one or two tensors, dequantised to one float vector."""

    name: str
    sources: tuple[str, ...]
    output: str


@dataclass
class Dense:
    """Fully connected float layer."""

    name: str
    sources: tuple[str, ...]  # one vector or two, one after the other
    output: str
    weight: Array  # f32 [out][in]
    bias: Array  # f32 [out]
    relu: bool = False


@dataclass
class MixHead:
    """Last convolution: weights mixed by the class probabilities, then pixel shuffle and activation."""

    name: str
    sources: tuple[Source, ...]
    map: str  # "albedo", "normal" or "roughness"
    shuffle: int
    weight: Array  # f32 [classes][N * shuffle^2][kh][kw][cin_total], real units; 8 classes, or 1: nothing to mix
    bias: Array  # f32 [classes][N * shuffle^2]
    pad: Pad = (1, 1, 1, 1)


Layer = Conv | Depthwise | MeanPool | Dense | MixHead


@dataclass
class Graph:
    """Tensors by definition; layers in the order of execution. `input` is the first tensor's name."""

    tensors: list[Tensor]
    layers: list[Layer]
    input: str
    logits: str  # the classifier's output, a vector of 8

    def tensor(self, name: str) -> Tensor:
        """The tensor of that name."""
        for tensor in self.tensors:
            if tensor.name == name:
                return tensor
        raise ModelFileError(f"no tensor named {name!r}")


@dataclass(frozen=True)
class Defaults:
    """How the training renders were lit and seen: what a capture assumes unless told otherwise."""

    fov_deg: float = 43.35  # over the square crop
    light_distance: float = 1.0  # above the plane, in plane units
    light_strength: float = 1.0  # radiance of a flat white Lambertian at the centre
    exposure: float = 1.0  # scale from radiance to the network's linear input
    base_size: int = 128  # pixels a side of the training photos: larger ones are seen at this size first; 0: no limit
    top_size: int = 0  # of the largest training photos beside those; 0: none


@dataclass
class Model:
    """Everything in a model file."""

    meta: dict[str, Any]
    graph: Graph
    crf: Array = field(default_factory=lambda: np.zeros((8, CRF_COEFFICIENTS), np.float32))
    defaults: Defaults = field(default_factory=Defaults)
    card: str = ""


def _quantised(folded: Array, bias: Array) -> tuple[Array, Array, Array]:
    """Codes, f32 scales and i32 bias of f64 weights whose last axis is the output channel, symmetric per channel."""
    peak = np.abs(folded).max(axis=tuple(range(folded.ndim - 1)))
    weight_scale = (np.maximum(peak, 1e-12) / 127.0).astype(np.float32)
    wide = weight_scale.astype(np.float64)
    weight_q = np.clip(np.rint(folded / wide), -127, 127).astype(np.int8)
    bias_q = np.clip(np.rint(bias / wide), -(2**30), 2**30).astype(np.int32)
    return weight_q, weight_scale, bias_q


def conv_from_float(
    graph_tensors: dict[str, Tensor],
    name: str,
    sources: tuple[Source, ...],
    output: str,
    weight: Array,
    bias: Array,
    *,
    stride: int = 1,
    pad: Pad = (1, 1, 1, 1),
    relu: bool = True,
    relu6: bool = False,
) -> Conv:
    """Quantises float weights `[cout][kh][kw][cin]` symmetrically per output channel.

    Each source's activation scale is folded into its channels first: one scale per output channel is left.
    """
    weight = np.asarray(weight, np.float32)
    bias = np.asarray(bias, np.float32)
    scales = np.concatenate([np.full(graph_tensors[s.tensor].channels, graph_tensors[s.tensor].scale) for s in sources])
    folded = np.moveaxis(weight.astype(np.float64) * scales, 0, -1)
    weight_q, weight_scale, bias_q = _quantised(folded, bias)
    weight_q = np.ascontiguousarray(np.moveaxis(weight_q, -1, 0))
    return Conv(name, sources, output, weight_q, weight_scale, bias_q, stride, pad, relu, weight, bias, relu6)


def depthwise_from_float(
    graph_tensors: dict[str, Tensor],
    name: str,
    source: str,
    output: str,
    weight: Array,
    bias: Array,
    *,
    stride: int = 1,
    pad: Pad = (1, 1, 1, 1),
    relu: bool = True,
    relu6: bool = False,
) -> Depthwise:
    """Quantises float weights `[kh][kw][channels]` symmetrically per channel, the source's scale folded in first."""
    weight = np.asarray(weight, np.float32)
    bias = np.asarray(bias, np.float32)
    quantised = _quantised(weight.astype(np.float64) * graph_tensors[source].scale, bias)
    return Depthwise(name, source, output, *quantised, stride, pad, relu, weight, bias, relu6)
