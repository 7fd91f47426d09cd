"""A small random net in the model file's terms: every kind of layer, odd channel counts and zero points."""

from __future__ import annotations

import numpy as np

from flashmat_train.int8_reference import network_input, run_float
from flashmat_train.modelfile import (
    INPUT_SCALE,
    INPUT_ZERO_POINT,
    MAP_CHANNELS,
    Conv,
    Defaults,
    Dense,
    Depthwise,
    Graph,
    Layer,
    MeanPool,
    MixHead,
    Model,
    Source,
    Tensor,
    conv_from_float,
    depthwise_from_float,
)


class ToyBuilder:
    """Collects tensors and layers with random weights of a given seed."""

    def __init__(self, seed: int, ranges: dict[str, tuple[float, float]]) -> None:
        self.rng = np.random.default_rng(seed)
        self.ranges = ranges  # of each convolution's output; missing: (0, 2)
        self.tensors = {"input": Tensor("input", 6, 1, INPUT_SCALE, INPUT_ZERO_POINT)}
        self.layers: list[Layer] = []

    def image(self, name: str, channels: int, divisor: int) -> None:
        """Adds an image tensor with the scale and zero point of its range."""
        low, high = self.ranges.get(name, (0.0, 2.0))
        scale = float(np.float32((high - low) / 255))
        self.tensors[name] = Tensor(name, channels, divisor, scale, int(np.rint(-128 - low / scale)))

    def conv(
        self,
        name: str,
        sources: tuple[Source, ...],
        channels: int,
        kernel: tuple[int, int] = (3, 3),
        stride: int = 1,
        pad: tuple[int, int, int, int] = (1, 1, 1, 1),
        relu: bool = True,
    ) -> str:
        """Adds a convolution and its output tensor; returns the tensor's name."""
        read = [self.tensors[s.tensor] for s in sources]
        cin = sum(tensor.channels for tensor in read)
        divisor = read[0].divisor // (2 if sources[0].upsample else 1) * stride
        self.image(name, channels, divisor)
        weight = self.rng.normal(0, 1.6 / np.sqrt(cin * kernel[0] * kernel[1]), (channels, *kernel, cin))
        bias = self.rng.normal(0, 0.3, channels)
        self.layers.append(
            conv_from_float(self.tensors, name, sources, name, weight, bias, stride=stride, pad=pad, relu=relu)
        )
        return name

    def depthwise(
        self, name: str, source: str, kernel: tuple[int, int], stride: int, pad: tuple[int, int, int, int], relu: bool
    ) -> str:
        """Adds a depthwise convolution and its output tensor; returns the tensor's name."""
        channels = self.tensors[source].channels
        self.image(name, channels, self.tensors[source].divisor * stride)
        weight = self.rng.normal(0, 1.6 / np.sqrt(kernel[0] * kernel[1]), (*kernel, channels))
        bias = self.rng.normal(0, 0.3, channels)
        self.layers.append(
            depthwise_from_float(self.tensors, name, source, name, weight, bias, stride=stride, pad=pad, relu=relu)
        )
        return name

    def classifier(self, pools: tuple[tuple[str, ...], tuple[str, ...]], hidden: int) -> None:
        """Adds the means of one or two tensors, twice, and two dense layers, the second giving the logits."""
        channels = [sum(self.tensors[source].channels for source in sources) for sources in pools]
        for name, count in (("pool", channels[0]), ("pool2", channels[1]), ("hidden", hidden), ("logits", 8)):
            self.tensors[name] = Tensor(name, count, 0)
        for name, sources in zip(("pool", "pool2"), pools, strict=True):
            self.layers.append(MeanPool(name, sources, name))
        for name, read, fan_in, fan_out in (
            ("hidden", ("pool", "pool2"), sum(channels), hidden),
            ("logits", ("hidden",), hidden, 8),
        ):
            weight = self.rng.normal(0, 1.5 / np.sqrt(fan_in), (fan_out, fan_in)).astype(np.float32)
            bias = self.rng.normal(0, 0.2, fan_out).astype(np.float32)
            self.layers.append(Dense(name, read, name, weight, bias, name == "hidden"))

    def head(self, kind: str, sources: tuple[Source, ...], shuffle: int) -> None:
        """Adds the mixed head of one map."""
        cin = sum(self.tensors[s.tensor].channels for s in sources)
        cout = MAP_CHANNELS[kind] * shuffle**2
        weight = self.rng.normal(0, 1.5 / np.sqrt(9 * cin), (8, cout, 3, 3, cin)).astype(np.float32)
        bias = self.rng.normal(0, 0.3, (8, cout)).astype(np.float32)
        self.layers.append(MixHead(f"{kind}-head", sources, kind, shuffle, weight, bias))

    def model(self, name: str) -> Model:
        """The finished model."""
        crf = self.rng.uniform(0, 1, (8, 12)).astype(np.float32)
        graph = Graph(list(self.tensors.values()), self.layers, "input", "logits")
        return Model({"name": name}, graph, crf, Defaults(), f"# {name}\n\nRandom weights; of no use but in tests.\n")


def _build(seed: int, ranges: dict[str, tuple[float, float]]) -> Model:
    toy = ToyBuilder(seed, ranges)
    low = toy.conv("enc1", (Source("input"),), 6, (4, 4), 2)
    mid = toy.conv("enc2", (Source(low),), 13, (4, 4), 2)
    deep = toy.conv("enc3", (Source(mid),), 34, (3, 3), 2, (0, 0, 1, 1), relu=False)
    wide = toy.depthwise("wide", mid, (5, 3), 2, (1, 1, 2, 0), relu=True)
    deep = toy.conv("enc4", (Source(deep), Source(wide)), 18, (1, 1), 1, (0, 0, 0, 0))
    toy.classifier(((deep, mid), (low,)), 24)
    detail = Source(toy.conv("detail", (Source("input"),), 5, (2, 2), 2, (0, 0, 0, 0)))
    for kind, width in (("albedo", 7), ("normal", 6), ("roughness", 5)):
        up = toy.conv(f"{kind}1", (Source(deep, True), Source(mid)), width + 7)
        up = toy.conv(f"{kind}2", (Source(up, True), Source(low)), width)
        toy.head(kind, (Source(up),) if kind == "roughness" else (Source(up), detail), 2)
    return toy.model("toy")


def smooth_photo(size: int = 128, seed: int = 5) -> np.ndarray:
    """Smooth random planar linear RGB."""
    rng = np.random.default_rng(seed)
    coarse = rng.uniform(0, 1, (3, 9, 9))
    at = np.linspace(0, 8, size)
    rows = np.stack([[np.interp(at, range(9), line) for line in plane] for plane in coarse])
    full = np.stack([[np.interp(at, range(9), column) for column in plane.T] for plane in rows])
    return (full.transpose(0, 2, 1) ** 2).astype(np.float32)


def toy_model(seed: int = 7) -> Model:
    """Three levels deep; concatenation, also in two heads, up-sampling, asymmetric padding, 1x1, depthwise, and not
    every layer with ReLU.

    The activations' scales are measured on `smooth_photo` with the float weights, as the exporter does it.
    """
    draft = _build(seed, {})
    result = run_float(draft.graph, network_input(smooth_photo()))
    ranges = {
        layer.output: (min(0.0, float(out.min())), float(out.max()))
        for layer in draft.graph.layers
        if isinstance(layer, Conv | Depthwise)
        for out in [result.tensors[layer.output]]
    }
    return _build(seed, ranges)
