"""Equalisation before quantisation: the network's function stays, the channels' ranges come together."""

from __future__ import annotations

import copy

import torch

from flashmat_train.export import blocks, equalise
from flashmat_train.model import PRESETS, Network


def ranges(network: Network, photo: torch.Tensor) -> dict[str, torch.Tensor]:
    out: dict[str, torch.Tensor] = {}
    hooks = [
        block.register_forward_hook(lambda _m, _i, y, name=name: out.__setitem__(name, y.amax(dim=(0, 2, 3))))
        for name, block in blocks(network).items()
    ]
    with torch.no_grad():
        network(photo)
    for hook in hooks:
        hook.remove()
    return out


def test_equalisation_keeps_the_function_and_evens_the_ranges() -> None:
    torch.manual_seed(5)
    network = Network(PRESETS["tiny"]).eval()
    photo = torch.rand(2, 6, 128, 128)
    with torch.no_grad():
        for block in blocks(network).values():
            block.norm.weight.copy_(torch.rand_like(block.norm.weight) * 3 + 0.01)
            block.norm.bias.uniform_(-0.1, 0.5)
        before = network(photo)
    balanced = copy.deepcopy(network)
    equalise(balanced, [photo])
    with torch.no_grad():
        after = balanced(photo)
    for name, values in after.items():
        assert torch.allclose(values, before[name], atol=2e-5), name

    def spread(r: torch.Tensor) -> float:
        live = r[r > 1e-4]
        return float(live.max() / live.min())

    raw, even = ranges(network, photo), ranges(balanced, photo)
    assert sum(spread(even[name]) < spread(raw[name]) for name in raw) > len(raw) / 2
