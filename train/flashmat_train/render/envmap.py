"""Environment light, prefiltered: a diffuse map and a stack of GGX-filtered maps for each environment and rotation.

Maps are octahedral over the sphere about the plane's normal; light from below the plane is left out (the sample
lies on something). Specular light is a split sum: filtered radiance times the directional albedo of the BRDF, which
is tabulated here with the same D, F and G that `brdf.py` renders. The look-up matches moments: the table also holds
the mean vector of the true lobe, whose direction says where to look (rough lobes lean from the mirror direction
towards the normal) and whose length says which filtered level is as wide.
Radiance is scaled so that a flat white Lambertian surface reflects luminance 1. Checked against Mitsuba 3 in
`mitsuba_check.py`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from .brdf import ALPHA_MIN, dot
from .hdr import read_hdr

#: Filtered levels, evenly spaced in `spread` from that of the sharpest to that of roughness 1.
LEVELS = 8
SHARPEST = 0.1
OCT = 40
#: Size that environments are filtered from; the sun is kept apart, at the position it has in the file.
COARSE = (48, 96)
SUNS = 48
LUMINANCE = (0.2126, 0.7152, 0.0722)


def oct_decode(uv: Tensor) -> Tensor:
    """Octahedral coordinates in [-1,1]² (...,2) to unit directions (...,3)."""
    x, y = uv[..., 0], uv[..., 1]
    z = 1 - x.abs() - y.abs()
    fx = torch.where(z >= 0, x, (1 - y.abs()) * x.sign())
    fy = torch.where(z >= 0, y, (1 - x.abs()) * y.sign())
    v = torch.stack((fx, fy, z), dim=-1)
    return v / v.norm(dim=-1, keepdim=True)


def oct_encode(d: Tensor) -> Tensor:
    """Directions (B,3,H,W) to octahedral coordinates (B,H,W,2)."""
    s = d.abs().sum(dim=1).clamp_min(1e-9)
    x, y, below = d[:, 0] / s, d[:, 1] / s, d[:, 2] < 0
    u = torch.where(below, (1 - y.abs()) * torch.where(x < 0, -1.0, 1.0), x)
    v = torch.where(below, (1 - x.abs()) * torch.where(y < 0, -1.0, 1.0), y)
    return torch.stack((u, v), dim=-1)


def equirect_directions(h: int, w: int) -> tuple[Tensor, Tensor]:
    """Directions (h*w,3), z up, and solid angles (h*w,) of an equirectangular map's pixels."""
    theta = (torch.arange(h) + 0.5) * math.pi / h
    phi = (torch.arange(w) + 0.5) * 2 * math.pi / w
    s = torch.sin(theta)[:, None]
    d = torch.stack((s * torch.cos(phi), s * torch.sin(phi), torch.cos(theta)[:, None].expand(h, w)), dim=-1).reshape(
        -1, 3
    )
    band = torch.cos(theta - math.pi / h / 2) - torch.cos(theta + math.pi / h / 2)
    return d, (band * (2 * math.pi / w))[:, None].expand(h, w).reshape(-1)


def random_rotation(rng: np.random.Generator) -> Tensor:
    """A rotation matrix, uniform over the rotations."""
    q = rng.normal(size=4)
    w, x, y, z = q / np.linalg.norm(q)
    m = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return torch.tensor(m, dtype=torch.float32)


def _lobe_samples(samples: int) -> tuple[Tensor, Tensor]:
    """Hammersley points."""
    i = torch.arange(samples)
    return (i + 0.5) / samples, torch.tensor([int(f"{int(k):032b}"[::-1], 2) / 2**32 for k in i])


