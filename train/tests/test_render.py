"""The renderer against cases worked by hand, quadrature and symmetry."""

from __future__ import annotations

import io
import math

import numpy as np
import pytest
import torch
from PIL import Image
from small_data import random_maps, sky

from flashmat_train.losses import specular_share
from flashmat_train.render.brdf import distribution, fresnel, geometry_over_cosines, normalise, shade
from flashmat_train.render.camera import CameraNoise, _tone_mapped, photograph
from flashmat_train.render.envmap import (
    Environments,
    Source,
    directional_albedo,
    equirect_directions,
    oct_decode,
    oct_encode,
)
from flashmat_train.render.flash import FOV_DEG, fronto_parallel, pixel_positions, render_point, tilted
from flashmat_train.render.jpeg import jpeg

FLAT = torch.tensor([0.0, 0.0, 1.0])


def value(x: float) -> torch.Tensor:
    return torch.full((1, 1, 1, 1), x)


def flat_maps(n: int, albedo: float, roughness: float) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    normal = FLAT[None, :, None, None].expand(1, 3, n, n)
    return torch.full((1, 3, n, n), albedo), normal, torch.full((1, 1, n, n), roughness)


def default_geometry(n: int):
    return fronto_parallel(n, torch.tensor([FOV_DEG]))


def directions(rng: np.random.Generator, count: int, lowest: float = 0.05) -> torch.Tensor:
    """(count,3,1,1) unit vectors above the horizon."""
    z, phi = rng.uniform(lowest, 1, count), rng.uniform(0, 2 * math.pi, count)
    s = np.sqrt(1 - z * z)
    return torch.tensor(np.stack((s * np.cos(phi), s * np.sin(phi), z), 1), dtype=torch.float32)[:, :, None, None]


def test_terms_by_hand() -> None:
    # r = 1: alpha = 1, D = 1/pi everywhere; r² = 1/2: D = 4/pi at the peak and 16/(25 pi) at (n.h)² = 1/2
    assert distribution(value(0.3), value(0.7), value(1.0)).item() == pytest.approx(1 / math.pi, rel=1e-5)
    half = value(math.sqrt(0.5))
    assert distribution(value(1.0), value(0.0), half).item() == pytest.approx(4 / math.pi, rel=1e-5)
    assert distribution(value(0.5), value(0.5), half).item() == pytest.approx(16 / (25 * math.pi), rel=1e-5)
    # head on: 2^-12.53789; v.h = 1/2: 2^-4.8802625; grazing: all
    assert fresnel(value(1.0), 0.05).item() == pytest.approx(0.05 + 0.95 * 1.681757e-4, rel=1e-4)
    assert fresnel(value(0.5), 0.0).item() == pytest.approx(0.0339553, rel=1e-4)
    assert fresnel(value(0.0), 0.05).item() == pytest.approx(1.0)
    # r = 1, k = 1/2, n.x = 1/2 both: G = 4/9, over n.l n.v = 1/4
    assert geometry_over_cosines(value(0.5), value(0.5), value(1.0)).item() == pytest.approx(16 / 9, rel=1e-5)


def test_white_lambertian_is_one_at_the_centre() -> None:
    out = render_point(*flat_maps(1, 1.0, 1.0), 0.0, default_geometry(1), torch.tensor([[0.0, 0.0, 1.0]]))
    assert out[0, :, 0, 0].tolist() == pytest.approx([1 + 1.681757e-4 / 4] * 3, abs=1e-6)


def test_falloff_and_cosine() -> None:
    """A Lambertian at every pixel: radiance = albedo (z/d) / d², d the distance to the light."""
    n, light = 16, torch.tensor([0.3, -0.2, 1.4])
    out = render_point(*flat_maps(n, 0.5, 1.0), 0.0, default_geometry(n), light[None])[0, 0]
    t = math.tan(math.radians(FOV_DEG) / 2)
    p = pixel_positions(n) * t
    d = ((p[0] - light[0]) ** 2 + (p[1] - light[1]) ** 2 + light[2] ** 2).sqrt()
    # f0 = 0 leaves 1e-4 of specular light
    assert (out - 0.5 * light[2] / d**3).abs().max() < 1e-3
    assert p[1, 0, 0] > 0 > p[1, -1, 0] and p[0, 0, 0] < 0  # row 0 is the top, column 0 the left


