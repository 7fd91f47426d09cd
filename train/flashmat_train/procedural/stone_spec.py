"""Polished stones and glazes: marble, onyx, granite, terrazzo, glazed tiles, mosaics, stone floors, ice."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from .noise import Draw, blur, sample, smoothstep, spectral, unit, warp, worley
from .scatter import scatter, sizes
from .structure import Surface, any_colour, colour, gradient, hsv, jitter, mix, ramp, to_slope, unit_range
from .tiles import Tiles, brick_tiles, herringbone_tiles, hexagon_tiles
from .wear import blotches, clouds, cracks, scratches, smudges, specks


def _gloss(d: Draw) -> float:
    return d.log_uniform(0.02, 0.25)


def _polished(d: Draw, n: int, level: float, structure: Tensor) -> Tensor:
    """Roughness of a polish: the stone's own structure shows faintly, wiping and grit more."""
    rough = level * (1 + d.uniform(-0.4, 0.5) * structure + d.uniform(0.05, 0.5) * smudges(d, n))
    rough = rough + d.uniform(0.0, 0.05) * clouds(d, n, 2.4)
    if d.chance(0.4):
        rough = rough + d.uniform(0.03, 0.2) * scratches(d, n, d.integer(10, 120), (0.03, 0.4), 0.8)
    if d.chance(0.3):
        rough = rough + d.uniform(0.05, 0.3) * blotches(d, n, d.uniform(0.03, 0.2), low=3, soft=0.6)
    return rough.clamp_min(0.02)


def _veins(d: Draw, n: int, low: float, thin: float, swirl: float) -> Tensor:
    """Branching veins in [0, 1]: zero crossings of smooth warped fields, their strength varying along."""
    f = spectral(d, n, 2.8, low=low, high=16 * low, batch=3)
    lean = d.uniform(0, math.pi)
    g = spectral(d, n, d.uniform(3.2, 4.2), low=low, high=12 * low, stretch=(d.uniform(1, 3), 1), angle=lean)
    kink = (0.004 / low) * spectral(d, n, 2.0, low=8 * low, batch=2)
    g = unit(warp(g, swirl * f[0] / low + kink[0], swirl * f[1] / low + kink[1]))
    slope = torch.hypot(*gradient(g)).clamp_min(1.0)
    width = thin / low * torch.exp(0.9 * f[2])  # in tile units
    return torch.exp(-((g.abs() / slope) / width.clamp_min(0.35 / n)))


def _marble(d: Draw, n: int) -> tuple[Tensor, Tensor]:
    """sRGB colour and a structure field in [0, 1] (1 = vein)."""
    pick = d.uniform()
    if pick < 0.55:  # white to grey
        base = hsv(d, (0.05, 0.65), (0.0, 0.06), (0.75, 0.97))
        vein = hsv(d, (0.05, 0.65), (0.0, 0.15), (0.3, 0.65))
    elif pick < 0.7:  # black with pale veins
        base = hsv(d, (0, 1), (0, 0.2), (0.03, 0.14))
        vein = hsv(d, (0.06, 0.14), (0, 0.3), (0.4, 0.85))
    elif pick < 0.9:  # beige, brown
        base = hsv(d, (0.05, 0.11), (0.1, 0.35), (0.5, 0.85))
        vein = hsv(d, (0.03, 0.1), (0.2, 0.6), (0.3, 0.6))
    else:  # green, red, blue
        base = hsv(d, (0, 1), (0.2, 0.55), (0.2, 0.5))
        vein = hsv(d, (0.05, 0.6), (0, 0.25), (0.5, 0.9))
    low = d.uniform(1, 3)
    swirl = d.uniform(0.02, 0.14)
    big = _veins(d, n, low, d.log_uniform(0.004, 0.02), swirl)
    fine = _veins(d, n, 2.5 * low, d.uniform(0.003, 0.012), swirl) * blotches(d, n, 0.4, low=2, soft=0.8)
    body = clouds(d, n, 2.6, low=low, swirl=0.08)
    grain = spectral(d, n, 0.8, low=n / 14)
    c = mix(base, jitter(d, base, 0.07), body)
    shade = smoothstep(0.2, 1.0, blur(big, 0.02) * 1.6) * d.uniform(0.0, 0.5)
    c = mix(c, mix(base, vein, torch.tensor(0.5, device=d.device)), shade)
    strength = d.uniform(0.3, 0.95)
    v = torch.maximum(big * blotches(d, n, d.uniform(0.4, 0.9), low=1.5, soft=0.8), d.uniform(0.2, 0.8) * fine)
    return mix(c, vein, strength * v) + 0.008 * grain, v


