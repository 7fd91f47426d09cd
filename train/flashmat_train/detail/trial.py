"""Weights of the experiments that came before this package: read as the kit's.

Two forms are known. `tn.i.k`: the trunk's features were multiplied, as here (the script of the first long run; its
checkpoints hold `net`, `ema`, `opt`, `step`). `tn.i.weight` and so on: they went through a batch norm (the trial that
found the trunk's worth; a state dict alone). Of that norm the factor is kept; its shift is put into the mean of the
norm behind the convolution, which is exact but for the picture's border, where the convolution pads with zeros.
"""

from __future__ import annotations

import re

import torch
from torch import Tensor

from .network import DetailConfig, DetailNetwork

#: Beginnings of names there and here.
NAMES = {
    "detail.": "full.",
    "down.": "down.",
    "mix.": "mix.",
    "tn.": "skip.",
    "dec.": "up.",
    "head.": "half_head.",
    "fine.": "full_head.",
}
EPS = 1e-5


def is_trial(state: dict) -> bool:
    """Whether a loaded file is one of these."""
    weights = state.get("ema", state)
    return isinstance(weights, dict) and "mix.0.c.weight" in weights


def kit_names(state: dict[str, Tensor]) -> dict[str, Tensor]:
    """A state dict under the kit's names, the trunk's norms made factors."""
    state = dict(state)
    for i in range(4):
        if f"tn.{i}.weight" not in state:
            continue
        weight, bias, mean, variance = (
            state.pop(f"tn.{i}.{k}") for k in ("weight", "bias", "running_mean", "running_var")
        )
        state.pop(f"tn.{i}.num_batches_tracked", None)
        scale = weight / (variance + EPS).sqrt()
        shift = bias - mean * scale
        taps = state[f"mix.{i}.c.weight"][:, -len(scale) :]
        state[f"tn.{i}.k"] = scale
        state[f"mix.{i}.n.running_mean"] = state[f"mix.{i}.n.running_mean"] - taps.sum(dim=(2, 3)) @ shift
    out = {}
    for name, value in state.items():
        first = next(k for k in NAMES if name.startswith(k))
        rest = name.removeprefix(first)
        rest = re.sub(r"\bc\.(weight|bias)$", r"conv.\1", rest)
        rest = re.sub(r"\bn\.(\w+)$", r"norm.\1", rest)
        rest = re.sub(r"\bk$", "scale", rest)
        out[NAMES[first] + rest] = value
    return out


def config_of(weights: dict[str, Tensor]) -> DetailConfig:
    """The widths of a state dict under the kit's names."""
    widths = tuple(weights[f"down.{i}.conv.weight"].shape[0] for i in range(4))
    return DetailConfig(widths, weights["full.conv.weight"].shape[0])


def read_trial(state: dict) -> dict:
    """`config`, `ema` and, of a run's checkpoint, `network`, `optimizer` and `step`: what a kit's checkpoint holds."""
    ema = kit_names(state.get("ema", state))
    config = config_of(ema)
    out = {"config": config.asdict(), "ema": ema}
    if "net" in state:
        out |= {"network": kit_names(state["net"]), "optimizer": _optimizer(state["opt"]), "step": state["step"]}
    DetailNetwork(config).load_state_dict(ema)  # an error here names what is missing
    return out


def _optimizer(parts: list[dict]) -> dict:
    """Muon's and AdamW's states: parameters stand in the same order in both packages, settings are the kit's own."""
    muon, adamw = parts
    momentum = {i: {"momentum": s["m"]} for i, s in muon["state"].items()}
    return {"parts": [{"state": momentum}, {"state": adamw["state"]}]}


def take_optimizer(optimizer: object, state: dict) -> None:
    """Puts the states of `read_trial` into an optimizer made by `muon_and_adamw`, which keeps its own settings."""
    own = optimizer.state_dict()
    for part, taken in zip(own["parts"], state["parts"], strict=True):
        count = sum(len(g["params"]) for g in part["param_groups"])
        if len(taken["state"]) != count:
            raise ValueError(f"optimizer of {len(taken['state'])} weights, the network has {count}")
        part["state"] = {i: {k: torch.as_tensor(v) for k, v in s.items()} for i, s in taken["state"].items()}
    optimizer.load_state_dict(own)
