"""A Flashmat model file as ONNX graphs for peers: node by node what the file's own graph says, with its own weights.

Nothing here knows which network it is: every layer of the file becomes the nodes that compute it, so a network of
another shape needs no other writer (a layer of another kind is an error). The heads are mixed beforehand with the
probabilities given, as the int8 engine mixes them at run time, so that peers have plain convolutions with constant
weights throughout and can quantise every one of them. A residual that the file folded into a 1x1 convolution (its
second source is read with the identity) becomes an addition again, which is what peers are fast at.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from flashmat_train import export_onnx, modelfile
from flashmat_train.int8_reference import NORMAL_Z_EPSILON, mix

#: What a weight of the identity may be off after its quantisation to int8.
ROUNDING = 0.02
MAPS = {"albedo": 3, "normal": 3, "roughness": 1}
#: Peers quantise all that moves pixels; pooling and dense layers stay in float, as in our engine.
QUANTISED = ["Conv", "Relu", "Clip", "Add", "Concat", "Resize"]


def real_weights(layer: modelfile.Conv | modelfile.Depthwise, graph: modelfile.Graph) -> tuple[np.ndarray, np.ndarray]:
    """Float weights in the file's layout and bias: the file's own, or what its int8 ones stand for."""
    if layer.weight is not None and layer.bias is not None:
        return layer.weight, layer.bias
    scale = layer.weight_scale.astype(np.float64)
    if isinstance(layer, modelfile.Depthwise):
        weight = layer.weight_q * scale / graph.tensor(layer.source).scale
    else:
        tensors = [graph.tensor(s.tensor) for s in layer.sources]
        scales = np.concatenate([np.full(t.channels, t.scale, np.float64) for t in tensors])
        weight = layer.weight_q * scale[:, None, None, None] / scales
    return weight.astype(np.float32), (layer.bias_q * scale).astype(np.float32)


class Writer:
    """Writes layers as nodes; tensors keep the file's names."""

    def __init__(self, model: modelfile.Model, probabilities: np.ndarray) -> None:
        self.graph, self.probabilities = model.graph, probabilities
        self.out = export_onnx.Builder()
        self.scales = self.out.constant("upsample.scales", np.array([1, 1, 2, 2], np.float32))

    def joined(self, name: str, sources: tuple[modelfile.Source, ...]) -> str:
        """The sources side by side, up-sampled as asked."""
        parts = []
        for i, source in enumerate(sources):
            part = source.tensor
            if source.upsample:
                how = {"nearest_mode": "floor", "coordinate_transformation_mode": "asymmetric"}
                part = self.out.add("Resize", [part, "", self.scales], f"{name}.up{i}", mode="nearest", **how)
            parts.append(part)
        return parts[0] if len(parts) == 1 else self.out.add("Concat", parts, f"{name}.cat", axis=1)

    def convolution(
        self, name: str, source: str, weight: np.ndarray, bias: np.ndarray, pad: modelfile.Pad, **how: Any
    ) -> str:
        """`weight` as ONNX has it: [cout][cin][kh][kw]."""
        inputs = [source, self.out.constant(f"{name}.weight", weight.astype(np.float32))]
        inputs.append(self.out.constant(f"{name}.bias", bias.astype(np.float32)))
        return self.out.add("Conv", inputs, f"{name}.conv", kernel_shape=weight.shape[2:], pads=pad, **how)

    def activated(self, source: str, layer: modelfile.Conv | modelfile.Depthwise) -> None:
        if layer.relu6:
            ends = [self.out.constant(f"{layer.name}.{e}", np.float32(x)) for e, x in (("low", 0), ("high", 6))]
            self.out.add("Clip", [source, *ends], layer.output)
        else:
            self.out.add("Relu" if layer.relu else "Identity", [source], layer.output)

    def conv(self, layer: modelfile.Conv) -> None:
        weight, bias = real_weights(layer, self.graph)
        name, sources = layer.name, layer.sources
        residual = residual_of(layer, weight, self.graph)
        if residual:
            sources, weight = sources[:1], weight[..., : self.graph.tensor(sources[0].tensor).channels]
        source = self.joined(name, sources)
        stride = [layer.stride, layer.stride]
        y = self.convolution(name, source, weight.transpose(0, 3, 1, 2), bias, layer.pad, strides=stride)
        if residual:
            y = self.out.add("Add", [y, residual], f"{name}.sum")
        self.activated(y, layer)

    def depthwise(self, layer: modelfile.Depthwise) -> None:
        weight, bias = real_weights(layer, self.graph)
        stride, group = [layer.stride, layer.stride], weight.shape[2]
        weight = weight.transpose(2, 0, 1)[:, None]
        y = self.convolution(layer.name, layer.source, weight, bias, layer.pad, strides=stride, group=group)
        self.activated(y, layer)

    def pool(self, layer: modelfile.MeanPool) -> None:
        means = []
        for i, source in enumerate(layer.sources):
            mean = self.out.add("GlobalAveragePool", [source], f"{layer.name}.mean{i}")
            means.append(self.out.add("Flatten", [mean], f"{layer.name}.flat{i}"))
        self.out.add("Concat", means, layer.output, axis=1)

    def dense(self, layer: modelfile.Dense) -> None:
        name, sources = layer.name, list(layer.sources)
        source = sources[0] if len(sources) == 1 else self.out.add("Concat", sources, f"{name}.cat", axis=1)
        inputs = [source, self.out.constant(f"{name}.weight", layer.weight)]
        inputs.append(self.out.constant(f"{name}.bias", layer.bias))
        y = self.out.add("Gemm", inputs, f"{name}.sum", transB=1)
        self.out.add("Relu" if layer.relu else "Identity", [y], layer.output)
        if layer.output == self.graph.logits:
            self.out.add("Softmax", [layer.output], "probabilities", axis=1)

    def head(self, layer: modelfile.MixHead) -> None:
        name, add = layer.map, self.out.add
        weight, bias = (mix(self.probabilities.astype(np.float32), sets) for sets in (layer.weight, layer.bias))
        source = self.joined(f"{name}.head", layer.sources)
        y = self.convolution(f"{name}.head", source, weight.transpose(0, 3, 1, 2), bias, layer.pad)
        y = add("DepthToSpace", [y], f"{name}.raw", blocksize=layer.shuffle, mode="CRD")
        if name != "normal":
            add("Sigmoid", [y], name)
            return
        split = self.out.constant("normal.split", np.array([2, 1], np.int64))
        parts = ["normal.xy", "normal.z"]
        self.out.nodes.append(self.out.helper.make_node("Split", [y, split], parts, name="normal.parts", axis=1))
        floor = self.out.constant("normal.floor", np.float32(NORMAL_Z_EPSILON))
        z = add("Add", [add("Sigmoid", ["normal.z"], "normal.up"), floor], "normal.zplus")
        v = add("Concat", [add("Tanh", ["normal.xy"], "normal.side"), z], "normal.vector", axis=1)
        axes = self.out.constant("normal.axes", np.array([1], np.int64))
        add("Div", [v, add("ReduceL2", [v, axes], "normal.length", keepdims=1)], "normal")

    def model(self) -> Any:
        write = {
            modelfile.Conv: self.conv,
            modelfile.Depthwise: self.depthwise,
            modelfile.MeanPool: self.pool,
            modelfile.Dense: self.dense,
            modelfile.MixHead: self.head,
        }
        for layer in self.graph.layers:
            write[type(layer)](layer)
        h = self.out.helper

        def real(name: str, dims: list[Any]) -> Any:
            return h.make_tensor_value_info(name, 1, dims)

        outputs = [real(name, [1, planes, "height", "width"]) for name, planes in MAPS.items()]
        outputs.append(real("probabilities", [1, len(self.probabilities)]))
        inputs = [real(self.graph.input, [1, modelfile.INPUT_CHANNELS, "height", "width"])]
        weights = list(self.out.initialisers.values())
        graph = h.make_graph(self.out.nodes, "flashmat", inputs, outputs, weights)
        model = h.make_model(graph, opset_imports=[h.make_opsetid("", export_onnx.OPSET)])
        model.ir_version = 10
        return model


