"""Environment light, prefiltered: a diffuse map and a stack of GGX-filtered maps for each environment and rotation.

Maps are octahedral over the sphere about the plane's normal; light from below the plane is left out (the sample
lies on something). Specular light is the split sum: filtered radiance along the mirror direction times the
directional albedo of the BRDF, which is tabulated here with the same D, F and G that `brdf.py` renders.
Radiance is scaled so that a flat white Lambertian surface reflects luminance 1.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from .brdf import ALPHA_MIN, dot
from .hdr import read_hdr

#: Roughness of the filtered levels, evenly spaced so that one trilinear look-up reads them.
LEVELS = (0.1, 0.25, 0.4, 0.55, 0.7, 0.85, 1.0)
OCT = 40
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


def directional_albedo(size: int = 32, samples: int = 512) -> Tensor:
    """(2, size roughness, size NdotV): specular albedo is f0 * [0] + (1 - f0) * [1], by GGX importance sampling."""
    r = torch.linspace(0, 1, size)[:, None, None].clamp_min(0.02)
    nv = torch.linspace(0, 1, size)[None, :, None].clamp_min(1e-3)
    i = torch.arange(samples)
    u1 = (i + 0.5) / samples
    u2 = torch.tensor([int(f"{int(k):032b}"[::-1], 2) / 2**32 for k in i])
    a2 = (r * r).clamp_min(ALPHA_MIN) ** 2
    cos = torch.sqrt((1 - u1) / (1 + (a2 - 1) * u1))
    sin = torch.sqrt((1 - cos * cos).clamp_min(0))
    hx = sin * torch.cos(2 * math.pi * u2)
    vx = torch.sqrt(1 - nv * nv)
    vh = (vx * hx + nv * cos).clamp_min(0)
    nl = 2 * vh * cos - nv
    k = (r + 1) ** 2 / 8
    g = nl / (nl * (1 - k) + k) * nv / (nv * (1 - k) + k)
    # pdf of l is D cos / (4 vh): D F G / (4 nl nv) nl / pdf = F G vh / (nv cos)
    weight = torch.where(nl > 0, g * vh / (nv * cos.clamp_min(1e-6)), torch.zeros(()))
    f = torch.exp2((-5.55473 * vh - 6.98316) * vh)
    return torch.stack((weight.mean(-1), (weight * f).mean(-1)))


def _filters(rotation: Tensor, h: int, w: int) -> Tensor:
    """(1 + levels, OCT², h*w) weights that filter an equirectangular map: diffuse first, then the GGX levels."""
    d, omega = equirect_directions(h, w)
    d = d @ rotation.T
    omega = torch.where(d[:, 2] > 0, omega, torch.zeros(()))
    c = (torch.arange(OCT) + 0.5) * (2.0 / OCT) - 1.0
    out = oct_decode(torch.stack(torch.meshgrid(c, c, indexing="xy"), dim=-1)).reshape(-1, 3)
    cos = (out @ d.T).clamp(-1, 1)
    full = torch.where(d[:, 2] > 0, 1.0, 0.0)
    area = equirect_directions(h, w)[1]
    filters = [cos.clamp_min(0) * omega / math.pi]
    for r in LEVELS:
        # n = v = mirror direction: NdotH is the cosine of half the angle, weighted by NdotL as usual
        nh2 = (1 + cos) / 2
        a2 = max(r * r, ALPHA_MIN) ** 2
        k = torch.where(cos > 0, a2 / (nh2 * (a2 - 1) + 1).square() * cos, torch.zeros(())) * area
        filters.append(k * full / k.sum(dim=1, keepdim=True).clamp_min(1e-12))
    return torch.stack(filters)


class Environments:
    """Prefiltered environments: `diffuse` (E,3,OCT,OCT) and `specular` (E,3,levels,OCT,OCT)."""

    def __init__(self, maps: list[np.ndarray], rotations: int, seed: int):
        rng = np.random.default_rng(seed)
        stack = torch.stack([torch.from_numpy(m).permute(2, 0, 1) for m in maps])
        stack = F.interpolate(stack, size=(48, 96), mode="area")
        pixels = stack.flatten(2)  # (E,3,h*w)
        parts = []
        for _ in range(rotations):
            f = _filters(random_rotation(rng), 48, 96)
            parts.append(torch.einsum("lop,ecp->eclo", f, pixels))
        x = torch.cat(parts).unflatten(-1, (OCT, OCT))
        up = x[:, :, 0, OCT // 2 - 1 : OCT // 2 + 1, OCT // 2 - 1 : OCT // 2 + 1].mean(dim=(2, 3))
        x = x / (up @ torch.tensor(LUMINANCE)).clamp_min(1e-6)[:, None, None, None, None]
        self.diffuse, self.specular = x[:, :, 0].contiguous(), x[:, :, 1:].contiguous()
        self.albedo_table = directional_albedo()

    @staticmethod
    def from_folder(folder: Path, rotations: int = 6, seed: int = 7) -> Environments:
        files = sorted(folder.glob("*.hdr"))
        if not files:
            raise SystemExit(f"{folder}: no .hdr environment maps")
        return Environments([read_hdr(f) for f in files], rotations, seed)

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
        mirror = 2 * n_dot_v * normal - view
        level = (roughness[:, 0] - LEVELS[0]) / (LEVELS[-1] - LEVELS[0]) * 2 - 1
        b, _h, _w = level.shape
        uv = oct_encode(_spin(mirror, spin))
        # align_corners=False everywhere; the level axis is mapped so that its centres are the LEVELS
        depth = level.clamp(-1, 1) * (len(LEVELS) - 1) / len(LEVELS)
        grid = torch.cat((uv, depth[..., None]), dim=-1)[:, None]
        spec = F.grid_sample(self.specular[index], grid, padding_mode="border", align_corners=False)[:, :, 0]
        diff = F.grid_sample(
            self.diffuse[index], oct_encode(_spin(normal, spin)), padding_mode="border", align_corners=False
        )
        table = self.albedo_table
        at = torch.stack((n_dot_v[:, 0] * 2 - 1, roughness[:, 0] * 2 - 1), dim=-1)
        ab = F.grid_sample(table.expand(b, *table.shape), at, padding_mode="border", align_corners=True)
        return albedo * diff + spec * (f0 * (ab[:, :1] - ab[:, 1:]) + ab[:, 1:])


def _spin(d: Tensor, angle: Tensor) -> Tensor:
    c, s = torch.cos(angle)[:, None, None], torch.sin(angle)[:, None, None]
    return torch.stack((c * d[:, 0] - s * d[:, 1], s * d[:, 0] + c * d[:, 1], d[:, 2]), dim=1)
