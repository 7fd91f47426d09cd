"""The network as ONNX, for peers: batch norm folded, the heads mixed by the classifier inside the graph.

`python -m flashmat_train export-onnx --checkpoint RUN/last.pt --out phone.onnx [--int8 phone.int8.onnx --data DIR]`

Input `input` (1,6,h,w): sRGB-encoded R, G, B, then the coordinates (`model.network_input`), then 1 where the
light's scale is known; h and w multiples of 128. Outputs
`albedo` (1,3,h,w), `normal` (1,3,h,w) unit, `roughness` (1,1,h,w), `probabilities` (1,8).
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn

from . import CLASSES, checkpoint
from .export import calibration_photos, fold
from .model import HEADS, INPUT_CHANNELS, Z_EPS, ConvBlock, Network, NetworkConfig
from .trunk import FoldedConv, Trunk

OPSET = 21


def add_arguments(p: argparse.ArgumentParser) -> None:
    p.add_argument("--checkpoint", type=Path, required=True)
    p.add_argument("--out", type=Path, required=True)
    p.add_argument("--int8", type=Path, help="also write a quantised graph (QDQ) here; needs data to calibrate with")
    p.add_argument("--data", help="data folder for calibration (default: FLASHMAT_DATA)")
    p.add_argument("--photos", type=int, default=32, help="photos to calibrate with")
    p.add_argument("--size", type=int, default=256)


class Builder:
    """Collects nodes and initialisers."""

    def __init__(self) -> None:
        from onnx import helper, numpy_helper

        self.helper, self.numpy_helper = helper, numpy_helper
        self.nodes: list[Any] = []
        self.initialisers: dict[str, Any] = {}

    def constant(self, name: str, value: np.ndarray) -> str:
        self.initialisers[name] = self.numpy_helper.from_array(np.ascontiguousarray(value), name)
        return name

    def add(self, op: str, inputs: list[str], name: str, **attributes: Any) -> str:
        self.nodes.append(self.helper.make_node(op, inputs, [name], name=name, **attributes))
        return name

    def conv(self, name: str, source: str, block: ConvBlock) -> str:
        """A folded convolution and its ReLU."""
        w, b = (t.detach().numpy() for t in fold(block))
        k, p, s = w.shape[2:], block.conv.padding[0], block.conv.stride[0]
        inputs = [source, self.constant(f"{name}.weight", w), self.constant(f"{name}.bias", b)]
        y = self.add("Conv", inputs, f"{name}.conv", kernel_shape=list(k), pads=[p] * 4, strides=[s, s])
        return self.add("Relu", [y], name)

    def folded(self, name: str, source: str, layer: FoldedConv) -> str:
        """A convolution of the trunk, with its ReLU6 if it has one."""
        conv, (before, after) = layer.conv, layer.pad
        w, v = conv.weight.detach().numpy(), conv.bias.detach().numpy()
        inputs = [source, self.constant(f"{name}.weight", w), self.constant(f"{name}.bias", v)]
        how = {"pads": [before, before, after, after], "strides": list(conv.stride), "group": conv.groups}
        y = self.add("Conv", inputs, f"{name}.conv", kernel_shape=list(w.shape[2:]), **how)
        ends = [self.constant(f"{name}.{end}", np.array(x, np.float32)) for end, x in (("low", 0), ("high", 6))]
        return self.add("Clip", [y, *ends], name) if layer.relu else y

    def trunk(self, trunk: Trunk) -> list[str]:
        """The trunk; the tensors whose means the classifier reads."""
        x, read = self.folded("trunk.stem", "input", trunk.stem), []
        for i, block in enumerate(trunk.blocks):
            y = x if block.expand is None else self.folded(f"trunk{i}.expand", x, block.expand)
            y = self.folded(f"trunk{i}.spatial", y, block.spatial)
            if i in trunk.reads:
                read.append(y)
            if block.project is not None:
                y = self.folded(f"trunk{i}.project", y, block.project)
                x = self.add("Add", [x, y], f"trunk{i}.sum") if block.residual else y
        return read

    def dense(self, name: str, source: str, layer: nn.Linear) -> str:
        w, b = layer.weight.detach().numpy(), layer.bias.detach().numpy()
        inputs = [source, self.constant(f"{name}.weight", w), self.constant(f"{name}.bias", b)]
        return self.add("Gemm", inputs, name, transB=1)


def build(network: Network) -> Any:
    """The ONNX model of a trained network."""
    b, shape = Builder(), Builder.constant
    h = b.helper
    features, x = [], "input"
    for i, block in enumerate(network.encoder):
        x = b.conv(f"enc{i}", x, block)
        features.append(x)
    if network.trunk is None:
        read = [x, *(features[stage] for stage in network.config.texture)]
    else:
        read = b.trunk(network.trunk)
    means = [
        b.add("Flatten", [b.add("GlobalAveragePool", [y], f"pooled{i}")], f"pooled{i}.flat") for i, y in enumerate(read)
    ]
    flat = b.add("Concat", means, "pooled", axis=1)
    hidden = b.add("Relu", [b.dense("hidden.sum", flat, network.classifier[0])], "hidden")
    b.add("Softmax", [b.dense("logits", hidden, network.classifier[2])], "probabilities", axis=1)
    detail = b.conv("detail", "input", network.detail) if network.detail is not None else None
    scales = shape(b, "upsample.scales", np.array([1, 1, 2, 2], np.float32))
    raw = {}
    for name, maps in HEADS.items():
        decoder, y = network.decoders[name], features[-1]
        for i, (block, skip) in enumerate(zip(decoder.blocks, features[-2::-1], strict=True)):
            up = b.add(
                "Resize",
                [y, "", scales],
                f"{name}.up{i}",
                mode="nearest",
                nearest_mode="floor",
                coordinate_transformation_mode="asymmetric",
            )
            y = b.conv(f"{name}.dec{i}", b.add("Concat", [up, skip], f"{name}.cat{i}", axis=1), block)
        if detail is not None:
            y = b.add("Concat", [y, detail], f"{name}.cat", axis=1)
        weight, bias = decoder.head.conv.weight.detach().numpy(), decoder.head.conv.bias.detach().numpy()
        k, c = decoder.head.classes, maps * 4
        if k == 1:
            w, v = shape(b, f"{name}.head.weight", weight), shape(b, f"{name}.head.bias", bias)
        else:
            sets = shape(b, f"{name}.head.weights", weight.reshape(k, -1))
            biases = shape(b, f"{name}.head.biases", bias.reshape(k, c))
            form = shape(b, f"{name}.head.shape", np.array([c, *weight.shape[1:]], np.int64))
            line = shape(b, f"{name}.head.line", np.array([c], np.int64))
            mixed = b.add("MatMul", ["probabilities", sets], f"{name}.head.mixed")
            w = b.add("Reshape", [mixed, form], f"{name}.head.weight")
            v = b.add("Reshape", [b.add("MatMul", ["probabilities", biases], f"{name}.head.sum"), line], f"{name}.bias")
        y = b.add("Conv", [y, w, v], f"{name}.head", kernel_shape=[3, 3], pads=[1] * 4)
        raw[name] = b.add("DepthToSpace", [y], f"{name}.raw", blocksize=2, mode="CRD")
    b.add("Sigmoid", [raw["albedo"]], "albedo")
    b.add("Sigmoid", [raw["roughness"]], "roughness")
    split = shape(b, "normal.split", np.array([2, 1], np.int64))
    b.nodes.append(h.make_node("Split", [raw["normal"], split], ["normal.xy", "normal.z"], name="normal.parts", axis=1))
    eps = shape(b, "normal.eps", np.array(Z_EPS, np.float32))
    z = b.add("Add", [b.add("Sigmoid", ["normal.z"], "normal.up"), eps], "normal.zplus")
    v = b.add("Concat", [b.add("Tanh", ["normal.xy"], "normal.side"), z], "normal.vector", axis=1)
    axes = shape(b, "normal.axes", np.array([1], np.int64))
    b.add("Div", [v, b.add("ReduceL2", [v, axes], "normal.length", keepdims=1)], "normal")
    real = lambda name, dims: h.make_tensor_value_info(name, 1, dims)  # noqa: E731
    outputs = [real(n, [1, m, "height", "width"]) for n, m in HEADS.items()]
    graph = h.make_graph(
        b.nodes,
        "flashmat",
        [real("input", [1, INPUT_CHANNELS, "height", "width"])],
        [*outputs, real("probabilities", [1, len(CLASSES)])],
        list(b.initialisers.values()),
    )
    model = h.make_model(graph, opset_imports=[h.make_opsetid("", OPSET)], producer_name="flashmat_train")
    model.ir_version = 10
    h.set_model_props(model, {"classes": ",".join(CLASSES), "preset": network.config.name})
    return model


@torch.no_grad()
def difference(path: Path, network: Network, photo: torch.Tensor) -> dict[str, float]:
    """Largest difference of each output between ONNX Runtime and PyTorch (means for a quantised graph are smaller)."""
    import onnxruntime

    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    names = [o.name for o in session.get_outputs()]
    got = dict(zip(names, session.run(None, {"input": photo.numpy()}), strict=True))
    want = network.eval()(photo)
    want["probabilities"] = want.pop("class_logits").softmax(dim=1)
    return {k: float(np.abs(got[k] - want[k].numpy()).max()) for k in names}


def quantise(path: Path, out: Path, photos: list[torch.Tensor]) -> None:
    """A QDQ graph with int8 activations and per-channel int8 weights. Heads, which are mixed in the graph, stay in
    float."""
    from onnxruntime.quantization import CalibrationDataReader, QuantFormat, QuantType, quantize_static

    class Reader(CalibrationDataReader):
        def __init__(self) -> None:
            self.left = iter(photos)

        def get_next(self) -> dict[str, np.ndarray] | None:
            photo = next(self.left, None)
            return None if photo is None else {"input": photo.numpy()}

    quantize_static(
        str(path),
        str(out),
        Reader(),
        quant_format=QuantFormat.QDQ,
        per_channel=True,
        activation_type=QuantType.QUInt8,
        weight_type=QuantType.QInt8,
        op_types_to_quantize=["Conv", "Relu", "Concat", "Resize"],
        nodes_to_exclude=[f"{name}.head" for name in HEADS],
    )


def run(args: argparse.Namespace) -> None:
    import onnx

    state = checkpoint.load(args.checkpoint)
    network = Network(NetworkConfig.fromdict(state["config"]))
    network.load_state_dict(state["ema"])
    network.eval()
    model = build(network)
    onnx.checker.check_model(model, full_check=True)
    args.out.parent.mkdir(parents=True, exist_ok=True)
    onnx.save(model, args.out)
    photo = torch.rand(1, INPUT_CHANNELS, args.size, args.size, generator=torch.Generator().manual_seed(1))
    gap = difference(args.out, network, photo)
    print(f"{args.out}: {args.out.stat().st_size / 1e6:.2f} MB, largest difference to PyTorch {json.dumps(gap)}")
    if max(gap.values()) > 1e-3:
        raise SystemExit("the ONNX graph does not compute what the network computes")
    if args.int8:
        photos = calibration_photos(args.data, args.photos, args.size)
        quantise(args.out, args.int8, photos)
        gap = difference(args.int8, network, photos[0])
        print(f"{args.int8}: {args.int8.stat().st_size / 1e6:.2f} MB, largest difference to PyTorch {json.dumps(gap)}")
