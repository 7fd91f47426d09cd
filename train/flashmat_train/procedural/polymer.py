"""Polymers."""

from __future__ import annotations

from .noise import Draw, spectral
from .structure import Surface, any_colour


def grained_plastic(d: Draw, n: int) -> Surface:
    grain = spectral(d, n, 1.5, low=d.log_uniform(10, 60))
    base = any_colour(d, 0.9, (0.05, 1.0))
    albedo = base * (1 + 0.01 * grain)
    rough = d.uniform(0.2, 0.6) + 0.03 * grain
    return Surface(albedo, grain, rough, d.log_uniform(0.01, 0.2))


FAMILIES = {"grained_plastic": grained_plastic}
