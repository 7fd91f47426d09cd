"""The materials in memory: uint8 mip pyramids, and random crops out of them.

Maps have seven channels (linear albedo, unit normal, roughness), or eight: metallic, for renders whose F0 varies from
pixel to pixel.

A crop has any scale, flips and a rotation by a multiple of 45°, its normals turned with it (paper, "Dataset" and
appendix "Details of Data Augmentation"). Materials wrap around: nearly all of them tile.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from .. import CLASSES, METAL
from .materials import Material

#: Side of a crop as a share of the material's shorter side: the paper's 512, 1024, 2048, 3072, 4096 of 4096, and one
#: beyond, since textures repeat: cloth in photos has finer threads than scans of it.
CROP_SCALES = (0.125, 0.25, 0.5, 0.75, 1.0, 1.6)
CROP_SHARES = (0.04, 0.18, 0.26, 0.22, 0.18, 0.12)


def srgb_decode(x: Tensor) -> Tensor:
    """sRGB-encoded to linear, in [0,1]."""
    return torch.where(x <= 0.04045, x / 12.92, ((x.clamp_min(0.04045) + 0.055) / 1.055) ** 2.4)


def srgb_encode(x: Tensor) -> Tensor:
    """Linear to sRGB-encoded, in [0,1]."""
    return torch.where(x <= 0.0031308, x * 12.92, 1.055 * x.clamp_min(0.0031308) ** (1 / 2.4) - 0.055)


def to_float(maps: Tensor) -> Tensor:
    """uint8 (7 or 8,H,W) to linear albedo, unit normal, roughness, and metallic."""
    x = maps.float() / 255.0
    n = x[3:6] * 2.0 - 1.0
    n = torch.cat((n[:2], n[2:].clamp_min(1e-3)))
    n = n / n.square().sum(dim=0, keepdim=True).sqrt()
    return torch.cat((srgb_decode(x[:3]), n, x[6:]))


def to_bytes(maps: Tensor) -> Tensor:
    """The inverse of `to_float`."""
    x = torch.cat((srgb_encode(maps[:3].clamp(0, 1)), maps[3:6] * 0.5 + 0.5, maps[6:].clamp(0, 1)))
    return (x * 255.0 + 0.5).clamp(0, 255).to(torch.uint8)


def pyramid(maps: Tensor, smallest: int = 96) -> list[Tensor]:
    """Halvings of a material, filtered in linear light; normals are averaged and made unit again."""
    levels, x = [maps], None
    while min(levels[-1].shape[1:]) // 2 >= smallest:
        x = to_float(levels[-1]) if x is None else x
        x = F.avg_pool2d(x[None], 2)[0]
        n = x[3:6]
        x = torch.cat((x[:3], n / n.square().sum(dim=0, keepdim=True).sqrt().clamp_min(1e-6), x[6:]))
        levels.append(to_bytes(x))
    return levels


def with_metallic(m: Material) -> np.ndarray:
    """(8,H,W) maps: the metallic map last; of a material without one all or nothing, as its class says."""
    metal = m.metallic
    if metal is None:
        metal = np.full(m.maps.shape[1:], 255 if m.cls == METAL else 0, np.uint8)
    return np.concatenate((m.maps, metal[None]))


class Pool:
    """Materials with their pyramids; draws classes evenly-ish and crops at random. `metallic`: maps have eight
    channels."""

    def __init__(self, materials: list[Material], class_power: float = 0.5, metallic: bool = False):
        self.levels = [pyramid(torch.from_numpy(with_metallic(m) if metallic else m.maps)) for m in materials]
        self.classes = np.array([m.cls for m in materials])
        self.names = [m.name for m in materials]
        counts = np.bincount(self.classes, minlength=8).astype(float)
        weight = counts[self.classes] ** (class_power - 1.0)
        self.weight = weight / weight.sum()

    def __len__(self) -> int:
        return len(self.levels)

    def fold(self, k: int, count: int) -> Pool:
        """The materials of fold `k` of `count`: of each class every `count`-th; a view, nothing is copied."""
        rank = np.array([np.count_nonzero(self.classes[:i] == c) for i, c in enumerate(self.classes)], dtype=int)
        keep = np.flatnonzero(rank % count == k)
        part = copy.copy(self)
        part.levels = [self.levels[i] for i in keep]
        part.names = [self.names[i] for i in keep]
        part.classes = self.classes[keep]
        part.weight = self.weight[keep] / self.weight[keep].sum()
        return part

    def draw(self, rng: np.random.Generator, size: int, cls: int | None = None) -> tuple[Tensor, int]:
        """A random crop (7,size,size) float (linear albedo, unit normal, roughness), and its class; of class `cls` if
        one is given and there is a material of it."""
        of_class = np.flatnonzero(self.classes == cls)
        i = int(rng.choice(of_class)) if len(of_class) else int(rng.choice(len(self), p=self.weight))
        scale = float(rng.choice(CROP_SCALES, p=CROP_SHARES)) * float(rng.uniform(0.85, 1.15))
        turn = int(rng.integers(8))
        flip = bool(rng.integers(2))
        centre = rng.random(2)
        return self.crop(i, size, scale, turn * math.pi / 4, flip, centre), int(self.classes[i])

    def crop(
        self,
        i: int,
        size: int,
        scale: float,
        angle: float,
        flip: bool,
        centre: np.ndarray | tuple[float, float],
    ) -> Tensor:
        """The crop of side `scale` (share of the shorter side) about `centre`, turned by `angle`, flipped in x."""
        levels = self.levels[i]
        side = scale * min(levels[0].shape[1:])
        level = 0
        while level + 1 < len(levels) and side / 2 ** (level + 1) >= 0.75 * size:
            level += 1
        source = levels[level]
        side /= 2**level
        h, w = source.shape[1:]
        # the box that holds the turned square, wrapped around the edges
        reach = math.ceil(side * 0.5 * (abs(math.cos(angle)) + abs(math.sin(angle)))) + 2
        cy, cx = centre[0] * h, centre[1] * w
        y0, x0 = int(cy) - reach, int(cx) - reach
        patch = _wrapped(_wrapped(source, 1, y0, 2 * reach + 1), 2, x0, 2 * reach + 1).float()
        k = patch.shape[1]
        u = (torch.arange(size) + 0.5) * (side / size) - side / 2
        fx = -u if flip else u
        c, s = math.cos(angle), math.sin(angle)
        # image coordinates: x right, y down; source = R(angle) * target
        gx = c * fx[None, :] - s * u[:, None] + (cx - x0)
        gy = s * fx[None, :] + c * u[:, None] + (cy - y0)
        grid = torch.stack((gx, gy), dim=-1) * (2.0 / k) - 1.0
        out = F.grid_sample(patch[None], grid[None], mode="bilinear", align_corners=False, padding_mode="border")
        x = to_float(out[0])
        return turn_normals(x, angle, flip)


def turn_normals(x: Tensor, angle: float, flip: bool) -> Tensor:
    """Turns the normals of a crop whose pixels were read at R(angle) (image axes, y down), then flipped in x."""
    c, s = math.cos(angle), math.sin(angle)
    nx, ny = x[3], x[4]
    # a vector (vx, vy up) is (vx, -vy) in image axes; the target's axes are R(angle)^T of the source's
    tx = c * nx - s * ny
    ty = s * nx + c * ny
    if flip:
        tx = -tx
    return torch.cat((x[:3], tx[None], ty[None], x[5:]))


def _wrapped(x: Tensor, axis: int, start: int, count: int) -> Tensor:
    """`count` slices from `start` on, around the edges where they go beyond; a view where they do not."""
    size = x.shape[axis]
    if start >= 0 and start + count <= size:
        return x.narrow(axis, start, count)
    return x.index_select(axis, torch.arange(start, start + count).remainder(size))


#: Factors of the albedo, drawn evenly in their logarithm: of a metal, of anything else. The paper's U(0.8,1.4) makes
#: materials brighter than they are; a metal's is wide since the pool's base colours lean to polished ones.
ALBEDO_SCALES = {True: (0.35, 1.3), False: (0.65, 1.4)}


def scale_maps(x: Tensor, cls: int, rng: np.random.Generator) -> Tensor:
    """The paper's augmentation: albedo x a random factor, normal xy x U(0.8,1.4), roughness x N(1,0.2)."""
    low, high = ALBEDO_SCALES[cls == METAL]
    albedo = (x[:3] * math.exp(rng.uniform(math.log(low), math.log(high)))).clamp(0, 1)
    n = torch.cat((x[3:5] * float(rng.uniform(0.8, 1.4)), x[5:6]))
    n = n / n.square().sum(dim=0, keepdim=True).sqrt()
    rough = (x[6:7] * max(float(rng.normal(1.0, 0.2)), 0.2)).clamp(0.02, 1)
    return torch.cat((albedo, n, rough, x[7:]))


