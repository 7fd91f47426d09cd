"""Our renderer against Mitsuba 3: the same maps, light and camera, the same BRDF written as a Mitsuba BSDF.

`python -m flashmat_train mitsuba-check --data DIR` prints a table: mean relative error per scene under the flash
alone, under the environment alone, and under both. Mitsuba integrates the environment (512x256, not prefiltered) by
multiple importance sampling; its own noise is estimated from two halves of the samples and printed beside.
"""

from __future__ import annotations

import argparse
import itertools
import math
import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from .. import CLASSES, METAL
from ..data.materials import data_root, load, scan
from ..data.pool import Pool
from .brdf import ALPHA_MIN, blended_f0
from .envmap import Environments, Source
from .flash import FOV_DEG, fronto_parallel, render_point
from .hdr import read_hdr

#: Errors above these fail the stage: flash alone, flash and environment.
LIMITS = (0.01, 0.03)


def add_arguments(p: argparse.ArgumentParser) -> None:
    p.add_argument("--data", help="data folder (default: FLASHMAT_DATA)")
    p.add_argument("--scenes", type=int, default=24)
    p.add_argument("--size", type=int, default=64)
    p.add_argument("--spp", type=int, default=1024, help="Mitsuba's samples a pixel for the environment")
    p.add_argument("--seed", type=int, default=3)
    p.add_argument("--threads", type=int, default=0)


@dataclass
class CheckScene:
    """One material crop under one flash and one environment; `environment` holds radiance where `Environments` has
    it: (h,w,3), +z up, and the rotation from its frame to the plane's."""

    name: str
    maps: Tensor  # (7,n,n)
    f0: float
    light: Tensor  # (3,)
    environment: np.ndarray
    rotation: Tensor  # (3,3)


def variant() -> Any:
    """Mitsuba, set to a vectorised variant; SystemExit with the reason when there is none."""
    try:
        import mitsuba as mi
    except ImportError as e:
        raise SystemExit("this check needs Mitsuba 3: pip install mitsuba") from e
    newest_llvm()
    for name in ("llvm_ad_rgb", "cuda_ad_rgb"):
        try:
            mi.set_variant(name)
            import drjit as dr

            dr.eval(mi.Float([1.0]) + 1)
            return mi
        except Exception as e:  # a missing LLVM library shows only here
            reason = e
    raise SystemExit(f"Mitsuba has no variant that runs here ({reason}); it needs the LLVM library, e.g. libllvm15")


def newest_llvm() -> None:
    """Points Dr.Jit at the newest LLVM here: versions before 16 lack instructions it asks for, and abort."""
    if "DRJIT_LIBLLVM_PATH" in os.environ:
        return
    found = [(int(m[1]), p) for p in Path("/usr/lib").glob("*/libLLVM*.so*") if (m := re.search(r"(\d+)", p.name))]
    if found:
        os.environ["DRJIT_LIBLLVM_PATH"] = str(max(found)[1])


