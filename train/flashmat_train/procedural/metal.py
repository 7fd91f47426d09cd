"""Metals."""

from __future__ import annotations

from .noise import Draw, spectral
from .structure import Surface, hsv


def brushed(d: Draw, n: int) -> Surface:
    streak = spectral(d, n, 0.5, low=4, stretch=(d.log_uniform(8, 60), 1.0))
    base = hsv(d, (0.05, 0.14), (0.0, 0.4), (0.4, 0.95))
    albedo = base * (1 + 0.04 * streak)
    rough = d.uniform(0.2, 0.5) + 0.03 * streak
    return Surface(albedo, streak, rough, d.log_uniform(0.005, 0.08))


FAMILIES = {"brushed": brushed}
