"""Woods: veneer, planks, parquet, siding, bark, varnished boards, OSB, MDF, cork, cardboard and paper."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from .noise import Draw, blur, sample, smoothstep, spectral, unit, worley
from .scatter import scatter, sizes
from .structure import Surface, any_colour, cavity, hsv, mix, ramp, to_slope, unit_range
from .tiles import Tiles, basket_tiles, brick_tiles, herringbone_tiles
from .wear import blotches, clouds, cracks, dust, mask, scratches, smudges, specks


@dataclass
class Timber:
    """A sawn face, grain along u: ring tone, pores, fibre and knots, about [0, 1] (fibre: unit noise)."""

    ring: Tensor
    pore: Tensor
    fibre: Tensor
    knot: Tensor

    def stack(self) -> Tensor:
        return torch.stack((self.ring, self.pore, self.fibre, self.knot))


def _timber(d: Draw, n: int, knots: int, rings: float | None = None, scale: float = 1.0) -> Timber:
    """Cuts through bent rings: loops where they touch the surface, stripes where they stand; knots push them."""
    u, v = d.grid(n)
    long = d.uniform(5, 12) / scale
    f = spectral(d, n, 4.0, low=1, high=d.uniform(4, 10), stretch=(long, 1))
    count = rings if rings is not None else d.log_uniform(3, 18) * scale
    # A whole number of rings over the tile, so that stripes meet; the bend makes loops where it outruns them.
    slope = max(1.0, round(count))
    field = slope * v + d.uniform(0.5, 2.0) * max(1.0, slope / 5) * f
    field = field + 0.06 * spectral(d, n, 2.2, low=4, high=60, stretch=(10 / scale, 1))
    knot = torch.zeros(n, n, device=d.device)
    for _ in range(knots):
        cx, cy = d.uniform(), d.uniform()
        r = d.log_uniform(0.008, 0.03) * scale**-0.3
        dx, dy = u - cx, v - cy
        dx, dy = dx - torch.round(dx), dy - torch.round(dy)
        rho = torch.sqrt((dx / d.uniform(1.0, 1.6)) ** 2 + dy * dy)
        near = torch.exp(-((dx / (6 * r)) ** 2) - (dy / (3.0 * r)) ** 2)
        side = torch.tanh(dy / (0.8 * r))
        field = field - slope * 2.2 * r * side * near
        inside = smoothstep(1.15 * r, 0.75 * r, rho)
        field = torch.lerp(field, rho / r * d.uniform(2, 4), inside)
        knot = torch.maximum(knot, inside + 0.25 * torch.exp(-((rho / (2.0 * r)) ** 2)))
    s = torch.remainder(field, 1)
    late = d.uniform(0.6, 0.9)
    ring = torch.where(s < late, (s / late) ** d.uniform(1.2, 2.6), 1 - (s - late) / (1 - late))
    vary = 0.55 + 0.45 * torch.sin(torch.floor(field) * 2.4 + d.uniform(0, 6))
    ring = ring * (0.55 + 0.45 * vary)
    fine = min(n / 3.0, d.uniform(70, 160) * scale)
    fibre = spectral(d, n, 1.0, low=3, high=fine * 1.5, stretch=(d.uniform(20, 45), 1))
    pores = spectral(d, n, 0.2, low=fine / 2, high=fine * 1.6, stretch=(d.uniform(12, 28), 1))
    pore = mask(pores + 0.5 * unit(ring), d.uniform(0.06, 0.22), 0.35)
    return Timber(ring, pore, fibre, knot.clamp(0, 1))


def _species(d: Draw) -> tuple[Tensor, Tensor]:
    """Early and late wood."""
    pick = d.uniform()
    if pick < 0.25:  # pale: birch, maple, spruce
        early = hsv(d, (0.08, 0.12), (0.15, 0.35), (0.75, 0.93))
    elif pick < 0.6:  # oak, teak, pine
        early = hsv(d, (0.06, 0.1), (0.35, 0.62), (0.5, 0.78))
    elif pick < 0.8:  # cherry, mahogany
        early = hsv(d, (0.03, 0.065), (0.5, 0.72), (0.36, 0.62))
    elif pick < 0.93:  # walnut, wenge
        early = hsv(d, (0.05, 0.085), (0.35, 0.55), (0.2, 0.42))
    else:  # weathered
        early = hsv(d, (0.06, 0.12), (0.05, 0.2), (0.4, 0.65))
    dark = d.uniform(0.55, 0.88)
    late = early * torch.tensor(
        [dark, dark * d.uniform(0.88, 0.98), dark * d.uniform(0.78, 0.95)], device=d.device
    ).view(3, 1, 1)
    return early, late


def _face(
    d: Draw, n: int, w: Timber, early: Tensor, late: Tensor, strength: float = 1.0
) -> tuple[Tensor, Tensor, Tensor]:
    """Colour, relief and roughness offset of a timber face."""
    c = mix(early, late, (strength * w.ring).clamp(0, 1)) * (1 + d.uniform(0.02, 0.08) * w.fibre)
    c = c * (1 - d.uniform(0.03, 0.28) * w.pore)
    c = mix(c, late * d.uniform(0.3, 0.6), (w.knot * 0.85).clamp(0, 1))
    open_grain = d.uniform(0.0, 1.0)
    relief = to_slope(w.fibre, 0.6) - open_grain * to_slope(w.pore, 1.0) + d.uniform(-0.5, 0.8) * to_slope(w.ring, 0.6)
    rough = 0.025 * w.fibre + d.uniform(-0.02, 0.1) * w.pore + d.uniform(-0.08, 0.06) * (w.ring - 0.4) - 0.05 * w.knot
    return c, relief, rough


def veneer(d: Draw, n: int) -> Surface:
    """One sheet: table tops, doors, panels."""
    w = _timber(d, n, d.choice((0, 0, 0, 1, 2)))
    early, late = _species(d)
    c, relief, rough = _face(d, n, w, early, late, d.uniform(0.4, 1.0))
    tone = clouds(d, n, 2.6)
    c = c * (1 + d.uniform(0.02, 0.14) * (tone - 0.5))
    rough = d.uniform(0.33, 0.7) + rough + d.uniform(0.0, 0.08) * smudges(d, n)
    s = Surface(c, relief + to_slope(spectral(d, n, 3.0), 0.2), rough, d.log_uniform(0.01, 0.12), limit=1.5)
    return _maybe_turned(d, s)


def _maybe_turned(d: Draw, s: Surface, chance: float = 0.4) -> Surface:
    if d.chance(chance):
        s.albedo, s.height, s.roughness = (t.transpose(-1, -2).contiguous() for t in (s.albedo, s.height, s.roughness))
    return s


def _laid(d: Draw, n: int, t: Tiles, w: Timber, scale: float) -> Timber:
    """The timber cut into the pieces of a tiling: each from another place, grain along its length."""
    along = t.dx if t.turned is None else torch.where(t.turned, t.dy, t.dx)
    across = t.dy if t.turned is None else torch.where(t.turned, t.dx, t.dy)
    place = d.rand(2, t.count)
    flip = torch.where(d.rand(t.count) < 0.5, -1.0, 1.0)
    fu = t.per_tile(place[0]) + along * scale * t.per_tile(flip)
    fv = t.per_tile(place[1]) + across * scale
    cut = sample(w.stack(), fu, fv)
    return Timber(cut[0], cut[1], cut[2], cut[3])


def _boards(d: Draw, n: int, t: Tiles, scale: float, knots: int, width: float, bevel: float, spread: float) -> Surface:
    w = _laid(d, n, t, _timber(d, n, knots, scale=scale if scale < 1 else 1.0), scale)
    early, late = _species(d)
    c, relief, rough = _face(d, n, w, early, late, d.uniform(0.5, 1.0))
    tone = t.per_tile(d.randn(t.count)).clamp(-2.2, 2.2)
    hue = t.per_tile(d.randn(t.count)).clamp(-2, 2)
    warmth = torch.stack((hue, 0 * hue, -1.4 * hue)) * 0.25 * spread
    c = c * (1 + spread * tone) * (1 + warmth)
    edge = t.edge + 0.0004 * spectral(d, n, 2.0, low=12)
    gap = smoothstep(width + 0.7 / n, width - 0.7 / n, edge)
    rise = ((edge - width) / bevel).clamp(0, 1)
    profile = 1 - (1 - rise) ** 2
    cup = t.per_tile(d.randn(t.count)) * t.dy + 0.5 * t.per_tile(d.randn(t.count)) * t.dx
    rim = torch.exp(-(edge - width).clamp_min(0) / bevel)
    c = c * (1 - d.uniform(0.0, 0.3) * rim) * (1 - d.uniform(0.5, 0.85) * gap)
    rough = d.uniform(0.33, 0.72) + rough + d.uniform(0.0, 0.04) * tone + d.uniform(-0.03, 0.12) * rim + 0.15 * gap
    height = to_slope(profile - 0.5 * gap + d.uniform(0, 1.5) * cup, 1.0) + to_slope(relief, d.uniform(0.1, 0.8))
    s = Surface(c, height, rough, d.log_uniform(0.03, 0.4), limit=2.2)
    _use(d, n, s)
    return s


def _use(d: Draw, n: int, s: Surface) -> None:
    """Traffic: scuffs, worn finish, dirt, polish."""
    patch = clouds(d, n, 2.2)
    s.albedo = s.albedo * (1 + d.uniform(0.0, 0.16) * (patch - 0.5))
    s.roughness = s.roughness + d.uniform(0.0, 0.14) * (patch - 0.5) + d.uniform(0.0, 0.06) * smudges(d, n)
    if d.chance(0.4):
        line = scratches(d, n, d.integer(10, 150), (0.02, 0.35), 0.5)
        s.albedo = s.albedo * (1 + d.uniform(-0.25, 0.25) * line)
        s.roughness = s.roughness + 0.15 * line
    if d.chance(0.35):
        m = dust(d, s.height, d.uniform(0.2, 0.8)) * blotches(d, n, 0.5, low=2, soft=0.8)
        s.albedo = s.albedo * (1 - 0.5 * m)
        s.roughness = s.roughness + 0.1 * m


def planks(d: Draw, n: int) -> Surface:
    """Floors and decks: long boards, joints at random, nails."""
    u, v = d.grid(n)
    rows = d.integer(3, 9)
    t = brick_tiles(u, v, d.choice((1, 1, 2)), rows, d.rand(rows))
    s = _boards(
        d,
        n,
        t,
        d.uniform(0.7, 1.3),
        d.integer(0, 4),
        d.log_uniform(0.0008, 0.004),
        d.uniform(0.002, 0.012),
        d.uniform(0.03, 0.14),
    )
    if d.chance(0.25):
        end = t.half[0] - t.dx.abs()
        dist = torch.sqrt((end - 0.02) ** 2 + (t.dy.abs() - 0.55 * t.half[1]) ** 2)
        nail = smoothstep(0.006, 0.004, dist)
        s.albedo = mix(s.albedo, hsv(d, (0.05, 0.1), (0, 0.2), (0.1, 0.35)), nail)
        s.roughness = s.roughness - 0.15 * nail
        s.height = s.height - 0.002 * nail
    return _maybe_turned(d, s)


def parquet(d: Draw, n: int) -> Surface:
    u, v = d.grid(n)
    kind = d.uniform()
    if kind < 0.35:
        t = herringbone_tiles(u, v, d.integer(1, 3), d.integer(3, 5))
    elif kind < 0.65:
        t = basket_tiles(u, v, d.integer(1, 4), d.integer(3, 6))
    else:
        rows = d.integer(8, 22)
        t = brick_tiles(u, v, d.integer(2, 4), rows, d.rand(rows))
    return _boards(
        d,
        n,
        t,
        d.uniform(0.8, 1.6),
        0,
        d.log_uniform(0.0005, 0.002),
        d.uniform(0.001, 0.006),
        d.uniform(0.05, 0.2),
    )


def siding(d: Draw, n: int) -> Surface:
    """Weathered or painted cladding: overlapping boards, deep shadows, peeling paint, raised grain."""
    u, v = d.grid(n)
    rows = d.integer(4, 14)
    t = brick_tiles(u, v, 1, rows, d.rand(rows))
    w = _laid(d, n, t, _timber(d, n, d.integer(0, 3)), 1.0)
    down = t.dy / t.half[1]
    lap = d.chance(0.6)
    step = (0.5 + 0.5 * down) * 1.0 if lap else 0.0 * down
    gap = smoothstep(0.84, 0.97, down.abs()) if not lap else smoothstep(0.9, 0.99, down)
    early, late = _species(d)
    if d.chance(0.5):
        grey = hsv(d, (0.06, 0.12), (0.03, 0.2), (0.35, 0.65))
        early, late = (
            mix(early, grey, torch.tensor(0.75, device=d.device)),
            mix(late, grey * 0.6, torch.tensor(0.75, device=d.device)),
        )
    c, relief, rough = _face(d, n, w, early, late)
    rough = d.uniform(0.5, 0.8) + rough
    if d.chance(0.5):
        coat = any_colour(d, 0.6, (0.35, 0.95)) * (1 + 0.04 * w.fibre + 0.05 * t.per_tile(d.randn(t.count)))
        f = spectral(d, n, 1.7, low=3, stretch=(d.uniform(2, 6), 1)) + 0.4 * w.fibre + 0.3 * unit(w.ring)
        flake = mask(unit(f), d.uniform(0.0, 0.6), 0.12)
        c = mix(coat, c, flake)
        rough = rough + 0.1 * flake - 0.1
        relief = relief * 0.6 - 0.003 * blur(flake, 1.0 / n)
    split = (
        cracks(d, u * 0.25, v, d.integer(10, 30), 0.05) * blotches(d, n, 0.15, low=2, soft=0.5)
        if d.chance(0.3)
        else 0.0
    )
    c = c * (1 + 0.06 * t.per_tile(d.randn(t.count))) * (1 - d.uniform(0.5, 0.8) * gap) * (1 - 0.5 * split)
    z = blur(step - d.uniform(0.5, 1.3) * gap, 0.8 / n)
    height = to_slope(z, 1.0) + to_slope(relief, d.uniform(0.15, 0.7)) - 0.004 * split
    s = Surface(c, height, rough + 0.1 * gap, d.log_uniform(0.15, 0.9), limit=2.5)
    _use(d, n, s)
    return _maybe_turned(d, s)


def bark(d: Draw, n: int) -> Surface:
    """Furrowed, plated or smooth bark; moss and lichen; trunks stand upright."""
    u, v = d.grid(n)
    k = d.integer(4, 13)
    tall = d.uniform(1.5, 5.0)
    ky = max(3, round(k / tall))
    w = spectral(d, n, 3.0, low=k / 2, high=3 * k, stretch=(1, d.uniform(1, 2.5)), batch=2)
    drift = 0.04 * spectral(d, n, 3.0, low=1, high=6, stretch=(1, 2))
    c = worley(d, u + drift + (0.15 / k) * w[0], v + (0.2 / ky) * w[1], k, ky)
    furrow = smoothstep(0.0, d.uniform(0.15, 0.45), c.edge)
    f = spectral(d, n, 2.3, low=k / 2, stretch=(1, d.uniform(3, 7)))
    plates = spectral(d, n, 2.4, low=1.5 * k, high=8 * k, stretch=(1, d.uniform(1, 3.5)))
    scale_steps = torch.floor(2.5 * plates) + smoothstep(0.0, 0.4, torch.remainder(2.5 * plates, 1))
    grain = spectral(d, n, 0.8, low=n / 14)
    height = to_slope(furrow * (0.6 + 0.4 * c.per_cell(d.rand(c.count))), d.uniform(0.6, 1.2))
    height = height + to_slope(-f.abs(), d.uniform(0.3, 0.8)) + to_slope(grain, 0.18)
    height = height + to_slope(blur(scale_steps, 0.0015), d.uniform(0.05, 0.35))
    relief = unit_range(height)
    cav = cavity(height, 0.015)
    deep = hsv(d, (0.03, 0.09), (0.2, 0.5), (0.12, 0.3))
    crust = hsv(d, (0.04, 0.12), (0.03, 0.35), (0.38, 0.7))
    c0 = ramp(0.2 + 0.75 * relief + 0.1 * cav, [deep, mix(deep, crust, torch.tensor(0.6, device=d.device)), crust])
    albedo = c0 * (1 + 0.06 * grain + 0.1 * (clouds(d, n, 2.0, low=3) - 0.5) + 0.07 * c.per_cell(d.randn(c.count)))
    rough = d.uniform(0.55, 0.9) - d.uniform(-0.1, 0.15) * (relief - 0.5) + 0.03 * grain
    if d.chance(0.55):
        field = spectral(d, n, 1.7, low=d.uniform(3, 9))
        m = mask(field, d.uniform(0.05, 0.4), 0.2)
        green = hsv(d, (0.13, 0.27), (0.15, 0.65), (0.3, 0.65))
        tuft = spectral(d, n, 0.8, low=n / 10)
        albedo = mix(albedo, green * (1 + 0.15 * tuft), m * d.uniform(0.4, 1.0))
        height = height + 0.003 * m + m * to_slope(tuft, 0.3)
        rough = rough + 0.05 * m
    return _maybe_turned(d, Surface(albedo, height, rough, d.log_uniform(0.5, 1.4), limit=2.0), 0.15)


def varnished(d: Draw, n: int) -> Surface:
    """High-gloss or waxed: smooth film over the grain, wiped, ringed, faintly scratched."""
    w = _timber(d, n, d.choice((0, 0, 1)))
    early, late = _species(d)
    c, _, offset = _face(d, n, w, early, late, d.uniform(0.6, 1.0))
    c = (c * d.uniform(0.75, 1.0)).clamp(0, 1) ** d.uniform(1.0, 1.3)
    rough = d.uniform(0.12, 0.4) + 0.3 * offset + d.uniform(0.02, 0.1) * smudges(d, n)
    line = scratches(d, n, d.integer(10, 200), (0.02, 0.5), 0.5)
    rough = rough + d.uniform(0.05, 0.25) * line
    peel = spectral(d, n, 2.2, low=d.uniform(8, 30), high=100)
    height = to_slope(peel, 1.0) + to_slope(w.fibre, d.uniform(0, 0.6)) + to_slope(spectral(d, n, 3.2), 0.4)
    return _maybe_turned(d, Surface(c, height, rough, d.log_uniform(0.004, 0.05)))


def sheet_board(d: Draw, n: int) -> Surface:
    """OSB: long flakes pressed every way, resin between; or chipboard of small ones."""
    big = d.chance(0.65)
    high = d.uniform(0.04, 0.11) if big else d.uniform(0.01, 0.03)
    low = 0.35 * high
    count = int(d.uniform(1.6, 2.6) / (0.6 * high) ** 2)
    p = torch.stack(
        (
            math.pi * d.rand(count) if d.chance(0.6) else d.uniform(0, 3) + 0.5 * d.randn(count),
            2.0 + 3 * d.rand(count),
            d.rand(count),
            d.randn(count),
            d.randn(count),
        )
    )

    def flake(x: Tensor, y: Tensor, q: Tensor) -> Tensor:
        c, s = torch.cos(q[0]), torch.sin(q[0])
        a, b = c * x + s * y, (c * y - s * x) * q[1]
        inside = (
            torch.maximum(a.abs() + 0.12 * torch.sin(5 * b + 6 * q[3]), b.abs() + 0.1 * torch.sin(4 * a + 5 * q[4]))
            < 0.8
        )
        return torch.where(inside, q[2] + 0.12 * q[3] * a + 0.1 * q[4] * b, -math.inf)

    s, p = scatter(d, n, sizes(d, count, max(low, 2.0 / n), high, 1.0), p, flake)
    turn, slim = s.per_splat(p[0]), s.per_splat(p[1])
    a = torch.cos(turn) * s.dx + torch.sin(turn) * s.dy
    b = (torch.cos(turn) * s.dy - torch.sin(turn) * s.dx) * slim
    place = s.per_splat(d.rand(count))
    fibre = sample(spectral(d, n, 1.0, low=4, stretch=(14, 1)), place + 0.15 * a, place * 7 + 0.12 * b)
    early, late = (
        _species(d)
        if d.chance(0.3)
        else (hsv(d, (0.08, 0.115), (0.35, 0.6), (0.65, 0.88)), hsv(d, (0.06, 0.1), (0.4, 0.65), (0.5, 0.72)))
    )
    tone = (0.5 + 0.3 * s.per_splat(d.randn(count))).clamp(0, 1)
    albedo = mix(early, late, tone) * (1 + 0.07 * fibre) * (1 + 0.05 * s.per_splat(d.randn(count)))
    z = torch.where(s.hit, s.top, 0.0)
    edge = smoothstep(0.3, 1.0, -cavity(z, 0.004))
    albedo = albedo * (1 - d.uniform(0.1, 0.45) * edge)
    dark = (s.per_splat(d.rand(count)) < 0.06).float()
    albedo = albedo * (1 - 0.45 * dark)
    height = to_slope(blur(z, 0.0008), 1.0) + to_slope(fibre, d.uniform(0.2, 0.8))
    rough = d.uniform(0.45, 0.75) + d.uniform(0.02, 0.08) * s.per_splat(d.randn(count)) + 0.03 * fibre + 0.08 * edge
    return Surface(albedo, height, rough, d.log_uniform(0.03, 0.2), limit=1.5)


def fibreboard(d: Draw, n: int) -> Surface:
    """MDF and hardboard: even, finely mottled."""
    base = hsv(d, (0.05, 0.1), (0.3, 0.65), (0.4, 0.75))
    fine = spectral(d, n, 0.6, low=n / 10)
    mottle = spectral(d, n, 1.6, low=10)
    dots = specks(d, n, d.uniform(0.01, 0.05), n / 5)
    albedo = base * (1 + d.uniform(0.01, 0.04) * fine + d.uniform(0.01, 0.04) * mottle - d.uniform(0.0, 0.2) * dots)
    albedo = albedo * (1 + d.uniform(0.0, 0.08) * (clouds(d, n) - 0.5))
    rough = d.uniform(0.35, 0.75) + 0.015 * fine + 0.02 * mottle + d.uniform(0, 0.06) * smudges(d, n)
    height = to_slope(fine, 1.0) + to_slope(mottle, d.uniform(0.2, 1.0))
    return Surface(albedo, height, rough, d.log_uniform(0.01, 0.15), limit=1.5)


def cork(d: Draw, n: int) -> Surface:
    """Pressed granules of cork, dark seams, pits."""
    u, v = d.grid(n)
    k = int(min(d.log_uniform(14, 50), n / 5))
    w = (0.1 / k) * spectral(d, n, 2.6, low=k / 2, high=4 * k, batch=2)
    c = worley(d, u + w[0], v + w[1], k, k)
    fine = spectral(d, n, 0.8, low=2 * k)
    pit = blotches(d, n, d.uniform(0.02, 0.1), low=k, beta=1.0, soft=0.2)
    seam = smoothstep(0.1, 0.0, c.edge)
    base = hsv(d, (0.06, 0.1), (0.35, 0.6), (0.55, 0.8))
    tone = 1 + d.uniform(0.05, 0.16) * c.per_cell(d.randn(c.count)) + 0.07 * fine
    albedo = base * tone * (1 - 0.25 * seam) * (1 - d.uniform(0.3, 0.6) * pit)
    height = to_slope(c.per_cell(d.rand(c.count)) * 0.3 * (1 - seam) - 0.3 * seam, 1.0) - to_slope(
        blur(pit, 1.0 / n), 1.0
    )
    height = blur(height, 0.7 / n) + to_slope(fine, 0.4)
    rough = d.uniform(0.55, 0.85) + 0.04 * c.per_cell(d.randn(c.count)) + 0.08 * pit + 0.02 * fine
    return Surface(albedo, height, rough, d.log_uniform(0.06, 0.3), limit=1.5)


def card(d: Draw, n: int) -> Surface:
    """Cardboard and paper: fluting showing through, fibres, creases."""
    u, v = d.grid(n)
    paper = d.chance(0.4)
    base = hsv(d, (0.07, 0.13), (0.0, 0.1), (0.8, 0.96)) if paper else hsv(d, (0.07, 0.1), (0.28, 0.5), (0.5, 0.75))
    tooth = spectral(d, n, d.uniform(0.6, 1.6), low=n / 20)
    fibre = spectral(d, n, 1.0, low=12, stretch=(6, 1), angle=d.uniform(0, math.pi))
    height = to_slope(tooth, 1.0) + to_slope(spectral(d, n, 3.0, low=1), 0.4)
    if not paper:
        height = height + to_slope(torch.cos(2 * math.pi * d.integer(16, 60) * u), d.uniform(0.0, 1.5) + 1e-3)
    if d.chance(0.35):
        k = d.integer(3, 6)
        c = worley(d, u, v, k, k)
        height = height + to_slope(c.f2 - c.f1, d.uniform(0.5, 2.0))
    dots = specks(d, n, 0.01, n / 4)
    albedo = base * (1 + 0.02 * tooth + d.uniform(0.01, 0.04) * fibre - d.uniform(0, 0.15) * dots)
    albedo = albedo * (1 + d.uniform(0, 0.1) * (clouds(d, n) - 0.5))
    rough = d.uniform(0.5, 0.85) + 0.015 * tooth + 0.02 * fibre
    return _maybe_turned(d, Surface(albedo, height, rough, d.log_uniform(0.02, 0.15), limit=1.5))


FAMILIES = {
    "veneer": veneer,
    "planks": planks,
    "parquet": parquet,
    "siding": siding,
    "bark": bark,
    "varnished": varnished,
    "sheet_board": sheet_board,
    "fibreboard": fibreboard,
    "cork": cork,
    "card": card,
}
