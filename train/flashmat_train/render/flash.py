"""The flash photo's geometry and the point light.

Camera at (0,0,1) above the plane z = 0; pixel position p in [-1,1]² at pixel centres, x right, y up (row 0 is the
top); the plane point of a pixel is (p.x t, p.y t, 0), t = tan(fov/2). A light of strength 1 gives a flat white
Lambertian surface straight under it at distance 1 the radiance 1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from .brdf import normalise, shade

#: The paper's field of view over the square crop, degrees.
FOV_DEG = 43.35


@dataclass
class Geometry:
    """Per-pixel plane points and unit view vectors, (B,3,H,W), in the plane's own frame."""

    points: Tensor
    view: Tensor
    camera: Tensor  # (B,3)


def pixel_positions(size: int, device: torch.device | str = "cpu") -> Tensor:
    """p of every pixel centre, (2, size, size): x right, y up."""
    c = (torch.arange(size, device=device, dtype=torch.float32) + 0.5) * (2.0 / size) - 1.0
    return torch.stack((c[None, :].expand(size, size), -c[:, None].expand(size, size)))


def fronto_parallel(size: int, fov_deg: Tensor, device: torch.device | str = "cpu") -> Geometry:
    """The default geometry: the camera looks straight down from distance 1. `fov_deg` is (B,)."""
    b = fov_deg.shape[0]
    return tilted(size, fov_deg, torch.zeros(b, 2, device=device), device)


def tilted(size: int, fov_deg: Tensor, tilt: Tensor, device: torch.device | str = "cpu") -> Geometry:
    """The camera looks at the plane's origin from distance 1, tilted by `tilt` (B,2) radians about x and y.

    The maps stay in image space; points and view vectors are those of the tilted plane.
    """
    p = pixel_positions(size, device)
    t = torch.tan(torch.deg2rad(fov_deg) / 2)[:, None, None]
    sx, cx = torch.sin(tilt[:, 0]), torch.cos(tilt[:, 0])
    sy, cy = torch.sin(tilt[:, 1]), torch.cos(tilt[:, 1])
    zero = torch.zeros_like(sx)
    # camera axes in the plane's frame: rotation about x, then about y
    right = torch.stack((cy, zero, -sy), 1)
    up = torch.stack((sy * sx, cx, cy * sx), 1)
    back = torch.stack((sy * cx, -sx, cy * cx), 1)
    camera = back  # distance 1 along the viewing axis
    ray = (
        right[:, :, None, None] * (p[0] * t)[:, None]
        + up[:, :, None, None] * (p[1] * t)[:, None]
        - back[:, :, None, None]
    )
    s = -camera[:, 2, None, None] / ray[:, 2].clamp_max(-1e-3)
    points = camera[:, :, None, None] + ray * s[:, None]
    return Geometry(points, normalise(-ray), camera)


def render_point(
    albedo: Tensor, normal: Tensor, roughness: Tensor, f0: Tensor | float, geometry: Geometry, light: Tensor
) -> Tensor:
    """Radiance under a point light of strength 1 at `light` (B,3), linear, not clamped."""
    to_light = light[:, :, None, None] - geometry.points
    d2 = to_light.square().sum(dim=1, keepdim=True).clamp_min(1e-6)
    direction = to_light / d2.sqrt()
    return shade(albedo, normal, roughness, direction, geometry.view, f0) * (math.pi / d2)