def directional_albedo(size: int = 32, samples: int = 1024) -> Tensor:
    """(6, size roughness, size NdotV) moments of the specular lobe, by GGX importance sampling.

    Channels 0 and 1: the albedo is f0 * [0] + (1 - f0) * [1]. Channels 2 and 3, 4 and 5: the same two parts of the
    mean vector, weighted by reflectance, as its factors of n and of (n nv - v), which points where v is reflected to.
    """
    r = torch.linspace(0, 1, size)[:, None, None].clamp_min(0.02)
    nv = torch.linspace(0, 1, size)[None, :, None].clamp(1e-3, 0.9999)
    u1, u2 = _lobe_samples(samples)
    a2 = (r * r).clamp_min(ALPHA_MIN) ** 2
    cos = torch.sqrt((1 - u1) / (1 + (a2 - 1) * u1))
    sin = torch.sqrt((1 - cos * cos).clamp_min(0))
    hx = sin * torch.cos(2 * math.pi * u2)
    vx = torch.sqrt(1 - nv * nv)
    vh = (vx * hx + nv * cos).clamp_min(0)
    nl, lx = 2 * vh * cos - nv, 2 * vh * hx - vx
    k = (r + 1) ** 2 / 8
    g = nl / (nl * (1 - k) + k) * nv / (nv * (1 - k) + k)
    # pdf of l is D cos / (4 vh): D F G / (4 nl nv) nl / pdf = F G vh / (nv cos)
    weight = torch.where(nl > 0, g * vh / (nv * cos.clamp_min(1e-6)), torch.zeros(()))
    f = torch.exp2((-5.55473 * vh - 6.98316) * vh)
    parts = [(weight * x * y).mean(-1) for y in (torch.ones(()), nl, -lx / vx) for x in (torch.ones(()), f)]
    return torch.stack(parts)


def mean_length(roughness: Tensor, steps: int = 1024) -> Tensor:
    """Length of the mean vector of the filter's own lobe, where n = v = l's mean; 1 for a mirror, 2/3 for r = 1."""
    theta = (torch.arange(steps, dtype=torch.float64) + 0.5) * (math.pi / 2 / steps)
    # finer steps near the axis, where sharp lobes live
    theta = theta**3 / (math.pi / 2) ** 2
    step = torch.diff(theta, append=torch.tensor([math.pi / 2], dtype=torch.float64))
    w = _kernel(torch.cos(theta), roughness.double()[:, None]) * torch.sin(theta) * step
    return ((w * torch.cos(theta)).sum(-1) / w.sum(-1)).float()


def _kernel(cos: Tensor, roughness: Tensor) -> Tensor:
    """GGX about n = v = the axis, times NdotL: NdotH is the cosine of half the angle."""
    a2 = (roughness * roughness).clamp_min(ALPHA_MIN) ** 2
    c = (a2 - 1) / 2
    bottom = (cos * c).add_(1 + c).square_()  # cos²(angle/2) (a2 - 1) + 1, squared
    return bottom.reciprocal_().mul_(cos.clamp_min(0)).mul_(a2)


def spread(length: Tensor) -> Tensor:
    """Width of a lobe from the length of its mean vector; about linear in roughness."""
    return (1 - length).clamp_min(0).sqrt()


def level_roughness() -> tuple[Tensor, float, float]:
    """Roughness of each level, and the spread of the first and the last."""
    r = torch.linspace(0, 1, 201)
    s = spread(mean_length(r))
    low, high = float(np.interp(SHARPEST, r, s)), float(s[-1])
    at = np.linspace(low, high, LEVELS)
    return torch.tensor(np.interp(at, s, r), dtype=torch.float32), low, high


