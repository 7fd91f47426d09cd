"""Photos with known maps, as files that `flashmat eval` and `flashmat learn-crf` read.

`python -m flashmat_train testset --out DIR` renders the *test* materials with Mitsuba 3, which shares no code with the
renderer that the network was trained on; `--renderer ours --split train` makes the photos that the CRFs learn from.
One photo is one folder, DIR/CLASS/MATERIAL__K/:

    photo.png        8-bit sRGB: flash + strength x environment, clamped to (0,1), no noise, no automatic exposure
    albedo.png       16 bit, sRGB-encoded
    normal.png       16 bit, (n+1)/2, OpenGL
    roughness.png    16 bit, linear
    environment.png  16 bit, linear: radiance under the environment alone at strength 1, over `environment_white`
    scene.json       what the photo is of, and the light it was taken in

The flash is where the camera is and gives a flat white Lambertian at the centre radiance 1; an environment of strength
1 gives it luminance 1. Photo K of a material is a function of the seed, the material's place in the list and K. A run
that was stopped goes on where it stopped; DIR/testset.json holds the options, and other options are refused.
"""

from __future__ import annotations

import argparse
import json
import math
import shutil
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import torch
from PIL import Image
from torch import Tensor
from tqdm import tqdm

from . import CLASSES, METAL
from .data.materials import Entry, data_root, load, scan
from .data.pool import Pool, srgb_encode
from .png16 import write_png16
from .render.brdf import blended_f0
from .render.envmap import LUMINANCE, Environments, Source, equirect_directions, random_rotation
from .render.flash import FOV_DEG, fronto_parallel, render_point
from .render.hdr import read_hdr
from .render.mitsuba_scene import PlaneScene

#: Sides of crops as shares of the material's shorter side; smaller ones are blurred at 256².
CROP_SCALES = (0.4, 0.5, 0.6, 0.8, 1.0)
#: Radiance of the highest code in environment.png: a highlight brighter than this is clipped at any strength used.
ENVIRONMENT_WHITE = 8.0

Render = Callable[[PlaneScene, int], tuple[Tensor, Tensor]]


def add_arguments(p: argparse.ArgumentParser) -> None:
    p.add_argument("--data", help="data folder (default: FLASHMAT_DATA)")
    p.add_argument("--out", type=Path, required=True)
    p.add_argument("--split", choices=("train", "val", "test"), default="test")
    p.add_argument("--per-material", type=int, default=10, help="photos of each material")
    p.add_argument("--size", type=int, default=256)
    p.add_argument("--renderer", choices=("mitsuba", "ours"), default="mitsuba")
    p.add_argument("--spp", type=int, default=512, help="Mitsuba's samples a pixel for the environment, a power of 2")
    p.add_argument("--strength", type=float, default=0.8, help="the strongest environment, flash = 1")
    p.add_argument("--seed", type=int, default=2018)
    p.add_argument("--threads", type=int, default=1)


@dataclass
class Shot:
    """One photo before it is taken."""

    name: str  # CLASS/MATERIAL__K
    entry: Entry
    crop_scale: float
    turn: int  # of 45 degrees
    flip: bool
    centre: tuple[float, float]
    environment: Path
    rotation: Tensor  # (3,3), from the environment's frame to the plane's
    strength: float
    seed: int


def shots(entries: list[Entry], environments: list[Path], per_material: int, strength: float, seed: int) -> list[Shot]:
    """All photos, every material's first before any one's second."""
    out = []
    for k in range(per_material):
        for i, entry in enumerate(entries):
            rng = np.random.default_rng((seed, i, k))
            out.append(
                Shot(
                    f"{CLASSES[entry.cls]}/{entry.name}__{k:02d}",
                    entry,
                    float(rng.choice(CROP_SCALES)),
                    int(rng.integers(8)),
                    bool(rng.integers(2)),
                    (float(rng.random()), float(rng.random())),
                    environments[int(rng.integers(len(environments)))],
                    random_rotation(rng),
                    float(rng.uniform(0, strength)),
                    int(rng.integers(2**31)),
                )
            )
    return out


@lru_cache(maxsize=64)
def environment_map(path: Path) -> np.ndarray:
    """Linear RGB, (h,w,3)."""
    return read_hdr(path)


def white_luminance(environment: np.ndarray, rotation: Tensor) -> float:
    """Luminance of a flat white Lambertian plane under an equirectangular map (h,w,3), +z up, turned by `rotation`."""
    h, w, _ = environment.shape
    d, omega = equirect_directions(h, w)
    cos = (d @ rotation[2]).clamp_min(0)
    light = torch.from_numpy(np.ascontiguousarray(environment, np.float32)).reshape(-1, 3) @ torch.tensor(LUMINANCE)
    return float((light * cos * omega).double().sum() / math.pi)


def mitsuba_renderer(spp: int, threads: int) -> Render:
    """(flash, environment) radiance by Mitsuba."""
    from .render import mitsuba_scene

    mi = mitsuba_scene.variant()
    mitsuba_scene.define_bsdf(mi)
    import drjit as dr

    dr.set_thread_count(threads)
    return lambda scene, seed: (
        mitsuba_scene.flash_radiance(mi, scene),
        mitsuba_scene.environment_radiance(mi, scene, spp, seed),
    )


