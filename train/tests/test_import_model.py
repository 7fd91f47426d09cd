"""A model file made a checkpoint again computes what the file's weights say, and can be trained on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from flashmat_train import modelfile
from flashmat_train.export import blocks, build, calibrate, trunk_ranges
from flashmat_train.import_model import network_of, restore_norms
from flashmat_train.model import PRESETS, Network


def exported(photos: list[torch.Tensor], trunk: int = 0) -> tuple[Network, modelfile.Model]:
    """A random network with norms that matter, and its file's contents after a trip through bytes."""
    torch.manual_seed(8)
    network = Network(replace(PRESETS["tiny"], trunk=trunk)).eval()
    with torch.no_grad():
        for block in blocks(network).values():
            block.norm.weight.copy_(torch.rand_like(block.norm.weight) + 0.5)
            block.norm.bias.uniform_(-0.1, 0.5)
            block.norm.running_mean.uniform_(-0.1, 0.1)
            block.norm.running_var.uniform_(0.5, 2)
    ranges = calibrate(network, photos) | (trunk_ranges(network, photos) if trunk else {})
    model = build(network, ranges, {"preset": "tiny"}, "", np.ones((8, 12), np.float32))
    return network, modelfile.parse_model(modelfile.model_bytes(model))


@pytest.mark.parametrize("trunk", [0, 3])
def test_the_network_comes_back_but_for_the_weights_rounding(trunk: int) -> None:
    photos = [torch.rand(1, 6, 128, 128) for _ in range(3)]
    network, model = exported(photos, trunk)
    back = network_of(model)
    assert back.config == type(back.config)(**{**network.config.asdict(), "room": 0})
    with torch.no_grad():
        want, got = network(photos[0]), back(photos[0])
    for name in ("albedo", "normal", "roughness", "class_logits"):
        signal = (want[name] - want[name].mean()).square().mean().sqrt()
        error = (want[name] - got[name]).square().mean().sqrt()
        assert error < 0.1 * signal, (name, float(error), float(signal))


def test_norms_get_statistics_and_keep_the_function() -> None:
    photos = [torch.rand(1, 6, 128, 128) for _ in range(3)]
    _, model = exported(photos)
    network = network_of(model)
    with torch.no_grad():
        before = network(photos[1])
        restore_norms(network, photos)
        after = network(photos[1])
        # in training mode a norm takes the batch's own statistics: over the same photos they are the restored ones
        block = network.encoder[0].train()
        training = block(torch.cat(photos))
        fixed = block.eval()(torch.cat(photos))
    for name, values in before.items():
        assert torch.allclose(values, after[name], atol=1e-4), name
    assert torch.allclose(training, fixed, atol=1e-2)


def test_a_file_of_another_network_is_named() -> None:
    _, model = exported([torch.rand(1, 6, 128, 128)])
    model.graph.tensors = [t for t in model.graph.tensors if t.name != "hidden"]
    with pytest.raises(ValueError, match="hidden"):
        network_of(model)
