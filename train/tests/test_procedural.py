"""The procedural materials: what the maps promise, seeds, variety, tiling."""

from __future__ import annotations

import pytest
import torch

from flashmat_train.procedural import CLASSES, FAMILIES, WEIGHTS, generate
from flashmat_train.procedural.contact_sheet import block, flash_photo
from flashmat_train.procedural.mixed import combined
from flashmat_train.procedural.noise import (
    Draw,
    blur,
    gradient_noise,
    sample,
    spectral,
    splat,
    value_noise,
    warp,
    worley,
)
from flashmat_train.procedural.structure import Surface, finish, height_to_normal
from flashmat_train.procedural.tiles import basket_tiles, brick_tiles, herringbone_tiles, hexagon_tiles

PAIRS = [(cls, family) for cls in CLASSES for family in FAMILIES[cls]]
SIZE = 64


@pytest.fixture(autouse=True)
def one_thread():
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


def rng(seed: int) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def check(m, cls: str, size: int) -> None:
    assert m.albedo.shape == (3, size, size)
    assert m.normal.shape == (3, size, size)
    assert m.roughness.shape == (1, size, size)
    assert m.cls == CLASSES.index(cls)
    for name in ("albedo", "normal", "roughness"):
        x = getattr(m, name)
        assert x.dtype == torch.float32, name
        assert torch.isfinite(x).all(), name
    assert m.albedo.min() >= 0 and m.albedo.max() <= 1
    assert m.roughness.min() >= 0 and m.roughness.max() <= 1
    assert (m.normal.norm(dim=0) - 1).abs().max() < 1e-4
    assert m.normal[2].min() > 0


def test_classes_are_in_the_agreed_order() -> None:
    assert CLASSES == ("fabric", "ground", "leather", "metal", "stone-diff", "stone-spec", "polymer", "wood")


def test_every_class_has_at_least_four_families() -> None:
    for cls in CLASSES:
        assert len(FAMILIES[cls]) >= 4, cls


@pytest.mark.parametrize(("cls", "family"), PAIRS)
def test_maps_are_well_formed_and_seeded(cls: str, family: str) -> None:
    first = generate(cls, SIZE, rng(11), "cpu", family)
    check(first, cls, SIZE)
    again = generate(cls, SIZE, rng(11), "cpu", family)
    other = generate(cls, SIZE, rng(12), "cpu", family)
    for name in ("albedo", "normal", "roughness"):
        assert torch.equal(getattr(first, name), getattr(again, name)), name
        assert not torch.equal(getattr(first, name), getattr(other, name)), name
    assert first.family == family


@pytest.mark.parametrize("seed", range(50))
def test_any_seed_gives_a_material(seed: int) -> None:
    m = generate(None, 48, rng(seed))
    check(m, CLASSES[m.cls], 48)


def test_class_by_index_is_class_by_name() -> None:
    a, b = generate(3, 32, rng(5)), generate("metal", 32, rng(5))
    assert a.family == b.family and torch.equal(a.albedo, b.albedo)


def test_wrong_names_are_told() -> None:
    with pytest.raises(ValueError, match="no material class"):
        generate("cheese", 32, rng(0))
    with pytest.raises(ValueError, match="no family"):
        generate("wood", 32, rng(0), "cpu", "marble")


def test_classes_differ() -> None:
    """Mean roughness and relief tell polished stone, metal and ground apart; all families are distinct."""
    rough, flat = {}, {}
    for cls in CLASSES:
        made = [generate(cls, 48, rng(s)) for s in range(12)]
        rough[cls] = sum(float(m.roughness.mean()) for m in made) / len(made)
        flat[cls] = sum(float(1 - m.normal[2].mean()) for m in made) / len(made)
    assert rough["stone-spec"] < rough["metal"] < rough["ground"]
    assert flat["stone-spec"] < flat["stone-diff"]
    assert flat["metal"] < flat["ground"]
    names = [family for cls in CLASSES for family in FAMILIES[cls]]
    functions = [FAMILIES[cls][family] for cls, family in PAIRS]
    assert len(set(functions)) == len(names)