def our_renderer() -> Render:
    """(flash, environment) radiance by the renderer of the training; environments are filtered one at a time."""

    def render(scene: PlaneScene, seed: int) -> tuple[Tensor, Tensor]:
        m = scene.maps[None]
        geometry = fronto_parallel(m.shape[-1], torch.tensor([FOV_DEG]))
        flash = render_point(m[:, :3], m[:, 3:6], m[:, 6:], scene.f0, geometry, scene.light[None])
        env = Environments([Source.of(scene.environment)], 1, 0, [scene.rotation])
        at = torch.tensor([0]), torch.zeros(1)
        around = env.render(*at, m[:, :3], m[:, 3:6], m[:, 6:], scene.f0, geometry.view)
        return flash[0], around[0] / env.gain  # the scene's environment has its gain already

    return render


def take(shot: Shot, pool: Pool, render: Render, size: int, folder: Path) -> None:
    """Renders one photo and writes its folder."""
    angle = shot.turn * math.pi / 4
    maps = pool.crop(0, size, shot.crop_scale, angle, shot.flip, shot.centre)
    f0 = float(blended_f0(torch.tensor([float(shot.entry.cls == METAL)])))
    environment = environment_map(shot.environment)
    gain = 1 / max(white_luminance(environment, shot.rotation), 1e-6)
    light = torch.tensor([0.0, 0.0, 1.0])
    scene = PlaneScene(shot.name, maps, f0, light, environment * np.float32(gain), shot.rotation)
    flash, around = render(scene, shot.seed)
    around = around.clamp(0, ENVIRONMENT_WHITE)
    photo = srgb_encode((flash + shot.strength * around).clamp(0, 1))
    part = folder.with_name(folder.name + ".part")
    shutil.rmtree(part, ignore_errors=True)
    part.mkdir(parents=True)

    def interleaved(x: Tensor) -> np.ndarray:
        return x.permute(1, 2, 0).numpy().astype(np.float64)

    Image.fromarray(np.rint(interleaved(photo) * 255).astype(np.uint8)).save(part / "photo.png")
    write_png16(part / "albedo.png", interleaved(srgb_encode(maps[:3].clamp(0, 1))))
    write_png16(part / "normal.png", interleaved(maps[3:6] * 0.5 + 0.5))
    write_png16(part / "roughness.png", maps[6].numpy().astype(np.float64))
    write_png16(part / "environment.png", interleaved(around / ENVIRONMENT_WHITE))
    facts: dict[str, Any] = {k: v for k, v in asdict(shot).items() if k not in ("entry", "rotation", "environment")}
    facts |= {
        "class": CLASSES[shot.entry.cls],
        "material": shot.entry.name,
        "split": shot.entry.split,
        "fov_deg": FOV_DEG,
        "f0": f0,
        "light": light.tolist(),
        "light_scale": 1.0,
        "environment": shot.environment.name,
        "environment_rotation": shot.rotation.tolist(),
        "environment_gain": gain,
        "environment_strength": facts.pop("strength"),
        "environment_white": ENVIRONMENT_WHITE,
    }
    (part / "scene.json").write_text(json.dumps(facts, indent=1) + "\n")
    part.rename(folder)


def run(args: argparse.Namespace) -> None:
    """Makes the photos that are not there yet."""
    torch.set_num_threads(args.threads)
    root = data_root(args.data)
    entries, problems = scan(root)
    for line in problems:
        print("skipped", line)
    entries = [e for e in entries if e.split == args.split]
    environments = sorted((root / "envmaps").glob("*.hdr"))
    if not entries or not environments:
        raise SystemExit(f"{root}: no materials of the split '{args.split}', or no envmaps/*.hdr")
    options = {k: getattr(args, k) for k in ("split", "per_material", "size", "renderer", "spp", "strength", "seed")}
    options |= {"materials": len(entries), "environments": [f.name for f in environments]}
    args.out.mkdir(parents=True, exist_ok=True)
    described = args.out / "testset.json"
    if described.is_file() and json.loads(described.read_text()) != options:
        raise SystemExit(f"{described}: made with other options or data; give another --out")
    described.write_text(json.dumps(options, indent=1) + "\n")
    wanted = shots(entries, environments, args.per_material, args.strength, args.seed)
    todo = [s for s in wanted if not (args.out / s.name).is_dir()]
    print(f"{args.out}: {len(wanted)} photos of {len(entries)} materials, {len(todo)} to make", flush=True)
    render = mitsuba_renderer(args.spp, args.threads) if args.renderer == "mitsuba" else our_renderer()
    pools: dict[str, Pool] = {}
    for shot in tqdm(todo, mininterval=10):
        key = str(shot.entry.folder)
        if key not in pools:
            pools[key] = Pool([load(shot.entry)])
        take(shot, pools[key], render, args.size, args.out / shot.name)
