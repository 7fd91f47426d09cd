"""The classifier's trunk: pretrained weights taken over, folded, exported; the classifier that is fitted to it."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
import torch.nn.functional as F
from small_data import material, sky
from torch import Tensor

from flashmat_train import classifier, modelfile, trunk
from flashmat_train.data.pool import Pool
from flashmat_train.export import build, calibrate, trunk_ranges
from flashmat_train.int8_reference import run_float, run_int8
from flashmat_train.model import PRESETS, Network, gmacs
from flashmat_train.render.envmap import Environments, Source

COUNT = 5


def random_state(seed: int) -> dict[str, Tensor]:
    """An EfficientNet-Lite0 state of the first blocks: weights that keep activations alive, norms that matter."""
    g = torch.Generator().manual_seed(seed)
    state: dict[str, Tensor] = {}

    def layer(conv: str, norm: str, cout: int, cin: int, kernel: int) -> None:
        state[f"{conv}.weight"] = torch.randn(cout, cin, kernel, kernel, generator=g) / (cin * kernel**2) ** 0.5
        state[f"{norm}.weight"] = 0.5 + torch.rand(cout, generator=g)
        state[f"{norm}.bias"] = torch.randn(cout, generator=g) * 0.3
        state[f"{norm}.running_mean"] = torch.randn(cout, generator=g) * 0.2
        state[f"{norm}.running_var"] = 0.1 + torch.rand(cout, generator=g)

    layer("_conv_stem", "_bn0", trunk.STEM, 3, 3)
    cin = trunk.STEM
    for i, (kernel, _, expansion, cout) in enumerate(trunk.BLOCKS[:COUNT]):
        name, wide = f"_blocks.{i}", cin * expansion
        if expansion > 1:
            layer(f"{name}._expand_conv", f"{name}._bn0", wide, cin, 1)
        layer(f"{name}._depthwise_conv", f"{name}._bn1", wide, 1, kernel)
        layer(f"{name}._project_conv", f"{name}._bn2", cout, wide, 1)
        cin = cout
    return state


def reference(state: dict[str, Tensor], photo: Tensor) -> Tensor:
    """The means that the trunk gives, by the published formulas, nothing folded; double precision."""
    state = {k: v.double() for k, v in state.items()}

    def layer(x: Tensor, conv: str, norm: str, stride: int = 1, groups: int = 1) -> Tensor:
        weight = state[f"{conv}.weight"]
        total = weight.shape[-1] - stride
        x = F.pad(x, (total // 2, total - total // 2) * 2)
        x = F.conv2d(x, weight, stride=stride, groups=groups)
        means = (state[f"{norm}.running_mean"], state[f"{norm}.running_var"])
        return F.batch_norm(x, *means, state[f"{norm}.weight"], state[f"{norm}.bias"], eps=trunk.PRETRAINED_EPS)

    # black around the photo, as the int8 engine pads
    dark = F.pad(photo.double(), (0, 1, 0, 1))
    x = (dark - trunk.MEAN) / trunk.SPREAD
    x = F.conv2d(x, state["_conv_stem.weight"], stride=2)
    means = (state["_bn0.running_mean"], state["_bn0.running_var"])
    x = F.batch_norm(x, *means, state["_bn0.weight"], state["_bn0.bias"], eps=trunk.PRETRAINED_EPS).clamp(0, 6)
    out = []
    for i, (_, stride, expansion, _) in enumerate(trunk.BLOCKS[:COUNT]):
        name, y = f"_blocks.{i}", x
        if expansion > 1:
            y = layer(y, f"{name}._expand_conv", f"{name}._bn0").clamp(0, 6)
        y = layer(y, f"{name}._depthwise_conv", f"{name}._bn1", stride, y.shape[1]).clamp(0, 6)
        if i in trunk.reads(COUNT):
            out.append(y.mean(dim=(2, 3)))
        y = layer(y, f"{name}._project_conv", f"{name}._bn2")
        x = x + y if y.shape == x.shape else y
    return torch.cat(out, dim=1)


@pytest.fixture
def network(tmp_path: Path) -> Network:
    """The tiny preset with a trunk of five blocks, its weights from a file."""
    torch.save(random_state(3), tmp_path / "lite0.pth")
    torch.manual_seed(4)
    net = Network(replace(PRESETS["tiny"], trunk=COUNT)).eval()
    trunk.load_pretrained(net.trunk, tmp_path / "lite0.pth")
    return net


def test_folded_weights_see_what_the_published_network_sees(network: Network) -> None:
    photo = torch.rand(2, 6, 128, 128, generator=torch.Generator().manual_seed(1))
    want = reference(random_state(3), photo[:, :3])
    got = network.trunk(photo)
    assert got.shape == (2, trunk.width(COUNT)) == want.shape
    assert torch.allclose(got.double(), want, atol=1e-4), float((got - want).abs().max())
    assert float(want.std()) > 0.1


def test_the_trunk_is_not_trained_and_counts_in_the_products(network: Network) -> None:
    assert not any(p.requires_grad for p in network.trunk.parameters())
    assert all(p.requires_grad for p in network.classifier.parameters())
    counted = 0

    def count(m: trunk.FoldedConv, _: object, y: Tensor) -> None:
        nonlocal counted
        counted += m.conv.weight.numel() * y.shape[2] * y.shape[3]

    for m in network.trunk.modules():
        if isinstance(m, trunk.FoldedConv):
            m.register_forward_hook(count)
    network.trunk(torch.rand(1, 6, 128, 128))
    assert counted == trunk.macs(COUNT, 6, 128)
    without = replace(network.config, trunk=0)
    assert gmacs(network.config, 128) == pytest.approx(gmacs(without, 128) + counted / 1e9)


def test_int8_classes_are_the_float_ones(network: Network) -> None:
    g = torch.Generator().manual_seed(2)
    photos = [F.interpolate(torch.rand(1, 6, 16, 16, generator=g), size=(128, 128), mode="bilinear") for _ in range(4)]
    photos = [torch.round(p * 255) / 255 for p in photos]
    ranges = calibrate(network, photos) | trunk_ranges(network, photos)
    model = build(network, ranges, {}, "", np.ones((8, 12), np.float32))
    kinds = [type(layer).__name__ for layer in model.graph.layers]
    assert kinds.count("Depthwise") == COUNT
    back = modelfile.parse_model(modelfile.model_bytes(model))
    image = photos[0][0].permute(1, 2, 0).double().numpy()
    exact = run_float(back.graph, image)
    codes = (photos[0][0].permute(1, 2, 0) * 255 - 128).round().numpy().astype(np.int8)
    got = run_int8(back.graph, codes)
    with torch.no_grad():
        means, logits = network.trunk(photos[0])[0].numpy(), network(photos[0])["class_logits"][0].numpy()
    np.testing.assert_allclose(exact.tensors["pooled0"], means, atol=1e-4)
    error = np.abs(got.tensors["pooled0"] - means)
    assert error.mean() < 0.03 * means.std(), (error.mean(), means.std())
    assert np.abs(got.tensors["logits"] - logits).max() < 0.1 * (1 + np.ptp(logits))


def test_photos_of_a_fold_are_of_its_materials(network: Network) -> None:
    """Materials of one class each: a fold's photos have the classes of that fold's materials."""
    pools = [(Pool([material(i, i) for i in range(8)] + [material(8 + i, i) for i in range(4)]), 1.0)]
    env = Environments([Source.of(sky(1))], 1, 0)
    args = argparse.Namespace(photos=33, folds=2, size=64, seed=5)
    means, cls, fold = classifier.observe(network.trunk, pools, env, args)
    assert means.shape == (33, 2, trunk.width(COUNT)) and torch.isfinite(means.float()).all()
    assert torch.bincount(fold).tolist() == [17, 16]
    assert set(cls[fold == 1].tolist()) <= set(range(4)), "only the first four classes have a second material"
    assert len(set(cls[fold == 0].tolist())) > 4


def test_a_classifier_is_fitted_and_reads_the_means_as_they_are() -> None:
    g = torch.Generator().manual_seed(6)
    cls = torch.randint(8, (640,), generator=g)
    centres = torch.randn(8, 40, generator=g)
    means = 5 + 0.1 * (centres[cls][:, None] + 0.5 * torch.randn(640, 2, 40, generator=g))
    head = classifier.fit(means, cls, 16, seed=1)
    fresh = 5 + 0.1 * (centres[cls] + 0.5 * torch.randn(640, 40, generator=g))
    with torch.no_grad():
        assert (head(fresh).argmax(dim=1) == cls).float().mean() > 0.95
    again = classifier.fit(means, cls, 16, seed=1)
    assert all(torch.equal(a, b) for a, b in zip(head.parameters(), again.parameters(), strict=True))
