"""Leathers."""

from __future__ import annotations

from .noise import Draw, smoothstep, spectral, worley
from .structure import Surface, hsv


def pebbled(d: Draw, n: int) -> Surface:
    u, v = d.grid(n)
    k = d.integer(16, 50)
    wob = 0.3 / k * spectral(d, n, 2.0, low=k / 2, batch=2)
    c = worley(d, u + wob[0], v + wob[1], k, k)
    height = smoothstep(0.0, 0.35, c.edge)
    base = hsv(d, (0.0, 0.1), (0.3, 0.8), (0.1, 0.7))
    albedo = base * (0.85 + 0.15 * height)
    rough = d.uniform(0.38, 0.55) - 0.06 * (height - 0.5)
    return Surface(albedo, height, rough, d.log_uniform(0.05, 0.25))


FAMILIES = {"pebbled": pebbled}
