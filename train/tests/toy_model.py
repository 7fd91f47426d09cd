"""A small random net in the model file's terms: every kind of layer, odd channel counts and zero points."""

from __future__ import annotations

import numpy as np

from flashmat_train.modelfile import (
    INPUT_SCALE,
    INPUT_ZERO_POINT,
    MAP_CHANNELS,
    Defaults,
    Dense,
    Graph,
    Layer,
    MeanPool,
    MixHead,
    Model,
    Source,
    Tensor,
    conv_from_float,
)


class ToyBuilder:
    """Collects tensors and layers with random weights of a given seed."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        self.tensors = {"input": Tensor("input", 5, 1, INPUT_SCALE, INPUT_ZERO_POINT)}
        self.layers: list[Layer] = []

    def conv(
        self,
        name: str,
        sources: tuple[Source, ...],
        channels: int,
        kernel: tuple[int, int] = (3, 3),
        stride: int = 1,
        pad: tuple[int, int, int, int] = (1, 1, 1, 1),
        relu: bool = True,
        zero_point: int = -128,
    ) -> str:
        """Adds a convolution and its output tensor; returns the tensor's name."""
        read = [self.tensors[s.tensor] for s in sources]
        cin = sum(tensor.channels for tensor in read)
        divisor = read[0].divisor // (2 if sources[0].upsample else 1) * stride
        scale = float(np.float32(self.rng.uniform(0.008, 0.016)))
        self.tensors[name] = Tensor(name, channels, divisor, scale, zero_point)
        weight = self.rng.normal(0, 1.6 / np.sqrt(cin * kernel[0] * kernel[1]), (channels, *kernel, cin))
        bias = self.rng.normal(0, 0.3, channels)
        self.layers.append(
            conv_from_float(
                self.tensors, name, sources, name, weight, bias, stride=stride, pad=pad, relu=relu
            )
        )
        return name

    def classifier(self, source: str, hidden: int) -> None:
        """Adds mean pool and two dense layers, the second giving the logits."""
        channels = self.tensors[source].channels
        for name, count in (("pool", channels), ("hidden", hidden), ("logits", 8)):
            self.tensors[name] = Tensor(name, count, 0)
        self.layers.append(MeanPool("pool", source, "pool"))
        for name, read, fan_in, fan_out in (
            ("hidden", "pool", channels, hidden),
            ("logits", "hidden", hidden, 8),
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
        return Model(
            {"name": name}, graph, crf, Defaults(), f"# {name}\n\nRandom weights; of no use but in tests.\n"
        )


def toy_model(seed: int = 7) -> Model:
    """Three levels deep; concatenation, up-sampling, asymmetric padding, 1x1, a layer without ReLU."""
    toy = ToyBuilder(seed)
    low = toy.conv("enc1", (Source("input"),), 12, (4, 4), 2)
    mid = toy.conv("enc2", (Source(low),), 21, (4, 4), 2)
    deep = toy.conv("enc3", (Source(mid),), 34, (3, 3), 2, (0, 0, 1, 1), relu=False, zero_point=11)
    deep = toy.conv("enc4", (Source(deep),), 18, (1, 1), 1, (0, 0, 0, 0), zero_point=-128)
    toy.classifier(deep, 24)
    for kind, width in (("albedo", 17), ("normal", 16), ("roughness", 9)):
        up = toy.conv(f"{kind}1", (Source(deep, True), Source(mid)), width + 3)
        up = toy.conv(f"{kind}2", (Source(up, True), Source(low)), width)
        toy.head(kind, (Source(up),), 2)
    return toy.model("toy")