@pytest.mark.parametrize(("cls", "family"), PAIRS)
def test_maps_tile(cls: str, family: str) -> None:
    """The step across the seam is like the steps inside, in both directions."""
    m = generate(cls, 96, rng(3), "cpu", family)
    x = torch.cat((m.albedo, m.normal, m.roughness))
    for axis in (1, 2):
        step = (x - torch.roll(x, 1, axis)).abs().mean(0)
        lines = step.mean(2 - axis)
        assert lines[0] <= lines[1:].max() * 1.05 + 1e-4, (axis, float(lines[0]), float(lines[1:].max()))


def test_noise_is_periodic() -> None:
    d = Draw(rng(1), "cpu")
    u, v = d.grid(64)
    seed = 21
    for make in (
        lambda u, v: value_noise(Draw(rng(seed), "cpu"), u, v, 5, 7),
        lambda u, v: gradient_noise(Draw(rng(seed), "cpu"), u, v, 5, 7),
        lambda u, v: worley(Draw(rng(seed), "cpu"), u, v, 5, 7).edge,
        lambda u, v: worley(Draw(rng(seed), "cpu"), u, v, 5, 7).f1,
        lambda u, v: brick_tiles(u, v, 3, 4).edge,
        lambda u, v: brick_tiles(u, v, 3, 4, Draw(rng(seed), "cpu").rand(4)).edge,
        lambda u, v: herringbone_tiles(u, v, 2, 3).edge,
        lambda u, v: basket_tiles(u, v, 2, 3).edge,
        lambda u, v: hexagon_tiles(u, v, 6).edge,
    ):
        assert torch.allclose(make(u, v), make(u + 1, v - 2), atol=2e-4)


