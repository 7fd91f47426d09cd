"""Woods."""

from __future__ import annotations

import torch

from .noise import Draw, sample, spectral
from .structure import Surface, hsv, unit_range


def boards(d: Draw, n: int) -> Surface:
    u, v = d.grid(n)
    rows = d.integer(1, 6)
    y = v * rows
    row = torch.floor(y).long() % rows
    grain = sample(spectral(d, n, 1.5, low=2, stretch=(12, 1)), u + d.rand(rows)[row], v)
    gap = torch.exp(-(torch.minimum(y % 1, 1 - y % 1) * 40))
    base = hsv(d, (0.05, 0.1), (0.3, 0.7), (0.3, 0.8))
    tone = 1 + 0.15 * (d.rand(rows)[row] - 0.5) + 0.12 * (unit_range(grain) - 0.5)
    albedo = base * tone * (1 - 0.6 * gap)
    rough = d.uniform(0.35, 0.7) - 0.03 * grain
    return Surface(albedo, 0.02 * grain - gap, rough, d.log_uniform(0.02, 0.2))


FAMILIES = {"boards": boards}
