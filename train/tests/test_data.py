"""Folders, crops, augmentation, procedural pools, packs."""

from __future__ import annotations

import argparse
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
import torch.nn.functional as F
from PIL import Image
from small_data import material, sky, write_hdr, write_material

from flashmat_train import CLASSES, METAL
from flashmat_train.data import procedural_pool
from flashmat_train.data.batches import Crops, SceneOptions, batches, render_batch
from flashmat_train.data.materials import data_root, load, scan
from flashmat_train.data.pool import (
    Pool,
    blended,
    dyed,
    lightened,
    scale_maps,
    srgb_decode,
    srgb_encode,
    tinted,
    to_bytes,
    to_float,
)
from flashmat_train.data.procedural_fresh import WINDOW, FreshPool
from flashmat_train.pack import pack, unpack
from flashmat_train.render.camera import CameraNoise
from flashmat_train.render.envmap import Environments, Source
from flashmat_train.render.flash import FOV_DEG, fronto_parallel, render_point
from flashmat_train.render.hdr import read_hdr


def test_srgb_round_trip() -> None:
    codes = torch.arange(256) / 255
    assert torch.equal((srgb_encode(srgb_decode(codes)) * 255).round(), codes * 255)
    assert srgb_decode(torch.tensor(0.5)).item() == pytest.approx(0.2140411, abs=1e-6)
    assert srgb_encode(torch.tensor(0.002)).item() == pytest.approx(0.02584, abs=1e-6)


def test_bytes_round_trip() -> None:
    maps = torch.from_numpy(material(1).maps)
    again = to_bytes(to_float(maps))
    assert torch.equal(again[:3], maps[:3]) and torch.equal(again[6], maps[6])
    assert (again[3:6].int() - maps[3:6].int()).abs().max() <= 1