def test_brdf_is_reciprocal_and_black_from_below() -> None:
    rng = np.random.default_rng(5)
    a, b = directions(rng, 500), directions(rng, 500)
    n = normalise(
        FLAT[None, :, None, None] + 0.4 * torch.randn(500, 3, 1, 1, generator=torch.Generator().manual_seed(1))
    )
    rough = torch.rand(500, 1, 1, 1, generator=torch.Generator().manual_seed(2)) * 0.9 + 0.1
    white = torch.full((500, 3, 1, 1), 0.7)
    one, other = shade(white, n, rough, a, b, 0.05), shade(white, n, rough, b, a, 0.05)
    na, nb = (n * a).sum(1, keepdim=True), (n * b).sum(1, keepdim=True)
    up = ((na > 0.02) & (nb > 0.02)).expand_as(one)
    assert torch.allclose((one * nb)[up], (other * na)[up], rtol=1e-4, atol=1e-6)
    assert (one[((na <= 0) | (nb <= 0)).expand_as(one)] == 0).all()


def hemisphere(h: int, w: int) -> tuple[torch.Tensor, torch.Tensor]:
    d, omega = equirect_directions(2 * h, w)
    return d[: h * w], omega[: h * w]


@pytest.mark.parametrize("roughness", [0.3, 0.6, 1.0])
def test_specular_energy(roughness: float) -> None:
    """The lobe never reflects more than it receives, and the table holds what quadrature gives."""
    d, omega = hemisphere(200, 800)
    light = d.T[None, :, :, None]
    table = directional_albedo()
    for nv in (0.3, 0.7, 0.98):
        view = torch.tensor([math.sqrt(1 - nv * nv), 0, nv])[None, :, None, None]
        f = shade(torch.zeros(1, 3, 1, 1), FLAT[None, :, None, None], value(roughness), light, view, 0.5)
        total = float((f[0, 0, :, 0] * omega).sum())
        assert total < 1.0
        i, j = roughness * (table.shape[1] - 1), nv * (table.shape[2] - 1)
        near = table[:2, round(i), round(j)]
        assert total == pytest.approx(float(0.5 * near[0] + 0.5 * near[1]), rel=0.04)


def test_octahedral_map_round_trip() -> None:
    d = torch.randn(200, 3, generator=torch.Generator().manual_seed(3))
    d = d / d.norm(dim=1, keepdim=True)
    uv = oct_encode(d[:, :, None, None])[:, 0, 0]
    assert torch.allclose(oct_decode(uv), d, atol=1e-5)


def test_furnace() -> None:
    """Even light all around: a flat white surface reflects 1; a tilted one misses what is below the plane."""
    env = Environments([Source.of(np.ones((64, 128, 3), np.float32))], 1, 0)
    albedo, normal, rough = flat_maps(4, 1.0, 0.8)
    view = FLAT[None, :, None, None].expand(1, 3, 4, 4)
    at = torch.tensor([0]), torch.tensor([0.7])
    flat = env.render(*at, albedo, normal, rough, 0.0, view)
    assert (flat - 1).abs().max() < 0.01
    tilt = math.radians(60)
    side = torch.tensor([math.sin(tilt), 0, math.cos(tilt)])[None, :, None, None].expand(1, 3, 4, 4)
    leaning = env.render(*at, albedo, side, rough, 0.0, view)
    assert leaning.mean().item() == pytest.approx((1 + math.cos(tilt)) / 2, abs=0.03)


@pytest.mark.parametrize("f0", [0.05, 0.5])
def test_environment_against_quadrature(f0: float) -> None:
    """Prefiltered light against the sum over all pixels of the environment, a small sun among them."""
    pixels = sky(4)
    env = Environments([Source.of(pixels)], 1, 3)
    d, omega = equirect_directions(*pixels.shape[:2])
    d = d @ env.rotation[0].T
    light = torch.from_numpy(pixels.reshape(-1, 3)) * omega[:, None] * env.gain[0]
    d, light = d[d[:, 2] > 0], light[d[:, 2] > 0]
    n = 8
    maps = random_maps(7, n, 4)[None]
    view = default_geometry(n).view
    ours = env.render(torch.tensor([0]), torch.zeros(1), maps[:, :3], maps[:, 3:6], maps[:, 6:], f0, view)[0]
    errors = []
    for y in range(n):
        for x in range(n):
            m = maps[0, :, y, x][None, :, None, None]
            f = shade(m[:, :3], m[:, 3:6], m[:, 6:], d.T[None, :, :, None], view[:, :, y : y + 1, x : x + 1], f0)
            want = (f[0, :, :, 0] * light.T).sum(1)
            errors.append(((ours[:, y, x] - want).abs() / want).mean())
    print(f"mean relative error {np.mean(errors):.4f}")
    assert np.mean(errors) < 0.03


