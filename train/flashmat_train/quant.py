"""The int8 arithmetic of the engine simulated in float, to measure what quantisation costs and to train it away.

`QuantNetwork` has batch norm folded; activations are rounded to the codes that the model file will have, weights per
output channel with the sources' scales folded in, the mixed heads' weights after mixing. Rounding passes gradients
straight through, so the same module can be fine-tuned where rounding costs too much. The classifier's trunk is not
trained, and not rounded here.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from . import checkpoint
from .export import blocks, calibrate, calibration_photos, fold
from .fine_metrics import COLUMNS
from .model import HEADS, INPUT_CHANNELS, Network, NetworkConfig, activate

CODES = 255.0


def ste_round(x: Tensor) -> Tensor:
    """Rounded, with the gradient of the identity."""
    return x + (torch.round(x) - x).detach()


def quantise_weight(weight: Tensor, scale: Tensor) -> Tensor:
    """Symmetric int8 per output channel; `scale` (cin) of the activations is folded in first, and out again."""
    folded = weight * scale[:, None, None]
    step = folded.detach().abs().amax(dim=(1, 2, 3), keepdim=True).clamp_min(1e-12) / 127.0
    q = ste_round(folded / step).clamp(-127, 127) * step
    return q / scale[:, None, None]


class QuantConv(nn.Module):
    """A folded convolution with quantised weights and output codes."""

    def __init__(self, weight: Tensor, bias: Tensor, stride: int, padding: int, top: float, scale_in: Tensor):
        super().__init__()
        self.weight, self.bias = nn.Parameter(weight.clone()), nn.Parameter(bias.clone())
        self.stride, self.padding = stride, padding
        self.register_buffer("scale_in", scale_in)
        self.step = top / CODES

    def forward(self, x: Tensor) -> Tensor:
        w = quantise_weight(self.weight, self.scale_in)
        y = F.conv2d(x, w, self.bias, self.stride, self.padding)
        return ste_round((y / self.step).clamp(0, CODES)) * self.step


class QuantNetwork(nn.Module):
    """The network as the int8 engine computes it, for square inputs; same outputs as `Network`."""

    def __init__(self, network: Network, ranges: dict[str, float]):
        super().__init__()
        self.config, self.ranges = network.config, ranges
        named = blocks(network)
        depth = len(network.config.encoder)
        scales = {"input": 1.0 / CODES} | {k: v / CODES for k, v in ranges.items()}
        widths = {"input": INPUT_CHANNELS} | {k: b.conv.out_channels for k, b in named.items()}
        self.convs = nn.ModuleDict()
        for name, block in named.items():
            head, _, tail = name.rpartition(".")
            if name == "detail":
                sources = ["input"]
            elif head:
                i = int(tail[3:])
                sources = [f"{head}.dec{i - 1}" if i else f"enc{depth - 1}", f"enc{depth - 2 - i}"]
            else:
                i = int(name[3:])
                sources = [f"enc{i - 1}" if i else "input"]
            scale_in = torch.cat([torch.full((widths[s],), scales[s]) for s in sources])
            w, b = fold(block)
            conv = QuantConv(w, b, block.conv.stride[0], block.conv.padding[0], ranges[name], scale_in)
            self.convs[name.replace(".", "_")] = conv
        self.heads = nn.ModuleDict({k: d.head for k, d in network.decoders.items()})
        self.classifier = network.classifier
        self.pooled, self.evidence = network.pooled, network.evidence

    def encode(self, x: Tensor) -> tuple[list[Tensor], Tensor]:
        """Features of every stage, and the class logits."""
        features, y = [], x
        for i in range(len(self.config.encoder)):
            y = self.convs[f"enc{i}"](y)
            features.append(y)
        return features, self.classifier(self.evidence(x, self.pooled(features)))

    def forward(self, x: Tensor) -> dict[str, Tensor]:
        features, logits = self.encode(x)
        probabilities = logits.softmax(dim=1)
        detail = {"detail": self.convs["detail"](x)} if "detail" in self.convs else {}
        raw = {}
        for name in HEADS:
            y = features[-1]
            for i, skip in enumerate(features[-2::-1]):
                y = torch.cat((F.interpolate(y, scale_factor=2, mode="nearest"), skip), dim=1)
                y = self.convs[f"{name}_dec{i}"](y)
            read = {f"{name}.dec{len(features) - 2}": y} | detail
            scale = torch.cat([torch.full((t.shape[1],), self.ranges[k] / CODES) for k, t in read.items()])
            raw[name] = self._head(self.heads[name], torch.cat(list(read.values()), dim=1), probabilities, scale)
        return {**activate(raw), "class_logits": logits}

    @staticmethod
    def _head(head: nn.Module, x: Tensor, probabilities: Tensor, scale: Tensor) -> Tensor:
        k, c = head.classes, head.maps * 4
        weight, bias = head.conv.weight.reshape(k, c, -1), head.conv.bias.view(k, c)
        out = []
        for xi, p in zip(x, probabilities, strict=True):
            if k == 1:
                p = torch.ones_like(p[:1])
            w = torch.einsum("k,kcn->cn", p, weight).view(c, x.shape[1], 3, 3)
            w = quantise_weight(w, scale.to(x.device))
            out.append(F.conv2d(xi[None], w, p @ bias, padding=1))
        return F.pixel_shuffle(torch.cat(out), 2)


def add_arguments(p: argparse.ArgumentParser) -> None:
    p.add_argument("--checkpoint", type=Path, required=True)
    p.add_argument("--data", help="data folder (default: FLASHMAT_DATA)")
    p.add_argument("--photos", type=int, default=64, help="photos to calibrate with")
    p.add_argument("--size", type=int, default=128)
    p.add_argument("--share", type=float, nargs="+", default=[0.999, 0.9999, 0.99995, 1.0])


def run(args: argparse.Namespace) -> None:
    """Prints the validation errors of the float network and of int8 at several range shares."""
    from .train import evaluate, load_pools, validation_set

    state = checkpoint.load(args.checkpoint)
    network = Network(NetworkConfig.fromdict(state["config"]))
    network.load_state_dict(state["ema"])
    network.eval()
    args.pack, args.procedural = None, None
    _, val_pool, env = load_pools(args)
    val = validation_set(val_pool, env, args.size)
    columns = ("albedo_mse", "normal_mse", "roughness_mse", "angle_deg", "class_accuracy")
    base = evaluate(network, val, "cpu")
    columns += tuple(c for c in COLUMNS if c in base)
    print(json.dumps({"engine": "float"} | {c: round(base[c], 6) for c in columns}))
    photos = calibration_photos(args.data, args.photos, args.size)
    for share in args.share:
        quant = QuantNetwork(network, calibrate(network, photos, share))
        got = evaluate(quant, val, "cpu")
        ratios = {c: round(got[c] / max(base[c], 1e-9), 4) for c in columns}
        print(json.dumps({"engine": f"int8, share {share}", "ratio to float": ratios}))
