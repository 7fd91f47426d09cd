"""Fabrics."""

from __future__ import annotations

import math

import torch

from .noise import Draw, spectral
from .structure import Surface, any_colour


def plain_weave(d: Draw, n: int) -> Surface:
    u, v = d.grid(n)
    k = 2 * d.integer(8, 32)
    x, y = u * k, v * k
    s = torch.cos(math.pi * (torch.floor(x) + torch.floor(y)))
    ax, ay = torch.sin(math.pi * (x % 1)), torch.sin(math.pi * (y % 1))
    height = torch.maximum(ax * (0.6 + 0.4 * s * ay), ay * (0.6 - 0.4 * s * ax))
    noise = spectral(d, n, 1.0)
    base = any_colour(d)
    albedo = base * (0.6 + 0.4 * height) + 0.02 * noise
    rough = d.uniform(0.6, 0.85) - 0.1 * (height - 0.5) + 0.02 * noise
    return Surface(albedo, height + 0.02 * noise, rough, d.log_uniform(0.12, 0.5))


FAMILIES = {"plain_weave": plain_weave}
