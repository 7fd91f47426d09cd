"""The reference executors against PyTorch's operators and against each other."""

from __future__ import annotations

import numpy as np
import pytest
import torch
import torch.nn.functional as F
from toy_model import smooth_photo, toy_model

from flashmat_train.int8_reference import (
    activate,
    correlate,
    correlate_depthwise,
    network_input,
    pixel_shuffle,
    quantise_input,
    requantise,
    run_float,
    run_int8,
)
from flashmat_train.modelfile import Conv, Depthwise


@pytest.mark.parametrize(("kernel", "stride", "pad"), [((3, 3), 1, (1, 1, 1, 1)), ((4, 4), 2, (1, 1, 1, 1))])
def test_correlate_is_conv2d(kernel: tuple[int, int], stride: int, pad: tuple[int, int, int, int]) -> None:
    rng = np.random.default_rng(3)
    image, weight = rng.normal(size=(12, 16, 7)), rng.normal(size=(5, *kernel, 7))
    theirs = F.conv2d(
        torch.tensor(image.transpose(2, 0, 1))[None],
        torch.tensor(weight.transpose(0, 3, 1, 2)),
        stride=stride,
        padding=1,
    )
    np.testing.assert_allclose(correlate(image, weight, stride, pad), theirs[0].numpy().transpose(1, 2, 0), atol=1e-12)


@pytest.mark.parametrize(("kernel", "stride"), [((3, 3), 1), ((5, 3), 2)])
def test_correlate_depthwise_is_grouped_conv2d(kernel: tuple[int, int], stride: int) -> None:
    rng = np.random.default_rng(3)
    image, weight = rng.normal(size=(12, 16, 7)), rng.normal(size=(*kernel, 7))
    theirs = F.conv2d(
        F.pad(torch.tensor(image.transpose(2, 0, 1))[None], (1, 1, 1, 3)),
        torch.tensor(weight.transpose(2, 0, 1))[:, None],
        stride=stride,
        groups=7,
    )
    ours = correlate_depthwise(image, weight, stride, (1, 1, 3, 1))
    np.testing.assert_allclose(ours, theirs[0].numpy().transpose(1, 2, 0), atol=1e-12)


def test_pixel_shuffle_is_torch() -> None:
    image = np.random.default_rng(4).normal(size=(3, 5, 12))
    theirs = F.pixel_shuffle(torch.tensor(image.transpose(2, 0, 1))[None], 2)[0].numpy()
    np.testing.assert_array_equal(pixel_shuffle(image, 2), theirs)


def test_requantise_rounds_half_to_even_and_clamps() -> None:
    acc = np.array([1, 3, 5, -1, -3, 10**9, -(10**9)])
    out = requantise(acc, np.full(7, 0.5, np.float32), -3, relu=False)
    np.testing.assert_array_equal(out, [-3, -1, -1, -3, -5, 127, -128])
    assert requantise(np.array([-9]), np.ones(1, np.float32), -3, relu=True)[0] == -3


def test_input_corners() -> None:
    image = network_input(np.zeros((3, 128, 128), np.float32), fov_deg=90.0)
    assert (image[0, 0, 3], image[0, 0, 4]) == (0.0, 1.0)  # wider than the coordinates reach
    image = network_input(np.zeros((3, 128, 128), np.float32), fov_deg=2 * np.rad2deg(np.arctan(0.6)))
    side = 0.6 / 0.75 * 127 / 128
    assert image[0, 0, 3] == pytest.approx((1 - side) / 2)  # left
    assert image[0, 0, 4] == pytest.approx((1 + side) / 2)  # top: y up
    assert quantise_input(image).min() == -128


def test_normals_are_unit() -> None:
    normal = activate("normal", np.random.default_rng(6).normal(0, 3, (3, 4, 4)))
    np.testing.assert_allclose((normal**2).sum(axis=0), 1.0, atol=1e-12)
    assert normal[2].min() > 0


def test_int8_follows_float() -> None:
    """Every int8 tensor is within 25 dB of the float weights' result."""
    model = toy_model()
    image = network_input(smooth_photo())
    exact, quantised = run_float(model.graph, image), run_int8(model.graph, quantise_input(image))
    for layer in model.graph.layers:
        if not isinstance(layer, Conv | Depthwise):
            continue
        tensor = model.graph.tensor(layer.output)
        real = (quantised.tensors[layer.output].astype(float) - tensor.zero_point) * tensor.scale
        want = exact.tensors[layer.output]
        snr = 10 * np.log10((want**2).sum() / ((real - want) ** 2).sum())
        print(layer.output, f"{snr:.1f} dB, float range {want.min():.2f}..{want.max():.2f}")
        assert snr > 25, layer.output
    np.testing.assert_allclose(quantised.probabilities, exact.probabilities, atol=0.02)
    for name, value in exact.maps.items():
        assert np.abs(quantised.maps[name] - value).mean() < 0.02, name
