"""The detail network: its layers, its inputs against plain formulas, its losses, Muon, and the trial's weights."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
import torch.nn.functional as F
from torch import nn

from flashmat_train import METAL
from flashmat_train.detail import trial
from flashmat_train.detail.first_look import global_maps, shrunk, trunk_features
from flashmat_train.detail.inputs import NAMES, GlobalMaps, detail_inputs
from flashmat_train.detail.losses import DetailWeights, detail_losses, slope_energy
from flashmat_train.detail.network import DetailConfig, DetailNetwork, corrected, gmacs, reach
from flashmat_train.losses import point_lights
from flashmat_train.model import Network, NetworkConfig, network_input
from flashmat_train.slopes import height_of, normals_of, radial_tangential, slopes_of
from flashmat_train.training.muon import Muon, muon_and_adamw, orthogonal

SMALL = DetailConfig((8, 8, 12, 12), 4)


def rand(seed: int, *shape: int) -> torch.Tensor:
    return torch.rand(*shape, generator=torch.Generator().manual_seed(seed))


def features(config: DetailConfig, n: int, batch: int = 1, seed: int = 3) -> list[torch.Tensor]:
    return [rand(seed + i, batch, c, n >> (i + 1), n >> (i + 1)) - 0.5 for i, c in enumerate(config.skips)]


def base_maps(batch: int, n: int, seed: int = 5) -> GlobalMaps:
    return GlobalMaps(
        0.05 + 0.8 * rand(seed, batch, 3, n, n),
        rand(seed + 1, batch, 2, n, n) - 0.5,
        0.2 + 0.7 * rand(seed + 2, batch, 1, n, n),
        rand(seed + 3, batch),
    )


def test_answers_are_local_and_have_the_photos_size() -> None:
    """A change of one pixel, or of the trunk's features at it, changes nothing further away than `reach` says."""
    torch.manual_seed(0)
    network = DetailNetwork(SMALL).eval()
    n, at = 128, 65
    x, skips = rand(1, 1, len(NAMES), n, n), features(SMALL, n)
    with torch.no_grad():
        before = network(x, skips)
        x[:, :, at, at] += 5
        after = network(x, skips)
    assert before.shape == (1, 6, n, n)
    rows = (after - before).abs().amax(dim=(0, 1, 3)).nonzero()[:, 0]
    far = max(at - int(rows.min()), int(rows.max()) - at)
    assert 0.6 * reach(SMALL) < far <= reach(SMALL)


def test_trunk_factors_fold_into_the_weights_that_read_them() -> None:
    """Exactly, also at the border: what int8 needs."""
    torch.manual_seed(0)
    network = DetailNetwork(SMALL).eval()
    for i, skip in enumerate(network.skip):
        skip.scale.copy_(0.2 + rand(i, len(skip.scale)))
    x, skips = rand(1, 1, len(NAMES), 32, 32), features(SMALL, 32)
    with torch.no_grad():
        want = network(x, skips)
        for mix, skip in zip(network.mix, network.skip, strict=True):
            mix.conv.weight[:, -len(skip.scale) :] *= skip.scale[:, None, None]
            skip.scale.fill_(1)
        assert torch.allclose(network(x, skips), want, atol=1e-5)


def test_costs_are_those_of_the_layers() -> None:
    network, total = DetailNetwork(SMALL), 0

    def count(module: nn.Conv2d, inputs: tuple, output: torch.Tensor) -> None:
        nonlocal total
        total += module.weight.numel() * output.shape[2] * output.shape[3]

    for module in network.modules():
        if isinstance(module, nn.Conv2d):
            module.register_forward_hook(count)
    network(rand(1, 1, len(NAMES), 64, 64), features(SMALL, 64))
    assert gmacs(SMALL, 64) == pytest.approx(total / 1e9, rel=1e-9)