def marble(d: Draw, n: int) -> Surface:
    c, v = _marble(d, n)
    rough = _polished(d, n, _gloss(d), 2 * v - 0.5)
    height = (
        to_slope(spectral(d, n, 3.4), 1.0) + to_slope(-v, d.uniform(0, 1.0)) + to_slope(spectral(d, n, 1.0, low=9), 0.3)
    )
    return Surface(c, height, rough, d.log_uniform(0.002, 0.03))


def _onyx(d: Draw, n: int) -> tuple[Tensor, Tensor]:
    """Flowing bands."""
    _, v = d.grid(n)
    f = spectral(d, n, 4.0, low=1, high=8)
    detail = spectral(d, n, 2.4, low=5)
    phase = v * d.integer(1, 2) + d.uniform(0.05, 0.2) * f + 0.002 * detail
    table = spectral(d, n, d.uniform(0.9, 1.5), low=2, high=d.uniform(25, 60), stretch=(1e3, 1))  # a bar code
    t = unit_range(warp(table, torch.zeros_like(phase), phase - v))
    first = hsv(d, (0.04, 0.12), (0.05, 0.6), (0.3, 0.8)) if d.chance(0.7) else any_colour(d, 0.5, (0.15, 0.8))
    palette = [
        jitter(d, first, 0.2) * 0.6,
        first,
        jitter(d, first, 0.12),
        hsv(d, (0.05, 0.6), (0, 0.25), (0.65, 0.95)),
    ]
    c = ramp(0.8 * t + 0.2 * clouds(d, n), palette)
    return c * (1 + 0.04 * detail) + 0.008 * spectral(d, n, 0.6, low=n / 12), t


def onyx(d: Draw, n: int) -> Surface:
    c, t = _onyx(d, n)
    if d.chance(0.5):
        c, t = c.transpose(-1, -2), t.transpose(-1, -2)
    rough = _polished(d, n, _gloss(d) * 0.7, t - 0.5)
    return Surface(c, to_slope(spectral(d, n, 3.2), 1.0) + to_slope(t, 0.5), rough, d.log_uniform(0.002, 0.02))


