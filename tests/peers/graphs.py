"""A Flashmat model file as ONNX graphs for peers: the training kit's exporter over the file's own weights.

The heads are mixed beforehand with the probabilities given, as the int8 engine mixes them at run time, so that peers
have plain convolutions with constant weights throughout and can quantise every one of them.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from flashmat_train import export_onnx, modelfile
from flashmat_train.model import HEADS, ConvBlock, Network, NetworkConfig


def real_weights(conv: modelfile.Conv, graph: modelfile.Graph) -> tuple[np.ndarray, np.ndarray]:
    """Float weights [cout][kh][kw][cin] and bias of a convolution: the file's own, or what its int8 ones stand for."""
    if conv.weight is not None and conv.bias is not None:
        return conv.weight, conv.bias
    tensors = [graph.tensor(s.tensor) for s in conv.sources]
    scales = np.concatenate([np.full(t.channels, t.scale, np.float64) for t in tensors])
    weight = conv.weight_q.astype(np.float64) * conv.weight_scale.astype(np.float64)[:, None, None, None] / scales
    return weight.astype(np.float32), (conv.bias_q * conv.weight_scale.astype(np.float64)).astype(np.float32)


@torch.no_grad()
def fill(block: ConvBlock, weight: np.ndarray, bias: np.ndarray) -> None:
    """Puts folded weights into a block whose batch norm then changes nothing else."""
    block.conv.weight.copy_(torch.from_numpy(weight.transpose(0, 3, 1, 2).copy()))
    block.norm.bias.copy_(torch.from_numpy(bias))
    block.norm.running_mean.zero_()
    block.norm.running_var.fill_(1.0 - block.norm.eps)


@torch.no_grad()
def network(model: modelfile.Model, probabilities: np.ndarray) -> Network:
    """The file's network in PyTorch, its heads mixed with `probabilities`."""
    layers = model.graph.layers
    convs = [layer for layer in layers if isinstance(layer, modelfile.Conv)]
    detail = [c for c in convs if c.name == "detail"]
    encoder = [c for c in convs if len(c.sources) == 1 and c.name != "detail"]
    decoder = [c for c in convs if len(c.sources) == 2]
    widths = tuple(c.weight_q.shape[0] for c in decoder[: len(decoder) // len(HEADS)])
    dense = [layer for layer in layers if isinstance(layer, modelfile.Dense)]
    config = NetworkConfig(
        "file",
        tuple(c.weight_q.shape[0] for c in encoder),
        widths,
        classifier=dense[0].weight.shape[0],
        detail=detail[0].weight_q.shape[0] if detail else 0,
        encoder_kernel=encoder[0].weight_q.shape[1],
        mixing=False,
    )
    out = Network(config)
    own = [out.detail] if out.detail is not None else []
    blocks = [*out.encoder, *own, *(b for d in out.decoders.values() for b in d.blocks)]
    for block, conv in zip(blocks, [*encoder, *detail, *decoder], strict=True):
        fill(block, *real_weights(conv, model.graph))
    for linear, layer in zip((out.classifier[0], out.classifier[2]), dense, strict=True):
        linear.weight.copy_(torch.from_numpy(layer.weight))
        linear.bias.copy_(torch.from_numpy(layer.bias))
    for layer in layers:
        if isinstance(layer, modelfile.MixHead):
            head = out.decoders[layer.map].head.conv
            share = probabilities if layer.weight.shape[0] > 1 else np.ones(1)
            weight, bias = (np.tensordot(share, v, 1).astype(np.float32) for v in (layer.weight, layer.bias))
            head.weight.copy_(torch.from_numpy(weight.transpose(0, 3, 1, 2).copy()))
            head.bias.copy_(torch.from_numpy(bias))
    return out.eval()


def write(
    model: modelfile.Model, probabilities: np.ndarray, photos: list[np.ndarray], folder: Path
) -> tuple[Path, Path]:
    """Writes float.onnx and int8.onnx (QDQ, per-channel s8 weights, u8 activations, calibrated on `photos`)."""
    import onnx
    from onnxruntime.quantization.shape_inference import quant_pre_process

    plain, ready, int8 = (folder / name for name in ("plain.onnx", "float.onnx", "int8.onnx"))
    onnx.save(export_onnx.build(network(model, probabilities)), plain)
    quant_pre_process(str(plain), str(ready), skip_symbolic_shape=True)
    export_onnx.quantise(ready, int8, [torch.from_numpy(p) for p in photos], heads=True)
    return plain, int8