def test_tilted_camera_sees_the_origin_at_the_centre() -> None:
    g = tilted(9, torch.tensor([FOV_DEG]), torch.tensor([[0.2, -0.1]]))
    assert g.points[0, :, 4, 4].abs().max() < 1e-6
    assert g.points[0, 2].abs().max() < 1e-6
    assert torch.allclose(normalise(g.camera[:, :, None, None] - g.points), g.view, atol=1e-6)
    straight = tilted(9, torch.tensor([FOV_DEG]), torch.zeros(1, 2))
    assert torch.allclose(straight.points[0, :2], pixel_positions(9) * math.tan(math.radians(FOV_DEG) / 2), atol=1e-6)


@pytest.mark.parametrize("quality", [80, 90, 97])
def test_jpeg_is_libjpegs(quality: int) -> None:
    """Our JPEG against Pillow's: their difference is small beside what either loses."""
    x = torch.round(random_maps(2, 128, 40)[None, :3] * 255) / 255
    x = (
        torch.round((x + 0.02 * torch.randn(x.shape, generator=torch.Generator().manual_seed(4))).clamp(0, 1) * 255)
        / 255
    )
    buffer = io.BytesIO()
    Image.fromarray((x[0].permute(1, 2, 0) * 255 + 0.5).byte().numpy()).save(buffer, "JPEG", quality=quality)
    theirs = torch.from_numpy(np.array(Image.open(buffer))).permute(2, 0, 1) / 255
    ours = jpeg(x, [quality])[0]
    assert (ours - theirs).abs().mean() < 0.35 * (theirs - x[0]).abs().mean()


def test_plain_camera_only_rounds() -> None:
    x = torch.rand(2, 3, 32, 32, generator=torch.Generator().manual_seed(1)) * 1.2
    photo, known = photograph(x, np.random.default_rng(0), CameraNoise(plain=1.0))
    assert known.tolist() == [1.0] * len(x)
    assert ((photo * 255).round() / 255 - photo).abs().max() < 1e-6
    assert photo.max() == 1 and (photo[x >= 1] == 1).all()


def test_local_tone_mapping_evens_out_what_is_large() -> None:
    """Power 0 changes nothing, power 1 makes the surroundings even; detail stays a ratio."""
    n = 128
    fall = torch.linspace(1.0, 0.2, n)[None, None, None, :].expand(2, 3, n, n)
    check = 1 + 0.1 * ((torch.arange(n)[:, None] + torch.arange(n)[None, :]) % 2 * 2 - 1)
    x = fall * check
    out = _tone_mapped(x, torch.tensor([0.0, 1.0]))
    assert torch.equal(out[0], x[0])
    columns = out[1].mean(dim=(0, 1))[24:-24]
    assert float(columns.max() / columns.min()) < 1.1
    assert torch.allclose(out[1, :, 64, 64] / out[1, :, 64, 65], x[1, :, 64, 64] / x[1, :, 64, 65], rtol=0.02)


def test_the_specular_share_is_that_of_the_brdf_head_on() -> None:
    """At the centre of a flat material: D F / 4 over that and the diffuse part; 1 where the albedo is black."""
    n, r, albedo, f0 = 65, 0.5, 0.2, 0.05
    flat = torch.zeros(1, 3, n, n)
    flat[:, 2] = 1
    maps = {"albedo": torch.full((1, 3, n, n), albedo), "normal": flat, "roughness": torch.full((1, 1, n, n), r)}
    geometry = tilted(n, torch.tensor([FOV_DEG]), torch.zeros(1, 2))
    to_light = geometry.view
    share = specular_share(maps, torch.full((1, 1, 1, 1), f0), geometry.view, to_light)
    specular = f0 / (math.pi * r**4) / 4
    wanted = specular / (specular + albedo / math.pi)
    assert float(share[0, 0, n // 2, n // 2]) == pytest.approx(wanted, rel=2e-3)
    black = specular_share(maps | {"albedo": flat * 0}, torch.full((1, 1, 1, 1), f0), geometry.view, to_light)
    assert torch.allclose(black, torch.ones_like(black))
