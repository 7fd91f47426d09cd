"""What use and weather leave on a surface: stains, smudges, scratches, streaks, chips, cracks."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from .noise import Draw, smoothstep, spectral, uniformise, unit, warp, worley
from .scatter import curves, lines
from .structure import unit_range


def clouds(d: Draw, n: int, beta: float = 2.4, low: float = 1.0, swirl: float = 0.04) -> Tensor:
    """Stains: warped fBm spread evenly over [0, 1]."""
    f = spectral(d, n, beta, low=low, batch=3)
    return uniformise(unit(warp(f[0], swirl * f[1], swirl * f[2])))


def blotches(d: Draw, n: int, cover: float, low: float = 2.0, beta: float = 2.2, soft: float = 0.12) -> Tensor:
    """A mask in [0, 1] of ragged patches that cover a share ``cover``."""
    f = spectral(d, n, beta, low=low)
    return mask(f, cover, soft)


def mask(field: Tensor, cover: float, soft: float = 0.12) -> Tensor:
    """Where a unit Gaussian ``field`` lies in its upper share ``cover``, with a soft border."""
    level = math.sqrt(2) * torch.erfinv(torch.tensor(1 - 2 * min(max(cover, 1e-3), 0.999))).item()
    return smoothstep(level - soft, level + soft, field)


def smudges(d: Draw, n: int) -> Tensor:
    """Uneven polish, about zero mean, half-unit: clouds, wipes along a direction, now and then grit."""
    out = spectral(d, n, d.uniform(1.6, 2.6), low=d.uniform(1, 3))
    if d.chance(0.6):
        angle = d.choice((0.0, math.pi / 2, d.uniform(0, math.pi)))
        wipes = spectral(d, n, d.uniform(1.2, 2.2), low=2, stretch=(d.log_uniform(3, 12), 1.0), angle=angle)
        out = unit(out + d.uniform(0.3, 1.5) * wipes)
    if d.chance(0.5):
        out = out.abs() * 1.6 - 1.2 if d.chance(0.5) else torch.exp(0.7 * out) - 1.2
    return 0.5 * out.clamp(-3, 3)


def scratches(
    d: Draw,
    n: int,
    count: int,
    length: tuple[float, float] = (0.05, 0.6),
    bend: float = 0.5,
    angle: float | None = None,
    spread: float = 0.2,
) -> Tensor:
    """Thin lines in [0, 1], faint ones the more frequent; all about ``angle``, or every way."""
    turn = 2 * math.pi * d.rand(count) if angle is None else angle + spread * d.randn(count)
    reach = length[0] + (length[1] - length[0]) * d.rand(count) ** 3
    points = max(8, int(1.4 * n * length[1]))
    x, y = curves(d, count, points, reach, bend, turn)
    strength = d.rand(count, 1) ** 2.5
    t = torch.linspace(0, math.pi, points, device=d.device)
    return lines(n, x, y, strength * torch.sin(t).clamp_min(0) ** 0.5)


def streaks(d: Draw, n: int, cover: float = 0.3) -> Tensor:
    """Vertical runs (rain, drips) in [0, 1]."""
    f = spectral(d, n, 1.4, low=2, stretch=(1.0, d.log_uniform(6, 25)))
    return mask(f, cover, 0.8) * unit_range(spectral(d, n, 2.0, low=1))


def specks(d: Draw, n: int, cover: float, scale: float) -> Tensor:
    """Small round-ish dots; ``scale``: about that many dots would fit across the tile."""
    f = spectral(d, n, 0.0, low=1.0, high=scale)
    return mask(f, cover, 0.25)


def cracks(d: Draw, u: Tensor, v: Tensor, cells: int, width: float, wobble: float = 0.25) -> Tensor:
    """Crack depth in [0, 1] along the borders of wobbly cells; ``width`` in cells."""
    n = u.shape[-1]
    w = (wobble / cells) * spectral(d, n, 3.0, low=max(2.0, cells / 2), batch=2)
    c = worley(d, u + w[0], v + w[1], cells, cells)
    vary = width * torch.exp(0.6 * spectral(d, n, 2.0, low=2))
    return (1 - c.edge / vary).clamp(0, 1)


def dust(d: Draw, height: Tensor, amount: float) -> Tensor:
    """A mask in [0, 1] of dirt that gathers in the recesses of ``height``, broken up by clouds."""
    n = height.shape[-1]
    low = 1 - unit_range(height)
    return (smoothstep(0.3, 1.0, low + 0.25 * spectral(d, n, 1.8, low=3)) * amount).clamp(0, 1)
