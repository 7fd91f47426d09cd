"""Tilings of the unit torus: bricks, herringbone, basket weave, hexagons."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass
class Tiles:
    """A tiling: each pixel's tile id, offset from the tile's centre and distance to its edge (tile units)."""

    id: Tensor
    dx: Tensor
    dy: Tensor
    edge: Tensor
    count: int
    half: tuple[float, float]
    turned: Tensor | None = None  # True where the tile lies crosswise (herringbone, basket)

    def per_tile(self, values: Tensor) -> Tensor:
        return values[..., self.id]


def brick_tiles(u: Tensor, v: Tensor, columns: int, rows: int, shift: float | Tensor = 0.5) -> Tiles:
    """Running bond: ``columns`` by ``rows``, row j moved by ``shift * j`` (or ``shift[j]``) widths."""
    y = v * rows
    row = torch.floor(y)
    j = row.long() % rows
    if isinstance(shift, Tensor):
        x = u * columns + shift[j]
    else:
        x = u * columns + (shift * j.float() if rows % 2 == 0 or shift == 0 else 0.5 * (j % 2).float())
    col = torch.floor(x)
    i = col.long() % columns
    dx, dy = (x - col - 0.5) / columns, (y - row - 0.5) / rows
    edge = torch.minimum(0.5 / columns - dx.abs(), 0.5 / rows - dy.abs())
    return Tiles(j * columns + i, dx, dy, edge, columns * rows, (0.5 / columns, 0.5 / rows))


def herringbone_tiles(u: Tensor, v: Tensor, repeat: int, ratio: int) -> Tiles:
    """Herringbone of ``1 : ratio`` blocks; ``repeat`` periods of ``2 * ratio`` widths across."""
    period = 2 * ratio
    cells = repeat * period
    x, y = u * cells, v * cells
    ix, iy = torch.floor(x), torch.floor(y)
    fx, fy = x - ix, y - iy
    phase = (ix - iy).long() % period
    flat = phase < ratio
    along = torch.where(flat, phase.float() + fx, (period - 1 - phase).float() + fy) - ratio / 2
    across = torch.where(flat, fy, fx) - 0.5
    # The block's first cell names it.
    ax = torch.where(flat, ix - phase.float(), ix).long() % cells
    ay = torch.where(flat, iy, iy - (period - 1 - phase).float()).long() % cells
    edge = torch.minimum(ratio / 2 - along.abs(), 0.5 - across.abs()) / cells
    dx = torch.where(flat, along, across) / cells
    dy = torch.where(flat, across, along) / cells
    return Tiles(ay * cells + ax, dx, dy, edge, cells * cells, (ratio / 2 / cells, 0.5 / cells), ~flat)


def basket_tiles(u: Tensor, v: Tensor, repeat: int, strips: int) -> Tiles:
    """Basket weave: ``2 * repeat`` squares of ``strips`` parallel blocks across, every second one turned."""
    m = 2 * repeat
    x, y = u * m, v * m
    ix, iy = torch.floor(x), torch.floor(y)
    fx, fy = x - ix, y - iy
    turned = (ix + iy).long() % 2 == 1
    along, across = torch.where(turned, fy, fx), torch.where(turned, fx, fy) * strips
    k = torch.floor(across).clamp(0, strips - 1)
    da, dc = (along - 0.5) / m, (across - k - 0.5) / (strips * m)
    ident = ((iy.long() % m) * m + ix.long() % m) * strips + k.long()
    edge = torch.minimum(0.5 / m - da.abs(), 0.5 / (strips * m) - dc.abs())
    dx, dy = torch.where(turned, dc, da), torch.where(turned, da, dc)
    return Tiles(ident, dx, dy, edge, m * m * strips, (0.5 / m, 0.5 / (strips * m)), turned)


def hexagon_tiles(u: Tensor, v: Tensor, columns: int) -> Tiles:
    """Hexagons, ``columns`` across; rows stretched a little so that the pattern tiles."""
    rows = max(2, 2 * round(columns / math.sqrt(3)))
    x, y = u * columns, v * rows
    best: tuple[Tensor, Tensor, Tensor, Tensor] | None = None
    ky = columns / rows
    for odd in (0, 1):
        cy = torch.round((y - odd) / 2) * 2 + odd
        cx = torch.floor(x + 0.5 * (1 - odd)) + 0.5 * odd
        dx, dy = x - cx, (y - cy) * ky
        ident = (cy.long() % rows) * columns + torch.floor(cx).long() % columns
        dist = dx * dx + dy * dy
        if best is None:
            best = (dist, dx, dy, ident)
        else:
            near = dist < best[0]
            pairs = zip((dist, dx, dy, ident), best, strict=True)
            a, b, c, e = (torch.where(near, new, old) for new, old in pairs)
            best = (a, b, c, e)
    assert best is not None
    _, dx, dy, ident = best
    gx, gy = 0.5, 1 * ky
    norm = math.hypot(gx, gy)
    slant = norm / 2 - (dx.abs() * gx + dy.abs() * gy) / norm
    edge = torch.minimum(0.5 - dx.abs(), slant) / columns
    return Tiles(ident, dx / columns, dy / columns, edge, rows * columns, (0.5 / columns, 0.58 / columns))
