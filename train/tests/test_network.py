"""The network, its checkpoints, and what is exported of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
import torch.nn.functional as F
from small_data import random_maps

from flashmat_train import checkpoint, export_onnx, int8_reference
from flashmat_train.export import CRF_DEFAULT, build, calibrate
from flashmat_train.int8_reference import quantise_input, run_float, run_int8
from flashmat_train.losses import NORMAL_BINS, normal_weights
from flashmat_train.metrics import map_errors, trivial
from flashmat_train.model import PRESETS, MixHead, Network, NetworkConfig, gmacs, network_input
from flashmat_train.modelfile import Conv, read_model, write_model


def photo(seed: int, size: int = 128) -> torch.Tensor:
    return network_input(torch.round(random_maps(seed, size)[None, :3] * 255) / 255, torch.ones(1))


@pytest.fixture(scope="module")
def trained() -> Network:
    """A tiny network whose batch statistics have seen photos, so that its activations are those of a real one."""
    torch.manual_seed(4)
    net = Network(PRESETS["tiny"])
    for p in net.classifier.parameters():
        p.data.mul_(3)
    for block in net.modules():
        if isinstance(block, torch.nn.BatchNorm2d):
            block.momentum = 0.5
            torch.nn.init.uniform_(block.weight, 0.5, 1.5)
            torch.nn.init.uniform_(block.bias, -0.3, 0.3)
    batch = torch.cat([photo(s) for s in range(4)])
    with torch.no_grad():
        for _ in range(6):
            net(batch)
    return net.eval()


def test_input_is_the_reference() -> None:
    linear = np.random.default_rng(8).uniform(0, 1, (3, 128, 128)).astype(np.float32)
    for fov, scale in ((30.0, None), (43.35, 1.0), (85.0, 1.0)):
        want = int8_reference.network_input(linear, scale, fov).transpose(2, 0, 1)
        srgb = torch.tensor(int8_reference.srgb_encode(linear))[None]
        got = network_input(srgb, torch.tensor([float(scale is not None)]), torch.tensor([fov]))[0]
        np.testing.assert_allclose(got, want, atol=1e-6)


def test_heads_read_the_photo_pixel_by_pixel() -> None:
    """One pixel's colour reaches its own albedo past an encoder and decoders whose features do not see it."""
    torch.manual_seed(2)
    net = Network(PRESETS["tiny"]).eval()
    for block in (*net.encoder, *(b for d in net.decoders.values() for b in d.blocks)):
        torch.nn.init.zeros_(block.conv.weight)
    x = photo(9)
    other = x.clone()
    other[0, :3, 40, 51] = 1 - other[0, :3, 40, 51]
    with torch.no_grad():
        change = (net(other)["albedo"] - net(x)["albedo"]).abs().sum(dim=1)[0]
    assert change[40, 51] > 0
    change[36:45, 46:56] = 0  # the kernels' reach
    assert change.max() == 0


def test_mixing_first_is_mixing_afterwards() -> None:
    torch.manual_seed(1)
    head = MixHead(6, 3, 8)
    x, p = torch.randn(3, 6, 10, 10), torch.randn(3, 8).softmax(dim=1)
    each = head.conv(x).view(3, 8, 12, 10, 10)
    want = F.pixel_shuffle((each * p[:, :, None, None, None]).sum(1), 2)
    assert torch.allclose(head(x, p), want, atol=1e-5)


def test_presets_are_what_the_design_asks() -> None:
    assert gmacs(PRESETS["phone"]) <= 4.0
    assert sum(p.numel() for p in Network(PRESETS["phone"]).parameters()) <= 8e6
    for config in PRESETS.values():
        assert NetworkConfig.fromdict(config.asdict()) == config


def test_outputs_are_maps(trained: Network) -> None:
    with torch.no_grad():
        out = trained(photo(9))
    assert out["albedo"].shape == (1, 3, 128, 128) and out["roughness"].shape == (1, 1, 128, 128)
    assert (out["normal"].norm(dim=1) - 1).abs().max() < 1e-5 and out["normal"][:, 2].min() > 0
    with torch.no_grad():
        assert trained(photo(9, 256))["albedo"].shape == (1, 3, 256, 256)


