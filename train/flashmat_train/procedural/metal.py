"""Metals: sheet, brushed, cast, hammered, rusted, perforated, tread plate, galvanised, painted and more."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from .noise import Draw, blur, smoothstep, spectral, unit, worley
from .structure import Surface, any_colour, cavity, colour, hsv, jitter, mix, ramp, to_slope, unit_range
from .tiles import brick_tiles
from .wear import blotches, clouds, dust, mask, scratches, smudges, specks, streaks

METALS = {
    "steel": (0.62, 0.62, 0.63),
    "dark": (0.36, 0.36, 0.37),
    "aluminium": (0.86, 0.87, 0.88),
    "zinc": (0.66, 0.69, 0.72),
    "titanium": (0.69, 0.66, 0.63),
    "gold": (0.98, 0.83, 0.47),
    "brass": (0.88, 0.77, 0.50),
    "copper": (0.90, 0.62, 0.50),
    "bronze": (0.66, 0.50, 0.33),
    "black": (0.14, 0.15, 0.16),
}


def _bare(d: Draw, grey: bool = False) -> Tensor:
    names = ("steel", "dark", "aluminium", "zinc", "titanium", "black") if grey else tuple(METALS)
    c = jitter(d, colour(d, METALS[d.choice(names)]), 0.05)
    return c * d.uniform(0.8, 1.08)


def _polish(d: Draw, n: int) -> float:
    """The roughness of bare metal before wear."""
    return d.uniform(0.26, 0.55) if d.chance(0.85) else d.uniform(0.12, 0.25)


def _tarnish(d: Draw, n: int, base: Tensor) -> tuple[Tensor, Tensor]:
    """Colour and roughness offset of handled metal: stains, wipes, scratches, spots."""
    smudge = smudges(d, n)
    patch = clouds(d, n, d.uniform(1.8, 2.6))
    tone = 1 + d.uniform(0, 0.12) * (patch - 0.5)
    if d.chance(0.5):
        tone = tone + d.uniform(0.0, 0.05) * spectral(d, n, 1.2, low=6)
    albedo = base * tone
    rough = d.uniform(0.01, 0.12) * smudge + d.uniform(-0.06, 0.1) * (patch - 0.5)
    if d.chance(0.6):
        s = scratches(d, n, d.integer(20, 260), (0.05, d.uniform(0.2, 0.9)), d.uniform(0.0, 0.9))
        rough = rough + d.uniform(0.05, 0.4) * s * d.choice((1.0, 1.0, -0.3))
        albedo = albedo * (1 + d.uniform(-0.1, 0.15) * s)
    if d.chance(0.35):
        spot = specks(d, n, d.uniform(0.002, 0.03), d.uniform(20, n / 3))
        albedo = albedo * (1 - d.uniform(0.03, 0.4) * spot)
        rough = rough + d.uniform(0, 0.25) * spot
    if d.chance(0.25):
        warm = blotches(d, n, d.uniform(0.05, 0.4), low=2, beta=2.0, soft=0.9)
        albedo = mix(albedo, albedo * colour(d, (0.9, 0.75, 0.58)), d.uniform(0.2, 0.8) * warm)
        rough = rough + 0.1 * warm
    return albedo, rough


def _nearly_flat(d: Draw, n: int, extra: Tensor | None = None) -> tuple[Tensor, float]:
    """Relief of sheet metal: slight waves and grain (slopes of a fraction of a degree to a few)."""
    wave = spectral(d, n, 3.4, low=1)
    grain = spectral(d, n, 1.0, low=n / 20)
    height = to_slope(wave, d.uniform(0.1, 1.0)) + to_slope(grain, d.uniform(0.1, 1.0))
    if extra is not None:
        height = height + to_slope(extra, d.uniform(0.3, 1.5))
    return height, d.log_uniform(0.002, 0.04)


def sheet(d: Draw, n: int) -> Surface:
    """Plain or polished sheet, smudged and scratched."""
    albedo, rough = _tarnish(d, n, _bare(d))
    height, slope = _nearly_flat(d, n)
    return Surface(albedo, height, _polish(d, n) + rough, slope)


def brushed(d: Draw, n: int) -> Surface:
    angle = d.choice((0.0, math.pi / 2, d.uniform(0, math.pi)))
    long = d.log_uniform(8, 60)
    streak = spectral(d, n, d.uniform(0.0, 0.9), low=4, stretch=(long, 1.0), angle=angle)
    wide = spectral(d, n, 1.4, low=1, stretch=(0.5 * long, 1.0), angle=angle)
    lines = scratches(d, n, d.integer(30, 300), (0.1, 0.8), 0.05, angle, 0.03)
    albedo, rough = _tarnish(d, n, _bare(d))
    albedo = albedo * (1 + d.uniform(0.005, 0.05) * streak + 0.02 * wide + 0.05 * lines)
    rough = _polish(d, n) + rough * 0.5 + d.uniform(0.01, 0.06) * streak + 0.02 * wide + 0.1 * lines
    height = to_slope(streak, 1.0) + to_slope(wide, 0.3) - to_slope(lines, 0.3)
    return Surface(albedo, height, rough, d.log_uniform(0.004, 0.08))


def cast(d: Draw, n: int) -> Surface:
    """Sand-cast iron or blasted parts: grainy, pitted, oily or dusty."""
    grain = spectral(d, n, d.uniform(0.4, 1.6), low=d.log_uniform(15, 70))
    pits = blotches(d, n, d.uniform(0.01, 0.08), low=d.uniform(12, 40), beta=1.2)
    height = to_slope(grain, 1.0) - to_slope(blur(pits, 0.003), d.uniform(0.2, 1.0))
    base = _bare(d, grey=True) * d.uniform(0.5, 1.0)
    albedo, rough = _tarnish(d, n, base)
    albedo = albedo * (1 + 0.06 * cavity(height, 0.02)) * (1 - 0.35 * pits)
    if d.chance(0.3):
        albedo = mix(albedo, _rust(d, n), 0.7 * pits)
    rough = d.uniform(0.35, 0.65) + rough * 0.7 + 0.05 * grain - 0.05 * cavity(height, 0.02) + 0.1 * pits
    return Surface(albedo, height, rough, d.log_uniform(0.02, 0.2), limit=1.5)


def hammered(d: Draw, n: int) -> Surface:
    """Beaten by hand: overlapping shallow dents, polished ridges between."""
    u, v = d.grid(n)
    k = d.integer(6, 22)
    w = (0.05 / k) * spectral(d, n, 3.0, low=k / 2, high=3 * k, batch=2)
    c = worley(d, u + w[0], v + w[1], k, k, d.uniform(0.6, 1.0))
    bowl = blur(c.f1 * c.f1, 0.03 / k)
    tilt = c.per_cell(d.randn(c.count)) * c.dx + c.per_cell(d.randn(c.count)) * c.dy
    height = to_slope(bowl, 1.0) + to_slope(blur(tilt, 0.03 / k), 0.3) + to_slope(spectral(d, n, 1.0, low=n / 16), 0.08)
    albedo, rough = _tarnish(d, n, _bare(d))
    ridge = unit_range(bowl)
    deep = dust(d, bowl, d.uniform(0, 0.6))
    albedo = albedo * (1 + 0.12 * (ridge - 0.4)) * (1 - 0.4 * deep)
    rough = _polish(d, n) + rough * 0.7 - d.uniform(0, 0.12) * ridge + 0.2 * deep
    return Surface(albedo, height, rough, d.log_uniform(0.05, 0.25), limit=1.5)


def _rust(d: Draw, n: int) -> Tensor:
    """Rust colours, from dark scale to orange bloom."""
    dark = hsv(d, (0.03, 0.06), (0.4, 0.7), (0.15, 0.28))
    brown = hsv(d, (0.04, 0.07), (0.55, 0.8), (0.32, 0.48))
    bloom = hsv(d, (0.055, 0.09), (0.6, 0.85), (0.5, 0.75))
    t = clouds(d, n, 1.7, low=2) * 0.75 + 0.12 + 0.08 * spectral(d, n, 0.5, low=n / 12)
    return ramp(t, [dark, brown, mix(brown, bloom, torch.tensor(0.5, device=d.device)), bloom])


def rusted(d: Draw, n: int) -> Surface:
    """Steel going to rust: from first patches to all scale; runs below."""
    base = _bare(d, grey=True)
    albedo, rough = _tarnish(d, n, base)
    field = spectral(d, n, d.uniform(1.7, 2.8), low=d.uniform(1, 4))
    if d.chance(0.4):
        field = unit(field + d.uniform(0.3, 1.0) * spectral(d, n, 1.5, low=2, stretch=(1, d.uniform(3, 10))))
    cover = d.choice((d.uniform(0.05, 0.4), d.uniform(0.3, 0.7), d.uniform(0.8, 1.0)))
    m = mask(field, cover, d.uniform(0.1, 0.6))
    halo = mask(field, min(1.0, cover * 1.4), 0.9)
    rust = _rust(d, n)
    scale = spectral(d, n, 1.4, low=6)
    albedo = mix(albedo, albedo * colour(d, (0.85, 0.66, 0.5)), 0.6 * halo)
    albedo = mix(albedo, rust * (1 + 0.05 * scale), m)
    grain = spectral(d, n, 0.6, low=n / 12)
    lump = to_slope(scale, 1.0) + to_slope(grain, 0.7)
    height = m * lump + 0.012 * m * d.choice((-1, 1)) + to_slope(spectral(d, n, 3.2), 0.1)
    rough = torch.lerp(
        _polish(d, n) + rough,
        d.uniform(0.6, 0.88) + 0.05 * grain + 0.03 * scale,
        torch.maximum(m, 0.4 * halo),
    )
    return Surface(albedo, height, rough, d.log_uniform(0.006, 0.25), limit=1.8)


def perforated(d: Draw, n: int) -> Surface:
    """Punched sheet: round, square or slotted holes on a straight or staggered grid."""
    u, v = d.grid(n)
    k = 2 * d.integer(2, 11)
    staggered = d.chance(0.65)
    x, y = u * k, v * k
    row = torch.floor(y)
    if staggered:
        x = x + 0.5 * (row.long() % 2)
    fx, fy = torch.remainder(x, 1) - 0.5, y - row - 0.5
    r = d.uniform(0.22, 0.4)
    kind = d.uniform()
    if kind < 0.6:
        dist = torch.sqrt(fx * fx + fy * fy) - r
    elif kind < 0.8:
        corner = d.uniform(0.02, 0.12)
        qx, qy = fx.abs() - r + corner, fy.abs() - r + corner
        dist = torch.sqrt(qx.clamp_min(0) ** 2 + qy.clamp_min(0) ** 2) + torch.maximum(qx, qy).clamp(max=0) - corner
    else:
        dist = torch.sqrt((fx.abs() - 0.22).clamp_min(0) ** 2 + fy * fy) - 0.55 * r
    soft = d.uniform(0.03, 0.1)
    hole = smoothstep(soft / 2, -soft / 2, dist)
    dished = d.chance(0.4)
    rim = smoothstep(0.14, 0.0, dist) * (1 - hole)
    albedo, rough = _tarnish(d, n, _bare(d))
    rough = _polish(d, n) + rough
    flat, _ = _nearly_flat(d, n)
    if dished:  # embossed: the floor is seen
        height = to_slope(blur(-hole, 0.02 / k) + 0.25 * rim, 1.0) + to_slope(flat, 0.03)
        deep = dust(d, -hole, d.uniform(0, 0.7))
        albedo = albedo * (1 - 0.3 * deep) * (1 + 0.06 * rim)
        rough = rough + 0.15 * deep - 0.05 * rim
    else:
        behind = _bare(d, grey=True) * d.uniform(0.02, 0.15) * (1 + 0.2 * spectral(d, n, 2.0))
        albedo = mix(albedo * (1 + 0.05 * rim), behind, hole)
        height = to_slope(blur(-hole, 0.02 / k) + 0.15 * rim, 1.0) + to_slope(flat, 0.03)
        rough = torch.lerp(rough, torch.full_like(rough, d.uniform(0.5, 0.9)), hole)
    if d.chance(0.3):
        stain = blotches(d, n, 0.15, low=3) * smoothstep(0.25, 0.0, dist)
        albedo = mix(albedo, _rust(d, n), 0.8 * stain)
        rough = rough + 0.3 * stain
    return Surface(albedo, height, rough, d.log_uniform(0.25, 0.9), limit=3.0)


def tread_plate(d: Draw, n: int) -> Surface:
    """Diamond plate: lens-shaped bars, crossed, in ones to fives; worn bright on top, dirt between."""
    u, v = d.grid(n)
    k = 2 * d.integer(2, 8)
    diagonal = d.chance(0.5)
    x, y = u * k, v * k
    if diagonal:
        x, y = (u + v) * k / 2 * 1.0, (u - v) * k / 2 * 1.0
    i, j = torch.floor(x), torch.floor(y)
    fx, fy = 2 * (x - i) - 1, 2 * (y - j) - 1
    turned = (i + j).long() % 2 == 1
    a, b = torch.where(turned, fy, fx), torch.where(turned, fx, fy)
    bars = d.choice((1, 1, 2, 3, 5))
    long = d.uniform(0.85, 1.1)
    if bars > 1:
        pitch = 2.0 / bars
        lane = torch.floor((b + 1) / pitch).clamp(0, bars - 1)
        b = ((b + 1) / pitch - lane - 0.5) * 2
        wide = d.uniform(0.4, 0.65)
    else:
        wide = d.uniform(0.25, 0.42)
    lens = 1 - (a / long) ** 2 - (b / wide).abs() ** d.uniform(1.2, 2.0)
    bar = smoothstep(0.0, d.uniform(0.4, 0.9), lens)
    bar = blur(bar, 0.012 / k)
    albedo, rough = _tarnish(d, n, _bare(d, grey=d.chance(0.85)))
    dirt = dust(d, bar, d.uniform(0, 0.9)) * (1 - bar)
    worn = bar * d.uniform(0.1, 1.0)
    grime = hsv(d, (0.06, 0.12), (0.1, 0.5), (0.1, 0.35))
    albedo = mix(albedo, grime, 0.6 * dirt) * (1 + 0.12 * worn)
    if d.chance(0.3):
        rust = blotches(d, n, d.uniform(0.1, 0.6), low=3, soft=0.4) * (1 - worn)
        albedo = mix(albedo, _rust(d, n), rust)
        rough = rough + 0.3 * rust
    rough = d.uniform(0.25, 0.5) + rough + 0.25 * dirt - d.uniform(0, 0.12) * worn
    flat = spectral(d, n, 1.4, low=8)
    height = to_slope(bar, 1.0) + to_slope(flat, d.uniform(0.03, 0.2))
    return Surface(albedo, height, rough, d.log_uniform(0.15, 0.65), limit=2.2)


def galvanised(d: Draw, n: int) -> Surface:
    """Zinc spangle: crystal patches, each with its own tone and polish."""
    u, v = d.grid(n)
    k = d.integer(6, 36)
    w = (d.uniform(0.05, 0.3) / k) * spectral(d, n, 2.6, low=k, high=6 * k, batch=2)
    c = worley(d, u + w[0], v + w[1], k, k)
    turn = math.pi * d.rand(c.count)
    x = torch.cos(c.per_cell(turn)) * c.dx + torch.sin(c.per_cell(turn)) * c.dy
    fern = torch.sin(d.uniform(10, 30) * x + 3 * c.f1)
    tone = c.per_cell(d.rand(c.count))
    base = _bare(d, grey=True) if d.chance(0.25) else jitter(d, colour(d, METALS["zinc"]), 0.08)
    albedo, rough = _tarnish(d, n, base)
    contrast = d.uniform(0.05, 0.3)
    albedo = albedo * (1 + contrast * (tone - 0.5) + 0.02 * fern * tone)
    if d.chance(0.4):
        white = blotches(d, n, d.uniform(0.05, 0.4), low=2, soft=0.8) * streaks(d, n, 0.5)
        albedo = mix(albedo, jitter(d, colour(d, (0.8, 0.8, 0.8)), 0.05), white)
        rough = rough + 0.25 * white
    rough = (
        d.uniform(0.25, 0.5) + rough * 0.6 + d.uniform(0.05, 0.3) * (c.per_cell(d.rand(c.count)) - 0.5) + 0.02 * fern
    )
    tilt = c.per_cell(d.randn(c.count)) * c.dx + c.per_cell(d.randn(c.count)) * c.dy
    height = to_slope(tilt, 1.0) + to_slope(spectral(d, n, 3.0), 1.0) + to_slope(spectral(d, n, 1.0, low=n / 16), 0.4)
    return Surface(albedo, height, rough, d.log_uniform(0.004, 0.06))


def scratched(d: Draw, n: int) -> Surface:
    """Hard use: gouges with raised lips, scuffs in bunches, fine circles of wiping."""
    albedo, rough = _tarnish(d, n, _bare(d))
    heading = d.uniform(0, math.pi) if d.chance(0.5) else None
    fine = scratches(d, n, d.integer(200, 900), (0.02, 0.3), d.uniform(0, 1.5), heading, d.uniform(0.05, 0.6))
    deep = scratches(d, n, d.integer(10, 120), (0.1, 0.9), d.uniform(0, 0.5), heading, d.uniform(0.05, 0.8))
    scuffed = blotches(d, n, 0.35, low=2, soft=0.8)
    fine = fine * (0.3 + 0.7 * scuffed)
    lips = blur(deep, 1.6 / n)
    albedo = albedo * (1 + d.uniform(-0.15, 0.2) * deep + d.uniform(-0.05, 0.08) * fine)
    rough = _polish(d, n) + rough * 0.6 + d.uniform(0.05, 0.3) * fine + d.uniform(0.1, 0.35) * lips
    height, _ = _nearly_flat(d, n)
    height = to_slope(height, 1.0) + to_slope(0.7 * lips - deep, d.uniform(0.5, 2.5)) - to_slope(fine, 0.4)
    return Surface(albedo, height, rough, d.log_uniform(0.01, 0.12))


def plates(d: Draw, n: int) -> Surface:
    """Panels with seams and rivets or screws, each a little dished; dirt in the joints."""
    u, v = d.grid(n)
    columns, rows = d.integer(1, 4), 2 * d.integer(1, 3)
    t = brick_tiles(u, v, columns, rows, 0.5 if d.chance(0.6) else 0.0)
    width = d.uniform(0.002, 0.006)
    seam = smoothstep(width, 0.3 * width, t.edge)
    near = torch.exp(-t.edge / 0.03)
    albedo, rough = _tarnish(d, n, _bare(d, grey=d.chance(0.7)))
    tone = t.per_tile(d.randn(t.count))
    albedo = (
        albedo * (1 + d.uniform(0, 0.08) * tone) * (1 - d.uniform(0.3, 0.8) * seam) * (1 - d.uniform(0, 0.2) * near)
    )
    rough = _polish(d, n) + rough + 0.03 * t.per_tile(d.randn(t.count)) + 0.25 * seam + 0.08 * near
    height = to_slope(-seam, 1.0)
    height = height + to_slope(t.per_tile(d.randn(t.count)) * t.dx + t.per_tile(d.randn(t.count)) * t.dy, 0.1)
    dish = (t.dx.abs() / t.half[0]) ** 4 + (t.dy.abs() / t.half[1]) ** 4
    height = height - to_slope(dish, d.uniform(0.0, 0.3)) + to_slope(spectral(d, n, 3.0, low=2), d.uniform(0.05, 0.4))
    if d.chance(0.65):
        inset = d.uniform(0.015, 0.035)
        pitch = d.uniform(0.04, 0.12)
        side = torch.stack((t.half[0] - t.dx.abs(), t.half[1] - t.dy.abs()))
        if d.chance(0.5):  # along the edges
            px = torch.remainder(t.dx + 0.5 * pitch, pitch) - 0.5 * pitch
            py = torch.remainder(t.dy + 0.5 * pitch, pitch) - 0.5 * pitch
            da = torch.sqrt((side[0] - inset) ** 2 + py * py)
            db = torch.sqrt((side[1] - inset) ** 2 + px * px)
            dist = torch.minimum(da, db)
        else:  # in the corners
            dist = torch.sqrt((side[0] - inset) ** 2 + (side[1] - inset) ** 2)
        r = inset * d.uniform(0.3, 0.5)
        rivet = (1 - (dist / r) ** 2).clamp_min(0).sqrt()
        ring = torch.exp(-(((dist - r) / (0.25 * r)) ** 2))
        height = height + to_slope(rivet - 0.3 * ring, 0.8)
        albedo = albedo * (1 - 0.4 * ring) * (1 + 0.08 * rivet)
        rough = rough + 0.12 * ring - 0.06 * rivet
    if d.chance(0.5):
        run = streaks(d, n, 0.4) * d.uniform(0.2, 0.8)
        albedo = mix(albedo, albedo * colour(d, (0.7, 0.6, 0.5)), run)
        rough = rough + 0.1 * run
    return Surface(albedo, height, rough, d.log_uniform(0.02, 0.3), limit=1.8)


def painted(d: Draw, n: int) -> Surface:
    """Paint on steel, chipped and flaking to primer, metal and rust."""
    field = spectral(d, n, d.uniform(1.7, 2.6), low=d.uniform(1.5, 5))
    bare = mask(field, d.uniform(0.03, 0.5), 0.06)
    edge = mask(field, 0.75, 0.9)
    paint = any_colour(d, 0.85, (0.15, 0.9))
    fade = clouds(d, n, 2.4)
    coat = paint * (1 + 0.12 * (fade - 0.5)) * (1 - 0.15 * streaks(d, n, 0.4))
    coat = mix(coat, coat * 0.6 + 0.25, 0.4 * edge * d.uniform(0, 1))
    under, rough = _tarnish(d, n, _bare(d, grey=True))
    rust = blotches(d, n, d.uniform(0.1, 0.9), low=3, soft=0.5)
    under = mix(under, _rust(d, n), rust)
    albedo = mix(coat, under, bare)
    rim = mask(field, 0.5, 0.03)
    peel = spectral(d, n, 1.8, low=20)
    orange = spectral(d, n, 2.0, low=20, high=80)
    rough = torch.lerp(d.uniform(0.25, 0.6) + 0.08 * (fade - 0.5) + 0.5 * rough, 0.45 + rough + 0.3 * rust, bare)
    height = to_slope(blur(1 - bare, 1.2 / n), 1.0) + to_slope(orange, 0.05) + bare * to_slope(peel, 0.3) + 0.001 * rim
    return Surface(albedo, height, rough, d.log_uniform(0.02, 0.2), limit=1.8)


def ribbed(d: Draw, n: int) -> Surface:
    """Corrugated sheet and roller shutters."""
    _, v = d.grid(n)
    k = d.integer(4, 26)
    f = torch.remainder(v * k, 1)
    if d.chance(0.5):
        wave = torch.cos(2 * math.pi * f)
    else:
        flat = d.uniform(0.55, 0.9)
        wave = (1 - ((f - 0.5).abs() * 2 / flat) ** d.uniform(2, 6)).clamp_min(-0.6)
        wave = blur(wave, 0.02 / k)
    painted_over = d.chance(0.4)
    base = any_colour(d, 0.6, (0.3, 0.9)) if painted_over else _bare(d, grey=True)
    albedo, rough = _tarnish(d, n, base)
    deep = dust(d, wave, d.uniform(0.2, 0.9))
    albedo = albedo * (1 - 0.55 * deep)
    if d.chance(0.35):
        r = blotches(d, n, d.uniform(0.05, 0.5), low=2, soft=0.4)
        albedo = mix(albedo, _rust(d, n), r)
        rough = rough + 0.3 * r
    rough = d.uniform(0.3, 0.6) + rough * 0.7 + 0.2 * deep
    dents = spectral(d, n, 3.0, low=2)
    height = to_slope(wave, 1.0) + to_slope(dents, d.uniform(0.02, 0.2))
    s = Surface(albedo, height, rough, d.log_uniform(0.2, 0.8), limit=2.2)
    if d.chance(0.5):
        s.albedo, s.height, s.roughness = (t.transpose(-1, -2).contiguous() for t in (s.albedo, s.height, s.roughness))
    return s


FAMILIES = {
    "sheet": sheet,
    "brushed": brushed,
    "cast": cast,
    "hammered": hammered,
    "rusted": rusted,
    "perforated": perforated,
    "tread_plate": tread_plate,
    "galvanised": galvanised,
    "scratched": scratched,
    "plates": plates,
    "painted": painted,
    "ribbed": ribbed,
}