def test_scan_names_bad_folders(tmp_path: Path) -> None:
    root = tmp_path / "materials"
    for name in ("good", "lacking", "uneven", "broken", "small"):
        write_material(root / "wood" / name, 1, 96 if name == "small" else 160)
    write_material(root / "water" / "sea", 1)
    (root / "wood" / "lacking" / "normal.png").unlink()
    Image.new("L", (170, 160)).save(root / "wood" / "uneven" / "roughness.png")
    (root / "wood" / "broken" / "albedo.png").write_bytes(b"not a picture")
    entries, problems = scan(tmp_path)
    assert [e.name for e in entries] == ["good"]
    text = "\n".join(problems)
    for needle in ("lacking: no normal map", "uneven: map sizes differ", "broken", "small: maps under 128", "water"):
        assert needle in text
    assert len(problems) == 5
    # cut short: the header is fine, the pixels are not
    data = (root / "wood" / "good" / "albedo.png").read_bytes()
    (root / "wood" / "good" / "albedo.png").write_bytes(data[: len(data) // 2])
    with pytest.raises(OSError, match="good"):
        load(scan(tmp_path)[0][0])


def test_no_data_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("FLASHMAT_DATA", raising=False)
    with pytest.raises(SystemExit, match="FLASHMAT_DATA"):
        data_root(None)
    with pytest.raises(SystemExit, match="materials"):
        data_root(str(tmp_path))


def test_hdr_reads_what_was_written(tmp_path: Path) -> None:
    want = sky(2, 16)
    write_hdr(tmp_path / "a.hdr", want)
    assert np.abs(read_hdr(tmp_path / "a.hdr") - want).max() / want.max() < 0.01
    (tmp_path / "b.hdr").write_bytes(b"#?RADIANCE\n\n-Y 16 +X 32\n\x02\x02\x00\x20\x90")
    with pytest.raises(ValueError, match=r"b\.hdr"):
        read_hdr(tmp_path / "b.hdr")


def render(maps: torch.Tensor, light: torch.Tensor) -> torch.Tensor:
    m = maps[None]
    geometry = fronto_parallel(m.shape[-1], torch.tensor([FOV_DEG]))
    return render_point(m[:, :3], m[:, 3:6], m[:, 6:], 0.05, geometry, light[None])[0]


def turned_light(light: torch.Tensor, angle: float, flip: bool) -> torch.Tensor:
    """Where the light must be for a crop turned by `angle` and flipped: its target shows the source at R(angle)."""
    c, s = math.cos(angle), math.sin(angle)
    x, y = c * light[0] - s * light[1], s * light[0] + c * light[1]
    return torch.stack((-x if flip else x, y, light[2]))


@pytest.mark.parametrize("flip", [False, True])
@pytest.mark.parametrize("quarter", range(4))
def test_render_of_turned_maps_is_turned_render(quarter: int, flip: bool) -> None:
    """Exact for quarter turns: pixels fall on pixels."""
    pool, light = Pool([material(5)]), torch.tensor([0.5, 0.2, 0.8])
    place = {"i": 0, "size": 128, "scale": 0.8, "centre": (0.5, 0.5)}
    straight = render(pool.crop(angle=0.0, flip=False, **place), light)
    angle = quarter * math.pi / 2
    turned = render(pool.crop(angle=angle, flip=flip, **place), turned_light(light, angle, flip))
    want = torch.rot90(straight, quarter, (1, 2))
    if flip:
        want = want.flip(2)
    assert (turned - want).abs().max() < 2e-3


@pytest.mark.parametrize("flip", [False, True])
def test_render_of_maps_turned_by_45_degrees(flip: bool) -> None:
    """Up to interpolation, inside the circle that both crops hold."""
    pool, light = Pool([material(6, size=256)]), torch.tensor([0.3, -0.6, 0.9])
    place = {"i": 0, "size": 128, "scale": 0.5, "centre": (0.45, 0.55)}
    angle = math.pi / 4
    straight = render(pool.crop(angle=0.0, flip=False, **place), light)
    turned = render(pool.crop(angle=angle, flip=flip, **place), turned_light(light, angle, flip))
    u = (torch.arange(128) + 0.5) / 64 - 1
    y, x = torch.meshgrid(u, u, indexing="ij")
    x_in = -x if flip else x
    c, s = math.cos(angle), math.sin(angle)
    grid = torch.stack((c * x_in - s * y, s * x_in + c * y), -1)[None]
    want = F.grid_sample(straight[None], grid, align_corners=False)[0]
    inside = (x * x + y * y < 0.9)[None].expand_as(want)
    error = (turned - want).abs()[inside] / want[inside]
    print(f"mean relative difference {error.mean():.4f}")
    assert error.mean() < 0.01


def test_crops_wrap_around() -> None:
    """A crop about a corner of a tiling material is what the material rolled by half shows at its centre."""
    m = material(8)
    rolled = type(m)(0, "rolled", np.roll(m.maps, (80, 80), axis=(1, 2)))
    pool = Pool([m, rolled])
    corner = pool.crop(0, 128, 0.8, 0.0, False, (0.0, 0.0))
    assert torch.allclose(corner, pool.crop(1, 128, 0.8, 0.0, False, (0.5, 0.5)), atol=1e-6)


def test_scaling_keeps_maps_valid() -> None:
    maps = to_float(torch.from_numpy(material(2).maps))
    for seed in range(20):
        x = scale_maps(maps, seed % len(CLASSES), np.random.default_rng(seed))
        assert (x[3:6].norm(dim=0) - 1).abs().max() < 1e-5
        assert x[:3].min() >= 0 and x[:3].max() <= 1 and x[6].min() >= 0.02 and x[6].max() <= 1


@pytest.mark.parametrize(("cls", "bounds"), [(METAL, (0.35, 1.3)), (0, (0.65, 1.4))])
def test_albedo_scales_are_even_in_their_logarithm(cls: int, bounds: tuple[float, float]) -> None:
    grey = torch.cat(
        (torch.full((3, 2, 2), 0.5), torch.zeros(2, 2, 2), torch.ones(1, 2, 2), torch.full((1, 2, 2), 0.5))
    )
    factors = np.array([float(scale_maps(grey, cls, np.random.default_rng(s))[0, 0, 0]) / 0.5 for s in range(2000)])
    low, high = np.log(bounds)
    place = (np.log(factors) - low) / (high - low)
    assert place.min() >= -1e-5 and place.max() <= 1 + 1e-5
    assert abs(place.mean() - 0.5) < 0.02 and abs(place.std() - 12**-0.5) < 0.01


def test_blends_lie_between_two_materials() -> None:
    a, b = (to_float(torch.from_numpy(material(s).maps)) for s in (2, 5))
    assert torch.allclose(blended(a, b, 0.0), a, atol=1e-5) and torch.allclose(blended(a, b, 1.0), b, atol=1e-5)
    half = blended(a, b, 0.5)
    assert torch.allclose(half[[0, 1, 2, 6]], (a + b)[[0, 1, 2, 6]] / 2, atol=1e-6)
    slope = [m[3:5] / m[5] for m in (a, b, half)]
    assert torch.allclose(slope[2], (slope[0] + slope[1]) / 2, atol=1e-4)
    tint = tinted(a, np.random.default_rng(1))
    ratio = (tint[:3] / a[:3].clamp_min(1e-3)).flatten(1)
    assert torch.equal(tint[3:], a[3:]) and ratio.std(dim=1).max() < 0.05 and ratio.mean(dim=1).std() > 0.02


def test_dyes_and_brightness_change_the_albedo_alone() -> None:
    x = to_float(torch.from_numpy(material(2).maps))
    rng = np.random.default_rng(4)
    orders = set()
    for _ in range(40):
        y = dyed(x, rng)
        assert torch.equal(y[3:], x[3:]) and torch.equal(y[:3].sort(dim=0)[0], x[:3].sort(dim=0)[0])
        orders.add(tuple(next(i for i in range(3) if torch.equal(y[c], x[i])) for c in range(3)))
    assert len(orders) == 6
    means = []
    for _ in range(40):
        y = lightened(x, rng)
        assert torch.equal(y[3:], x[3:]) and y[:3].min() >= 0 and y[:3].max() <= 1
        assert torch.equal(y[0].flatten().argsort(stable=True), x[0].flatten().argsort(stable=True))
        means.append(float(y[:3].mean()))
    assert min(means) < 0.75 * float(x[:3].mean()) and max(means) > 1.3 * float(x[:3].mean())


def test_crops_of_a_class_are_blended_within_it() -> None:
    """Red and green of class 1, blue of class 3: blends of the first two occur, of the third with others none."""
    colours = np.zeros((3, 7, 160, 160), np.uint8)
    colours[:, 3:5], colours[:, 5:] = 128, 255
    for i in range(3):
        colours[i, i] = 200
    pools = [
        (Pool([type(material(1))(c, str(i), m) for i, (c, m) in enumerate(zip((1, 1, 3), colours, strict=True))]), 1.0)
    ]
    crops = Crops(pools, 128, 3, True, 200)
    blends = 0
    for i in range(len(crops)):
        maps, cls = crops[i]
        red, green, blue = (float(c) > 0.01 for c in maps[:3].mean(dim=(1, 2)))
        assert blue == (cls == 3) and not (blue and (red or green))
        blends += red and green
    assert 10 < blends < 40


def test_folds_part_the_materials_of_every_class() -> None:
    materials = [replace(material(i, cls), name=str(i)) for i, cls in enumerate((0, 0, 3, 0, 3, 0, 3, 5))]
    pool = Pool(materials)
    parts = [pool.fold(k, 3) for k in range(3)]
    assert sorted(name for p in parts for name in p.names) == sorted(pool.names)
    for cls, count in ((0, 4), (3, 3), (5, 1)):
        shares = [int((p.classes == cls).sum()) for p in parts]
        assert sum(shares) == count and max(shares) - min(shares) <= 1
    for p in parts:
        assert p.weight.sum() == pytest.approx(1) and len(p.levels) == len(p.classes) == len(p)
        for name, levels in zip(p.names, p.levels, strict=True):
            assert levels[0] is pool.levels[pool.names.index(name)][0]


def test_rooms_are_even_and_known() -> None:
    """The room's light that a batch tells is what the photo was lit with: its own share of a flat white plane."""
    white = torch.cat((torch.ones(3, 128, 128), torch.zeros(2, 128, 128), torch.ones(2, 128, 128)))
    options = SceneOptions(
        camera=CameraNoise(plain=1.0),
        tilt_sigma=0.0,
        light_sigma=0.0,
        beside=0.0,
        fov_exact=1.0,
        environment=(0.0, 0.8),
    )
    env = Environments([Source.of(sky(1))], 1, 0)
    rooms = []
    for seed in range(8):
        maps = torch.stack([white * 0.25, white * 0.25])
        maps[:, 5:] = 1
        cls = torch.zeros(2, dtype=torch.long)
        batch = render_batch(maps, cls, env, options, np.random.default_rng(seed))
        flash = render_batch(maps, cls, env, replace(options, environment=(0.0, 0.0)), np.random.default_rng(seed))
        light = [srgb_decode(b.input[:, :3]).mean(dim=(1, 2, 3)) for b in (batch, flash)]
        told = batch.target["room"]
        # rough and dielectric: the highlight of room and flash adds a little to the diffuse part
        assert torch.allclose(light[0] - light[1], 0.25 * told, rtol=0.35, atol=0.01)
        rooms += told.tolist()
    assert min(rooms) >= 0 and max(rooms) <= 0.8 and 0.25 < float(np.mean(rooms)) < 0.55


def test_half_of_the_flashes_are_beside_the_camera() -> None:
    """The share, the reach, and every direction; a flat glossy plane mirrors such a flash half way from the centre."""
    gloss = torch.zeros(7, 128, 128)
    gloss[:3], gloss[5], gloss[6] = 0.05, 1.0, 0.2
    count = 64
    maps, cls = gloss.expand(count, 7, 128, 128), torch.zeros(count, dtype=torch.long)
    options = SceneOptions(
        camera=CameraNoise(plain=1.0),
        tilt_sigma=0.0,
        light_sigma=0.0,
        fov_exact=1.0,
        environment=(0.0, 0.0),
        second_lobe=0.0,
    )
    env = Environments([Source.of(sky(1))], 1, 0)
    batch = render_batch(maps, cls, env, options, np.random.default_rng(4))
    beside = batch.light[:, :2]
    radius = beside.norm(dim=1)
    assert torch.equal(batch.light[:, 2], torch.ones(count))
    away = radius > 0
    assert 0.3 * count < int(away.sum()) < 0.7 * count and 0.15 < float(radius.max()) <= options.beside_reach
    assert len({(bool(x > 0), bool(y > 0)) for x, y in beside[away]}) == 4
    light = srgb_decode(batch.input[:, :3]).mean(dim=1)
    weight = (light - light.amax(dim=(1, 2), keepdim=True) * 0.7).clamp_min(0)[:, None]
    place = (batch.points[:, :2] * weight).sum(dim=(2, 3)) / weight.sum(dim=(2, 3))
    assert torch.allclose(place, beside / 2, atol=0.02)
    none = render_batch(maps, cls, env, replace(options, beside=0.0), np.random.default_rng(4))
    assert not none.light[:, :2].any()


def test_batches_do_not_depend_on_workers_or_start() -> None:
    pools = [(Pool([material(1, 0), material(2, 3)]), 1.0)]
    env = Environments([Source.of(sky(1))], 1, 0)

    def take(workers: int, start: int) -> list[torch.Tensor]:
        crops = Crops(pools, 128, 5, True, 8)
        return [b.input for b in batches(crops, env, SceneOptions(), 2, start, "cpu", workers)]

    whole = take(0, 0)
    assert len(whole) == 4
    for other in (take(2, 0), [*whole[:2], *take(0, 2)]):
        assert all(torch.equal(a, b) for a, b in zip(whole, other, strict=True))


def test_procedural_pool(tmp_path: Path) -> None:
    args = argparse.Namespace(out=tmp_path, count=3, size=128, seed=2, threads=1)
    procedural_pool.run(args)
    procedural_pool.run(args)  # those already there stay
    materials = procedural_pool.read_pool(tmp_path)
    assert [m.cls for m in materials] == sorted(m.cls for m in materials) == [0, 1, 2]
    assert all(m.maps.shape == (7, 128, 128) and m.maps.dtype == np.uint8 for m in materials)
    assert materials[0].name.startswith(CLASSES[0])
    np.save(tmp_path / "wood--plank--9.npy", np.zeros((3, 4)))
    with pytest.raises(SystemExit, match="wood--plank--9"):
        procedural_pool.read_pool(tmp_path)
    with pytest.raises(SystemExit, match="procedural"):
        procedural_pool.read_pool(tmp_path / "empty")


def test_fresh_materials_follow_the_sample_number() -> None:
    pool = FreshPool(seed=3, lanes=2, batch=2, reuse=4, size=128)

    def numbers(samples: range) -> set[int]:
        return {pool.number(np.random.default_rng(i), i) for i in samples}

    assert len(numbers(range(400))) > 60
    lane0 = {pool.number(np.random.default_rng(i), i) for b in range(0, 50, 2) for i in (2 * b, 2 * b + 1)}
    assert all(n % 2 == 0 for n in lane0) and max(lane0) <= 2 * (50 * 2 // 2 // 4 + WINDOW)
    one, cls = pool.draw_for(5, np.random.default_rng(5), 128)
    again, other = FreshPool(3, 2, 2, 4, 128).draw_for(5, np.random.default_rng(5), 128)
    assert cls == other and torch.equal(one, again) and one.shape == (7, 128, 128)


def test_pack_round_trip(data_folder: Path, tmp_path: Path) -> None:
    entries = [e for e in scan(data_folder)[0] if e.split != "test"]
    sources = [Source.of(read_hdr(f)) for f in sorted((data_folder / "envmaps").glob("*.hdr"))]
    path = tmp_path / "materials.pack"
    quality = pack(entries, sources, path, 144, 20.0)
    train, val, env = unpack(path, rotations=1)
    assert quality == 93 and len(train) == 16 and len(val) == 8 and len(env) == 2
    straight = Environments(sources, 1, 7)
    assert (env.specular - straight.specular).abs().max() < 0.01 * straight.specular.max()
    by_name = {m.name: m for m in train}
    for e in entries:
        if e.split == "train":
            maps = by_name[e.name].maps
            assert maps.shape == (7, 144, 144) and by_name[e.name].cls == e.cls
    small = Pool([by_name[entries[0].name]]).crop(0, 128, 0.9, 0.0, False, (0.5, 0.5))
    full = Pool([load(entries[0])]).crop(0, 128, 0.9, 0.0, False, (0.5, 0.5))
    assert (small - full).abs().mean() < 0.02
    with pytest.raises(SystemExit, match="do not fit"):
        pack(entries, sources, path, 144, 0.01)
    path.write_bytes(path.read_bytes()[:1000])
    with pytest.raises(SystemExit, match=r"materials\.pack"):
        unpack(path)