@dataclass
class Source:
    """An environment as it is filtered: radiance without its brightest pixels (h,w,3), +z up; and those pixels' excess
    over the rest as `SUNS` distant lights, directions (k,3) and irradiance (k,3)."""

    radiance: Tensor
    sun_direction: Tensor
    sun_flux: Tensor

    @staticmethod
    def of(pixels: np.ndarray) -> Source:
        """From an equirectangular map (H,W,3), linear."""
        x = torch.from_numpy(np.ascontiguousarray(pixels, np.float32))
        h, w, _ = x.shape
        d, omega = equirect_directions(h, w)
        flat = x.reshape(-1, 3)
        power = (flat @ torch.tensor(LUMINANCE)) * omega
        top = power.topk(min(SUNS, power.numel() - 1) + 1)
        cap, at = top.values[-1], top.indices[:-1]
        keep = (cap / power[at].clamp_min(1e-30)).clamp_max(1.0)[:, None]
        flux = flat[at] * (1 - keep) * omega[at, None]
        rest = flat.clone()
        rest[at] = flat[at] * keep
        weighted = (rest * omega[:, None]).reshape(h, w, 3).permute(2, 0, 1)[None]
        area = F.interpolate(omega.reshape(1, 1, h, w), size=COARSE, mode="area")
        coarse = F.interpolate(weighted, size=COARSE, mode="area") / area
        return Source(coarse[0].permute(1, 2, 0).contiguous(), d[at], flux)


def _coverage(rotation: Tensor, h: int, w: int, sub: int = 4) -> Tensor:
    """(h*w,) share of each pixel that lies above the plane."""
    d, _ = equirect_directions(h * sub, w * sub)
    above = ((d @ rotation.T)[:, 2] > 0).float().reshape(1, 1, h * sub, w * sub)
    return F.avg_pool2d(above, sub).flatten()


def _octahedron() -> Tensor:
    c = (torch.arange(OCT) + 0.5) * (2.0 / OCT) - 1.0
    return oct_decode(torch.stack(torch.meshgrid(c, c, indexing="xy"), dim=-1)).reshape(-1, 3)