def residual_of(layer: modelfile.Conv, weight: np.ndarray, graph: modelfile.Graph) -> str | None:
    """The second source, where a 1x1 convolution only adds it to what it makes of the first."""
    if len(layer.sources) != 2 or weight.shape[1:3] != (1, 1) or any(s.upsample for s in layer.sources):
        return None
    second = weight[:, 0, 0, graph.tensor(layer.sources[0].tensor).channels :]
    if second.shape[0] != second.shape[1] or np.abs(second - np.eye(len(second))).max() > ROUNDING:
        return None
    return layer.sources[1].tensor


def build(model: modelfile.Model, probabilities: np.ndarray) -> Any:
    """The float ONNX model of a file, its heads mixed with `probabilities` (one per class)."""
    return Writer(model, probabilities).model()


def write(
    model: modelfile.Model, probabilities: np.ndarray, photos: list[np.ndarray], folder: Path
) -> tuple[Path, Path]:
    """Writes plain.onnx (float) and int8.onnx (QDQ, per-channel s8 weights, u8 activations, calibrated on `photos`)."""
    import onnx
    from onnxruntime.quantization import CalibrationDataReader, QuantFormat, QuantType, quantize_static
    from onnxruntime.quantization.shape_inference import quant_pre_process

    class Reader(CalibrationDataReader):
        def __init__(self) -> None:
            self.left = iter(photos)

        def get_next(self) -> dict[str, np.ndarray] | None:
            photo = next(self.left, None)
            return None if photo is None else {"input": photo}

    plain, ready, int8 = (folder / name for name in ("plain.onnx", "float.onnx", "int8.onnx"))
    onnx.save(build(model, probabilities), plain)
    quant_pre_process(str(plain), str(ready), skip_symbolic_shape=True)
    quantize_static(
        str(ready),
        str(int8),
        Reader(),
        quant_format=QuantFormat.QDQ,
        per_channel=True,
        activation_type=QuantType.QUInt8,
        weight_type=QuantType.QInt8,
        op_types_to_quantize=QUANTISED,
    )
    return plain, int8
