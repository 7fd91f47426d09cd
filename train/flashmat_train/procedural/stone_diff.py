"""Diffuse stones."""

from __future__ import annotations

from .noise import Draw, spectral
from .structure import Surface, cavity, hsv, unit_range


def concrete(d: Draw, n: int) -> Surface:
    stains = unit_range(spectral(d, n, 2.5))
    height = spectral(d, n, d.uniform(1.5, 2.5), low=4)
    base = hsv(d, (0.05, 0.15), (0.0, 0.15), (0.4, 0.75))
    albedo = base * (0.85 + 0.2 * stains + 0.05 * cavity(height, 0.02))
    rough = d.uniform(0.5, 0.85) - 0.1 * (stains - 0.5)
    return Surface(albedo, height, rough, d.log_uniform(0.04, 0.3))


FAMILIES = {"concrete": concrete}