class Environments:
    """Prefiltered environments: `diffuse` (E,3,OCT,OCT) and `specular` (E,3,levels,OCT,OCT)."""

    def __init__(self, sources: list[Source], rotations: int, seed: int, turns: list[Tensor] | None = None):
        """Every source under `rotations` random rotations, or under each of `turns`."""
        rng = np.random.default_rng(seed)
        turns = turns or [random_rotation(rng) for _ in range(rotations)]
        pixels = torch.stack([s.radiance.flatten(0, 1) for s in sources])  # (E,h*w,3)
        suns = torch.stack([s.sun_direction for s in sources]), torch.stack([s.sun_flux for s in sources])
        self.roughness, self.low, self.high = level_roughness()
        x = torch.cat([self._filter(pixels, *suns, turn) for turn in turns]).unflatten(-1, (OCT, OCT))
        up = x[:, :, 0, OCT // 2 - 1 : OCT // 2 + 1, OCT // 2 - 1 : OCT // 2 + 1].mean(dim=(2, 3))
        #: Environment e is source e % len(sources), turned by `rotation[e]` to the plane's frame, times `gain[e]`.
        self.gain = 1 / (up @ torch.tensor(LUMINANCE)).clamp_min(1e-6)
        self.rotation = torch.stack(turns).repeat_interleave(len(sources), dim=0)
        x = x * self.gain[:, None, None, None, None]
        self.diffuse, self.specular = x[:, :, 0].contiguous(), x[:, :, 1:].contiguous()
        self.albedo_table = directional_albedo()

    def _filter(self, pixels: Tensor, sun_direction: Tensor, sun_flux: Tensor, rotation: Tensor) -> Tensor:
        """(E,3,1 + levels,OCT²) filtered maps under one rotation."""
        d, area = equirect_directions(*COARSE)
        out = _octahedron()
        cos = (out @ (d @ rotation.T).T).clamp(-1, 1)
        above = _coverage(rotation, *COARSE)
        sun = sun_direction @ rotation.T  # (E,k,3)
        sun_flux = sun_flux * (sun[..., 2:] > 0)
        sun_cos = torch.einsum("oc,ekc->eok", out, sun).clamp(-1, 1)
        # the suns as part of their pixels, for levels too sharp to hold a point
        row = (torch.acos(sun_direction[..., 2].clamp(-1, 1)) / math.pi * COARSE[0]).long().clamp(0, COARSE[0] - 1)
        turn = torch.atan2(sun_direction[..., 1], sun_direction[..., 0]).remainder(2 * math.pi)
        column = (turn / (2 * math.pi) * COARSE[1]).long().clamp(0, COARSE[1] - 1)
        at = (row * COARSE[1] + column)[..., None].expand_as(sun_flux)
        together = (pixels * above[:, None]).scatter_add(1, at, sun_flux / area[at[..., 0], None])

        def spread_suns(kernel: Tensor) -> Tensor:
            return torch.einsum("eok,ekc->eco", kernel, sun_flux)

        rest = pixels * (above * area)[:, None]
        cosine = cos.clamp_min(0) / math.pi
        maps = [torch.einsum("op,epc->eco", cosine, rest) + spread_suns(sun_cos.clamp_min(0) / math.pi)]
        for r in self.roughness:
            k = _kernel(cos, r)
            norm = (k @ area).clamp_min(1e-12)
            if r < 0.25:
                m = torch.einsum("op,epc->eco", k, together * area[:, None])
            else:
                m = torch.einsum("op,epc->eco", k, rest) + spread_suns(_kernel(sun_cos, r))
            maps.append(m / norm)
        return torch.stack(maps, dim=2)

    @staticmethod
    def from_folder(folder: Path, rotations: int = 6, seed: int = 7) -> Environments:
        files = sorted(folder.glob("*.hdr"))
        if not files:
            raise SystemExit(f"{folder}: no .hdr environment maps")
        return Environments([Source.of(read_hdr(f)) for f in files], rotations, seed)

    def __len__(self) -> int:
        return self.diffuse.shape[0]

    def to(self, device: torch.device | str) -> Environments:
        for name in ("diffuse", "specular", "albedo_table"):
            setattr(self, name, getattr(self, name).to(device))
        return self

    def render(
        self,
        index: Tensor,
        spin: Tensor,
        albedo: Tensor,
        normal: Tensor,
        roughness: Tensor,
        f0: Tensor | float,
        view: Tensor,
    ) -> Tensor:
        """Radiance under environment `index` (B,) turned by `spin` (B,) radians about the plane's normal."""
        n_dot_v = dot(normal, view).clamp(1e-4, 1.0)
        b = normal.shape[0]
        at = torch.stack((n_dot_v[:, 0] * 2 - 1, roughness[:, 0] * 2 - 1), dim=-1)
        table = self.albedo_table
        m = F.grid_sample(table.expand(b, *table.shape), at, padding_mode="border", align_corners=True)
        m = f0 * (m[:, 0::2] - m[:, 1::2]) + m[:, 1::2]  # albedo, mean vector along n and along the mirrored view
        lobe = (m[:, 1:2] + m[:, 2:] * n_dot_v) * normal - m[:, 2:] * view
        length = lobe.square().sum(dim=1, keepdim=True).sqrt()
        width = spread(length / m[:, :1].clamp_min(1e-9))
        # align_corners=False everywhere; the level axis is mapped so that the levels are its centres
        level = (width - self.low) / (self.high - self.low) * 2 - 1
        depth = level.clamp(-1, 1) * ((LEVELS - 1) / LEVELS)
        uv = oct_encode(_spin(lobe / length.clamp_min(1e-9), spin))
        grid = torch.cat((uv, depth[:, 0, ..., None]), dim=-1)[:, None]
        spec = F.grid_sample(self.specular[index], grid, padding_mode="border", align_corners=False)[:, :, 0]
        diff = F.grid_sample(
            self.diffuse[index], oct_encode(_spin(normal, spin)), padding_mode="border", align_corners=False
        )
        return albedo * diff + spec * m[:, :1]


def _spin(d: Tensor, angle: Tensor) -> Tensor:
    c, s = torch.cos(angle)[:, None, None], torch.sin(angle)[:, None, None]
    return torch.stack((c * d[:, 0] - s * d[:, 1], s * d[:, 0] + c * d[:, 1], d[:, 2]), dim=1)
