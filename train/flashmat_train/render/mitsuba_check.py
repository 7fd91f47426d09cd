"""Our renderer against Mitsuba 3: the same maps, light and camera, the same BRDF written as a Mitsuba BSDF.

`python -m flashmat_train mitsuba-check --data DIR` prints a table: mean relative error per scene under the flash
alone, under the environment alone, and under both. Mitsuba integrates the environment (512x256, not prefiltered) by
multiple importance sampling; its own noise is estimated from two halves of the samples and printed beside.
"""

from __future__ import annotations

import argparse
import itertools
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from .. import CLASSES, METAL
from ..data.materials import data_root, load, scan
from ..data.pool import Pool
from .brdf import blended_f0
from .envmap import Environments, Source
from .flash import FOV_DEG, fronto_parallel, render_point
from .hdr import read_hdr
from .mitsuba_scene import PlaneScene, define_bsdf, environment_radiance, flash_radiance, variant

#: Errors above these fail the stage: flash alone, flash and environment.
LIMITS = (0.01, 0.03)


def add_arguments(p: argparse.ArgumentParser) -> None:
    p.add_argument("--data", help="data folder (default: FLASHMAT_DATA)")
    p.add_argument("--scenes", type=int, default=24)
    p.add_argument("--size", type=int, default=64)
    p.add_argument("--spp", type=int, default=1024, help="Mitsuba's samples a pixel for the environment")
    p.add_argument("--seed", type=int, default=3)
    p.add_argument("--threads", type=int, default=0)


def our_render(scene: PlaneScene, env: Environments | None, index: int = 0, flash: bool = True) -> Tensor:
    """The same scene by our renderer, (3,n,n)."""
    m = scene.maps[None]
    geometry = fronto_parallel(m.shape[-1], torch.tensor([FOV_DEG]))
    out = torch.zeros_like(m[:, :3])
    if flash:
        out = out + render_point(m[:, :3], m[:, 3:6], m[:, 6:], scene.f0, geometry, scene.light[None])
    if env is not None:
        at = torch.tensor([index]), torch.zeros(1)
        out = out + env.render(*at, m[:, :3], m[:, 3:6], m[:, 6:], scene.f0, geometry.view)
    return out[0]


def check_scenes(
    pool: Pool, env: Environments, maps: list[np.ndarray], count: int, size: int, seed: int
) -> list[PlaneScene]:
    """Crops of different materials, classes in turn, each with its own flash and environment (number i % len(env))."""
    rng = np.random.default_rng(seed)
    order = rng.permutation(len(pool))
    by_class = [[int(i) for i in order if pool.classes[i] == c] for c in range(len(CLASSES))]
    in_turn = [i for row in itertools.zip_longest(*by_class) for i in row if i is not None]
    scenes = []
    for i in in_turn[:count]:
        e = len(scenes) % len(env)
        crop = pool.crop(i, size, float(rng.choice((0.25, 0.5, 1.0))), 0.0, False, rng.random(2))
        z = rng.uniform(0.5, 1.0)
        phi = rng.uniform(0, 2 * math.pi)
        light = np.array([math.sqrt(1 - z * z) * math.cos(phi), math.sqrt(1 - z * z) * math.sin(phi), z])
        f0 = float(blended_f0(torch.tensor([float(pool.classes[i] == METAL)])))
        scenes.append(
            PlaneScene(
                f"{CLASSES[pool.classes[i]]}/{pool.names[i]}",
                crop,
                f0,
                torch.tensor(light * rng.uniform(1.0, 1.6), dtype=torch.float32),
                maps[e % len(maps)] * float(env.gain[e]),
                env.rotation[e],
            )
        )
    return scenes


def relative_error(ours: Tensor, theirs: Tensor, floor: float = 1e-3) -> float:
    """Mean over pixels and channels of |ours - theirs| / theirs; nearly black values count against `floor`."""
    return float(((ours - theirs).abs() / theirs.clamp_min(floor)).mean())


@dataclass
class Row:
    """Mean relative errors of one scene."""

    name: str
    flash: float
    environment: float
    both: float
    noise: float  # of Mitsuba's own environment render: |half - other half| / 2


def check(mi: Any, scene: PlaneScene, env: Environments, index: int, spp: int, strength: float) -> Row:
    """Renders one scene both ways; `strength` of the environment where flash and environment are added."""
    flash = flash_radiance(mi, scene)
    halves = [environment_radiance(mi, scene, spp // 2, seed) for seed in (1, 100_001)]
    around = (halves[0] + halves[1]) / 2
    our_flash = our_render(scene, None)
    our_around = our_render(scene, env, index, flash=False)
    return Row(
        scene.name,
        relative_error(our_flash, flash),
        relative_error(our_around, around),
        relative_error(our_flash + strength * our_around, flash + strength * around),
        relative_error(halves[0], halves[1]) / 2,
    )


def run(args: argparse.Namespace) -> None:
    """Checks `scenes` scenes of training and validation materials; exits 1 over the limits."""
    if args.threads:
        torch.set_num_threads(args.threads)
    mi = variant()
    define_bsdf(mi)
    root = data_root(args.data)
    entries = [e for e in scan(root)[0] if e.split != "test"]
    rng = np.random.default_rng(args.seed)
    chosen = [entries[i] for i in rng.permutation(len(entries))[: 3 * args.scenes]]
    files = sorted((root / "envmaps").glob("*.hdr"))
    maps = [read_hdr(files[i]) for i in rng.permutation(len(files))[: args.scenes]]
    env = Environments([Source.of(m) for m in maps], 1, args.seed)
    pool = Pool([load(e) for e in chosen])
    rows = []
    for i, scene in enumerate(check_scenes(pool, env, maps, args.scenes, args.size, args.seed)):
        row = check(mi, scene, env, i % len(env), args.spp, float(rng.uniform(0.1, 0.8)))
        rows.append(row)
        print(
            f"{row.name:46.46s} flash {row.flash:8.5%}  environment {row.environment:6.2%}"
            f"  both {row.both:6.2%}  noise {row.noise:6.2%}",
            flush=True,
        )
    flash, both = (float(np.mean([getattr(r, k) for r in rows])) for k in ("flash", "both"))
    around, worst = float(np.mean([r.environment for r in rows])), max(r.both for r in rows)
    print(f"mean of {len(rows)}: flash {flash:.5%}, environment {around:.2%}, both {both:.2%} (worst {worst:.2%})")
    if flash > LIMITS[0] or both > LIMITS[1]:
        raise SystemExit(f"over the limits of {LIMITS[0]:.0%} (flash) and {LIMITS[1]:.0%} (flash and environment)")
