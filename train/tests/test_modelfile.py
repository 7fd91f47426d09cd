"""The model file: what is written is what is read, and damage is seen."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from toy_model import toy_model

from flashmat_train.modelfile import (
    Conv,
    Dense,
    Depthwise,
    Layer,
    MixHead,
    ModelFileError,
    Tensor,
    column_sums,
    depthwise_from_float,
    model_bytes,
    pack_weights,
    parse_model,
    read_model,
    unpack_weights,
    write_model,
)


def assert_layers_equal(a: Layer, b: Layer) -> None:
    assert type(a) is type(b)
    for name, value in vars(a).items():
        if isinstance(value, np.ndarray):
            np.testing.assert_array_equal(value, getattr(b, name), err_msg=f"{a.name}.{name}")
        else:
            assert value == getattr(b, name), f"{a.name}.{name}"


def test_model_round_trip(tmp_path: Path) -> None:
    model = toy_model()
    path = tmp_path / "toy.fmat"
    write_model(path, model)
    again = read_model(path)
    assert again.meta == model.meta and again.card == model.card
    assert again.defaults.fov_deg == pytest.approx(model.defaults.fov_deg)
    assert (again.defaults.base_size, again.defaults.top_size) == (model.defaults.base_size, 0)
    model.defaults = replace(model.defaults, top_size=256)
    assert parse_model(model_bytes(model)).defaults.top_size == 256
    assert [vars(t) for t in again.graph.tensors] == [
        vars(t) | {"scale": float(np.float32(t.scale))} for t in model.graph.tensors
    ]
    assert (again.graph.input, again.graph.logits) == ("input", "logits")
    np.testing.assert_array_equal(again.crf, model.crf)
    assert len(again.graph.layers) == len(model.graph.layers)
    for a, b in zip(model.graph.layers, again.graph.layers, strict=True):
        assert_layers_equal(a, b)
    assert model_bytes(again) == path.read_bytes()


@pytest.mark.parametrize("shape", [(1, 1, 1, 1), (16, 3, 3, 4), (17, 4, 4, 5), (40, 2, 3, 7)])
def test_packing_inverts(shape: tuple[int, int, int, int]) -> None:
    weights = np.random.default_rng(1).integers(-127, 128, shape).astype(np.int8)
    packed = pack_weights(weights)
    assert packed.shape[-2:] == (16, 4)
    np.testing.assert_array_equal(unpack_weights(packed, shape), weights)


def test_packed_position_of_one_weight() -> None:
    weights = np.zeros((20, 3, 3, 6), np.int8)
    weights[18, 2, 1, 5] = (
        77  # output 18 is lane 2 of panel 1; tap row 2, run position 1 * 6 + 5 = 11 = group 2, byte 3
    )
    assert pack_weights(weights)[1, 2, 2, 2, 3] == 77


def test_column_sums_per_source() -> None:
    weights = np.random.default_rng(2).integers(-127, 128, (5, 3, 3, 7)).astype(np.int8)
    sums = column_sums(weights, [4, 3])
    assert sums[1, 2] == weights[2, :, :, 4:].astype(int).sum()


def test_depthwise_codes_stand_for_the_weights() -> None:
    rng = np.random.default_rng(7)
    weight, bias = rng.normal(size=(3, 5, 11)), rng.normal(size=11)
    layer = depthwise_from_float({"in": Tensor("in", 11, 2, 0.02, -5)}, "dw", "in", "out", weight, bias)
    assert (np.abs(layer.weight_q).max(axis=(0, 1)) == 127).all()
    np.testing.assert_allclose(layer.weight_q * layer.weight_scale / 0.02, weight, atol=layer.weight_scale.max() / 0.04)
    np.testing.assert_allclose(layer.bias_q * layer.weight_scale, bias, atol=layer.weight_scale.max())


@pytest.mark.parametrize("at", [3, 9, 13, 17, 25, 70, 300, -1])
def test_damage_is_seen(at: int) -> None:
    data = bytearray(model_bytes(toy_model()))
    data[at] ^= 0x10
    with pytest.raises(ModelFileError):
        parse_model(bytes(data))


def test_truncation_is_seen() -> None:
    data = model_bytes(toy_model())
    for size in (0, 7, 63, 64, 200, len(data) - 1):
        with pytest.raises(ModelFileError):
            parse_model(data[:size])


def test_writer_refuses_wrong_shapes() -> None:
    for change in ("conv", "depthwise", "dense", "mix"):
        model = toy_model()
        for layer in model.graph.layers:
            if change == "conv" and isinstance(layer, Conv):
                layer.weight_q = layer.weight_q[..., 1:]
            if change == "depthwise" and isinstance(layer, Depthwise):
                layer.weight_q = layer.weight_q[..., 1:]
            if change == "dense" and isinstance(layer, Dense):
                layer.bias = layer.bias[1:]
            if change == "mix" and isinstance(layer, MixHead):
                layer.shuffle = 3
        with pytest.raises(ModelFileError):
            model_bytes(model)
