"""Checkpoint to model file: batch norm folded, activation ranges calibrated, int8 weights, float weights beside.

`python -m flashmat_train export --checkpoint RUN/last.pt --out models/phone.fmat --data DIR`
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from . import CLASSES, checkpoint, modelfile
from .data.batches import Crops, SceneOptions, render_batch
from .data.materials import data_root, load, scan
from .data.pool import Pool
from .model import HEADS, INPUT_CHANNELS, ConvBlock, Network, NetworkConfig
from .modelfile import Source
from .render.envmap import Environments
from .trunk import FoldedConv, Trunk


def add_arguments(p: argparse.ArgumentParser) -> None:
    p.add_argument("--checkpoint", type=Path, required=True)
    p.add_argument("--out", type=Path, required=True)
    p.add_argument("--data", help="data folder for calibration (default: FLASHMAT_DATA)")
    p.add_argument("--name", default="phone")
    p.add_argument("--card", type=Path, help="model card to carry in the file")
    p.add_argument("--crf", type=Path, help="learned CRF coefficients, JSON (8 x 12)")
    p.add_argument("--float", action="store_true", help="float weights too (four times the size)")
    p.add_argument("--photos", type=int, default=96, help="photos to calibrate with")
    p.add_argument("--size", type=int, default=256)


@torch.no_grad()
def fold(block: ConvBlock) -> tuple[Tensor, Tensor]:
    """Weight and bias of a convolution with its batch norm folded in, f32."""
    norm = block.norm
    scale = norm.weight.double() / (norm.running_var.double() + norm.eps).sqrt()
    weight = block.conv.weight.double() * scale[:, None, None, None]
    return weight.float(), (norm.bias.double() - norm.running_mean.double() * scale).float()


def blocks(network: Network) -> dict[str, ConvBlock]:
    """All convolution blocks by the name of the tensor they write."""
    out = {f"enc{i}": b for i, b in enumerate(network.encoder)}
    if network.detail is not None:
        out["detail"] = network.detail
    for name, decoder in network.decoders.items():
        out |= {f"{name}.dec{i}": b for i, b in enumerate(decoder.blocks)}
    return out


@torch.no_grad()
def calibrate(network: Network, photos: list[Tensor], share: float = 0.99995) -> dict[str, float]:
    """Upper end of each block's range: the `share` quantile of its values in each photo, of these the 0.98 quantile."""
    tops: dict[str, list[float]] = {}

    def look(name: str, y: Tensor) -> None:
        v = y.float().flatten()
        k = max(1, int(v.numel() * (1 - share)))
        tops.setdefault(name, []).append(float(v.topk(k).values[-1]))

    watch(network, blocks(network), photos, look)
    return {name: max(float(np.quantile(v, 0.98)), 1e-4) for name, v in tops.items()}


@torch.no_grad()
def watch(
    net: nn.Module, parts: Mapping[str, nn.Module], photos: list[Tensor], look: Callable[[str, Any], None]
) -> None:
    """Runs the photos through `net` and shows what each of its `parts` gives to `look`, with the part's name."""
    hooks = [part.register_forward_hook(lambda _m, _i, y, name=name: look(name, y)) for name, part in parts.items()]
    net.eval()
    for photo in photos:
        net(photo)
    for h in hooks:
        h.remove()


def consumers(network: Network) -> dict[str, list[tuple[nn.Module, int]]]:
    """Of each block's output: the layers that read it, and at which input channel its channels begin."""
    named, depth = blocks(network), len(network.config.encoder)
    out: dict[str, list[tuple[nn.Module, int]]] = {name: [] for name in named}
    for i in range(1, depth):
        out[f"enc{i - 1}"].append((named[f"enc{i}"].conv, 0))
    first = 0
    for stage in (depth - 1, *network.config.texture) if network.trunk is None else ():
        out[f"enc{stage}"].append((network.classifier[0], first))
        first += network.config.encoder[stage]
    for name, decoder in network.decoders.items():
        previous = f"enc{depth - 1}"
        for i in range(len(decoder.blocks)):
            conv = named[f"{name}.dec{i}"].conv
            out[previous].append((conv, 0))
            out[f"enc{depth - 2 - i}"].append((conv, named[previous].conv.out_channels))
            previous = f"{name}.dec{i}"
        out[previous].append((decoder.head.conv, 0))
        if network.detail is not None:
            out["detail"].append((decoder.head.conv, network.config.decoder[-1]))
    return out