def test_no_answer_leaves_the_global_maps() -> None:
    base = base_maps(2, 16)
    out = corrected(torch.zeros(2, 7, 16, 16), base)
    assert torch.allclose(out["albedo"], base.albedo, atol=1e-5)
    assert torch.allclose(out["roughness"], base.roughness, atol=1e-5)
    assert torch.allclose(slopes_of(out["normal"]), base.slopes, atol=1e-5)
    assert torch.allclose(out["metallic"], base.metal.clamp(0.01, 0.99)[:, None, None, None].expand(2, 1, 16, 16))
    assert "metallic" not in corrected(torch.zeros(2, 6, 16, 16), base)


def encoded(photo: torch.Tensor, fov: float = 50.0) -> torch.Tensor:
    return network_input(photo, torch.ones(len(photo)), torch.full((len(photo),), fov))


def linear(v: float) -> float:
    return v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4


def shaded(albedo: np.ndarray, normal: np.ndarray, rough: float, f0: float, point: np.ndarray, flash: np.ndarray):
    """Diffuse part (3,) and highlight of one pixel under the flash, from the paper's formulas."""
    to_light, to_camera = flash - point, np.array([0, 0, 1.0]) - point
    light, view = to_light / np.linalg.norm(to_light), to_camera / np.linalg.norm(to_camera)
    half = (light + view) / np.linalg.norm(light + view)
    nl, nv, nh, vh = (float(a @ b) for a, b in ((normal, light), (normal, view), (normal, half), (view, half)))
    alpha = max(rough * rough, 1e-3)
    d = alpha**2 / (math.pi * (nh * nh * (alpha**2 - 1) + 1) ** 2)
    f = f0 + (1 - f0) * 2 ** ((-5.55473 * vh - 6.98316) * vh)
    k = (rough + 1) ** 2 / 8
    g = nl / (nl * (1 - k) + k) * nv / (nv * (1 - k) + k)
    irradiance = math.pi / float(to_light @ to_light) * nl
    return albedo / math.pi * irradiance, d * f * g / (4 * nl * nv) * irradiance


def test_inputs_are_their_formulas() -> None:
    """Every channel against loops over pixels written from the module's own table."""
    n, fov = 24, 50.0
    photo, base = 0.05 + 0.9 * rand(1, 1, 3, n, n), base_maps(1, n)
    flash = np.array([0.12, -0.07, 1.04])
    got = detail_inputs(encoded(photo, fov), base, torch.tensor(flash[None], dtype=torch.float32))[0].numpy()
    assert got.shape == (len(NAMES), n, n)
    rgb, slopes = photo[0].double().numpy(), base.slopes[0].double().numpy()
    albedo, rough = base.albedo[0].double().numpy(), base.roughness[0, 0].double().numpy()
    metal = float(base.metal[0])
    f0 = 0.05 + 0.45 * metal
    y = np.array([[np.mean([linear(rgb[c, i, j]) for c in range(3)]) for j in range(n)] for i in range(n)])
    log = np.log(y + 0.02)
    reach_of = math.tan(math.radians(fov) / 2)
    render, gloss, points = np.zeros((n, n)), np.zeros((n, n)), np.zeros((n, n, 2))
    for i in range(n):
        for j in range(n):
            p = points[i, j] = ((2 * j + 1) / n - 1) * reach_of, (1 - (2 * i + 1) / n) * reach_of
            normal = np.array([-slopes[0, i, j], -slopes[1, i, j], 1.0])
            point = np.array([*p, 0.0])
            diffuse, shine = shaded(albedo[:, i, j], normal / np.linalg.norm(normal), rough[i, j], f0, point, flash)
            render[i, j] = diffuse.mean() + shine
            gloss[i, j] = shine / (diffuse.mean() + shine)
    scale = (y * render).sum() / (render * render).sum()
    at = {name: got[k] for k, name in enumerate(NAMES)}
    for i, j in ((0, 0), (3, 20), (11, 12), (23, 23), (17, 2)):
        rows, columns = (np.clip(np.arange(c - 8, c + 9), 0, n - 1) for c in (i, j))
        shading = 1.5 * (log[i, j] - np.mean([log[a, b] for a in rows for b in columns]))
        across, up = (points[i, j, 0] - flash[0]) / 0.4, (points[i, j, 1] - flash[1]) / 0.4
        want = {
            **{name: rgb[c, i, j] for c, name in enumerate(("red", "green", "blue"))},
            **{"across": across, "up": up},
            **{"shading": shading, "shading_x": shading * across, "shading_y": shading * up},
            "unexplained": np.clip(log[i, j] - math.log(scale * render[i, j] + 0.02), -2, 2),
            "gloss": gloss[i, j],
            **{f"albedo_{name}": math.log(albedo[c, i, j] / (1 - albedo[c, i, j])) / 3 for c, name in enumerate("rgb")},
            **{"slope_x": slopes[0, i, j], "slope_y": slopes[1, i, j]},
            "rough": math.log(rough[i, j] / (1 - rough[i, j])) / 3,
            **{"metal": metal, "flash_x": flash[0], "flash_y": flash[1], "known": 1.0},
        }
        assert want.keys() == set(NAMES)
        for name, value in want.items():
            assert at[name][i, j] == pytest.approx(value, abs=3e-4, rel=3e-4), (name, i, j)


