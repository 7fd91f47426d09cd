"""Things scattered over a surface: stones, leaves, blades, fibres, scratches."""

from __future__ import annotations

import math
from collections.abc import Callable

import torch
from torch import Tensor

from .noise import Draw, Splats, splat

Shape = Callable[[Tensor, Tensor, Tensor], Tensor]


def merge(a: Splats, b: Splats, offset: int) -> Splats:
    """The higher of two layers; ids of ``b`` move up by ``offset``."""
    over = b.hit & (~a.hit | (b.top > a.top))
    return Splats(
        torch.where(over, b.id + offset, a.id),
        torch.where(over, b.top, a.top),
        torch.where(over, b.dx, a.dx),
        torch.where(over, b.dy, a.dy),
    )


def scatter(d: Draw, n: int, size: Tensor, params: Tensor, shape: Shape, floor: float = 0.0) -> tuple[Splats, Tensor]:
    """Scatters items of radius ``size`` (N,) at random places, big ones first, in up to four size buckets.

    ``shape(dx, dy, p)`` gets offsets in units of the item's size and its parameters ``p`` (P, N, 1); it gives
    heights, ``-inf`` outside the unit disc. Returns the splats and ``params`` in the order of the ids.
    """
    order = torch.argsort(size, descending=True, stable=True)
    size, params = size[order], params[:, order]
    cx, cy = d.rand(len(size)), d.rand(len(size))
    out: Splats | None = None
    start = 0
    sizes = size.tolist()
    while start < len(sizes):
        end = start
        while end < len(sizes) and sizes[end] > 0.6 * sizes[start]:
            end += 1
        s, p = size[start:end, None], params[:, start:end, None]

        def local(dx: Tensor, dy: Tensor, s: Tensor = s, p: Tensor = p) -> Tensor:
            return shape(dx / s, dy / s, p)

        part = splat(n, cx[start:end], cy[start:end], sizes[start], local, floor)
        out = part if out is None else merge(out, part, start)
        start = end
    assert out is not None
    scale = size[out.id.clamp_min(0)]
    return Splats(out.id, out.top, out.dx / scale, out.dy / scale), params


def sizes(d: Draw, count: int, low: float, high: float, power: float = 2.0) -> Tensor:
    """Radii between ``low`` and ``high``, small ones the more frequent."""
    return low + (high - low) * d.rand(count) ** power


def stone_params(d: Draw, count: int, depth: float) -> Tensor:
    """Parameters of `stone_shape`: turn, aspect, outline, tilt, base height."""
    return torch.stack(
        (
            2 * math.pi * d.rand(count),
            1 + 0.7 * d.rand(count),
            2 * math.pi * d.rand(count),
            2 * math.pi * d.rand(count),
            2 * math.pi * d.rand(count),
            0.7 * d.randn(count),
            0.7 * d.randn(count),
            depth * d.rand(count),
        )
    )


def stone_shape(angular: float, power: float, rise: float, tilt: float) -> Shape:
    """Irregular pebbles: lobed outline, domed (``power`` 2) or flat-topped (more), tilted."""

    def shape(x: Tensor, y: Tensor, p: Tensor) -> Tensor:
        c, s = torch.cos(p[0]), torch.sin(p[0])
        a, b = c * x + s * y, (c * y - s * x) * p[1]
        t = torch.atan2(b, a)
        edge = 1 - angular * (
            1.2 + torch.cos(2 * t + p[2]) * 0.3 + torch.cos(3 * t + p[3]) + 0.5 * torch.cos(5 * t + p[4])
        )
        rho = torch.sqrt(a * a + b * b) / edge.clamp_min(0.2)
        z = p[7] + rise * (1 - rho.clamp(max=1) ** power) + tilt * (p[5] * x + p[6] * y)
        return torch.where(rho < 1, z, -math.inf)

    return shape


def strokes(n: int, x: Tensor, y: Tensor, z: Tensor, radius: Tensor, reach: float, dome: float = 0.5) -> Splats:
    """Round strokes through points ``x``, ``y``, heights ``z``, radii ``radius`` (each (N, M), tile units).

    Ids are ``stroke * M + point``; ``reach`` is the greatest radius.
    """
    r = radius.reshape(-1, 1)
    zz = z.reshape(-1, 1)

    def shape(dx: Tensor, dy: Tensor) -> Tensor:
        rho = (dx * dx + dy * dy) / (r * r)
        return torch.where(rho < 1, zz - dome * rho * r, -math.inf)

    return splat(n, x.reshape(-1), y.reshape(-1), reach, shape)


def curves(
    d: Draw, count: int, points: int, length: Tensor | float, bend: float, turn: Tensor
) -> tuple[Tensor, Tensor]:
    """Random arcs: ``count`` curves of ``points`` points from random starts, headed ``turn`` (count,)."""
    t = torch.linspace(0, 1, points, device=d.device)
    k = bend * d.randn(count, 1)
    k2 = 0.7 * bend * d.randn(count, 1)
    angle = turn[:, None] + k * (t - 0.5) + k2 * torch.sin(2 * math.pi * t)
    step = (length if isinstance(length, Tensor) else torch.full((count,), length, device=d.device))[:, None] / points
    x = d.rand(count, 1) + torch.cumsum(torch.cos(angle) * step, 1)
    y = d.rand(count, 1) + torch.cumsum(torch.sin(angle) * step, 1)
    return x, y


def lines(n: int, x: Tensor, y: Tensor, weight: Tensor) -> Tensor:
    """Thin smooth lines through dense points (N, M), ``weight`` (N, M) or (N, 1); the strongest wins."""
    px, py = x * n - 0.5, y * n - 0.5
    ix, iy = torch.floor(px), torch.floor(py)
    fx, fy = px - ix, py - iy
    jx, jy = ix.long(), iy.long()
    out = torch.zeros(n * n, device=x.device)
    for ox in (0, 1):
        for oy in (0, 1):
            w = (fx if ox else 1 - fx) * (fy if oy else 1 - fy)
            at = ((jy + oy) % n) * n + (jx + ox) % n
            out.scatter_reduce_(0, at.reshape(-1), (w.sqrt() * weight).expand_as(px).reshape(-1), "amax")
    return out.view(n, n)
