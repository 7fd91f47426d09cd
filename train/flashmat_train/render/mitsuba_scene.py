"""A flat material under a flash or an environment in Mitsuba 3, our BRDF written a second time as a Mitsuba BSDF.

Used by `mitsuba_check.py` (is our renderer right?) and by `testset.py` (photos that our renderer had no part in).
"""

from __future__ import annotations

import math
import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from .brdf import ALPHA_MIN
from .flash import FOV_DEG


@dataclass
class PlaneScene:
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
        raise SystemExit("this stage needs Mitsuba 3: pip install mitsuba") from e
    newest_llvm()
    for name in ("llvm_ad_rgb", "cuda_ad_rgb"):
        try:
            mi.set_variant(name)
            import drjit as dr

            dr.eval(mi.Float([1.0]) + 1)
            return mi
        except Exception as e:  # a missing LLVM library shows only here
            reason = e
    raise SystemExit(f"Mitsuba has no variant that runs here ({reason}); it needs the LLVM library, e.g. libllvm19")


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


def plane(mi: Any, scene: PlaneScene, emitter: dict[str, Any]) -> Any:
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


def flash_emitter(scene: PlaneScene) -> dict[str, Any]:
    """The point light of `render_point`: irradiance pi at distance 1."""
    return {"type": "point", "position": scene.light.tolist(), "intensity": {"type": "rgb", "value": [math.pi] * 3}}


def environment_emitter(mi: Any, scene: PlaneScene) -> dict[str, Any]:
    """The equirectangular map in Mitsuba's frame: y up, longitude running the other way, and its first and last row
    at the poles rather than half a pixel away (resampled finely, so that the light stays what it was). What is below
    the plane is black: no light of it gets here, so no sample should go there."""
    axes = torch.tensor([[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    m = np.eye(4)
    m[:3, :3] = (scene.rotation @ axes).double().numpy()
    h = scene.environment.shape[0]
    at = np.linspace(0, h, 4 * h).clip(0.5, h - 0.5) - 0.5
    y = np.minimum(at.astype(int), h - 2)
    f = (at - y)[:, None, None]
    rows = scene.environment[y] * (1 - f) + scene.environment[y + 1] * f
    theta = np.arange(4 * h) * (math.pi / (4 * h - 1))
    phi = (np.arange(rows.shape[1]) + 0.5) * (2 * math.pi / rows.shape[1])
    to_plane = scene.rotation[2].double().numpy()
    flat = np.sin(theta)[:, None] * (to_plane[0] * np.cos(phi) + to_plane[1] * np.sin(phi))
    below = flat + to_plane[2] * np.cos(theta)[:, None] < -2 * math.pi / h
    mirrored = np.ascontiguousarray(np.where(below[..., None], 0, rows)[:, ::-1].astype(np.float32))
    return {"type": "envmap", "bitmap": mi.Bitmap(mirrored), "to_world": mi.ScalarTransform4f(m)}


def flash_radiance(mi: Any, scene: PlaneScene) -> Tensor:
    """Radiance (3,n,n) under the flash of the rays through the pixel centres: exact, there is nothing to sample."""
    world, n = plane(mi, scene, flash_emitter(scene)), scene.maps.shape[1]
    integrator = mi.load_dict({"type": "direct", "emitter_samples": 1, "bsdf_samples": 1})
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(0, n * n)
    value = integrator.sample(world, sampler, mi.RayDifferential3f(centre_rays(mi, world, n)))[0]
    return torch.from_numpy(np.asarray(value)).float().reshape(3, n, n)


def centre_rays(mi: Any, world: Any, n: int) -> Any:
    """One camera ray for each pixel, row by row."""
    import drjit as dr

    index = dr.arange(mi.UInt32, n * n)
    centre = mi.Point2f((mi.Float(index % n) + 0.5) / n, (mi.Float(index // n) + 0.5) / n)
    return world.sensors()[0].sample_ray(0, 0.5, centre, mi.Point2f(0.5))[0]


def environment_radiance(mi: Any, scene: PlaneScene, spp: int, seed: int) -> Tensor:
    """Radiance (3,n,n) under the environment, which nothing on a plane shades: no ray is traced twice.

    Multiple importance sampling (power heuristic, one sample of the emitter and one of the BSDF) at `spp` scrambled
    Sobol points, shifted at random for each pixel; a quarter of the noise of as many independent ones at 256.
    """
    import drjit as dr

    world, n = plane(mi, scene, environment_emitter(mi, scene)), scene.maps.shape[1]
    si = world.ray_intersect(centre_rays(mi, world, n))
    bsdf, env, context = si.bsdf(), world.environment(), mi.BSDFContext()
    points = torch.quasirandom.SobolEngine(5, scramble=True, seed=seed).draw(spp).numpy()
    columns = [mi.Float(np.ascontiguousarray(points[:, k])) for k in range(5)]
    rng = np.random.default_rng(seed)
    shifts = [mi.Float(rng.random(n * n, dtype=np.float32)) for _ in range(5)]
    dr.eval(si, columns, shifts)

    def weight(pdf: Any, other: Any) -> Any:
        return dr.select(pdf > 0, pdf * pdf / (pdf * pdf + other * other), 0)

    def step(i: Any, total: Any) -> tuple[Any, Any]:
        u = [dr.gather(mi.Float, c, i) + s for c, s in zip(columns, shifts, strict=True)]
        u = [x - dr.floor(x) for x in u]
        ds, light = env.sample_direction(si, mi.Point2f(u[0], u[1]))
        value, pdf = bsdf.eval_pdf(context, si, si.to_local(ds.d))
        total = total + value * light * weight(ds.pdf, pdf)
        bs, value = bsdf.sample(context, si, u[2], mi.Point2f(u[3], u[4]))
        seen, ds = dr.zeros(mi.SurfaceInteraction3f, n * n), dr.zeros(mi.DirectionSample3f, n * n)
        ds.d = si.to_world(bs.wo)
        seen.wi = -ds.d
        return i + 1, total + value * env.eval(seen) * weight(bs.pdf, env.pdf_direction(si, ds))

    start = (mi.UInt32(0), mi.Color3f(0))
    _, total = dr.while_loop(start, lambda i, _: i < spp, step, labels=("i", "total"))
    return torch.from_numpy(np.asarray(total)).float().reshape(3, n, n) / spp
