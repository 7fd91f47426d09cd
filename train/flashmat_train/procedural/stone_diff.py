"""Matt stones: plaster, stucco, concrete, brick, paving, cobbles, flagstones, slate, rock, sandstone, roofs."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from .noise import Draw, blur, smoothstep, spectral, unit, warp, worley
from .scatter import scatter, sizes, stone_params, stone_shape
from .structure import Surface, any_colour, cavity, hsv, jitter, mix, ramp, to_slope, unit_range
from .tiles import Tiles, basket_tiles, brick_tiles, herringbone_tiles, hexagon_tiles
from .wear import blotches, clouds, cracks, dust, mask, smudges, specks, streaks


def _mineral(d: Draw) -> Tensor:
    pick = d.uniform()
    if pick < 0.4:
        return hsv(d, (0.05, 0.16), (0.0, 0.14), (0.3, 0.85))
    if pick < 0.65:
        return hsv(d, (0.5, 0.7), (0.0, 0.12), (0.25, 0.7))
    return hsv(d, (0.04, 0.12), (0.15, 0.45), (0.35, 0.75))


def _weather(
    d: Draw, n: int, albedo: Tensor, rough: Tensor, height: Tensor, upright: bool = False
) -> tuple[Tensor, Tensor]:
    """Stains, rain runs, soot or moss in the recesses."""
    albedo = albedo * (1 + d.uniform(0.03, 0.22) * (clouds(d, n, d.uniform(1.8, 2.6)) - 0.5))
    if upright and d.chance(0.4):
        run = streaks(d, n, 0.5) * d.uniform(0.1, 0.45)
        albedo = albedo * (1 - run)
        rough = rough - 0.1 * run
    if d.chance(0.45):
        grime = (
            hsv(d, (0.05, 0.13), (0.05, 0.4), (0.1, 0.35))
            if d.chance(0.7)
            else hsv(d, (0.17, 0.27), (0.3, 0.7), (0.2, 0.4))
        )
        m = dust(d, height, d.uniform(0.1, 0.75))
        albedo = mix(albedo, grime, 0.7 * m)
        rough = rough + d.uniform(-0.05, 0.12) * m
    rough = rough + d.uniform(0.0, 0.06) * smudges(d, n)
    return albedo, rough


def plaster(d: Draw, n: int) -> Surface:
    """Trowelled wall plaster, painted or bare: faint waves, pinholes, hairline cracks, patches."""
    trowel = spectral(d, n, d.uniform(2.4, 3.2), low=2, stretch=(d.uniform(1, 3), 1), angle=d.uniform(0, math.pi))
    grain = spectral(d, n, d.uniform(0.4, 1.4), low=d.log_uniform(8, 50))
    height = to_slope(trowel, 1.0) + to_slope(grain, d.uniform(0.2, 1.5))
    base = hsv(d, (0.06, 0.15), (0.0, 0.15), (0.6, 0.95)) if d.chance(0.6) else any_colour(d, 0.5, (0.35, 0.9))
    albedo = base * (1 + 0.03 * cavity(height, 0.03) + 0.015 * grain)
    rough = d.uniform(0.6, 0.9) + 0.02 * grain
    hole = (
        specks(d, n, d.uniform(0.001, 0.01), d.uniform(30, n / 4))
        if d.chance(0.5)
        else torch.zeros(n, n, device=d.device)
    )
    height = height - 0.003 * blur(hole, 1.0 / n)
    albedo = albedo * (1 - 0.25 * hole)
    if d.chance(0.35):
        u, v = d.grid(n)
        line = cracks(d, u, v, d.integer(2, 5), 0.012, 0.3) * blotches(d, n, 0.4, low=1.5, soft=0.4)
        albedo = albedo * (1 - 0.5 * line)
        height = height - 0.004 * line
    if d.chance(0.35):  # flaked paint over another coat
        f = spectral(d, n, 1.9, low=d.uniform(2, 5))
        m = mask(f, d.uniform(0.05, 0.5), 0.05)
        under = hsv(d, (0.05, 0.12), (0.03, 0.3), (0.4, 0.8)) * (1 + 0.06 * spectral(d, n, 1.4, low=5))
        albedo = mix(albedo, under, m)
        rough = rough + 0.08 * m
        height = height - 0.0035 * blur(m, 1.0 / n) + m * to_slope(spectral(d, n, 1.2, low=10), 0.5)
    albedo, rough = _weather(d, n, albedo, rough, height, upright=True)
    return Surface(albedo, height, rough, d.log_uniform(0.02, 0.22), limit=1.6)


def stucco(d: Draw, n: int) -> Surface:
    """Thrown or combed render: lace, dashes, swirls."""
    kind = d.uniform()
    grain = spectral(d, n, 0.8, low=n / 14)
    if kind < 0.35:  # knocked-down lace
        f = spectral(d, n, 2.2, low=d.uniform(6, 22), high=80)
        height = blur(smoothstep(-0.4, d.uniform(0.3, 1.2), f), 1.0 / n) + 0.1 * f
    elif kind < 0.7:  # dash of small stones in mortar
        count = d.integer(1500, 5000)
        p = stone_params(d, count, 0.5)
        size = sizes(d, count, max(0.004, 1.3 / n), d.uniform(0.01, 0.02), 2.0)
        s, _ = scatter(d, n, size, p, stone_shape(0.08, 2.0, 0.8, 0.2), floor=-0.1)
        height = s.top + 0.1 * spectral(d, n, 2.0, low=5)
    else:  # combed
        field = spectral(d, n, 3.0, low=d.uniform(1, 4), high=12)
        strokes = spectral(d, n, 1.2, low=12, stretch=(5, 1), angle=d.uniform(0, math.pi))
        height = torch.sin(d.uniform(5, 12) * field) * 0.5 + strokes
    height = to_slope(height, 1.0) + to_slope(grain, d.uniform(0.1, 0.5))
    base = hsv(d, (0.05, 0.14), (0.0, 0.35), (0.5, 0.92)) if d.chance(0.7) else any_colour(d, 0.5, (0.35, 0.9))
    cav = cavity(height, 0.015)
    albedo = base * (1 + d.uniform(0.03, 0.14) * cav + 0.03 * grain)
    rough = d.uniform(0.6, 0.9) - 0.05 * cav + 0.02 * grain
    albedo, rough = _weather(d, n, albedo, rough, height, upright=True)
    return Surface(albedo, height, rough, d.log_uniform(0.15, 0.6), limit=1.6)


def concrete(d: Draw, n: int) -> Surface:
    """Cast concrete: shutter marks, blow holes, or washed to the aggregate."""
    u, v = d.grid(n)
    grain = spectral(d, n, 0.7, low=n / 16)
    base = hsv(d, (0.05, 0.14), (0.0, 0.13), (0.38, 0.8))
    body = clouds(d, n, 2.2, low=1.5)
    if d.chance(0.35):  # exposed aggregate
        high = d.log_uniform(0.008, 0.03)
        count = int(min(d.uniform(0.6, 1.3) / (0.4 * high) ** 2 / 2, 8000))
        p = stone_params(d, count, 0.5)
        s, _ = scatter(
            d,
            n,
            sizes(d, count, max(0.25 * high, 1.3 / n), high, 2.0),
            p,
            stone_shape(0.1, 3, 0.6, 0.15),
            floor=0.0,
        )
        m = s.hit.float() * smoothstep(d.uniform(0.0, 0.7), 1.1, s.top)
        stones = ramp(0.5 + 0.3 * s.per_splat(d.randn(count)), [_mineral(d) for _ in range(3)])
        albedo = mix(base * (1 + 0.05 * grain), stones * (1 + 0.1 * s.per_splat(d.randn(count))), m)
        height = to_slope(s.top, 1.0) + to_slope(grain, 0.4)
        rough = d.uniform(0.5, 0.8) - d.uniform(0, 0.15) * m + 0.03 * grain
        slope = d.log_uniform(0.1, 0.5)
    else:
        albedo = base * (1 + d.uniform(0.05, 0.2) * (body - 0.5) + d.uniform(0.01, 0.05) * grain)
        wave = spectral(d, n, 2.8, low=2)
        height = to_slope(wave, 1.0) + to_slope(grain, d.uniform(0.3, 1.5))
        hole = specks(d, n, d.uniform(0.002, 0.015), d.uniform(14, 60))
        hole = hole * blotches(d, n, 0.6, low=2, soft=0.6)
        height = height - d.uniform(0.003, 0.008) * blur(hole, 1.2 / n)
        albedo = albedo * (1 - d.uniform(0.2, 0.55) * hole)
        rough = d.uniform(0.5, 0.85) - d.uniform(-0.05, 0.12) * (body - 0.5) + 0.02 * grain + 0.08 * hole
        slope = d.log_uniform(0.025, 0.25)
        if d.chance(0.35):  # boards of the form
            boards = d.integer(3, 10)
            t = brick_tiles(v, u, d.integer(1, 2), boards, d.rand(boards))
            wood = warp(spectral(d, n, 1.2, low=3, stretch=(1, 14)), 0 * u, t.per_tile(d.rand(t.count)))
            seam = torch.exp(-t.edge / 0.003)
            height = height + to_slope(wood, 0.6) + to_slope(t.per_tile(d.rand(t.count)) - 0.6 * seam, 0.8)
            albedo = albedo * (1 + 0.06 * t.per_tile(d.randn(t.count)) - 0.25 * seam + 0.03 * wood)
        elif d.chance(0.25):  # panel joints and tie holes
            t = brick_tiles(u, v, d.integer(1, 2), d.integer(1, 3), 0.0)
            seam = smoothstep(0.005, 0.002, t.edge)
            tie = torch.sqrt((t.dx.abs() - 0.6 * t.half[0]) ** 2 + (t.dy.abs() - 0.6 * t.half[1]) ** 2)
            hole = smoothstep(0.014, 0.011, tie)
            height = height - to_slope(seam + hole, 1.0)
            albedo = albedo * (1 - 0.4 * torch.maximum(seam, hole))
    if d.chance(0.35):
        line = cracks(d, u, v, d.integer(2, 4), 0.012, 0.35) * blotches(d, n, 0.45, low=1.5, soft=0.5)
        albedo = albedo * (1 - 0.5 * line)
        height = height - 0.006 * line
    albedo, rough = _weather(d, n, albedo, rough, height, upright=True)
    return Surface(albedo, height, rough, slope, limit=1.6)


def _blocks(d: Draw, n: int, t: Tiles, width: float, bevel: float, ragged: float) -> tuple[Tensor, Tensor]:
    """Mortar mask and block profile (domed rim, each block tilted and set at its own depth)."""
    edge = t.edge + ragged * spectral(d, n, 1.8, low=8) + 0.5 * ragged * spectral(d, n, 1.2, low=30)
    gap = smoothstep(width + 1.0 / n, width - 1.0 / n, edge)
    rise = ((edge - width) / bevel).clamp(0, 1)
    profile = 1 - (1 - rise) ** 2
    tilt = t.per_tile(d.randn(t.count)) * t.dx / t.half[0] + t.per_tile(d.randn(t.count)) * t.dy / t.half[1]
    sunk = t.per_tile(d.rand(t.count))
    return gap, profile * (1 - 0.3 * sunk) + d.uniform(0.0, 0.12) * tilt * (1 - gap)


def _masonry(
    d: Draw,
    n: int,
    t: Tiles,
    face: Tensor,
    width: float,
    bevel: float,
    ragged: float,
    spread: float,
    skin: Tensor,
) -> Surface:
    """Blocks in mortar: ``face`` colours (3,n,n), ``skin`` relief of their faces."""
    gap, profile = _blocks(d, n, t, width, bevel, ragged)
    grit = spectral(d, n, 0.8, low=n / 16)
    chips = blotches(d, n, d.uniform(0.03, 0.2), low=8, beta=1.4, soft=0.1) * smoothstep(4 * bevel, 0.0, t.edge - width)
    profile = profile - d.uniform(0.1, 0.5) * chips * (1 - gap)
    tone = 1 + spread * t.per_tile(d.randn(t.count)) + d.uniform(0.02, 0.08) * unit(skin) + 0.03 * grit
    mortar = hsv(d, (0.05, 0.13), (0.0, 0.25), (0.25, 0.8)) * (1 + 0.07 * grit) * (0.9 + 0.2 * clouds(d, n))
    rim = torch.exp(-(t.edge - width).clamp_min(0) / (0.6 * bevel)) * (1 - gap)
    albedo = mix(face * tone * (1 + d.uniform(-0.25, 0.15) * rim), mortar, gap)
    albedo = mix(albedo, jitter(d, face.mean((1, 2), keepdim=True), 0.1), 0.4 * chips * (1 - gap))
    z = profile * (1 - gap) + gap * (d.uniform(-0.3, 0.3) * bevel / max(bevel, width))
    height = to_slope(z, 1.0) + to_slope(skin, d.uniform(0.1, 0.45)) * (1 - gap) + to_slope(grit, d.uniform(0.05, 0.25))
    level = d.uniform(0.5, 0.82)
    rough = level + d.uniform(0.0, 0.06) * t.per_tile(d.randn(t.count)) + 0.02 * grit - 0.05 * rim
    rough = torch.lerp(rough, d.uniform(0.6, 0.95) + 0.03 * grit, gap)
    albedo, rough = _weather(d, n, albedo, rough, z)
    return Surface(albedo, height, rough, d.log_uniform(0.12, 0.65), limit=2.0)


def brick(d: Draw, n: int) -> Surface:
    """Walls and pavings of clay brick: bond, stack, basket weave, herringbone; burnt ends, lime, soot."""
    u, v = d.grid(n)
    w = 0.0025 * spectral(d, n, 2.6, low=3, high=20, batch=2)
    kind = d.uniform()
    if kind < 0.65:
        columns = d.integer(2, 7)
        t = brick_tiles(u + w[0], v + w[1], columns, 2 * max(1, round(columns * d.uniform(0.9, 1.9))), 0.5)
    elif kind < 0.8:
        t = herringbone_tiles(u + w[0], v + w[1], d.integer(1, 3), d.choice((2, 2, 3)))
    else:
        t = basket_tiles(u + w[0], v + w[1], d.integer(1, 3), d.choice((2, 2, 3)))
    small = t.half[1]
    clay = hsv(d, (0.015, 0.075), (0.3, 0.7), (0.35, 0.72)) if d.chance(0.75) else _mineral(d)
    burnt = jitter(d, clay * 0.55, 0.05)
    pale = jitter(d, clay, 0.06) * 1.15
    pick = t.per_tile(d.rand(t.count))
    skin = spectral(d, n, 1.6, low=6)
    face = ramp(0.25 + 0.6 * pick + 0.08 * skin, [burnt, clay, pale])
    face = mix(face, burnt, blotches(d, n, 0.2, low=4, soft=0.8) * d.uniform(0, 0.7))
    lime = blotches(d, n, d.uniform(0.02, 0.3), low=3, beta=1.8, soft=0.6) * d.uniform(0, 0.7)
    face = mix(face, hsv(d, (0.06, 0.12), (0, 0.12), (0.65, 0.9)), lime)
    width, bevel = small * d.uniform(0.04, 0.16), small * d.uniform(0.1, 0.45)
    return _masonry(d, n, t, face, width, bevel, small * d.uniform(0.01, 0.06), d.uniform(0.03, 0.14), skin)


def paving(d: Draw, n: int) -> Surface:
    """Concrete pavers and slabs: hexagons, interlocking waves, squares, herringbone; sand in the joints."""
    u, v = d.grid(n)
    kind = d.uniform()
    k = d.integer(2, 7)
    if kind < 0.25:
        t = hexagon_tiles(u, v, 2 * k)
    elif kind < 0.5:  # wavy interlocking
        rows = 2 * k
        x = u + d.uniform(0.1, 0.3) / k * torch.sin(2 * math.pi * rows * v) * 0.5
        y = v + d.uniform(0.05, 0.2) / rows * torch.sin(4 * math.pi * k * u)
        t = brick_tiles(x, y, k, rows, 0.5)
    elif kind < 0.75:
        t = brick_tiles(u, v, k, k * d.integer(1, 2), d.choice((0.0, 0.5)))
    else:
        t = herringbone_tiles(u, v, d.integer(1, 3), 2)
    small = min(t.half)
    skin = unit(spectral(d, n, 0.9, low=n / 20) + 0.6 * spectral(d, n, 2.0, low=4))
    base = _mineral(d)
    face = mix(base, jitter(d, base, 0.12), t.per_tile(d.rand(t.count)) * clouds(d, n, 1.8, low=3))
    dots = specks(d, n, d.uniform(0.02, 0.1), n / 4)
    face = face * (1 + d.uniform(-0.3, 0.3) * dots)
    width, bevel = small * d.uniform(0.02, 0.07), small * d.uniform(0.05, 0.3)
    return _masonry(d, n, t, face, width, bevel, small * d.uniform(0.0, 0.02), d.uniform(0.01, 0.08), skin)


def cobbles(d: Draw, n: int) -> Surface:
    """Setts and rounded cobbles, in rows, fans or at random; polished crowns."""
    u, v = d.grid(n)
    k = d.integer(5, 16)
    w = (0.04 / k) * spectral(d, n, 2.8, low=k / 2, high=2.5 * k, batch=2)
    fan = d.uniform(0.0, 0.05) * torch.sin(2 * math.pi * d.integer(1, 2) * u) if d.chance(0.4) else 0.0
    jitter_by = d.uniform(0.3, 0.95)
    ky = max(3, round(k * d.uniform(0.8, 1.4)))
    c = worley(d, u + w[0], v + w[1] + fan, k, ky, jitter_by)
    side = 1 / math.sqrt(k * ky)
    t = Tiles(c.id, c.dx * side, c.dy * side, c.edge * side, c.count, (0.5 * side, 0.5 * side))
    skin = unit(spectral(d, n, 1.8, low=k) + 0.4 * spectral(d, n, 0.8, low=n / 16))
    palette = [_mineral(d) for _ in range(3)] if d.chance(0.4) else [(m := _mineral(d)) * 0.75, m, jitter(d, m, 0.08)]
    face = ramp(t.per_tile(d.rand(t.count)), palette) * (1 + 0.05 * skin)
    s = _masonry(
        d,
        n,
        t,
        face,
        side * d.uniform(0.04, 0.12),
        side * d.uniform(0.2, 0.45),
        side * 0.02,
        d.uniform(0.04, 0.15),
        skin,
    )
    crown = smoothstep(0.15, 0.45, c.edge)
    s.roughness = s.roughness - d.uniform(0, 0.2) * crown
    s.slope = d.log_uniform(0.2, 0.6)
    return s


def flagstones(d: Draw, n: int) -> Surface:
    """Crazy paving: big irregular slabs, riven faces, pointed joints."""
    u, v = d.grid(n)
    k = d.integer(3, 6)
    w = (0.03 / k) * spectral(d, n, 3.0, low=k, high=5 * k, batch=2)
    c = worley(d, u + w[0], v + w[1], k, k, 0.9)
    side = 1 / k
    t = Tiles(c.id, c.dx * side, c.dy * side, c.edge * side, c.count, (0.5 * side, 0.5 * side))
    f = spectral(d, n, 2.4, low=3)
    steps = 6.0
    riven = torch.floor(steps * f) + smoothstep(0.0, 0.35, torch.remainder(steps * f, 1))
    skin = unit(0.6 * unit(riven) + unit(f) + 0.5 * spectral(d, n, 1.4, low=10))
    palette = [m := _mineral(d), jitter(d, m, 0.12), _mineral(d)]
    face = ramp(t.per_tile(d.rand(t.count)) * 0.9 + 0.1 * clouds(d, n, 1.8), palette)
    return _masonry(d, n, t, face, side * d.uniform(0.02, 0.05), side * d.uniform(0.03, 0.15), side * 0.01, 0.07, skin)


def slate(d: Draw, n: int) -> Surface:
    """Cleft slate: thin sheets broken in steps, metallic greys, rust along the breaks."""
    f = spectral(
        d,
        n,
        d.uniform(2.4, 3.0),
        low=d.uniform(1.5, 4),
        stretch=(d.uniform(1, 3), 1),
        angle=d.uniform(0, math.pi),
    )
    wob = 0.15 * spectral(d, n, 1.8, low=8)
    sheets = d.uniform(2, 6)
    g = sheets * f + wob
    step = torch.floor(g) + smoothstep(0.0, d.uniform(0.1, 0.5), torch.remainder(g, 1))
    fine = spectral(d, n, 1.6, low=5, stretch=(d.uniform(1, 4), 1), angle=d.uniform(0, math.pi))
    grain = spectral(d, n, 0.6, low=n / 12)
    height = to_slope(step, 1.0) + to_slope(fine, d.uniform(0.2, 0.7)) + to_slope(grain, 0.15)
    base = hsv(d, (0.5, 0.68), (0.03, 0.22), (0.16, 0.5)) if d.chance(0.65) else _mineral(d)
    layer = torch.remainder(torch.floor(g) * 0.37, 1)
    albedo = base * (0.9 + 0.2 * layer + 0.05 * fine + 0.03 * grain) * (1 + 0.1 * cavity(height, 0.015))
    edge = (torch.remainder(g, 1) < 0.25).float()
    rust = blotches(d, n, d.uniform(0.05, 0.4), low=2, soft=0.6) * (0.4 + 0.6 * blur(edge, 0.004))
    albedo = mix(albedo, hsv(d, (0.04, 0.09), (0.35, 0.65), (0.3, 0.55)), rust * d.uniform(0, 0.8))
    rough = d.uniform(0.42, 0.75) + 0.06 * (layer - 0.5) + 0.05 * fine.clamp(-2, 2) * 0.5 + 0.12 * rust + 0.02 * grain
    albedo, rough = _weather(d, n, albedo, rough, height)
    return Surface(albedo, height, rough, d.log_uniform(0.15, 0.55), limit=1.6)


def rock(d: Draw, n: int) -> Surface:
    """Natural faces: fractured planes, pitted crust, lichen."""
    u, v = d.grid(n)
    height = torch.zeros(n, n, device=d.device)
    for k, share in ((d.integer(3, 5), 1.0), (d.integer(7, 12), 0.6), (d.integer(18, 30), 0.35)):
        w = (0.35 / k) * spectral(d, n, 2.6, low=max(2, k / 2), high=8 * k, batch=2)
        c = worley(d, u + w[0], v + w[1], k, max(3, round(k * d.uniform(0.6, 1.6))))
        facet = c.per_cell(d.randn(c.count)) * c.dx + c.per_cell(d.randn(c.count)) * c.dy
        height = height + to_slope(blur(facet, 0.0015) + 0.4 * c.f1, share * d.uniform(0.4, 1.2))
    rough_skin = spectral(d, n, d.uniform(1.4, 2.2), low=6)
    grain = spectral(d, n, 0.6, low=n / 12)
    height = height + to_slope(rough_skin, d.uniform(0.3, 1.2)) + to_slope(grain, 0.25)
    cav = cavity(height, 0.012)
    base = _mineral(d)
    tint = clouds(d, n, 2.0, low=2)
    albedo = mix(base, jitter(d, base, 0.12), tint) * (1 + d.uniform(0.1, 0.3) * cav + 0.05 * grain + 0.04 * rough_skin)
    if d.chance(0.45):
        f = spectral(d, n, 1.5, low=d.uniform(4, 12))
        lichen = mask(f, d.uniform(0.03, 0.25), 0.1)
        tone = hsv(d, (0.08, 0.25), (0.1, 0.55), (0.4, 0.8))
        albedo = mix(albedo, tone * (1 + 0.12 * grain), lichen * d.uniform(0.4, 0.95))
    rough = d.uniform(0.5, 0.85) - d.uniform(-0.1, 0.12) * cav + 0.04 * rough_skin + 0.03 * grain
    albedo, rough = _weather(d, n, albedo, rough, height)
    return Surface(albedo, height, rough, d.log_uniform(0.3, 0.85), limit=1.6)


def sandstone(d: Draw, n: int) -> Surface:
    """Beds of sand: warm bands, iron rings, wind-worn ledges."""
    f = spectral(d, n, 3.2, low=1, high=16, batch=2)
    bands = spectral(d, n, d.uniform(1.8, 2.4), low=2, stretch=(1e3, 1))
    shift = d.uniform(0.02, 0.12) * f[0] + 0.003 * spectral(d, n, 2.0, low=6)
    t = unit(warp(bands, torch.zeros_like(shift), shift))
    grain = spectral(d, n, 0.5, low=n / 9)
    base = hsv(d, (0.05, 0.12), (0.2, 0.5), (0.5, 0.85)) if d.chance(0.8) else _mineral(d)
    palette = [jitter(d, base * 0.75, 0.06), base, jitter(d, base * 1.1, 0.05)]
    albedo = ramp(unit_range(t), palette) * (1 + d.uniform(0.02, 0.07) * grain)
    pits = blotches(d, n, d.uniform(0.01, 0.08), low=12, beta=1.4, soft=0.2)
    height = (
        to_slope(t, d.uniform(0.3, 1.0)) + to_slope(grain, d.uniform(0.3, 1.0)) - to_slope(blur(pits, 1.2 / n), 0.5)
    )
    height = height + to_slope(spectral(d, n, 2.4, low=3), d.uniform(0.2, 0.8))
    albedo = albedo * (1 - 0.3 * pits) * (1 + 0.05 * cavity(height, 0.02))
    rough = d.uniform(0.6, 0.9) + 0.03 * grain - 0.03 * t.clamp(-2, 2)
    albedo, rough = _weather(d, n, albedo, rough, height)
    return Surface(albedo, height, rough, d.log_uniform(0.08, 0.4), limit=1.6)


def roof(d: Draw, n: int) -> Surface:
    """Roofing: overlapping slates or clay tiles, each lower edge casting a step; lichen."""
    u, v = d.grid(n)
    k = d.integer(3, 9)
    rows = 2 * max(1, round(k * d.uniform(0.5, 1.0)))
    w = 0.004 * spectral(d, n, 2.4, low=4, high=30, batch=2)
    t = brick_tiles(u + w[0], v + w[1], k, rows, 0.5)
    down = t.dy / t.half[1]
    across = t.dx / t.half[0]
    lift = t.per_tile(d.rand(t.count))
    edge = t.half[0] - t.dx.abs() + 0.0006 * spectral(d, n, 1.8, low=20)
    slot = smoothstep(0.004, 0.0015, edge)
    butt = smoothstep(0.9, 1.0, down)
    curve = (1 - across * across) * d.uniform(0.5, 2.0) if d.chance(0.45) else 0.0
    z = (0.5 + 0.5 * down) * (0.7 + 0.5 * lift) - 1.2 * butt - 0.5 * slot + curve
    skin = spectral(d, n, 1.8, low=4, stretch=(1, d.uniform(1, 6)))
    grain = spectral(d, n, 0.8, low=n / 14)
    base = (
        hsv(d, (0.02, 0.07), (0.35, 0.7), (0.35, 0.7)) if d.chance(0.4) else hsv(d, (0.5, 0.7), (0, 0.2), (0.15, 0.5))
    )
    face = mix(base, jitter(d, base, 0.15), t.per_tile(d.rand(t.count)))
    shade = 1 - 0.55 * torch.maximum(butt, slot) - 0.25 * smoothstep(-0.7, -1.0, down)
    albedo = face * (1 + 0.07 * t.per_tile(d.randn(t.count)) + 0.06 * skin + 0.03 * grain) * shade
    moss = blotches(d, n, d.uniform(0.01, 0.2), low=5, soft=0.3) * d.uniform(0, 1)
    albedo = mix(albedo, hsv(d, (0.12, 0.27), (0.2, 0.6), (0.3, 0.6)), moss)
    rough = d.uniform(0.45, 0.8) + 0.05 * t.per_tile(d.randn(t.count)) + 0.04 * skin + 0.15 * moss + 0.1 * slot
    height = to_slope(blur(z, 0.8 / n), 1.0) + to_slope(skin, d.uniform(0.1, 0.4)) + to_slope(grain, 0.1)
    return Surface(albedo, height, rough, d.log_uniform(0.2, 0.6), limit=2.0)


FAMILIES = {
    "plaster": plaster,
    "stucco": stucco,
    "concrete": concrete,
    "brick": brick,
    "paving": paving,
    "cobbles": cobbles,
    "flagstones": flagstones,
    "slate": slate,
    "rock": rock,
    "sandstone": sandstone,
    "roof": roof,
}
