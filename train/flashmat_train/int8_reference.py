"""Reference executors of a model file's graph, in plain numpy: the oracles of the Rust engines.

`run_int8` does the integer arithmetic of `docs/model-format.md` in its textbook form: subtract the zero
point, pad with zeros, sum products in 64 bits. The Rust kernels do it in another form; their tensors must be
equal to these, bit for bit. `run_float` evaluates the float weights in double precision. Slow: for size 128.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from .modelfile import (
    INPUT_ZERO_POINT,
    MAP_CHANNELS,
    Array,
    Conv,
    Dense,
    Depthwise,
    Graph,
    MeanPool,
    MixHead,
    ModelFileError,
    Source,
)

NORMAL_Z_EPSILON = 1e-2
F32 = np.float32


@dataclass
class Result:
    """`tensors`: every tensor of the graph by name, images as [h][w][c], vectors as [c].

    `logits`: each head's [N][n][n] before the activation; `maps`: after it.
    `probabilities`: what mixed the heads.
    """

    tensors: dict[str, Array] = field(default_factory=dict)
    logits: dict[str, Array] = field(default_factory=dict)
    maps: dict[str, Array] = field(default_factory=dict)
    probabilities: Array = field(default_factory=lambda: np.full(8, 0.125, F32))


def srgb_encode(linear: Array) -> Array:
    """The sRGB transfer function, linear [0,1] to encoded [0,1]."""
    return np.where(linear <= 0.0031308, linear * 12.92, 1.055 * np.maximum(linear, 1e-12) ** (1 / 2.4) - 0.055)


def network_input(linear_rgb: Array, light_scale: float | None = None, fov_deg: float = 43.35) -> Array:
    """f64 [n][n][6] from planar linear RGB [3][n][n]: encoded R, G, B, then (x / 0.75 + 1) / 2 and (y / 0.75 + 1) / 2,
    in [0,1], of the pixel's point of the plane, y up, then 1 if the light's scale is known, which RGB is then divided
    by, else 0."""
    size = linear_rgb.shape[1]
    centres = (2.0 * np.arange(size) + 1.0) / size - 1.0
    reach = np.tan(np.deg2rad(fov_deg) / 2) / 0.75
    px, py = np.clip(np.meshgrid(centres * reach, -centres * reach), -1, 1)
    if light_scale is not None:
        linear_rgb = linear_rgb.astype(F32) * (F32(1.0) / F32(light_scale))
    rgb = srgb_encode(np.clip(linear_rgb.astype(np.float64), 0.0, 1.0))
    return np.stack([*rgb, (px + 1) / 2, (py + 1) / 2, np.full_like(px, light_scale is not None)], axis=-1)


def quantise_input(image: Array) -> Array:
    """The int8 input tensor: round half to even of 255 x, less 128."""
    return (np.rint(image * 255.0) + INPUT_ZERO_POINT).astype(np.int8)


def requantise(acc: Array, multiplier: Array, zero_point: int, relu: bool) -> Array:
    """The one rule: single-precision product, rounded half to even, plus zero point, clamped."""
    low = zero_point if relu else -128
    with np.errstate(over="ignore"):
        scaled = np.rint(acc.astype(F32) * multiplier.astype(F32))
    return np.clip(scaled.astype(np.float64) + zero_point, low, 127).astype(np.int8)


def correlate(image: Array, weight: Array, stride: int, pad: tuple[int, int, int, int]) -> Array:
    """[h][w][cin] with [cout][kh][kw][cin], padded with zeros (top, left, bottom, right): [ho][wo][cout]."""
    top, left, bottom, right = pad
    padded = np.pad(image, ((top, bottom), (left, right), (0, 0)))
    kh, kw = weight.shape[1:3]
    windows = np.lib.stride_tricks.sliding_window_view(padded, (kh, kw), axis=(0, 1))[::stride, ::stride]
    ho, wo = windows.shape[:2]
    columns = windows.transpose(0, 1, 3, 4, 2).reshape(ho * wo, -1)
    return (columns @ weight.reshape(weight.shape[0], -1).T).reshape(ho, wo, -1)


def correlate_depthwise(image: Array, weight: Array, stride: int, pad: tuple[int, int, int, int]) -> Array:
    """[h][w][channels] with [kh][kw][channels], padded with zeros (top, left, bottom, right): [ho][wo][channels]."""
    top, left, bottom, right = pad
    padded = np.pad(image, ((top, bottom), (left, right), (0, 0)))
    windows = np.lib.stride_tricks.sliding_window_view(padded, weight.shape[:2], axis=(0, 1))[::stride, ::stride]
    return np.einsum("yxcij,ijc->yxc", windows, weight)


def pixel_shuffle(image: Array, factor: int) -> Array:
    """[h][w][N r r] to planes [N][h r][w r], in PyTorch's order."""
    h, w, channels = image.shape
    count = channels // factor**2
    split = image.reshape(h, w, count, factor, factor)
    return split.transpose(2, 0, 3, 1, 4).reshape(count, h * factor, w * factor)


