"""Ground."""

from __future__ import annotations

from .noise import Draw, spectral
from .structure import Surface, cavity, hsv, mix, unit_range


def soil(d: Draw, n: int) -> Surface:
    height = spectral(d, n, d.uniform(2.2, 3.0), low=2)
    cav = cavity(height, 0.02)
    a, b = hsv(d, (0.05, 0.1), (0.2, 0.55), (0.25, 0.6)), hsv(d, (0.05, 0.1), (0.2, 0.55), (0.25, 0.6))
    albedo = mix(a, b, unit_range(spectral(d, n, 2.0))) * (1 + 0.25 * cav)
    rough = d.uniform(0.5, 0.8) - 0.06 * cav
    return Surface(albedo, height, rough, d.log_uniform(0.2, 0.6))


FAMILIES = {"soil": soil}