def _reading(layer: nn.Module, first: int, count: int) -> Tensor:
    """How much each of `count` input channels says in a layer: its largest weight, outputs of like size."""
    w = layer.weight.flatten(2) if layer.weight.dim() == 4 else layer.weight[:, :, None]
    w = w / w.abs().amax(dim=(1, 2), keepdim=True).clamp_min(1e-9)
    return w[:, first : first + count].abs().amax(dim=(0, 2))


@torch.no_grad()
def equalise(network: Network, photos: list[Tensor]) -> None:
    """Balances the channels of each block's output for int8, in place, without changing the network's function.

    A tensor has one scale in int8, so a channel with a small range is rounded coarsely; so are the weights of a
    channel that are small beside their neighbours'. ReLU lets a factor pass: a channel is divided by it and multiplied
    again in the layers that read it. The factor sqrt(range / weight) gives both the same share of their codes
    (Nagel et al., "Data-Free Quantization through Weight Equalization and Bias Correction", ICCV 2019).
    """
    network.room = None  # only training asks it, and the factors would have to be taken out of it too
    named = blocks(network)
    tops = {name: torch.zeros(block.conv.out_channels) for name, block in named.items()}

    def look(name: str, y: Tensor) -> None:
        tops[name] = torch.maximum(tops[name], y.float().amax(dim=(0, 2, 3)))

    watch(network, named, photos, look)
    readers = consumers(network)
    for name, block in named.items():
        top = tops[name].clamp_min(1e-4)
        size = torch.stack([_reading(layer, first, len(top)) for layer, first in readers[name]]).amax(dim=0)
        factor = (top / size.clamp_min(1e-4)).sqrt()
        block.norm.weight /= factor
        block.norm.bias /= factor
        for layer, first in readers[name]:
            shape = (1, -1, 1, 1) if layer.weight.dim() == 4 else (1, -1)
            layer.weight[:, first : first + len(factor)] *= factor.view(shape)


@torch.no_grad()
def build(network: Network, ranges: dict[str, float], meta: dict, card: str, crf: np.ndarray) -> modelfile.Model:
    """The model file's contents from a trained network and its activation ranges (with a trunk: its `trunk_ranges` too,
    below and above zero under `NAME.low` and `NAME`)."""
    config = network.config
    depth = len(config.encoder)
    tensors = [modelfile.Tensor("input", INPUT_CHANNELS, 1, modelfile.INPUT_SCALE, modelfile.INPUT_ZERO_POINT)]
    table = {"input": tensors[0]}
    layers: list[modelfile.Layer] = []

    def tensor(name: str, channels: int, divisor: int, scale: float = 1.0, zero: int = 0) -> None:
        table[name] = modelfile.Tensor(name, channels, divisor, float(np.float32(scale)), zero)
        tensors.append(table[name])

    def conv(name: str, sources: tuple[Source, ...], divisor: int, block: ConvBlock) -> None:
        weight, bias = fold(block)
        tensor(name, weight.shape[0], divisor, ranges[name] / 255.0, -128)
        p, stride = block.conv.padding[0], block.conv.stride[0]
        layers.append(
            modelfile.conv_from_float(
                table,
                name,
                sources,
                name,
                weight.permute(0, 2, 3, 1).numpy(),
                bias.numpy(),
                stride=stride,
                pad=(p, p, p, p),
            )
        )

    def dense(name: str, sources: tuple[str, ...], layer: nn.Linear, relu: bool) -> None:
        tensor(name, layer.out_features, 0)
        w, b = layer.weight.detach().float().numpy(), layer.bias.detach().float().numpy()
        layers.append(modelfile.Dense(name, sources, name, w, b, relu))

    previous = "input"
    for i, block in enumerate(network.encoder):
        conv(f"enc{i}", (Source(previous),), 2 ** (i + 1), block)
        previous = f"enc{i}"
    if network.trunk is None:
        read = [f"enc{stage}" for stage in (depth - 1, *config.texture)]
    else:
        read = add_trunk(network.trunk, ranges, table, tensors, layers)
    pooled = [read[i : i + 2] for i in range(0, len(read), 2)]  # a layer has two sources at most
    for i, sources in enumerate(pooled):
        tensor(f"pooled{i}", sum(table[source].channels for source in sources), 0)
        layers.append(modelfile.MeanPool(f"pooled{i}", tuple(sources), f"pooled{i}"))
    dense("hidden", tuple(f"pooled{i}" for i in range(len(pooled))), network.classifier[0], True)
    dense("logits", ("hidden",), network.classifier[2], False)
    detail: tuple[Source, ...] = ()
    if network.detail is not None:
        conv("detail", (Source("input"),), 2, network.detail)
        detail = (Source("detail"),)
    for name, maps in HEADS.items():
        decoder, previous = network.decoders[name], f"enc{depth - 1}"
        for i, block in enumerate(decoder.blocks):
            skip = depth - 2 - i
            conv(f"{name}.dec{i}", (Source(previous, True), Source(f"enc{skip}")), 2 ** (skip + 1), block)
            previous = f"{name}.dec{i}"
        k = decoder.head.classes
        w = decoder.head.conv.weight.detach().float()
        w = w.view(k, maps * 4, *w.shape[1:]).permute(0, 1, 3, 4, 2)
        b = decoder.head.conv.bias.detach().float().view(k, maps * 4)
        layers.append(modelfile.MixHead(f"{name}.head", (Source(previous), *detail), name, 2, w.numpy(), b.numpy()))
    graph = modelfile.Graph(tensors, layers, "input", "logits")
    return modelfile.Model(meta, graph, crf.astype(np.float32), card=card)