def global_network() -> Network:
    torch.manual_seed(2)
    config = NetworkConfig("small", (8, 8, 8, 8, 8, 8, 8), (8, 8, 8, 8, 8, 8), 8, trunk=11, detail=4)
    network = Network(config).eval()
    network.requires_grad_(False)
    return network


def test_first_look_sees_the_small_photo_once_or_twice() -> None:
    network, photo = global_network(), encoded(rand(4, 1, 3, 256, 256))
    one = global_maps(network, photo)
    out = network(shrunk(photo))
    assert one.albedo.shape == (1, 3, 256, 256)
    assert torch.allclose(F.avg_pool2d(one.albedo, 2)[:, :, 8:-8, 8:-8], out["albedo"][:, :, 8:-8, 8:-8], atol=0.05)
    assert float(one.metal) == pytest.approx(float(out["class_logits"].softmax(1)[0, METAL]), rel=1e-5)
    # two looks at a symmetric photo are symmetric, of slopes the x part changes sign
    even = encoded((photo + photo.flip(3))[:, :3] / 2)
    two = global_maps(network, even, looks=2)
    assert torch.allclose(two.albedo, two.albedo.flip(3), atol=1e-5)
    flipped = two.slopes.flip(3) * torch.tensor([-1.0, 1.0])[None, :, None, None]
    assert torch.allclose(two.slopes, flipped, atol=1e-4)
    with pytest.raises(ValueError, match="cannot be averaged"):
        global_maps(network, encoded(rand(4, 1, 3, 192, 192)))


def test_trunk_features_have_the_levels_sizes() -> None:
    network, photo = global_network(), encoded(rand(4, 1, 3, 64, 64))
    shapes = [tuple(f.shape[1:]) for f in trunk_features(network, photo)]
    assert shapes == [(16, 32, 32), (24, 16, 16), (40, 8, 8), (112, 4, 4)]


def loss_terms(weights: DetailWeights, **changed: torch.Tensor) -> dict[str, float]:
    n = 64
    xy = torch.stack(torch.meshgrid(torch.linspace(-1, 1, n), torch.linspace(1, -1, n), indexing="xy"))[None] * 0.4
    slopes = 0.3 * torch.sin(40 * xy)
    target = {
        "albedo": 0.2 + 0.4 * rand(1, 1, 3, n, n),
        "normal": normals_of(slopes),
        "roughness": torch.full((1, 1, n, n), 0.5),
        "known": torch.ones(1),
    }
    points = torch.cat((xy, torch.zeros_like(xy[:, :1])), 1)
    view = torch.tensor([0.0, 0.0, 1.0])[None, :, None, None].expand_as(points)
    lights = point_lights(points, [torch.tensor([[0.8, 0.1, 1.0]])])
    predicted = {k: v.clone() for k, v in target.items() if k != "known"} | changed
    out = detail_losses(predicted, target, xy, torch.full((1, 1, 1, 1), 0.05), view, lights, weights)
    return {k: float(v) for k, v in out.items()}


