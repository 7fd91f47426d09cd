"""Random relief, metallic maps and ambient occlusion: what crops and renders get where they are asked for."""

from __future__ import annotations

import argparse
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image
from small_data import material, sky, write_data

from flashmat_train import METAL
from flashmat_train.data.batches import BORROWED_SHARE, Crops, SceneOptions, render_batch
from flashmat_train.data.materials import load, scan
from flashmat_train.data.pool import Pool, scale_maps
from flashmat_train.data.procedural_pool import read_pool
from flashmat_train.procedural.relief import KINDS, STEEPEST, STRENGTH, depth_within, random_slopes, softened
from flashmat_train.render.brdf import F0_DIELECTRIC, F0_METAL
from flashmat_train.render.camera import CameraNoise
from flashmat_train.render.envmap import Environments, Source
from flashmat_train.render.occlusion import ambient_occlusion, between_surfaces
from flashmat_train.slopes import normals_of
from flashmat_train.training.setup import load_pools


def test_depths_are_distances() -> None:
    """Against a search over all pixels."""
    rng = np.random.default_rng(3)
    mask = rng.random((20, 30)) > 0.08
    y, x = np.nonzero(~mask)
    rows, columns = np.mgrid[0:20, 0:30]
    near = np.sqrt(((rows[..., None] - y) ** 2 + (columns[..., None] - x) ** 2).min(axis=2))
    for most in (3, 7):
        np.testing.assert_allclose(depth_within(mask, most), np.minimum(near, most), atol=1e-12)
    assert (depth_within(np.ones((9, 9), bool), 4) == 4).all()


def test_softening_keeps_planes_and_means() -> None:
    x = np.zeros((21, 21))
    x[10, 10] = 1
    soft = softened(x, 1.5)
    assert soft.sum() == pytest.approx(1) and soft[10, 10] == pytest.approx(1 / (2 * np.pi * 1.5**2), rel=0.02)
    assert np.allclose(softened(np.full((9, 9), 3.0), 2.0), 3.0)


@pytest.mark.parametrize("kind", KINDS)
def test_kinds_of_relief_are_heights(kind) -> None:
    a, b = (kind(np.random.default_rng(s), 48) for s in (5, 6))
    assert a.shape == (48, 48) and np.isfinite(a).all() and a.std() > 0
    assert not np.array_equal(a, b)
    assert np.array_equal(a, kind(np.random.default_rng(5), 48))


def test_random_slopes_have_strengths_of_the_range() -> None:
    made = [random_slopes(np.random.default_rng(s), 64) for s in range(24)]
    rms = [float(np.sqrt((s**2).sum(axis=0).mean())) for s in made]
    assert min(rms) > 0.8 * STRENGTH[0] and max(rms) < 1.01 * STRENGTH[1]
    assert max(rms) > 4 * min(rms)
    assert all(s.dtype == np.float32 and np.abs(s).max() <= STEEPEST for s in made)


def test_relief_takes_the_normals_of_its_share_and_nothing_else() -> None:
    pool = Pool([material(1), material(2, 3)])
    plain = Crops([(pool, 1.0)], 64, 7, True, 100)
    some = Crops([(pool, 1.0)], 64, 7, True, 100, relief=0.5)
    changed = 0
    for i in range(30):
        (a, cls), (b, other) = plain[i], some[i]
        assert cls == other and torch.equal(a[:3], b[:3]) and torch.equal(a[6:], b[6:])
        assert torch.allclose(b[3:6].norm(dim=0), torch.ones(64, 64), atol=1e-4)
        changed += not torch.equal(a[3:6], b[3:6])
        assert torch.equal(b, some[i][0])  # a function of the seed and i
    assert 8 <= changed <= 22
    assert 0 < BORROWED_SHARE < 1


def test_metallic_maps_are_read_where_asked_for(tmp_path: Path) -> None:
    root = write_data(tmp_path)
    folder = root / "materials" / "polymer" / "polymer0"
    grey = np.zeros((160, 160), np.uint8)
    grey[:, 80:] = 255
    Image.fromarray(grey).save(folder / "metallic.png")
    entry = next(e for e in scan(root)[0] if e.folder == folder)
    assert load(entry).metallic is None
    with_map = load(entry, metallic=True)
    assert np.array_equal(with_map.metallic, grey)
    pool = Pool([with_map, material(3, METAL), material(4)], metallic=True)
    crop = [pool.crop(i, 64, 1.0, 0.0, False, (0.5, 0.5)) for i in range(3)]
    assert crop[0].shape == (8, 64, 64)
    assert float(crop[0][7, 30, 20]) == 0 and float(crop[0][7, 30, 44]) == 1
    assert (crop[1][7] > 0.9999).all() and (crop[2][7] == 0).all()
    rng = np.random.default_rng(1)
    assert torch.equal(scale_maps(crop[0], 6, rng)[7], crop[0][7])
    plain = Pool([with_map]).crop(0, 64, 1.0, 0.0, False, (0.5, 0.5))
    assert torch.equal(plain, crop[0][:7])
    args = argparse.Namespace(pack=None, data=str(root), metallic=True, procedural_share=0.3)
    (train, _), val = load_pools(args)[0][0], load_pools(args)[1]
    assert train.levels[0][0].shape[0] == val.levels[0][0].shape[0] == 8