#: Standard deviation of the logarithm of a tint's factors.
TINT = 0.1


def tinted(x: Tensor, rng: np.random.Generator) -> Tensor:
    """Maps whose albedo's R, G and B each got a random factor, so that few materials have many colours."""
    factors = torch.tensor(np.exp(rng.normal(size=3) * TINT), dtype=torch.float32)
    return torch.cat(((x[:3] * factors[:, None, None]).clamp(0, 1), x[3:]))


#: Classes that are dyed or pigmented in any colour, so that their hue says nothing of what they are.
DYED = frozenset(CLASSES.index(c) for c in ("fabric", "leather", "polymer"))


def dyed(x: Tensor, rng: np.random.Generator) -> Tensor:
    """Maps whose albedo's R, G and B changed places: the texture in another dye, no brighter or darker than it was."""
    order = torch.from_numpy(rng.permutation(3))
    return torch.cat((x[:3][order], x[3:]))


#: Range of the power of `lightened`, drawn evenly in its logarithm: of albedo 0.2 it makes 0.08 to 0.48.
LIGHTENING = (0.45, 1.55)


def lightened(x: Tensor, rng: np.random.Generator) -> Tensor:
    """Maps whose albedo was taken to a random power: black cloth and white cloth are both cloth."""
    low, high = LIGHTENING
    power = math.exp(rng.uniform(math.log(low), math.log(high)))
    return torch.cat((x[:3].clamp(0, 1) ** power, x[3:]))


def blended(a: Tensor, b: Tensor, t: float) -> Tensor:
    """Maps between two materials' (Deschaintre et al. 2018, "Data augmentation"): 0 is `a`, 1 is `b`; of normals the
    slopes are blended."""
    x = a + t * (b - a)
    slope = [m[3:5] / m[5:6].clamp_min(0.05) for m in (a, b)]
    slope = slope[0] + t * (slope[1] - slope[0])
    n = torch.cat((slope, torch.ones_like(slope[:1])))
    return torch.cat((x[:3], n / n.square().sum(dim=0, keepdim=True).sqrt(), x[6:]))


Draw = Callable[[np.random.Generator, int], tuple[Tensor, int]]