def test_normal_weights_by_bin() -> None:
    angles = torch.tensor([5.0, 15.0, 60.0]).deg2rad()
    n = torch.stack((torch.sin(angles), torch.zeros(3), torch.cos(angles)))[None, :, None]
    assert normal_weights(n).flatten().tolist() == pytest.approx([w for _, w in NORMAL_BINS])


def test_errors_of_known_guesses() -> None:
    maps = random_maps(3)[None]
    target = {"albedo": maps[:, :3], "normal": maps[:, 3:6], "roughness": maps[:, 6:], "cls": torch.tensor([2])}
    zero = map_errors(target | {"class_logits": F.one_hot(torch.tensor([2]), 8).float()}, target)
    assert zero["albedo_mse"] == 0 and zero["angle_deg"] < 0.1 and zero["class_accuracy"] == 1
    flat = map_errors(trivial(target, 0.3, 0.5), target)
    assert flat["albedo_mse"] == pytest.approx(4 * float((maps[:, :3] - 0.3).square().mean()), rel=1e-5)
    assert flat["roughness_rmse"] == pytest.approx(float((maps[:, 6:] - 0.5).square().mean().sqrt()), rel=1e-5)


def test_checkpoint_round_trip(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(checkpoint, "PART", 10_000)
    path = tmp_path / "run" / "last.pt"
    assert not checkpoint.exists(path)
    with pytest.raises(FileNotFoundError, match=r"last\.pt"):
        checkpoint.load(path)
    for size, split in ((20_000, True), (3_000, True), (5_000, False), (9_000, True)):
        state = {"step": size, "x": torch.arange(size)}
        checkpoint.save(state, path, split)
        assert checkpoint.exists(path)
        back = checkpoint.load(path)
        assert back["step"] == size and torch.equal(back["x"], state["x"])
        files = sorted(p.name for p in path.parent.iterdir())
        assert ("last.pt" in files) != split and all(p.stat().st_size <= 10_000 for p in path.parent.iterdir() if split)


def test_export_round_trip(trained: Network, tmp_path: Path) -> None:
    """Exported, read back: float weights compute what PyTorch does, int8 stays near."""
    ranges = calibrate(trained, [photo(s) for s in range(6)])
    crf = np.tile(np.array(CRF_DEFAULT, np.float32), (8, 1))
    path = tmp_path / "tiny.fmat"
    write_model(path, build(trained, ranges, {"name": "tiny"}, "# tiny", crf))
    model = read_model(path)
    x = photo(11)
    image = x[0].permute(1, 2, 0).double().numpy()
    with torch.no_grad():
        want = trained(x)
    exact, quantised = run_float(model.graph, image), run_int8(model.graph, quantise_input(image))
    for name in ("albedo", "normal", "roughness"):
        np.testing.assert_allclose(exact.maps[name], want[name][0].numpy(), atol=2e-4)
        assert np.abs(quantised.maps[name] - exact.maps[name]).mean() < 0.02
    np.testing.assert_allclose(exact.probabilities, want["class_logits"][0].softmax(0).numpy(), atol=1e-4)
    np.testing.assert_allclose(quantised.probabilities, exact.probabilities, atol=0.03)
    for layer in model.graph.layers:
        if isinstance(layer, Conv):
            tensor = model.graph.tensor(layer.output)
            real = (quantised.tensors[layer.output].astype(float) - tensor.zero_point) * tensor.scale
            signal = exact.tensors[layer.output]
            snr = 10 * np.log10((signal**2).sum() / max(((real - signal) ** 2).sum(), 1e-12))
            print(layer.output, f"{snr:.1f} dB")
            assert snr > 20, layer.output


def test_onnx_computes_the_same(trained: Network, tmp_path: Path) -> None:
    onnx = pytest.importorskip("onnx")
    pytest.importorskip("onnxruntime")
    path = tmp_path / "tiny.onnx"
    model = export_onnx.build(trained)
    onnx.checker.check_model(model, full_check=True)
    onnx.save(model, path)
    for size in (128, 256):
        gap = export_onnx.difference(path, trained, photo(5, size))
        assert max(gap.values()) < 1e-4, gap