def _granite(d: Draw, n: int) -> tuple[Tensor, Tensor]:
    """Interlocked crystals of three or four minerals; the second value is a per-grain random in [0, 1]."""
    u, v = d.grid(n)
    k = int(min(d.log_uniform(28, 110), n / 4))
    w = (0.5 / k) * spectral(d, n, 2.0, low=k / 2, high=4 * k, batch=2)
    fine = worley(d, u + w[0], v + w[1], k, k)
    coarse = worley(d, u + 1.5 * w[1], v + 1.5 * w[0], max(4, k // 2), max(4, k // 2))
    pick = fine.per_cell(d.rand(fine.count))
    feldspar = (
        hsv(d, (0.0, 0.11), (0.02, 0.4), (0.4, 0.8)) if d.chance(0.8) else hsv(d, (0.3, 0.65), (0.05, 0.35), (0.3, 0.6))
    )
    quartz = hsv(d, (0.05, 0.6), (0, 0.08), (0.45, 0.9))
    mica = hsv(d, (0.0, 0.7), (0, 0.2), (0.04, 0.2))
    a, b = d.uniform(0.15, 0.5), d.uniform(0.1, 0.35)
    c = torch.where(pick < a, quartz, torch.where(pick < a + b, mica, feldspar))
    big = (coarse.per_cell(d.rand(coarse.count)) < d.uniform(0.1, 0.5)) & (coarse.edge > 0.12)
    grain = fine.per_cell(d.randn(fine.count))
    c = torch.where(big & (pick > 0.2), feldspar, c) * (1 + 0.09 * grain)
    c = c * (0.92 + 0.14 * clouds(d, n)) * (1 + 0.03 * spectral(d, n, 0.8, low=k))
    return c, fine.per_cell(d.rand(fine.count))


def granite(d: Draw, n: int) -> Surface:
    c, g = _granite(d, n)
    rough = _polished(d, n, _gloss(d) * 1.2, 2 * g - 1)
    pits = specks(d, n, 0.01, n / 5)
    rough = rough + 0.2 * pits
    return Surface(
        c,
        to_slope(spectral(d, n, 3.0), 1.0) + to_slope(g, 0.4) - 0.001 * pits,
        rough,
        d.log_uniform(0.003, 0.04),
    )


def _terrazzo(d: Draw, n: int) -> tuple[Tensor, Tensor]:
    """Chips of marble in cement or resin; the second value is 1 on a chip."""
    high = d.log_uniform(0.008, 0.06)
    low = max(high * d.uniform(0.1, 0.35), 1.2 / n)
    count = int(min(d.uniform(0.12, 0.8) / (low + 0.25 * (high - low)) ** 2, 7000))
    p = torch.stack(
        (
            2 * math.pi * d.rand(count),
            *(2 * math.pi * d.rand(3, count)),
            d.rand(count),
            0.55 + 0.35 * d.rand(count),
        )
    )

    def chip(x: Tensor, y: Tensor, q: Tensor) -> Tensor:
        inside = torch.full_like(x, 1.0) > 0
        for i in range(4):  # a convex polygon of four to five cuts
            t = q[0] + i * 1.57 + 0.35 * torch.sin(q[1 + i % 3] * (i + 1))
            inside = inside & (x * torch.cos(t) + y * torch.sin(t) < q[5] * (0.7 + 0.3 * torch.cos(q[1] * (i + 1))))
        return torch.where(inside & (x * x + y * y < 1), q[4], -math.inf)

    s, p = scatter(d, n, sizes(d, count, low, high, 3.0), p, chip)
    m = s.hit.float()
    tones = d.randn(3, count)
    first = hsv(d, (0.03, 0.13), (0.0, 0.4), (0.2, 0.9)) if d.chance(0.75) else any_colour(d, 0.4, (0.25, 0.9))
    palette = [jitter(d, first, 0.2), jitter(d, first, 0.12), hsv(d, (0, 1), (0, 0.15), (0.1, 0.9))]
    palette.append(hsv(d, (0.05, 0.1), (0, 0.2), (0.7, 0.95)))
    inner = clouds(d, n, 1.6, low=20)
    chips = (
        ramp(0.5 + 0.3 * s.per_splat(tones[0]), palette) * (1 + 0.08 * s.per_splat(tones[1])) * (0.94 + 0.12 * inner)
    )
    bed = any_colour(d, 0.35, (0.2, 0.95)) * (1 + 0.02 * spectral(d, n, 0.6, low=n / 12)) * (0.96 + 0.08 * clouds(d, n))
    return mix(bed, chips, m), m


def terrazzo(d: Draw, n: int) -> Surface:
    c, m = _terrazzo(d, n)
    rough = _polished(d, n, _gloss(d) * 1.2, d.choice((-1, 1)) * (m - 0.5))
    if d.chance(0.3):  # divider strips
        u, v = d.grid(n)
        t = brick_tiles(u, v, d.integer(1, 3), d.integer(1, 3), 0.0)
        strip = smoothstep(0.006, 0.004, t.edge)
        c = mix(c, colour(d, (0.75, 0.65, 0.42)) if d.chance(0.5) else c * 0 + 0.4, strip)
        rough = torch.lerp(rough, torch.full_like(rough, d.uniform(0.2, 0.5)), strip)
    height = to_slope(spectral(d, n, 3.2), 1.0) + to_slope(blur(m, 1.0 / n), d.uniform(0, 0.8))
    return Surface(c, height, rough, d.log_uniform(0.003, 0.05))


def _layout(d: Draw, n: int) -> Tiles:
    u, v = d.grid(n)
    kind = d.uniform()
    k = d.integer(2, 9)
    if kind < 0.4:
        return brick_tiles(u, v, k, k, 0.0)
    if kind < 0.7:
        return brick_tiles(u, v, k, 2 * max(1, round(k * d.uniform(0.4, 1.3))), 0.5)
    if kind < 0.85:
        return hexagon_tiles(u, v, 2 * k)
    return herringbone_tiles(u, v, d.integer(1, 3), d.integer(2, 4))


def _grout(d: Draw, n: int, t: Tiles, width: float, bevel: float) -> tuple[Tensor, Tensor, Tensor]:
    """Grout mask, tile height profile, sunken-edge darkness."""
    wob = t.edge + 0.0006 * spectral(d, n, 2.0, low=10)
    gap = smoothstep(width + 0.7 / n, width - 0.7 / n, wob)
    rise = ((wob - width) / bevel).clamp(0, 1)
    profile = 1 - (1 - rise) ** d.uniform(1.0, 2.5)
    tilt = t.per_tile(d.randn(t.count)) * t.dx + t.per_tile(d.randn(t.count)) * t.dy
    return gap, profile + d.uniform(0, 0.6) * tilt, torch.exp(-(wob - width).clamp_min(0) / bevel)


def glazed(d: Draw, n: int) -> Surface:
    """Ceramic tiles: pooled glaze, crazing, chipped edges, matt stained grout."""
    t = _layout(d, n)
    small = min(t.half)
    width, bevel = small * d.uniform(0.02, 0.09), small * d.log_uniform(0.06, 0.5)
    gap, profile, rim = _grout(d, n, t, width, bevel)
    base = hsv(d, (0.05, 0.6), (0, 0.06), (0.8, 1.0)) if d.chance(0.5) else any_colour(d, 0.85, (0.25, 0.95))
    base = base.expand(3, n, n)
    if d.chance(0.3):
        base = mix(base, any_colour(d, 0.8, (0.1, 0.95)), (t.per_tile(d.rand(t.count)) < d.uniform(0.1, 0.5)).float())
    pool = clouds(d, n, 2.6, low=3)
    tone = 1 + d.uniform(0.0, 0.12) * t.per_tile(d.randn(t.count)) + d.uniform(0, 0.16) * (pool - 0.5)
    c = base * tone * (1 + d.uniform(-0.2, 0.12) * rim)
    rough = _polished(d, n, d.log_uniform(0.02, 0.16), torch.zeros_like(gap)) + 0.03 * t.per_tile(d.rand(t.count))
    wave = spectral(d, n, 3.0, low=1 / small * 0.5)
    height = to_slope(profile, 1.0) + to_slope(wave, d.uniform(0.02, 0.35)) * (1 - gap)
    if d.chance(0.3):
        u, v = d.grid(n)
        craze = cracks(d, u, v, d.integer(14, 40), 0.05) * (1 - gap)
        c = c * (1 - d.uniform(0.05, 0.3) * craze)
        rough = rough + 0.1 * craze
    grit = spectral(d, n, 0.8, low=n / 12)
    cement = hsv(d, (0.06, 0.12), (0.02, 0.2), (0.35, 0.92)) * (1 + 0.05 * grit - d.uniform(0, 0.4) * clouds(d, n))
    c = mix(c, cement, gap)
    rough = torch.lerp(rough, d.uniform(0.55, 0.9) + 0.04 * grit, gap)
    if d.chance(0.25):
        chip = blotches(d, n, 0.12, low=8, beta=1.5, soft=0.05) * smoothstep(2.5 * bevel, 0.0, t.edge)
        c = mix(c, hsv(d, (0.05, 0.1), (0.1, 0.4), (0.5, 0.8)), chip)
        rough = torch.lerp(rough, torch.full_like(rough, 0.7), chip)
        height = height - 0.004 * chip
    height = height + to_slope(grit, 0.3) * gap
    return Surface(c, height, rough, d.log_uniform(0.05, 0.6), limit=2.5)


def mosaic(d: Draw, n: int) -> Surface:
    """Small glass or ceramic pieces, colours mixed, every piece set a little off."""
    u, v = d.grid(n)
    k = d.integer(8, 24)
    if d.chance(0.7):
        w = (0.035 / k) * spectral(d, n, 2.4, low=k / 2, high=1.5 * k, batch=2)
        t = brick_tiles(u + w[0], v + w[1], k, k, 0.0 if d.chance(0.6) else 0.5)
    else:
        c = worley(d, u, v, k, k, 0.8)
        side = 1 / k
        t = Tiles(c.id, c.dx * side, c.dy * side, c.edge * side, c.count, (0.5 * side, 0.5 * side))
    gap, profile, rim = _grout(d, n, t, 0.07 / k, d.uniform(0.05, 0.3) / k)
    first = any_colour(d, 0.8, (0.2, 0.9))
    palette = [jitter(d, first, 0.2), first, jitter(d, first, 0.15), hsv(d, (0, 1), (0, 0.2), (0.7, 0.95))]
    tile = ramp(t.per_tile(d.rand(t.count)), palette) * (1 + 0.06 * t.per_tile(d.randn(t.count)))
    tile = tile * (0.9 + 0.2 * clouds(d, n, 2.0, low=k / 2)) * (1 - 0.1 * rim)
    grit = spectral(d, n, 0.8, low=n / 12)
    cement = hsv(d, (0.06, 0.12), (0.0, 0.15), (0.3, 0.9)) * (1 + 0.05 * grit) * (1 - 0.3 * clouds(d, n))
    rough = _polished(d, n, d.log_uniform(0.05, 0.3), torch.zeros_like(gap)) + 0.06 * t.per_tile(d.rand(t.count))
    rough = torch.lerp(rough, d.uniform(0.5, 0.9) + 0.04 * grit, gap)
    height = to_slope(profile, 1.0) + to_slope(grit, 0.2) * gap
    return Surface(mix(tile, cement, gap), height, rough, d.log_uniform(0.1, 0.6), limit=2.2)


def floor(d: Draw, n: int) -> Surface:
    """Slabs of polished stone: each cut from another place, laid chequered or in bond, thin joints."""
    u, v = d.grid(n)
    k = 2 * d.integer(1, 4)
    chequered = d.chance(0.3)
    t = brick_tiles(u, v, k, k, 0.0) if chequered else _layout(d, n)
    makers = (_marble, _granite, _terrazzo, _onyx)
    first, structure = d.choice(makers)(d, n)
    shift = d.rand(2, t.count)
    su, sv = t.per_tile(shift[0]) + u, t.per_tile(shift[1]) + v
    flip = t.per_tile((d.rand(t.count) < 0.5).float())
    su = torch.where(flip > 0, -su, su)
    c, g = sample(first, su, sv), sample(structure, su, sv)
    if chequered:
        other, _ = d.choice(makers)(d, n)
        parity = (torch.floor(u * k) + torch.floor(v * k)) % 2
        c = mix(c, sample(other, sv, su), parity)
    width = d.uniform(0.001, 0.004)
    gap, profile, rim = _grout(d, n, t, width, d.uniform(0.002, 0.02))
    c = c * (1 + d.uniform(0, 0.08) * t.per_tile(d.randn(t.count))) * (1 - 0.08 * rim)
    joint = hsv(d, (0.05, 0.12), (0, 0.2), (0.2, 0.8))
    rough = _polished(d, n, _gloss(d), g - 0.5) + d.uniform(0, 0.06) * t.per_tile(d.rand(t.count))
    rough = torch.lerp(rough, torch.full_like(rough, d.uniform(0.4, 0.85)), gap)
    height = to_slope(profile, 1.0) + to_slope(spectral(d, n, 3.2), d.uniform(0.02, 0.2))
    return Surface(mix(c, joint, gap), height, rough, d.log_uniform(0.01, 0.3), limit=2.2)


def ice(d: Draw, n: int) -> Surface:
    """Ice and glassy stone: inner fractures, haze, a frosted skin here and there."""
    u, v = d.grid(n)
    k = d.integer(3, 7)
    w = (0.1 / k) * spectral(d, n, 3.2, low=k / 2, high=2 * k, batch=2)
    c = worley(d, u + w[0], v + w[1], k, k)
    where = clouds(d, n, 2.4, low=2)
    run = torch.exp(-c.edge / (d.uniform(0.004, 0.012) * (0.3 + 2 * where))) * where
    haze = torch.exp(-c.edge / d.uniform(0.1, 0.3)) * clouds(d, n, 2.0, low=2)
    haze = haze * (0.4 + 0.6 * c.per_cell(d.rand(c.count)))
    fine = _veins(d, n, 3, 0.006, 0.05) * blotches(d, n, 0.4, soft=0.8)
    base = hsv(d, (0.38, 0.6), (0.1, 0.5), (0.15, 0.6))
    pale = hsv(d, (0.45, 0.6), (0.0, 0.12), (0.75, 0.98))
    light = (d.uniform(0.3, 0.9) * haze + 0.5 * run + 0.25 * fine).clamp(0, 1)
    bubbles = specks(d, n, d.uniform(0.002, 0.02), n / 6)
    albedo = mix(base * (0.85 + 0.3 * clouds(d, n, 2.4)), pale, light) + 0.2 * bubbles
    frost = blotches(d, n, d.uniform(0.05, 0.5), low=2, soft=0.8)
    rough = _polished(d, n, d.log_uniform(0.05, 0.2), run) + d.uniform(0.05, 0.35) * frost + 0.15 * run
    height = (
        to_slope(spectral(d, n, 3.2, low=2), 1.0)
        - to_slope(run, d.uniform(0.2, 1.5))
        + frost * to_slope(spectral(d, n, 1.4, low=12), 0.5)
    )
    return Surface(albedo, height, rough, d.log_uniform(0.01, 0.12), limit=1.6)


FAMILIES = {
    "marble": marble,
    "onyx": onyx,
    "granite": granite,
    "terrazzo": terrazzo,
    "glazed": glazed,
    "mosaic": mosaic,
    "floor": floor,
    "ice": ice,
}
