"""Slopes of surfaces: between normals and slopes, radial and tangential parts, height from slopes.

A slope field is (B,2,H,W): how much the surface rises to the right and upwards for each unit of length along the plane,
so that the normal is (-sx, -sy, 1) made unit. Row 0 is the picture's top.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

#: The z of a normal is taken to be at least this, so that a slope is at most about 20.
LEAST_Z = 0.05


def slopes_of(normal: Tensor) -> Tensor:
    """(B,2,H,W) slopes of unit normals (B,3,H,W)."""
    return -normal[:, :2] / normal[:, 2:].clamp_min(LEAST_Z)


def normals_of(slopes: Tensor) -> Tensor:
    """(B,3,H,W) unit normals of slopes (B,2,H,W)."""
    n = torch.cat((-slopes, torch.ones_like(slopes[:, :1])), dim=1)
    return n / n.square().sum(dim=1, keepdim=True).sqrt()


def radial_tangential(slopes: Tensor, offset: Tensor) -> tuple[Tensor, Tensor]:
    """The parts of slopes along `offset` (B,2,H,W), which points away from the flash, and across it; (B,1,H,W) each.

    Shading under a flash tells the first; the second only context tells. At the flash itself both fade to zero.
    """
    u = offset / (offset.square().sum(dim=1, keepdim=True) + 1e-4).sqrt()
    along = (slopes * u).sum(dim=1, keepdim=True)
    across = slopes[:, :1] * u[:, 1:] - slopes[:, 1:] * u[:, :1]
    return along, across


def height_of(slopes: Tensor) -> Tensor:
    """(B,1,H,W) height in pixels, mean zero, whose slopes come nearest to `slopes` by least squares.

    Frankot and Chellappa (1988): divided by the frequencies after a Fourier transform. A crop does not wrap around, so
    the height is continued by its mirror image, whose slopes along the mirrored axis change sign.
    """
    h, w = slopes.shape[2:]
    sx, sy = slopes[:, 0], -slopes[:, 1]  # sy downwards, as rows run
    sx = torch.cat((sx, -sx.flip(2)), dim=2)
    sx = torch.cat((sx, sx.flip(1)), dim=1)
    sy = torch.cat((sy, sy.flip(2)), dim=2)
    sy = torch.cat((sy, -sy.flip(1)), dim=1)
    fx = 2 * math.pi * torch.fft.rfftfreq(2 * w, device=slopes.device)
    fy = 2 * math.pi * torch.fft.fftfreq(2 * h, device=slopes.device)[:, None]
    power = (fx.square() + fy.square()).clamp_min(1e-9)
    top = -1j * (fx * torch.fft.rfft2(sx) + fy * torch.fft.rfft2(sy)) / power
    height = torch.fft.irfft2(top, s=(2 * h, 2 * w))[:, None, :h, :w]
    return height - height.mean(dim=(2, 3), keepdim=True)
