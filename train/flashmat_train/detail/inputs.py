"""What the detail network reads: 20 values a pixel, made of the photo, the global maps and the flash's place.

All are float. With p the point of the plane z = 0 that a pixel sees (the camera at (0,0,1), x right, y up), l the
flash's place, rgb the photo in linear light and Y = (r + g + b)/3:

    red green blue     the photo, sRGB-encoded
    across up          (p - l)/0.4, x and y: where the flash is
    shading            1.5 (L - its mean over 17x17 pixels), L = ln(Y + 0.02); border pixels repeat beyond it
    shading_x _y       shading times across and up: the sign of a slope's shading changes from one side of the flash to
                       the other, so the product tells its direction
    unexplained        L - ln(s R + 0.02) in [-2,2]: R the global maps' re-render under the flash, mean of its channels;
                       s = sum(Y R)/sum(R R) over the whole photo
    gloss              the highlight's share of the re-render's light, in [0,1]
    albedo_r _g _b     logit(albedo)/3, of values in [0.01,0.99]
    slope_x _y         of the global normals, -n.xy / max(n.z, 0.05)
    rough              logit(roughness)/3, of values in [0.01,0.99]
    metal              P(metal) of the classifier
    flash_x _y         l.x and l.y
    known              1 where the flash's strength is known
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor

from ..data.pool import srgb_decode
from ..model import COORDINATE_REACH
from ..render.brdf import blended_f0, dot, normalise, shade
from ..render.flash import Geometry
from ..slopes import normals_of

NAMES = (
    *("red", "green", "blue"),
    *("across", "up"),
    *("shading", "shading_x", "shading_y"),
    *("unexplained", "gloss"),
    *("albedo_r", "albedo_g", "albedo_b"),
    *("slope_x", "slope_y", "rough", "metal"),
    *("flash_x", "flash_y"),
    "known",
)
#: Length of the plane that counts as 1 in `across` and `up`.
NEAR = 0.4
#: Window of the local mean, pixels; factor of the high-pass; what is added to luminance before its logarithm.
WINDOW, SHADING_GAIN, FLOOR = 17, 1.5, 0.02
#: Limit of `unexplained`; margin and divisor of logits.
UNEXPLAINED, MARGIN, LOGIT_SCALE = 2.0, 0.01, 3.0


@dataclass
class GlobalMaps:
    """The global network's answer at the photo's size: what the detail network starts from."""

    albedo: Tensor  # (B,3,n,n) linear
    slopes: Tensor  # (B,2,n,n)
    roughness: Tensor  # (B,1,n,n)
    metal: Tensor  # (B,) P(metal)

    def stacked(self) -> Tensor:
        """(B,6,n,n) albedo, slopes, roughness."""
        return torch.cat((self.albedo, self.slopes, self.roughness), dim=1)

    @staticmethod
    def of_stacked(x: Tensor, metal: Tensor) -> GlobalMaps:
        """The inverse of `stacked`."""
        return GlobalMaps(x[:, :3], x[:, 3:5], x[:, 5:6], metal)


def plane(photo: Tensor) -> Geometry:
    """Points and view vectors of a network input (B,6,n,n), whose channels 3 and 4 tell the points."""
    xy = (photo[:, 3:5] * 2 - 1) * COORDINATE_REACH
    points = torch.cat((xy, torch.zeros_like(xy[:, :1])), dim=1)
    camera = torch.tensor([0.0, 0.0, 1.0], device=photo.device)
    return Geometry(points, normalise(camera[:, None, None] - points), camera.expand(len(photo), 3))


def local_mean(x: Tensor, window: int) -> Tensor:
    """Mean over a square of `window` (odd) pixels about each; beyond the border its pixels repeat."""
    r = window // 2
    x = F.pad(x, (r, r, r, r), mode="replicate")
    return F.avg_pool2d(F.avg_pool2d(x, (window, 1), 1), (1, window), 1)


def log_luminance(photo: Tensor) -> Tensor:
    """(B,1,n,n) ln(Y + 0.02) of sRGB-encoded photos."""
    return torch.log(srgb_decode(photo[:, :3]).mean(dim=1, keepdim=True) + FLOOR)


def shading(photo: Tensor) -> Tensor:
    """(B,1,n,n) log-luminance without its local mean."""
    y = log_luminance(photo)
    return (y - local_mean(y, WINDOW)) * SHADING_GAIN


def rendered(base: GlobalMaps, geometry: Geometry, light: Tensor) -> tuple[Tensor, Tensor]:
    """(B,1,n,n) the global maps' re-render under the flash, mean of its channels, and the highlight's share of it.

    `shade` is a sum of albedo's part and the highlight, and only the first has a colour.
    """
    normal, f0 = normals_of(base.slopes), blended_f0(base.metal)
    to_light = light[:, :, None, None] - geometry.points
    d2 = dot(to_light, to_light).clamp_min(1e-6)
    direction = to_light / d2.sqrt()
    gloss = shade(torch.zeros_like(base.roughness), normal, base.roughness, direction, geometry.view, f0)
    lit = dot(normal, direction).clamp_min(0.0) * (dot(normal, geometry.view) > 0)
    both = gloss + base.albedo.mean(dim=1, keepdim=True) / math.pi * lit
    return both * (math.pi / d2), (gloss / both.clamp_min(1e-6)).clamp(0, 1)


def unexplained(photo: Tensor, radiance: Tensor) -> Tensor:
    """(B,1,n,n) log ratio of photo to re-render, the re-render scaled to the photo."""
    y = srgb_decode(photo[:, :3]).mean(dim=1, keepdim=True)
    top = (y * radiance).sum(dim=(1, 2, 3), keepdim=True)
    scale = top / radiance.square().sum(dim=(1, 2, 3), keepdim=True).clamp_min(1e-6)
    return (torch.log(y + FLOOR) - torch.log(radiance * scale + FLOOR)).clamp(-UNEXPLAINED, UNEXPLAINED)


def scaled_logit(x: Tensor) -> Tensor:
    """logit(x)/3, x kept within [0.01,0.99]."""
    return torch.logit(x.clamp(MARGIN, 1 - MARGIN)) / LOGIT_SCALE


@torch.no_grad()
def detail_inputs(photo: Tensor, base: GlobalMaps, light: Tensor) -> Tensor:
    """(B,20,n,n) in the order of `NAMES`.

    `photo` is the global network's input (B,6,n,n) at full size, the whole photo and not a crop of it (`unexplained`
    has a sum over all pixels); `light` (B,3) is the flash's place as far as it is known.
    """
    n = photo.shape[2:]
    geometry = plane(photo)
    radiance, gloss = rendered(base, geometry, light)
    high = shading(photo)
    beside = (geometry.points[:, :2] - light[:, :2, None, None]) / NEAR
    parts = (
        photo[:, :3],
        beside,
        high,
        high * beside,
        unexplained(photo, radiance),
        gloss,
        scaled_logit(base.albedo),
        base.slopes,
        scaled_logit(base.roughness),
        base.metal[:, None, None, None].expand(-1, 1, *n),
        light[:, :2, None, None].expand(-1, -1, *n),
        photo[:, 5:6],
    )
    return torch.cat(parts, dim=1)