def define_bsdf(mi: Any) -> None:
    """Registers BSDF `flashmat`: the appendix's model in Mitsuba's own terms, nothing shared with `brdf.py`."""
    import drjit as dr

    class Flashmat(mi.BSDF):
        def __init__(self, props: Any):
            mi.BSDF.__init__(self, props)
            self.albedo, self.normal = props["albedo"], props["normal"]
            self.roughness, self.f0 = props["roughness"], props["f0"]
            flags = mi.BSDFFlags.GlossyReflection | mi.BSDFFlags.FrontSide | mi.BSDFFlags.SpatiallyVarying
            self.m_components = [flags]
            self.m_flags = flags

        def _local(self, si: Any, active: Any) -> tuple[Any, Any, Any]:
            n = mi.Vector3f(self.normal.eval(si, active) * 2 - 1)
            r = self.roughness.eval_1(si, active)
            return dr.normalize(n), r, dr.maximum(r * r, ALPHA_MIN)

        def sample(self, ctx: Any, si: Any, sample1: Any, sample2: Any, active: Any = True) -> Any:
            n, _, alpha = self._local(si, active)
            frame = mi.Frame3f(n)
            cosine = frame.to_world(mi.warp.square_to_cosine_hemisphere(sample2))
            cos2 = (1 - sample2.x) / (1 + (alpha * alpha - 1) * sample2.x)
            sin, cos = dr.safe_sqrt(1 - cos2), dr.safe_sqrt(cos2)
            s, c = dr.sincos(2 * dr.pi * sample2.y)
            h = frame.to_world(mi.Vector3f(sin * c, sin * s, cos))
            wo = dr.select(sample1 < 0.5, cosine, 2 * dr.dot(si.wi, h) * h - si.wi)
            bs = mi.BSDFSample3f()
            bs.wo, bs.eta = wo, 1.0
            bs.sampled_type, bs.sampled_component = mi.UInt32(+mi.BSDFFlags.GlossyReflection), mi.UInt32(0)
            bs.pdf = self.pdf(ctx, si, wo, active)
            value = self.eval(ctx, si, wo, active)
            return bs, dr.select(bs.pdf > 0, value / bs.pdf, 0)

        def eval(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            n, r, alpha = self._local(si, active)
            d = self.albedo.eval(si, active)
            nl, nv = dr.dot(n, wo), dr.dot(n, si.wi)
            h = dr.normalize(wo + si.wi)
            vh = dr.dot(si.wi, h)
            a2 = alpha * alpha
            nh2 = dr.square(dr.dot(n, h))
            big_d = a2 / (dr.pi * dr.square(dr.squared_norm(dr.cross(n, h)) + nh2 * a2))
            f = self.f0 + (1 - self.f0) * dr.exp2((-5.55473 * vh - 6.98316) * vh)
            k = dr.square(r + 1) / 8
            g = nl / (nl * (1 - k) + k) * nv / (nv * (1 - k) + k)
            up = active & (nl > 0) & (nv > 0) & (wo.z > 0) & (si.wi.z > 0)
            return dr.select(up, (d / dr.pi + big_d * f * g / (4 * nl * nv)) * nl, 0)

        def pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            n, _, alpha = self._local(si, active)
            h = dr.normalize(wo + si.wi)
            nh, a2 = dr.dot(n, h), alpha * alpha
            big_d = a2 / (dr.pi * dr.square(dr.squared_norm(dr.cross(n, h)) + nh * nh * a2))
            lobe = big_d * dr.abs(nh) / dr.maximum(4 * dr.abs(dr.dot(wo, h)), 1e-9)
            p = 0.5 * dr.maximum(dr.dot(n, wo), 0) / dr.pi + 0.5 * lobe
            return dr.select(active & (wo.z > 0) & (si.wi.z > 0), p, 0)

        def eval_pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            return self.eval(ctx, si, wo, active), self.pdf(ctx, si, wo, active)

        def traverse(self, callback: Any) -> None:
            pass

        def to_string(self) -> str:
            return "Flashmat[]"

    mi.register_bsdf("flashmat", lambda props: Flashmat(props))


def _bitmap(mi: Any, plane: Tensor) -> dict[str, Any]:
    data = plane.flip(1).permute(1, 2, 0).contiguous().numpy()  # v runs up, rows run down
    return {"type": "bitmap", "bitmap": mi.Bitmap(data), "raw": True, "filter_type": "nearest", "wrap_mode": "clamp"}


def _plane(mi: Any, scene: CheckScene, emitter: dict[str, Any]) -> Any:
    t = math.tan(math.radians(FOV_DEG) / 2)
    look = mi.ScalarTransform4f().look_at(origin=[0, 0, 1], target=[0, 0, 0], up=[0, 1, 0])
    n = scene.maps.shape[1]
    return mi.load_dict(
        {
            "type": "scene",
            "plane": {
                "type": "rectangle",
                "to_world": mi.ScalarTransform4f().scale([t, t, 1]),
                "bsdf": {
                    "type": "flashmat",
                    "albedo": _bitmap(mi, scene.maps[:3]),
                    "normal": _bitmap(mi, scene.maps[3:6] * 0.5 + 0.5),
                    "roughness": _bitmap(mi, scene.maps[6:]),
                    "f0": scene.f0,
                },
            },
            "sensor": {
                "type": "perspective",
                "fov": FOV_DEG,
                "to_world": look,
                "film": {"type": "hdrfilm", "width": n, "height": n, "rfilter": {"type": "box"}},
            },
            "light": emitter,
        }
    )


def flash_emitter(scene: CheckScene) -> dict[str, Any]:
    """The point light of `render_point`: irradiance pi at distance 1."""
    return {"type": "point", "position": scene.light.tolist(), "intensity": {"type": "rgb", "value": [math.pi] * 3}}


def environment_emitter(mi: Any, scene: CheckScene) -> dict[str, Any]:
    """The equirectangular map in Mitsuba's frame: y up, longitude running the other way, and its first and last row
    at the poles rather than half a pixel away (resampled finely, so that the light stays what it was)."""
    axes = torch.tensor([[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    m = np.eye(4)
    m[:3, :3] = (scene.rotation @ axes).double().numpy()
    h = scene.environment.shape[0]
    at = np.linspace(0, h, 4 * h).clip(0.5, h - 0.5) - 0.5
    y = np.minimum(at.astype(int), h - 2)
    f = (at - y)[:, None, None]
    rows = scene.environment[y] * (1 - f) + scene.environment[y + 1] * f
    mirrored = np.ascontiguousarray(rows[:, ::-1].astype(np.float32))
    return {"type": "envmap", "bitmap": mi.Bitmap(mirrored), "to_world": mi.ScalarTransform4f(m)}


def mitsuba_render(mi: Any, scene: CheckScene, emitter: dict[str, Any], spp: int, seed: int) -> Tensor:
    """Radiance (3,n,n) of the rays through the pixel centres."""
    import drjit as dr

    world = _plane(mi, scene, emitter)
    n = scene.maps.shape[1]
    total = np.zeros((n * n, 3))
    chunk = max(1, min(spp, (1 << 22) // (n * n)))
    integrator = mi.load_dict({"type": "direct", "emitter_samples": 1, "bsdf_samples": 1})
    for part in range(math.ceil(spp / chunk)):
        index = dr.arange(mi.UInt32, n * n * chunk) // chunk
        centre = mi.Point2f((mi.Float(index % n) + 0.5) / n, (mi.Float(index // n) + 0.5) / n)
        ray, _ = world.sensors()[0].sample_ray(0, 0.5, centre, mi.Point2f(0.5))
        sampler = mi.load_dict({"type": "independent"})
        sampler.seed(seed + part, n * n * chunk)
        value = integrator.sample(world, sampler, mi.RayDifferential3f(ray))[0]
        total += np.asarray(value).T.reshape(n * n, chunk, 3).sum(axis=1)
    return torch.from_numpy(total / (chunk * math.ceil(spp / chunk))).float().T.reshape(3, n, n)


def our_render(scene: CheckScene, env: Environments | None, index: int = 0, flash: bool = True) -> Tensor:
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
) -> list[CheckScene]:
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
            CheckScene(
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


def check(mi: Any, scene: CheckScene, env: Environments, index: int, spp: int, strength: float) -> Row:
    """Renders one scene both ways; `strength` of the environment where flash and environment are added."""
    flash = mitsuba_render(mi, scene, flash_emitter(scene), 1, 0)
    emitter = environment_emitter(mi, scene)
    halves = [mitsuba_render(mi, scene, emitter, spp // 2, seed) for seed in (1, 100_001)]
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
