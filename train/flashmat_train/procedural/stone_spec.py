"""Polished stones."""

from __future__ import annotations

import torch

from .noise import Draw, spectral
from .structure import Surface, hsv, mix, unit_range


def marble(d: Draw, n: int) -> Surface:
    f = spectral(d, n, 3.2, batch=2)
    vein = torch.exp(-(f[0].abs() * d.uniform(4, 12)))
    a, b = hsv(d, (0.05, 0.15), (0.0, 0.2), (0.5, 0.95)), hsv(d, (0.05, 0.15), (0.0, 0.4), (0.15, 0.6))
    albedo = mix(a, b, vein * unit_range(f[1]))
    rough = d.uniform(0.05, 0.25) + 0.08 * vein
    return Surface(albedo, f[1] - 0.2 * vein, rough, d.log_uniform(0.002, 0.03))


FAMILIES = {"marble": marble}