def activate(kind: str, logits: Array) -> Array:
    """A head's non-linearity, in double precision."""
    logits = logits.astype(np.float64)
    if kind != "normal":
        return 1.0 / (1.0 + np.exp(-logits))
    v = np.stack([np.tanh(logits[0]), np.tanh(logits[1]), 1.0 / (1.0 + np.exp(-logits[2])) + NORMAL_Z_EPSILON])
    return v / np.sqrt((v * v).sum(axis=0))


def softmax(logits: Array) -> Array:
    """In double precision, rounded to single at the end."""
    e = np.exp(logits.astype(np.float64) - logits.max())
    return (e / e.sum()).astype(F32)


def mix(probabilities: Array, sets: Array) -> Array:
    """sum_k P_k W_k in single precision, in the order of the classes; a lone set is taken as it is."""
    if len(sets) == 1:
        return sets[0].astype(F32)
    total = probabilities[0] * sets[0]
    for p, w in zip(probabilities[1:], sets[1:], strict=True):
        total = total + p * w
    return total.astype(F32)


def _dense(layer: Dense, tensors: dict[str, Array], dtype: type) -> Array:
    """Products are added one input after the other, starting from the bias."""
    x = np.concatenate([tensors[source] for source in layer.sources])
    total = layer.bias.astype(dtype)
    for i in range(len(x)):
        total = total + layer.weight[:, i].astype(dtype) * x[i]
    return np.maximum(total, dtype(0)) if layer.relu else total


def _join(graph: Graph, sources: tuple[Source, ...], read: Callable[[str], Array]) -> Array:
    """The sources side by side, up-sampled as asked."""
    parts = []
    for source in sources:
        part = read(source.tensor)
        parts.append(part.repeat(2, axis=0).repeat(2, axis=1) if source.upsample else part)
    return np.concatenate(parts, axis=-1)


def _head_int8(graph: Graph, layer: MixHead, centred: Array, probabilities: Array) -> Array:
    """Mixes, folds the source scales in, quantises per output channel and runs; real logits [h][w][cout]."""
    weight, bias = mix(probabilities, layer.weight), mix(probabilities, layer.bias)
    tensors = [graph.tensor(s.tensor) for s in layer.sources]
    scales = np.concatenate([np.full(t.channels, t.scale, F32) for t in tensors])
    folded = weight * scales
    peak = np.abs(folded).max(axis=(1, 2, 3))
    weight_scale = np.where(peak > 0, peak / F32(127), F32(1)).astype(F32)
    weight_q = np.clip(np.rint(folded / weight_scale[:, None, None, None]), -127, 127).astype(np.int64)
    acc = correlate(centred, weight_q, 1, layer.pad)
    return acc.astype(F32) * weight_scale + bias


