"""Periodic noise: every field tiles on the unit torus.

Coordinates ``u`` (right) and ``v`` (down) are in tile units, pixel centres at ``(i + 0.5) / n``. Fields are
``(n, n)`` or ``(batch, n, n)`` float32. Random numbers are drawn on the generator's own device and moved: the
same CPU seed gives the same material on every device (up to rounding).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import torch
import torch.nn.functional as F
from torch import Tensor

T = TypeVar("T")


class Draw:
    """A seeded source of random choices and tensors for one material."""

    def __init__(self, rng: torch.Generator, device: torch.device | str) -> None:
        self.rng = rng
        self.device = torch.device(device)

    def uniform(self, low: float = 0.0, high: float = 1.0) -> float:
        return low + (high - low) * float(torch.rand((), generator=self.rng, device=self.rng.device))

    def log_uniform(self, low: float, high: float) -> float:
        return low * (high / low) ** self.uniform()

    def normal(self, mean: float = 0.0, std: float = 1.0) -> float:
        return mean + std * float(torch.randn((), generator=self.rng, device=self.rng.device))

    def integer(self, low: int, high: int) -> int:
        """A whole number in ``low..=high``."""
        return int(torch.randint(low, high + 1, (), generator=self.rng, device=self.rng.device))

    def chance(self, probability: float) -> bool:
        return self.uniform() < probability

    def choice(self, items: Sequence[T]) -> T:
        return items[self.integer(0, len(items) - 1)]

    def weighted(self, items: Sequence[T], weights: Sequence[float]) -> T:
        mark = self.uniform(0.0, sum(weights))
        for item, weight in zip(items, weights, strict=True):
            mark -= weight
            if mark < 0:
                return item
        return items[-1]

    def rand(self, *shape: int) -> Tensor:
        return torch.rand(shape, generator=self.rng, device=self.rng.device).to(self.device)

    def randn(self, *shape: int) -> Tensor:
        return torch.randn(shape, generator=self.rng, device=self.rng.device).to(self.device)

    def grid(self, n: int) -> tuple[Tensor, Tensor]:
        """Pixel-centre coordinates ``u``, ``v``, each ``(n, n)``."""
        c = (torch.arange(n, device=self.device, dtype=torch.float32) + 0.5) / n
        return c.expand(n, n), c[:, None].expand(n, n)


def unit(x: Tensor) -> Tensor:
    """Zero mean, unit deviation over the last two axes."""
    mean = x.mean((-2, -1), keepdim=True)
    return (x - mean) / (x.std((-2, -1), keepdim=True) + 1e-8)


def uniformise(x: Tensor) -> Tensor:
    """A unit Gaussian field to a roughly uniform one in [0, 1]."""
    return 0.5 * (1 + torch.erf(x * (1 / math.sqrt(2))))


def smoothstep(low: float, high: float, x: Tensor) -> Tensor:
    t = ((x - low) / (high - low)).clamp(0, 1)
    return t * t * (3 - 2 * t)


def _frequencies(n: int, device: torch.device) -> tuple[Tensor, Tensor]:
    fx = torch.arange(n // 2 + 1, device=device, dtype=torch.float32)
    fy = torch.fft.fftfreq(n, 1.0 / n, device=device)[:, None].float()
    return fx, fy


def spectral(
    d: Draw,
    n: int,
    beta: float = 2.0,
    low: float = 1.0,
    high: float | None = None,
    stretch: tuple[float, float] = (1.0, 1.0),
    angle: float = 0.0,
    batch: int | None = None,
) -> Tensor:
    """A unit Gaussian field whose power falls as ``f^-beta`` between ``low`` and ``high`` cycles per tile.

    ``stretch`` lengthens features along x and y of a frame turned by ``angle`` (radians); fBm in one FFT.
    """
    white = d.randn(batch or 1, n, n)
    fx, fy = _frequencies(n, d.device)
    c, s = math.cos(angle), math.sin(angle)
    gx, gy = (c * fx + s * fy) * stretch[0], (c * fy - s * fx) * stretch[1]
    f = torch.sqrt(gx * gx + gy * gy).clamp_min(1e-3)
    amp = f.pow(-beta / 2) / (1 + (low / f) ** 8)
    if high is not None:
        amp = amp * torch.exp(-((f / high) ** 2))
    amp[0, 0] = 0
    out = unit(torch.fft.irfft2(torch.fft.rfft2(white) * amp, s=(n, n)))
    return out if batch else out[0]


def blur(x: Tensor, sigma: float, sigma_v: float | None = None) -> Tensor:
    """Periodic Gaussian blur; ``sigma`` (and ``sigma_v`` downwards) in tile units."""
    n = x.shape[-1]
    fx, fy = _frequencies(n, x.device)
    sv = sigma if sigma_v is None else sigma_v
    gain = torch.exp(-2 * math.pi**2 * ((fx * sigma) ** 2 + (fy * sv) ** 2))
    return torch.fft.irfft2(torch.fft.rfft2(x) * gain, s=(n, n))


def sample(texture: Tensor, u: Tensor, v: Tensor) -> Tensor:
    """Bilinear periodic look-up of ``texture`` ``(H, W)`` or ``(C, H, W)`` at any ``u``, ``v``."""
    tex = texture if texture.dim() == 3 else texture[None]
    h, w = tex.shape[-2:]
    padded = F.pad(tex[None], (1, 1, 1, 1), mode="circular")
    x = (u - torch.floor(u)) * w + 0.5
    y = (v - torch.floor(v)) * h + 0.5
    at = torch.stack((2 * x / (w + 1) - 1, 2 * y / (h + 1) - 1), -1)
    out = F.grid_sample(padded, at[None], mode="bilinear", padding_mode="border", align_corners=True)[0]
    return out if texture.dim() == 3 else out[0]


def warp(texture: Tensor, du: Tensor, dv: Tensor) -> Tensor:
    """``texture`` displaced by ``du``, ``dv`` (tile units)."""
    n = texture.shape[-1]
    c = (torch.arange(n, device=texture.device, dtype=torch.float32) + 0.5) / n
    return sample(texture, c + du, c[:, None] + dv)


def value_noise(d: Draw, u: Tensor, v: Tensor, nx: int, ny: int) -> Tensor:
    """Value noise in [0, 1] on an ``nx`` by ``ny`` periodic lattice, smooth, at any coordinates."""
    lattice = d.rand(ny, nx)
    x, y = u * nx, v * ny
    ix, iy = torch.floor(x), torch.floor(y)
    fx, fy = x - ix, y - iy
    fx, fy = fx * fx * (3 - 2 * fx), fy * fy * (3 - 2 * fy)
    x0, y0 = ix.long() % nx, iy.long() % ny
    x1, y1 = (x0 + 1) % nx, (y0 + 1) % ny
    top = torch.lerp(lattice[y0, x0], lattice[y0, x1], fx)
    return torch.lerp(top, torch.lerp(lattice[y1, x0], lattice[y1, x1], fx), fy)


def gradient_noise(d: Draw, u: Tensor, v: Tensor, nx: int, ny: int) -> Tensor:
    """Perlin gradient noise, about [-1, 1], on an ``nx`` by ``ny`` periodic lattice, at any coordinates."""
    turn = 2 * math.pi * d.rand(ny, nx)
    gx, gy = torch.cos(turn), torch.sin(turn)
    x, y = u * nx, v * ny
    ix, iy = torch.floor(x), torch.floor(y)
    fx, fy = x - ix, y - iy
    x0, y0 = ix.long() % nx, iy.long() % ny
    x1, y1 = (x0 + 1) % nx, (y0 + 1) % ny
    sx, sy = fx**3 * (fx * (fx * 6 - 15) + 10), fy**3 * (fy * (fy * 6 - 15) + 10)

    def corner(yy: Tensor, xx: Tensor, ox: int, oy: int) -> Tensor:
        return gx[yy, xx] * (fx - ox) + gy[yy, xx] * (fy - oy)

    top = torch.lerp(corner(y0, x0, 0, 0), corner(y0, x1, 1, 0), sx)
    return 1.414 * torch.lerp(top, torch.lerp(corner(y1, x0, 0, 1), corner(y1, x1, 1, 1), sx), sy)


@dataclass
class Cells:
    """Worley cells: distances in units of the mean cell side."""

    f1: Tensor
    f2: Tensor
    edge: Tensor  # distance to the nearest cell border
    id: Tensor  # int64, 0..count
    dx: Tensor  # from the cell's point to the pixel
    dy: Tensor
    count: int

    def per_cell(self, values: Tensor) -> Tensor:
        return values[..., self.id]


def worley(d: Draw, u: Tensor, v: Tensor, nx: int, ny: int, jitter: float = 1.0) -> Cells:
    """Voronoi cells of one jittered point for each box of an ``nx`` by ``ny`` periodic lattice."""
    nx, ny = max(nx, 3), max(ny, 3)
    px = 0.5 + jitter * (d.rand(ny * nx) - 0.5)
    py = 0.5 + jitter * (d.rand(ny * nx) - 0.5)
    side = math.sqrt(1 / (nx * ny))
    kx, ky = 1 / (nx * side), 1 / (ny * side)
    x, y = u * nx, v * ny
    ix, iy = torch.floor(x), torch.floor(y)
    rx, ry = x - ix, y - iy
    x0, y0 = ix.long() % nx, iy.long() % ny
    columns = [(x0 + o) % nx for o in (-1, 0, 1)]
    near: list[tuple[Tensor, Tensor]] = []
    f1 = f2 = torch.full_like(rx, 9.0)
    ax, ay, at = rx, ry, x0
    for oy in (-1, 0, 1):
        row = ((y0 + oy) % ny) * nx
        for ox in (-1, 0, 1):
            i = row + columns[ox + 1]
            sx, sy = (px[i] + (ox - rx)) * kx, (py[i] + (oy - ry)) * ky
            near.append((sx, sy))
            dist = sx * sx + sy * sy
            closer = dist < f1
            f2 = torch.minimum(f2, torch.maximum(dist, f1))
            f1 = torch.minimum(dist, f1)
            ax, ay, at = torch.where(closer, sx, ax), torch.where(closer, sy, ay), torch.where(closer, i, at)
    edge = torch.full_like(rx, 9.0)
    for sx, sy in near:
        ex, ey = sx - ax, sy - ay
        gap = (ex * ex + ey * ey).clamp_min_(1e-12)
        border = ((sx + ax) * ex + (sy + ay) * ey) * torch.rsqrt(gap)
        edge = torch.where(gap > 1e-8, torch.minimum(edge, border), edge)
    return Cells(f1.sqrt(), f2.sqrt(), (0.5 * edge).clamp_min(0), at, -ax, -ay, nx * ny)


@dataclass
class Splats:
    """What lies on top after ``splat``: ids (-1: nothing), heights (``floor``: nothing), local offsets."""

    id: Tensor
    top: Tensor
    dx: Tensor
    dy: Tensor

    @property
    def hit(self) -> Tensor:
        return self.id >= 0

    def per_splat(self, values: Tensor) -> Tensor:
        return values[..., self.id.clamp_min(0)]


def splat(
    n: int, cx: Tensor, cy: Tensor, half: float, shape: Callable[[Tensor, Tensor], Tensor], floor: float = 0.0
) -> Splats:
    """Draws ``N`` small height patches into a periodic z-buffer.

    ``shape(dx, dy)`` takes offsets ``(N, K)`` in tile units from each centre; gives heights, ``-inf`` outside.
    Patches reach ``half`` (tile units) around their centres. Heights should lie within about [-4, 4].
    """
    k = max(1, math.ceil(half * n))
    device = cx.device
    o = torch.arange(-k, k + 1, device=device)
    bx, by = torch.floor(cx * n).long(), torch.floor(cy * n).long()
    ox, oy = o.repeat(len(o)), o.repeat_interleave(len(o))
    near = ox * ox + oy * oy <= (k + 1) ** 2
    ox, oy = ox[near], oy[near]
    px, py = bx[:, None] + ox, by[:, None] + oy
    dx = (px + 0.5) / n - cx[:, None]
    dy = (py + 0.5) / n - cy[:, None]
    z = shape(dx, dy)
    count = cx.shape[0]
    ids = torch.arange(count, device=device)[:, None]
    key = ((z.clamp(-8, 8) + 8) * (1 << 20)).long() * (1 << 22) + ids
    key = torch.where(torch.isfinite(z), key, torch.full_like(key, -1))
    flat = (py % n) * n + px % n
    buffer = torch.full((n * n,), -1, dtype=torch.int64, device=device)
    buffer.scatter_reduce_(0, flat.reshape(-1), key.reshape(-1), "amax")
    buffer = buffer.view(n, n)
    hit = buffer >= 0
    idx = torch.where(hit, buffer % (1 << 22), torch.full_like(buffer, -1))
    top = torch.where(hit, (buffer // (1 << 22)).float() / (1 << 20) - 8, floor)
    c = (torch.arange(n, device=device, dtype=torch.float32) + 0.5) / n
    safe = idx.clamp_min(0)
    ddx, ddy = c - cx[safe], c[:, None] - cy[safe]
    return Splats(idx, top, ddx - torch.round(ddx), ddy - torch.round(ddy))
