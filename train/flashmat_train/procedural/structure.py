"""From structure to maps: the `Surface` a family returns, heights to normals, cavities, masks, colours."""

from __future__ import annotations

import colorsys
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from .noise import Draw, blur

Colour = tuple[float, float, float]


@dataclass
class Surface:
    """What a family makes. Colours are sRGB-encoded here (easier to think of); `finish` linearises."""

    albedo: Tensor  # (3, n, n) sRGB-encoded
    height: Tensor  # (n, n), any unit: `slope` sets the scale
    roughness: Tensor  # (n, n)
    slope: float  # root mean square slope of the finished normals, before the soft limit
    limit: float = 2.5  # steepest slope
    metallic: Tensor | None = None  # (n, n) in [0, 1], of a surface that is metal in places


@dataclass
class Material:
    """Maps of one material: linear albedo (3,n,n), unit normal (3,n,n; x right, y up), roughness (1,n,n)."""

    albedo: Tensor
    normal: Tensor
    roughness: Tensor
    cls: int
    family: str
    metallic: Tensor | None = None  # (1,n,n); None: all or nothing, as the class says


def srgb_to_linear(x: Tensor) -> Tensor:
    return torch.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055).clamp_min(0).pow(2.4))


def linear_to_srgb(x: Tensor) -> Tensor:
    return torch.where(x <= 0.0031308, x * 12.92, 1.055 * x.clamp_min(1e-8).pow(1 / 2.4) - 0.055)


def gradient(height: Tensor) -> tuple[Tensor, Tensor]:
    """Periodic slopes per tile width, towards the right and towards the image's bottom."""
    n = height.shape[-1]
    gx = (torch.roll(height, -1, -1) - torch.roll(height, 1, -1)) * (n / 2)
    gy = (torch.roll(height, -1, -2) - torch.roll(height, 1, -2)) * (n / 2)
    return gx, gy


def rms_slope(height: Tensor) -> float:
    gx, gy = gradient(height)
    return float((gx * gx + gy * gy).mean().sqrt())


def to_slope(height: Tensor, slope: float) -> Tensor:
    """``height`` scaled to a root mean square slope: lets layers of relief be added in known shares."""
    return height * (slope / max(rms_slope(height), 1e-6))


def height_to_normal(height: Tensor, slope: float, limit: float = 2.5) -> Tensor:
    """Unit normals, y up, of a height scaled to r.m.s. ``slope``; slopes bend softly towards ``limit``."""
    gx, gy = gradient(height)
    rms = (gx * gx + gy * gy).mean().sqrt().clamp_min(1e-6)
    gx, gy = gx * (slope / rms), gy * (slope / rms)
    soft = torch.rsqrt(1 + (gx * gx + gy * gy) / limit**2)
    normal = torch.stack((-gx * soft, gy * soft, torch.ones_like(gx)))
    return normal / normal.norm(dim=0, keepdim=True)


# How far roughness follows luminance, by class: mean and deviation over materials, in 0.05 of roughness for
# each deviation of luminance. Pale fibres and grains lie on top and are smoother.
COUPLING: dict[str, tuple[float, float]] = {
    "fabric": (-0.75, 0.6),
    "ground": (-0.5, 0.5),
    "leather": (0.2, 0.35),
    "metal": (-0.05, 0.35),
    "stone-diff": (-0.45, 0.5),
    "stone-spec": (0.0, 0.25),
    "polymer": (0.25, 0.3),
    "wood": (-0.45, 0.5),
}


# Least share of the albedo's contrast that is kept, by class: real maps range from plain to busy.
CONTRAST: dict[str, float] = {"metal": 0.35, "stone-spec": 0.5, "polymer": 0.4}


def season(d: Draw, s: Surface, cls: str) -> Surface:
    """What holds for every family: colour contrast and sharpness vary; roughness follows luminance a little."""
    albedo = s.albedo.clamp(0, 1)
    middle = albedo.mean((1, 2), keepdim=True)
    albedo = middle + d.uniform(CONTRAST.get(cls, 0.65), 1.15) * (albedo - middle)
    s.albedo = blur(albedo, d.uniform(0.1, 0.45) / albedo.shape[-1])
    mean, spread = COUPLING[cls]
    light = s.albedo.clamp(0, 1).mean(0)
    light = ((light - light.mean()) / (light.std() + 1e-3)).clamp(-2.5, 2.5)
    s.roughness = s.roughness + 0.05 * d.normal(mean, spread) * light
    return s


def finish(s: Surface, cls: int, family: str) -> Material:
    return Material(
        srgb_to_linear(s.albedo.clamp(0, 1)).clamp(0, 1).contiguous(),
        height_to_normal(s.height, s.slope, s.limit),
        s.roughness.clamp(0.02, 1.0)[None].contiguous(),
        cls,
        family,
        None if s.metallic is None else s.metallic.clamp(0, 1)[None].contiguous(),
    )


def unit_range(x: Tensor, cut: float = 0.01) -> Tensor:
    """``x`` to [0, 1], the outermost shares ``cut`` clipped."""
    flat = x.reshape(-1)
    step = max(1, flat.numel() // 16384)
    q = torch.quantile(flat[::step].float(), torch.tensor([cut, 1 - cut], device=x.device))
    return ((x - q[0]) / (q[1] - q[0]).clamp_min(1e-6)).clamp(0, 1)


def cavity(height: Tensor, sigma: float) -> Tensor:
    """About [-1, 1]: negative in recesses, positive on ridges, at the scale ``sigma`` (tile units)."""
    c = height - blur(height, sigma)
    return (c / (2 * c.std() + 1e-8)).clamp(-1, 1)


def mix(a: Tensor, b: Tensor, t: Tensor) -> Tensor:
    """Blend of two images or colours by a mask ``(n, n)``."""
    return a + (b - a) * t


def colour(d: Draw, rgb: Colour) -> Tensor:
    return torch.tensor(rgb, device=d.device, dtype=torch.float32).view(3, 1, 1)


def hsv(d: Draw, h: tuple[float, float], s: tuple[float, float], v: tuple[float, float]) -> Tensor:
    """A colour (3,1,1) from ranges of hue (turns, may leave [0,1)), saturation and value, sRGB-encoded."""
    return colour(d, colorsys.hsv_to_rgb(d.uniform(*h) % 1.0, d.uniform(*s), d.uniform(*v)))


def any_colour(d: Draw, saturation: float = 0.8, value: tuple[float, float] = (0.08, 0.95)) -> Tensor:
    """Any paint-like colour, greys and muted ones the more frequent."""
    if d.chance(0.3):
        return hsv(d, (0, 1), (0, 0.08), value)
    return hsv(d, (0, 1), (0.1 * saturation, saturation), value)


def jitter(d: Draw, c: Tensor, amount: float) -> Tensor:
    """A colour near ``c``: brightness more than hue; dark colours move less."""
    shift = amount * d.normal() + 0.3 * amount * d.randn(3, 1, 1)
    return (c + shift * (0.25 + c.mean())).clamp(0.0, 1.0)


def ramp(t: Tensor, colours: Sequence[Tensor]) -> Tensor:
    """Piecewise linear gradient through ``colours`` (each (3,1,1)) at ``t`` in [0, 1]."""
    k = len(colours) - 1
    table = torch.cat([c.view(3, 1) for c in colours], 1)
    x = t.clamp(0, 1) * k
    i = torch.floor(x).clamp(0, k - 1).long()
    return torch.lerp(table[:, i], table[:, i + 1], x - i)
