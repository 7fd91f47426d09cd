"""Ambient occlusion of a height field: crevices see less of the room, and are darker by that.

Height in pixels over a grid of pixels (`slopes.height_of`), so no scale is needed. In each of eight directions the
steepest rise to a pixel of the height field within `STEPS` is the horizon; of the light of an even sky that a flat
patch gets from that direction the share above a horizon of slope t is 1/(1 + t²).
"""

from __future__ import annotations

import math

import torch
import torch.nn.functional as F
from torch import Tensor

#: Distances at which the horizon is looked for, pixels.
STEPS = (1, 2, 4, 7, 12, 20, 32)
DIRECTIONS = tuple((math.cos(k * math.pi / 4), math.sin(k * math.pi / 4)) for k in range(8))


def ambient_occlusion(height: Tensor) -> Tensor:
    """(B,1,H,W) share of an even sky's light that each pixel gets: 1 on a plane; border pixels repeat beyond it."""
    reach = max(STEPS)
    h, w = height.shape[2:]
    wide = F.pad(height, (reach,) * 4, mode="replicate")
    seen = torch.zeros_like(height)
    for dx, dy in DIRECTIONS:
        horizon = torch.zeros_like(height)
        for step in STEPS:
            x, y = round(dx * step), round(dy * step)
            other = wide[:, :, reach + y : reach + y + h, reach + x : reach + x + w]
            horizon = torch.maximum(horizon, (other - height) / math.hypot(x, y))
        seen += 1 / (1 + horizon.square())
    return seen / len(DIRECTIONS)


def between_surfaces(seen: Tensor, albedo: Tensor) -> Tensor:
    """(B,3,H,W) what dims ambient light: occlusion, and the light that the walls of that albedo throw back in."""
    return seen / (1 - albedo * (1 - seen))
