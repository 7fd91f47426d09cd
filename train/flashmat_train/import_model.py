"""Model file to checkpoint: the int8 weights made float again, so that training can go on from a model that ships.

`python -m flashmat_train import-model --model models/phone.fmat --out RUN/init.pt`, then `train --init RUN/init.pt`.

A model file has its batch norms folded away. Each is put back with the mean and variance that its convolution's output
has over rendered training photos, and a scale and shift that undo them: the network computes what the file's float
weights would, and its statistics are those that training expects. Rounding to int8 stays; the guess of the room's
light, which no file holds, begins anew.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from . import checkpoint, modelfile
from .export import blocks, calibration_photos, trunk_layers, watch
from .model import PRESETS, Network, NetworkConfig
from .trunk import Bottleneck


def add_arguments(p: argparse.ArgumentParser) -> None:
    p.add_argument("--model", type=Path, required=True)
    p.add_argument("--out", type=Path, required=True, help="the checkpoint to write")
    p.add_argument("--data", help="data folder for the statistics (default: FLASHMAT_DATA)")
    p.add_argument("--photos", type=int, default=192, help="photos to take the statistics from")


def config_of(model: modelfile.Model) -> NetworkConfig:
    """The widths of the network in a file; ValueError when it is none of this package's."""
    graph = model.graph
    channels = {tensor.name: tensor.channels for tensor in graph.tensors}
    layers = {layer.name: layer for layer in graph.layers}
    depth = sum(name.startswith("enc") for name in channels)
    try:
        pooled = [s for layer in graph.layers if isinstance(layer, modelfile.MeanPool) for s in layer.sources]
        preset = PRESETS.get(str(model.meta.get("preset")), PRESETS["phone"])
        return replace(
            preset,
            encoder=tuple(channels[f"enc{i}"] for i in range(depth)),
            decoder=tuple(channels[f"albedo.dec{i}"] for i in range(depth - 1)),
            classifier=channels["hidden"],
            trunk=sum(name.endswith(".spatial") for name in channels),
            texture=tuple(int(name.removeprefix("enc")) for name in pooled[1:])
            if "trunk.stem" not in channels
            else preset.texture,
            room=0,
            detail=channels.get("detail", 0),
            encoder_kernel=layers["enc0"].weight_q.shape[1],
            mixing=layers["albedo.head"].weight.shape[0] > 1,
        )
    except KeyError as e:
        raise ValueError(f"the file has no tensor or layer {e}: it was not exported from this package's network") from e


def real_weights(model: modelfile.Model, layer: modelfile.Conv | modelfile.Depthwise) -> tuple[Tensor, Tensor]:
    """Float weights (cout,cin,kh,kw) and bias of an int8 convolution, the sources' scales taken out of the weights."""
    graph, step = model.graph, layer.weight_scale.astype(np.float64)
    if isinstance(layer, modelfile.Depthwise):
        weight = layer.weight_q * (step / graph.tensor(layer.source).scale)
        taps = torch.from_numpy(weight).permute(2, 0, 1)[:, None]
        return taps.float(), torch.from_numpy(layer.bias_q * step).float()
    scales = np.concatenate(
        [np.full(graph.tensor(s.tensor).channels, graph.tensor(s.tensor).scale) for s in layer.sources]
    )
    weight = layer.weight_q * step[:, None, None, None] / scales
    return torch.from_numpy(weight).permute(0, 3, 1, 2).float(), torch.from_numpy(layer.bias_q * step).float()


@torch.no_grad()
def network_of(model: modelfile.Model) -> Network:
    """The network of a file; its batch norms do nothing but add the bias."""
    network = Network(config_of(model)).eval()
    layers = {layer.name: layer for layer in model.graph.layers}
    for name, block in blocks(network).items():
        weight, bias = real_weights(model, layers[name])
        block.conv.weight.copy_(weight)
        block.norm.running_mean.zero_()
        block.norm.running_var.fill_(1 - block.norm.eps)
        block.norm.weight.fill_(1)
        block.norm.bias.copy_(bias)
    for name, module in trunk_layers(network.trunk).items() if network.trunk is not None else ():
        layer = module.project if isinstance(module, Bottleneck) else module
        weight, bias = real_weights(model, layers[name])
        # a residual block's projection has the block's input, with weights of one, behind its own channels
        layer.conv.weight.copy_(weight[:, : layer.conv.weight.shape[1]])
        layer.conv.bias.copy_(bias)
    for name, linear in (("hidden", network.classifier[0]), ("logits", network.classifier[2])):
        linear.weight.copy_(torch.from_numpy(layers[name].weight))
        linear.bias.copy_(torch.from_numpy(layers[name].bias))
    for name, decoder in network.decoders.items():
        head = layers[f"{name}.head"]
        weight = torch.from_numpy(head.weight).permute(0, 1, 4, 2, 3)
        decoder.head.conv.weight.copy_(weight.flatten(0, 1))
        decoder.head.conv.bias.copy_(torch.from_numpy(head.bias).flatten())
    return network


@torch.no_grad()
def restore_norms(network: Network, photos: list[Tensor]) -> None:
    """Gives every batch norm the statistics of its convolution's outputs over `photos`; what it computes stays."""
    named = blocks(network)
    sums = {name: torch.zeros(3, block.conv.out_channels, dtype=torch.float64) for name, block in named.items()}

    def look(name: str, y: Tensor) -> None:
        y = y.double()
        total = torch.stack(
            (torch.ones_like(y[:, :1]).sum().expand(y.shape[1]), y.sum((0, 2, 3)), y.square().sum((0, 2, 3)))
        )
        sums[name] += total

    watch(network, {name: block.conv for name, block in named.items()}, photos, look)
    for name, block in named.items():
        count, first, second = sums[name]
        mean = first / count
        variance = (second / count - mean.square()).clamp_min(1e-6)
        norm = block.norm
        scale = norm.weight.double() / (norm.running_var.double() + norm.eps).sqrt()
        shift = norm.bias.double() - norm.running_mean.double() * scale
        norm.running_mean.copy_(mean)
        norm.running_var.copy_(variance)
        norm.weight.copy_(scale * (variance + norm.eps).sqrt())
        norm.bias.copy_(shift + scale * mean)


def run(args: argparse.Namespace) -> None:
    """Writes the checkpoint."""
    model = modelfile.read_model(args.model)
    try:
        network = network_of(model)
    except ValueError as e:
        raise SystemExit(f"{args.model}: {e}") from e
    size = model.defaults.base_size or 128
    restore_norms(network, calibration_photos(args.data, args.photos, size))
    samples = int(model.meta.get("samples", 0))
    state = {
        "config": network.config.asdict(),
        "ema": network.state_dict(),
        "samples": samples,
        "step": 0,
        "size": size,
    }
    checkpoint.save(state, args.out)
    print(f"{args.out}: {network.config.name}, {samples} samples seen")