def trunk_layers(trunk: Trunk) -> dict[str, nn.Module]:
    """The modules of a trunk by the name of the tensor that they write: a residual block writes its sum."""
    out: dict[str, nn.Module] = {"trunk.stem": trunk.stem}
    for i, block in enumerate(trunk.blocks):
        if block.expand is not None:
            out[f"trunk{i}.expand"] = block.expand
        out[f"trunk{i}.spatial"] = block.spatial
        if block.project is not None:
            out[f"trunk{i}.project"] = block
    return out


@torch.no_grad()
def trunk_ranges(network: Network, photos: list[Tensor], share: float = 0.9999) -> dict[str, float]:
    """The largest value of each of the trunk's tensors but for a share of outliers, and as `NAME.low` the least one."""
    ends: dict[str, tuple[list[float], list[float]]] = {}

    def look(name: str, y: Tensor | tuple[Tensor, Tensor]) -> None:
        v = (y if isinstance(y, Tensor) else y[0]).flatten()
        k = max(1, int(v.numel() * (1 - share)))
        low, high = ends.setdefault(name, ([], []))
        low.append(min(float(v.kthvalue(k).values), 0.0))
        high.append(float(v.topk(k).values[-1]))

    watch(network.trunk, trunk_layers(network.trunk), photos, look)
    out = {}
    for name, (low, high) in ends.items():
        out[f"{name}.low"], out[name] = float(np.quantile(low, 0.02)), max(float(np.quantile(high, 0.98)), 1e-4)
    return out