def run_int8(graph: Graph, input_q: Array, override: int | None = None) -> Result:
    """Runs the int8 graph on an input tensor i8 [n][n][5]; `override`: the class to mix the heads for."""
    result = Result(tensors={graph.input: input_q})

    def centred(name: str) -> Array:
        return result.tensors[name].astype(np.int64) - graph.tensor(name).zero_point

    for layer in graph.layers:
        if isinstance(layer, Conv | Depthwise):
            out, weight = graph.tensor(layer.output), layer.weight_q.astype(np.int64)
            if isinstance(layer, Conv):
                acc = correlate(_join(graph, layer.sources, centred), weight, layer.stride, layer.pad)
            else:
                acc = correlate_depthwise(centred(layer.source), weight, layer.stride, layer.pad)
            acc = acc + layer.bias_q
            if np.abs(acc).max() >= 2**31:
                raise ModelFileError(f"{layer.name}: accumulator beyond 32 bits")
            multiplier = layer.weight_scale.astype(F32) / F32(out.scale)
            result.tensors[layer.output] = requantise(acc, multiplier, out.zero_point, layer.relu)
        elif isinstance(layer, MeanPool):
            means = []
            for source in layer.sources:
                image = centred(source)
                mean = image.sum(axis=(0, 1)).astype(F32) / F32(image.shape[0] * image.shape[1])
                means.append(mean * F32(graph.tensor(source).scale))
            result.tensors[layer.output] = np.concatenate(means)
        elif isinstance(layer, Dense):
            result.tensors[layer.output] = _dense(layer, result.tensors, F32)
            _set_probabilities(graph, result, layer.output, override)
        else:
            image = _join(graph, layer.sources, centred)
            _finish_head(result, layer, _head_int8(graph, layer, image, result.probabilities))
    return result


def run_float(graph: Graph, image: Array, override: int | None = None) -> Result:
    """Runs the float weights on a real-valued input [n][n][6], in double precision."""
    result = Result(tensors={graph.input: image.astype(np.float64)})
    for layer in graph.layers:
        if isinstance(layer, Conv | Depthwise):
            if layer.weight is None or layer.bias is None:
                raise ModelFileError("the model has no float weights")
            weight = layer.weight.astype(np.float64)
            if isinstance(layer, Conv):
                joined = _join(graph, layer.sources, result.tensors.__getitem__)
                out = correlate(joined, weight, layer.stride, layer.pad) + layer.bias
            else:
                read = result.tensors[layer.source]
                out = correlate_depthwise(read, weight, layer.stride, layer.pad) + layer.bias
            out = np.maximum(out, 0.0) if layer.relu else out
            result.tensors[layer.output] = np.minimum(out, 6.0) if layer.relu6 else out
        elif isinstance(layer, MeanPool):
            result.tensors[layer.output] = np.concatenate([result.tensors[s].mean(axis=(0, 1)) for s in layer.sources])
        elif isinstance(layer, Dense):
            result.tensors[layer.output] = _dense(layer, result.tensors, np.float64)
            _set_probabilities(graph, result, layer.output, override)
        else:
            joined = _join(graph, layer.sources, result.tensors.__getitem__)
            weight = mix(result.probabilities, layer.weight).astype(np.float64)
            out = correlate(joined, weight, 1, layer.pad) + mix(result.probabilities, layer.bias)
            _finish_head(result, layer, out)
    return result


def _set_probabilities(graph: Graph, result: Result, output: str, override: int | None) -> None:
    if output == graph.logits:
        logits = result.tensors[output]
        result.probabilities = softmax(logits) if override is None else np.eye(8, dtype=F32)[override]


def _finish_head(result: Result, layer: MixHead, logits: Array) -> None:
    planes = pixel_shuffle(logits, layer.shuffle)
    assert planes.shape[0] == MAP_CHANNELS[layer.map]
    result.logits[layer.map] = planes
    result.maps[layer.map] = activate(layer.map, planes)