def test_losses_say_what_they_are_for() -> None:
    everything = DetailWeights(energy=0.05, render=1.0)
    zero = loss_terms(everything)
    assert all(v == pytest.approx(0, abs=1e-9) for v in zero.values())
    true = 0.2 + 0.4 * rand(1, 1, 3, 64, 64)
    darker = loss_terms(everything, albedo=true * 0.8)
    assert darker["albedo"] > 1e-3 and darker["albedo_scaled"] < 1e-9 and darker["render"] < 1e-9
    flat = loss_terms(everything, normal=torch.tensor([0.0, 0.0, 1.0])[None, :, None, None].expand(1, 3, 64, 64))
    assert flat["normal"] > 1e-2 and flat["render"] > 1e-4 and flat["energy"] > 4
    assert flat["total"] == pytest.approx(8 * flat["normal"] + 0.05 * flat["energy"] + flat["render"], rel=1e-5)
    assert "render" not in loss_terms(DetailWeights())


def test_energy_tells_radial_from_tangential() -> None:
    """Halved radial slopes lower the first part by ln 4 and leave the second."""
    n = 64
    xy = torch.stack(torch.meshgrid(torch.linspace(0.5, 1, n), torch.linspace(0.1, 0.6, n), indexing="xy"))[None]
    along, across = 0.4 + 0.1 * rand(1, 1, 1, n, n), 0.4 + 0.1 * rand(2, 1, 1, n, n)
    u = xy / xy.norm(dim=1, keepdim=True)

    def field(a: torch.Tensor) -> torch.Tensor:
        return a * u + across * torch.stack((u[:, 1], -u[:, 0]), dim=1)

    back = radial_tangential(field(along), xy)
    assert torch.allclose(back[0], along, atol=1e-3) and torch.allclose(back[1], across, atol=1e-3)
    change = slope_energy(normals_of(field(along / 2)), xy) - slope_energy(normals_of(field(along)), xy)
    assert torch.allclose(change[:, 0], torch.tensor(-math.log(4)), atol=0.01)
    assert torch.allclose(change[:, 1], torch.zeros(()), atol=0.01)


def test_height_is_what_the_slopes_climb() -> None:
    y, x = torch.meshgrid(torch.arange(48.0), torch.arange(64.0), indexing="ij")
    h = 3 * torch.exp(-((x - 40) ** 2 + (y - 20) ** 2) / 90) + 2 * torch.exp(-((x - 12) ** 2 + (y - 30) ** 2) / 60)
    sx = (torch.roll(h, -1, 1) - torch.roll(h, 1, 1)) / 2
    down = (torch.roll(h, -1, 0) - torch.roll(h, 1, 0)) / 2
    got = height_of(torch.stack((sx, -down))[None])[0, 0]
    assert float((got - (h - h.mean())).abs().max()) < 0.1


def test_muon_steps_by_orthogonal_matrices() -> None:
    g = torch.Generator().manual_seed(1)
    for shape in ((20, 50), (50, 20)):
        values = torch.linalg.svdvals(orthogonal(torch.randn(*shape, generator=g)))
        assert float(values.min()) > 0.6 and float(values.max()) < 1.25
    weight = nn.Parameter(torch.zeros(8, 4, 3, 3))
    muon = Muon([weight], lr=0.1, weight_decay=0.0)
    weight.grad = torch.randn(8, 4, 3, 3, generator=g)
    muon.step()
    rms = float(weight.detach().square().mean().sqrt())
    assert rms == pytest.approx(0.1 * 0.2, rel=0.2)  # the size of AdamW's usual step
    assert float((weight.detach() * weight.grad).sum()) < 0


def test_muon_has_the_hidden_convolutions() -> None:
    network = DetailNetwork(SMALL)
    hidden = network.hidden()
    assert {"down.1.conv.weight", "mix.0.conv.weight", "up.2.conv.weight"} <= hidden and len(hidden) == 10
    together = muon_and_adamw(network.named_parameters(), hidden, 1e-3)
    assert [len(g["params"]) for g in together.param_groups] == [10, len(list(network.parameters())) - 10]