def test_procedural_materials_keep_their_metal(tmp_path: Path) -> None:
    m = material(5, 6)
    metal = np.arange(160 * 160, dtype=np.uint32).reshape(160, 160).astype(np.uint8)
    np.save(tmp_path / "polymer--paint--1.npy", np.concatenate((m.maps, metal[None])))
    np.save(tmp_path / "wood--bark--2.npy", m.maps)
    first, second = read_pool(tmp_path)
    assert np.array_equal(first.metallic, metal) and first.maps.shape[0] == 7 and second.metallic is None
    np.save(tmp_path / "wood--bark--3.npy", m.maps[:6])
    with pytest.raises(SystemExit, match="7 or 8 channels"):
        read_pool(tmp_path)


PLAIN = SceneOptions(
    camera=CameraNoise(plain=1.0), tilt_sigma=0.0, light_sigma=0.0, beside=0.0, fov_exact=1.0, second_lobe=0.0
)


@lru_cache
def room() -> Environments:
    return Environments([Source.of(sky(1))], 1, 0)


def photo(maps: torch.Tensor, cls: int, **options: object):
    return render_batch(maps[None], torch.tensor([cls]), room(), replace(PLAIN, **options), np.random.default_rng(4))


def test_each_pixel_has_its_own_reflectance() -> None:
    """Half metal: the halves are those of the pictures that are all one or the other."""
    maps = Pool([material(3)]).crop(0, 64, 0.9, 0.0, False, (0.5, 0.5))
    half = torch.zeros(1, 64, 64)
    half[:, :, 32:] = 1
    mixed = photo(torch.cat((maps, half)), 0)
    matt, metal = photo(maps, 0), photo(maps, METAL)
    assert torch.equal(mixed.target["metallic"][0], half) and "metallic" not in matt.target
    assert mixed.f0.shape == (1, 1, 64, 64)
    assert float(mixed.f0[0, 0, 0, 0]) == pytest.approx(F0_DIELECTRIC)
    assert float(mixed.f0[0, 0, 0, 63]) == pytest.approx(F0_METAL)
    assert torch.allclose(mixed.input[..., :32], matt.input[..., :32], atol=1e-6)
    assert torch.allclose(mixed.input[..., 32:], metal.input[..., 32:], atol=1e-6)
    assert not torch.allclose(matt.input[..., 32:], metal.input[..., 32:], atol=1e-2)


def test_occlusion_of_known_pits() -> None:
    """1 on a plane; 1/(1 + s²) at the tip of a cone of slope s; darker the nearer to a wall's foot."""
    y, x = torch.meshgrid(torch.arange(65.0), torch.arange(65.0), indexing="ij")
    assert torch.equal(ambient_occlusion(torch.full((1, 1, 65, 65), 2.0)), torch.ones(1, 1, 65, 65))
    cone = 0.8 * torch.hypot(x - 32, y - 32)[None, None]
    assert float(ambient_occlusion(cone)[0, 0, 32, 32]) == pytest.approx(1 / 1.64, rel=1e-4)
    assert float(ambient_occlusion(-cone)[0, 0, 32, 32]) == 1
    wall = torch.where(x < 32, 10.0, 0.0)[None, None]
    row = ambient_occlusion(wall)[0, 0, 32]
    assert row[32] < row[36] < row[44] < 1 and row[20] == 1
    white, black = (between_surfaces(torch.tensor(0.5), torch.tensor(a)) for a in (1.0, 0.0))
    assert float(white) == 1 and float(black) == 0.5


def test_crevices_are_darker_in_the_rooms_light_alone() -> None:
    """A groove: the room's light in it is dimmed, the flash's is not; off by default, and nothing else changes."""
    n = 64
    x = torch.arange(n).expand(n, n)
    slope = torch.where((x >= 26) & (x < 32), -1.5, torch.where((x >= 32) & (x < 38), 1.5, 0.0))
    normal = normals_of(torch.stack((slope, torch.zeros(n, n)))[None])[0]
    maps = torch.cat((torch.full((3, n, n), 0.3), normal, torch.full((1, n, n), 0.9)))
    ambient = {"environment": (0.6, 0.6), "dark": 0.0}
    lit, dimmed = (photo(maps, 0, flash=False, occlusion=o, **ambient).input[0, :3] for o in (0.0, 1.0))
    ratio = (dimmed + 1e-4) / (lit + 1e-4)
    assert float(ratio[:, :, 30:34].mean()) < 0.85 and float(ratio[:, :, :8].mean()) > 0.98
    no_room = {"environment": (0.0, 0.0), "dark": 0.0}
    assert torch.equal(photo(maps, 0, **no_room).input, photo(maps, 0, occlusion=1.0, **no_room).input)
    assert SceneOptions().occlusion == 0