def add_trunk(
    trunk: Trunk,
    ranges: dict[str, float],
    table: dict[str, modelfile.Tensor],
    tensors: list[modelfile.Tensor],
    layers: list[modelfile.Layer],
) -> list[str]:
    """Appends the trunk's tensors and layers; returns the tensors whose means the classifier reads.

    A residual block's sum is its projection's: the 1x1 convolution reads the block's input beside the wide tensor, with
    weights of one. ReLU6 is the end of the tensor's codes.
    """

    def add(name: str, sources: tuple[Source, ...], layer: FoldedConv, skip: bool = False) -> str:
        conv = layer.conv
        low = 0.0 if layer.relu else ranges[f"{name}.low"]
        high = min(ranges[name], 6.0) if layer.relu else ranges[name]
        scale = float(np.float32((high - low) / 255.0))
        stride = conv.stride[0]
        divisor = table[sources[0].tensor].divisor * stride
        zero = int(np.clip(np.rint(-128 - low / scale), -128, 127))
        table[name] = modelfile.Tensor(name, conv.out_channels, divisor, scale, zero)
        tensors.append(table[name])
        weight, bias = conv.weight.detach().float(), conv.bias.detach().float().numpy()
        before, after = layer.pad
        how = {"stride": stride, "pad": (before, before, after, after), "relu": layer.relu, "relu6": layer.relu}
        if conv.groups > 1:
            taps = weight[:, 0].permute(1, 2, 0).numpy()
            layers.append(modelfile.depthwise_from_float(table, name, sources[0].tensor, name, taps, bias, **how))
            return name
        if skip:
            weight = torch.cat((weight, torch.eye(conv.out_channels)[:, :, None, None]), dim=1)
        layers.append(
            modelfile.conv_from_float(table, name, sources, name, weight.permute(0, 2, 3, 1).numpy(), bias, **how)
        )
        return name

    previous, read = add("trunk.stem", (Source("input"),), trunk.stem), []
    for i, block in enumerate(trunk.blocks):
        start = previous
        if block.expand is not None:
            previous = add(f"trunk{i}.expand", (Source(previous),), block.expand)
        previous = add(f"trunk{i}.spatial", (Source(previous),), block.spatial)
        if i in trunk.reads:
            read.append(previous)
        if block.project is not None:
            sources = (Source(previous), Source(start)) if block.residual else (Source(previous),)
            previous = add(f"trunk{i}.project", sources, block.project, block.residual)
    return read


def calibration_photos(data: str | None, count: int, size: int) -> list[Tensor]:
    """Network inputs of rendered training crops, fixed by seed."""
    root = data_root(data)
    entries, _ = scan(root)
    train = [e for e in entries if e.split == "train"]
    pool = Pool([load(e) for e in train[:: max(1, len(train) // 96)]])
    env = Environments.from_folder(root / "envmaps", rotations=1)
    options = SceneOptions()
    crops = Crops([(pool, 1.0)], size, 1234, True, count)
    out = []
    for i in range(count):
        maps, cls = crops[i]
        rng = np.random.default_rng((1234, 7, i))
        out.append(render_batch(maps[None], torch.tensor([cls]), env, options, rng).input)
    return out


#: Mild refinement until coefficients are learned: (a0, a1, b1, b2, b3), (a, b1, b2), (a0, a1, b1, b2).
CRF_DEFAULT = (0.6, 0.3, 0.02, 0.04, 0.04, 0.95, 0.02, 0.03, 0.8, 0.1, 0.02, 0.08)


def run(args: argparse.Namespace) -> None:
    state = checkpoint.load(args.checkpoint)
    network = Network(NetworkConfig.fromdict(state["config"]))
    network.load_state_dict(state["ema"])
    photos = calibration_photos(args.data, args.photos, args.size)
    if top := state.get("top_size", 0):
        photos += calibration_photos(args.data, max(1, args.photos // 4), top)
    for _ in range(3):  # each layer's factors change its neighbours' balance
        equalise(network, photos)
    ranges = calibrate(network, photos)
    if network.trunk is not None:
        ranges |= trunk_ranges(network, photos)
    crf = np.tile(np.array(CRF_DEFAULT, np.float32), (len(CLASSES), 1))
    if args.crf:
        crf = np.array(json.loads(args.crf.read_text()), np.float32)
    meta = {
        "name": args.name,
        "classes": list(CLASSES),
        "preset": state["config"]["name"],
        "samples": state.get("samples", 0),
        "steps": state["step"],
    }
    card = args.card.read_text() if args.card else ""
    args.out.parent.mkdir(parents=True, exist_ok=True)
    model = build(network, ranges, meta, card, crf)
    model.defaults = modelfile.Defaults(base_size=state.get("size", 128), top_size=state.get("top_size", 0))
    if not args.float:
        for layer in model.graph.layers:
            if isinstance(layer, modelfile.Conv | modelfile.Depthwise):
                layer.weight = layer.bias = None
    modelfile.write_model(args.out, model)
    print(f"{args.out}: {args.out.stat().st_size / 1e6:.2f} MB, {state.get('samples', 0)} samples")