def test_worley_agrees_with_brute_force() -> None:
    d = Draw(rng(4), "cpu")
    u, v = d.grid(32)
    nx, ny = 6, 6
    c = worley(Draw(rng(9), "cpu"), u, v, nx, ny, 0.9)
    draw = Draw(rng(9), "cpu")
    px, py = 0.5 + 0.9 * (draw.rand(nx * ny) - 0.5), 0.5 + 0.9 * (draw.rand(nx * ny) - 0.5)
    index = torch.arange(nx * ny)
    x, y = (index % nx + px) / nx, (index // nx + py) / ny
    dx, dy = u[..., None] - x, v[..., None] - y
    dist = torch.hypot(dx - dx.round(), dy - dy.round()) * nx
    near = dist.topk(2, largest=False)
    assert torch.allclose(c.f1, near.values[..., 0], atol=1e-4)
    assert torch.equal(c.id, near.indices[..., 0])


def test_tiles_partition_the_plane() -> None:
    d = Draw(rng(2), "cpu")
    u, v = d.grid(96)
    for tiles, used in (
        (brick_tiles(u, v, 4, 6), 24),
        (herringbone_tiles(u, v, 2, 2), 32),
        (basket_tiles(u, v, 2, 3), 48),
        (hexagon_tiles(u, v, 6), None),
    ):
        counts = torch.bincount(tiles.id.reshape(-1), minlength=tiles.count)
        counts = counts[counts > 0]
        assert used is None or len(counts) == used
        assert counts.max() <= 1.35 * counts.min()
        assert tiles.edge.min() > -1e-4


def test_spectral_noise_is_unit_and_blur_keeps_the_mean() -> None:
    f = spectral(Draw(rng(6), "cpu"), 64, 2.0, batch=3)
    assert torch.allclose(f.mean((1, 2)), torch.zeros(3), atol=1e-4)
    assert torch.allclose(f.std((1, 2)), torch.ones(3), atol=1e-3)
    x = f[0] + 2
    assert abs(float(blur(x, 0.05).mean()) - 2) < 1e-4


def test_sampling_at_pixel_centres_is_the_identity() -> None:
    d = Draw(rng(7), "cpu")
    f = spectral(d, 48, 1.0)
    u, v = d.grid(48)
    assert torch.allclose(sample(f, u, v), f, atol=1e-4)
    shifted = warp(f, torch.full_like(u, 1 / 48), torch.zeros_like(u))
    assert torch.allclose(shifted, torch.roll(f, -1, 1), atol=1e-3)


def test_splats_keep_the_highest_and_wrap() -> None:
    cx, cy = torch.tensor([0.01, 0.03]), torch.tensor([0.5, 0.5])
    lift = torch.tensor([[0.2], [0.6]])
    s = splat(32, cx, cy, 0.1, lambda x, y: torch.where(x * x + y * y < 0.01, lift, -torch.inf))
    assert s.id[16, 0] == 1 and abs(float(s.top[16, 0]) - 0.6) < 1e-4
    assert s.id[16, 29] == 0  # reached across the left border
    assert s.id[0, 0] == -1


def test_normals_point_away_from_a_bump() -> None:
    n = 64
    d = Draw(rng(0), "cpu")
    u, v = d.grid(n)
    bump = torch.exp(-((u - 0.5) ** 2 + (v - 0.5) ** 2) / 0.02)
    normal = height_to_normal(bump, 0.3)
    assert normal[0, 32, 48] > 0.05 and normal[0, 32, 16] < -0.05  # right of the top: to the right
    assert normal[1, 16, 32] > 0.05 and normal[1, 48, 32] < -0.05  # above it: up


def test_flash_photo_of_white_is_one_at_the_centre() -> None:
    from flashmat_train.procedural.structure import Material

    n = 33
    normal = torch.zeros(3, n, n)
    normal[2] = 1
    white = Material(torch.ones(3, n, n), normal, torch.ones(1, n, n), 0, "white")
    photo = flash_photo(white)
    # The diffuse part is exactly 1 there; a wholly rough surface adds (D F G / 4) pi = F0 / 4 to it.
    assert abs(float(photo[0, n // 2, n // 2]) - (1 + 0.05 / 4)) < 2e-3
    assert photo[0, 0, 0] < photo[0, n // 2, n // 2]
    assert block(white, 32, "white").size == (64, 64)


METAL_IN_PLACES = {("metal", "printed"), ("metal", "worn_paint"), ("wood", "wood_inlay"), ("stone-spec", "stone_inlay")}


def test_metal_in_places_is_told() -> None:
    """These families have a metallic map that is neither all nor nothing, of some seed; all others have none."""
    for cls, family in sorted(METAL_IN_PLACES):
        made = [generate(cls, 48, rng(s), "cpu", family).metallic for s in range(4)]
        some = [m for m in made if m is not None]
        assert some, family
        assert all(m.shape == (1, 48, 48) and float(m.min()) >= 0 and float(m.max()) <= 1 for m in some), family
        assert any(0 < float(m.mean()) < 1 for m in some), family
    for cls, family in (("metal", "foil"), ("fabric", "towel"), ("stone-diff", "wet")):
        assert generate(cls, 32, rng(1), "cpu", family).metallic is None


def test_weights_are_of_families_that_there_are() -> None:
    assert all(family in FAMILIES[cls] for cls, family in (name.split("/") for name in WEIGHTS))


def test_combined_surfaces_keep_their_own_relief() -> None:
    """Where the mask is 0 the first's slopes and maps, where it is 1 the second's, in one height."""
    n = 64
    d = Draw(rng(3), "cpu")
    u, _ = d.grid(n)

    def surface(slope: float, grey: float) -> Surface:
        wave = torch.sin(2 * torch.pi * 8 * u)
        return Surface(torch.full((3, n, n), grey), wave, torch.full((n, n), grey), slope)

    where = (u > 0.5).float()
    both = finish(combined(surface(0.1, 0.2), surface(0.4, 0.6), where), 0, "both")
    slope = both.normal[0].abs() / both.normal[2]
    left, right = (float(slope[:, a:b].square().mean().sqrt()) for a, b in ((4, 28), (36, 60)))
    assert left == pytest.approx(0.1, rel=0.1) and right == pytest.approx(0.4, rel=0.1)
    assert float(both.roughness[0, 0, 8]) == pytest.approx(0.2) and float(both.roughness[0, 0, 56]) == pytest.approx(
        0.6
    )