def trial_state(config: DetailConfig, norms: bool) -> dict[str, torch.Tensor]:
    """A network's weights under the trial's names."""
    names = {v: k for k, v in trial.NAMES.items()}
    out = {}
    torch.manual_seed(5)
    for name, value in DetailNetwork(config).state_dict().items():
        first = next(k for k in names if name.startswith(k))
        rest = name.removeprefix(first).replace("conv.", "c.").replace("norm.", "n.").replace("scale", "k")
        value = value + 0.1 * rand(len(name), *value.shape) if value.dtype.is_floating_point else value
        out[names[first] + rest] = value
    for i, channels in enumerate(config.skips):
        if norms:
            del out[f"tn.{i}.k"]
            parts = ("weight", "bias", "running_mean", "running_var")
            out |= {f"tn.{i}.{k}": 0.5 + rand(7 * i + j, channels) for j, k in enumerate(parts)}
            out[f"tn.{i}.num_batches_tracked"] = torch.tensor(3)
    return out


def test_trials_weights_are_taken_over() -> None:
    """Factors bit for bit; norms inside the border to rounding."""
    state = trial_state(SMALL, norms=False)
    assert trial.is_trial({"ema": state}) and trial.is_trial(state) and not trial.is_trial({"ema": {}})
    read = trial.read_trial(state)
    assert DetailConfig.fromdict(read["config"]) == SMALL
    assert torch.equal(read["ema"]["mix.2.norm.running_mean"], state["mix.2.n.running_mean"])
    assert torch.equal(read["ema"]["skip.3.scale"], state["tn.3.k"])

    state = trial_state(SMALL, norms=True)
    network = DetailNetwork(SMALL).eval()
    network.load_state_dict(trial.read_trial(state)["ema"])
    y, skip = rand(1, 1, SMALL.widths[0], 12, 12), rand(2, 1, SMALL.skips[0], 12, 12)
    with torch.no_grad():
        normed = F.batch_norm(skip, *(state[f"tn.0.{k}"] for k in ("running_mean", "running_var", "weight", "bias")))
        z = F.conv2d(torch.cat((y, normed), 1), state["mix.0.c.weight"], padding=1)
        keys = ("running_mean", "running_var", "weight", "bias")
        want = F.relu(F.batch_norm(z, *(state[f"mix.0.n.{k}"] for k in keys)))
        got = network.mix[0](torch.cat((y, network.skip[0](skip)), 1))
    assert torch.allclose(got[:, :, 1:-1, 1:-1], want[:, :, 1:-1, 1:-1], atol=1e-4)
    assert not torch.allclose(got[:, :, 0], want[:, :, 0], atol=1e-4)


def test_trials_run_goes_on_with_its_momentum() -> None:
    weights = trial_state(SMALL, norms=False)
    network = DetailNetwork(SMALL)
    network.load_state_dict(trial.kit_names(weights))
    hidden = network.hidden()
    inner = [p for name, p in network.named_parameters() if name in hidden]
    outer = [p for name, p in network.named_parameters() if name not in hidden]
    muon = {"state": {i: {"m": p.detach() * 0.5} for i, p in enumerate(inner)}}
    adamw = {
        "state": {
            i: {"step": torch.tensor(9.0), "exp_avg": p.detach() * 0.1, "exp_avg_sq": p.detach().square()}
            for i, p in enumerate(outer)
        }
    }
    read = trial.read_trial({"net": weights, "ema": weights, "opt": [muon, adamw], "step": 9})
    together = muon_and_adamw(network.named_parameters(), hidden, 1e-3)
    trial.take_optimizer(together, read["optimizer"])
    assert torch.equal(together.parts[0].state[inner[3]]["momentum"], inner[3] * 0.5)
    assert torch.equal(together.parts[1].state[outer[2]]["exp_avg"], outer[2] * 0.1)
    assert together.param_groups[0]["lr"] == 1e-3
    muon["state"].pop(0)
    with pytest.raises(ValueError, match="optimizer of 9 weights"):
        trial.take_optimizer(
            together, trial.read_trial({"net": weights, "ema": weights, "opt": [muon, adamw], "step": 9})["optimizer"]
        )
