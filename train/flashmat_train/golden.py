"""Golden renders: small maps and their radiance under a few lights, for the Rust renderer to agree with to 1e-4.

`python -m flashmat_train golden --out tests/golden/render` writes `render.json`, which lists the materials and their
renders, and `render.bin`: little-endian f32, planes row by row, top row first, offsets counted in values. A material
is 7 planes (albedo r g b, normal x y z, roughness), a render 3 (r g b, linear, not clamped).
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from .render.brdf import F0_DIELECTRIC, F0_METAL, normalise
from .render.flash import FOV_DEG, fronto_parallel, render_point

SIZE = 16
#: Name, F0, roughness range, slope of the normals.
MATERIALS = (
    ("plaster", F0_DIELECTRIC, (0.7, 1.0), 0.25),
    ("lacquer", F0_DIELECTRIC, (0.08, 0.2), 0.05),
    ("cast", F0_METAL, (0.2, 0.6), 1.5),
)
#: Field of view in degrees, light position, strength.
LIGHTS = (
    (FOV_DEG, (0.0, 0.0, 1.0), 1.0),
    (FOV_DEG, (0.04, -0.02, 1.03), 1.5),
    (60.0, (-1.1, 0.7, 0.6), 0.5),
)


def add_arguments(p: argparse.ArgumentParser) -> None:
    p.add_argument("--out", type=Path, default=Path("tests/golden/render"))
    p.add_argument("--seed", type=int, default=11)


def random_maps(rng: np.random.Generator, rough: tuple[float, float], slope: float) -> Tensor:
    """(7,n,n) maps; some normals of steep materials face away from the camera."""
    albedo = rng.uniform(0.02, 0.98, (3, SIZE, SIZE))
    normal = np.concatenate((rng.normal(0, slope, (2, SIZE, SIZE)), np.ones((1, SIZE, SIZE))))
    roughness = rng.uniform(*rough, (1, SIZE, SIZE))
    maps = torch.tensor(np.concatenate((albedo, normal, roughness)), dtype=torch.float32)
    maps[3:6] = normalise(maps[None, 3:6])[0]
    return maps


def render(maps: Tensor, f0: float, fov: float, light: tuple[float, float, float], strength: float) -> Tensor:
    """Radiance (3,n,n)."""
    m = maps[None]
    geometry = fronto_parallel(SIZE, torch.tensor([fov]))
    return render_point(m[:, :3], m[:, 3:6], m[:, 6:], f0, geometry, torch.tensor([light]))[0] * strength


def run(args: argparse.Namespace) -> None:
    rng = np.random.default_rng(args.seed)
    planes: list[np.ndarray] = []
    offset, materials = 0, []

    def put(x: Tensor) -> int:
        nonlocal offset
        planes.append(x.contiguous().numpy().astype("<f4").ravel())
        start, offset = offset, offset + x.numel()
        return start

    for name, f0, rough, slope in MATERIALS:
        maps = random_maps(rng, rough, slope)
        entry = {"name": name, "f0": f0, "maps": put(maps), "renders": []}
        for fov, light, strength in LIGHTS:
            at = put(render(maps, f0, fov, light, strength))
            entry["renders"].append({"fov_deg": fov, "light": light, "strength": strength, "radiance": at})
        materials.append(entry)
    args.out.mkdir(parents=True, exist_ok=True)
    (args.out / "render.bin").write_bytes(np.concatenate(planes).tobytes())
    table = {"seed": args.seed, "size": SIZE, "values": offset, "materials": materials}
    (args.out / "render.json").write_text(json.dumps(table, indent=1) + "\n")
    print(f"{args.out}: {offset * 4} bytes, {len(materials)} materials under {len(LIGHTS)} lights")
