"""Grounds: soil, gravel, pebbles, grass, leaf litter, sand, cracked mud, asphalt, snow, mossy earth."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from .noise import Draw, Splats, blur, smoothstep, spectral, unit, warp, worley
from .scatter import curves, lines, scatter, sizes, stone_params, stone_shape, strokes
from .structure import Surface, cavity, hsv, jitter, mix, ramp, to_slope, unit_range
from .wear import blotches, clouds, cracks, specks


def _earth(d: Draw) -> Tensor:
    """Soils from grey-brown to ochre and red-brown."""
    return hsv(d, (0.055, 0.115), (0.1, 0.5), (0.3, 0.7))


def _stone(d: Draw) -> Tensor:
    return (
        hsv(d, (0.04, 0.14), (0.0, 0.25), (0.4, 0.82))
        if d.chance(0.75)
        else hsv(d, (0.5, 0.7), (0.0, 0.15), (0.3, 0.7))
    )


def _stones(d: Draw, n: int, count: int, low: float, high: float, power: float = 2.5) -> tuple[Splats, Tensor]:
    """Loose stones; the second value holds, for each, random tones (4, count)."""
    p = stone_params(d, count, d.uniform(0.2, 0.8))
    size = sizes(d, count, low, high, power).clamp_min(1.2 / n)
    shape = stone_shape(d.uniform(0.04, 0.16), d.uniform(2.0, 5.0), d.uniform(0.4, 0.9), d.uniform(0.05, 0.3))
    p[7] = p[7] + 0.6 * size / high
    s, _ = scatter(d, n, size, p, shape, floor=-0.4)
    return s, d.randn(4, count)


def _stone_colours(d: Draw, s: Splats, tones: Tensor, spread: float) -> Tensor:
    """Each stone between two or three colours of one quarry, some odd ones."""
    palette = [_stone(d) for _ in range(d.integer(2, 3))]
    pick = 0.5 + 0.25 * s.per_splat(tones[0])
    base = ramp(pick, palette)
    tone = 1 + spread * s.per_splat(tones[1])
    hue = 0.25 * spread * torch.stack([s.per_splat(tones[i]) for i in (1, 2, 3)])
    return base * tone + hue * 0.4


def soil(d: Draw, n: int) -> Surface:
    """Bare earth: crumbs and clods, damp and dry patches, small stones, bits of straw."""
    clods = spectral(d, n, d.uniform(2.0, 2.8), low=d.uniform(2, 8))
    u, v = d.grid(n)
    k = int(min(d.log_uniform(20, 70), n / 4))
    w = (0.3 / k) * spectral(d, n, 2.5, low=k / 2, high=4 * k, batch=2)
    c = worley(d, u + w[0], v + w[1], k, k)
    crumbs = unit((1 - c.f1).clamp_min(0) * (0.5 + c.per_cell(d.rand(c.count))) + 0.3 * spectral(d, n, 1.0, low=k))
    grit = spectral(d, n, 0.5, low=n / 12)
    ridge = -clods.abs() if d.chance(0.4) else clods
    height = to_slope(ridge, 1.0) + to_slope(crumbs, d.uniform(0.4, 1.4)) + to_slope(grit, d.uniform(0.2, 0.6))
    cav = cavity(height, 0.012)
    base = _earth(d)
    other = jitter(d, base, 0.1)
    damp = blotches(d, n, d.uniform(0.05, 0.6), low=1.5, beta=2.6, soft=0.7)
    albedo = mix(base, other, clouds(d, n, 2.0)) * (1 + d.uniform(0.12, 0.35) * cav + 0.06 * grit)
    wet = d.uniform(0.0, 0.5)
    albedo = albedo * (1 - 0.6 * wet * damp)
    rough = d.uniform(0.52, 0.85) - 0.05 * cav + 0.03 * grit - 0.35 * wet * damp
    s = Surface(albedo, height, rough, d.log_uniform(0.2, 0.75), limit=1.9)
    if d.chance(0.6):
        _add_stones(d, n, s, d.integer(40, 500), 0.004, d.log_uniform(0.01, 0.04))
    if d.chance(0.4):
        _add_straw(d, n, s, d.integer(5, 80))
    return s


def _add_stones(d: Draw, n: int, s: Surface, count: int, low: float, high: float) -> None:
    stones, tones = _stones(d, n, count, low, high, 4.0)
    m = stones.hit.float()
    grain = spectral(d, n, 1.2, low=20)
    top = _stone_colours(d, stones, tones, 0.12) * (1 + 0.05 * grain)
    shade = blur(m, 0.006)
    s.albedo = mix(s.albedo * (1 - 0.3 * (shade - m).clamp_min(0)), top, m)
    s.roughness = torch.lerp(s.roughness, s.roughness - d.uniform(0.0, 0.2) + 0.03 * grain, m)
    h = to_slope(s.height, 1.0)
    scale = 0.8 * high
    s.height = torch.lerp(h, blur(h, 0.01) + scale * (stones.top + 0.5) + to_slope(grain, 0.15), m)


def _add_straw(d: Draw, n: int, s: Surface, count: int) -> None:
    length = 0.02 + 0.08 * d.rand(count) ** 2
    x, y = curves(d, count, 40, length, 0.6, 2 * math.pi * d.rand(count))
    r = 0.0012 + 0.002 * d.rand(count, 1)
    st = strokes(n, x, y, 0.2 * d.rand(count, 1).expand_as(x), r.expand_as(x), 0.0035)
    m = st.hit.float()
    tone = st.per_splat((1 + 0.25 * d.randn(count)).repeat_interleave(40))
    s.albedo = mix(s.albedo, hsv(d, (0.08, 0.14), (0.2, 0.45), (0.45, 0.8)) * tone, m)
    s.height = to_slope(s.height, 1.0) + 0.006 * m
    s.roughness = s.roughness - 0.06 * m


def gravel(d: Draw, n: int) -> Surface:
    """Crushed stone, all sizes, fines between."""
    high = d.log_uniform(0.018, 0.08)
    low = max(high * d.uniform(0.12, 0.4), 1.5 / n)
    count = int(min(d.uniform(1.4, 2.4) / (low + 0.28 * (high - low)) ** 2, 6000))
    s, tones = _stones(d, n, count, low, high, 3.0)
    m = s.hit.float()
    rock = spectral(d, n, 1.6, low=0.5 / high)
    grit = spectral(d, n, 0.6, low=n / 10)
    bed = to_slope(grit, 0.5) * high * 2
    z = torch.where(s.hit, s.top, -0.3 + bed) * high
    height = to_slope(z, 1.0) + to_slope(rock, d.uniform(0.15, 0.5)) + to_slope(grit, 0.15)
    ao = unit_range(cavity(z, 0.5 * high))
    base = _stone_colours(d, s, tones, d.uniform(0.08, 0.22)) * (1 + d.uniform(0.03, 0.1) * rock + 0.05 * grit)
    fines = _earth(d) * (0.8 + 0.1 * grit)
    albedo = mix(fines, base, m) * (1 - d.uniform(0.3, 0.7) * (1 - ao) ** 1.5)
    dirt = d.uniform(0, 0.7) * smoothstep(0.5, 0.1, ao)
    albedo = mix(albedo, fines * 0.7, dirt)
    rough = d.uniform(0.45, 0.75) + d.uniform(-0.05, 0.2) * (0.6 - ao) + 0.03 * rock + 0.04 * s.per_splat(tones[2]) * m
    return Surface(albedo, height, rough, d.log_uniform(0.5, 1.3), limit=1.8)


def pebbles(d: Draw, n: int) -> Surface:
    """Rounded stones bedded in sand or earth."""
    high = d.log_uniform(0.03, 0.14)
    low = high * d.uniform(0.2, 0.5)
    count = int(d.uniform(0.25, 1.2) / (low + 0.3 * (high - low)) ** 2)
    p = stone_params(d, count, 0.3)
    size = sizes(d, count, low, high, 2.5)
    p[7] = p[7] + 0.8 * size / high
    s, p = scatter(d, n, size, p, stone_shape(d.uniform(0.02, 0.08), d.uniform(2, 3.5), 0.8, 0.08), floor=0.0)
    tones = d.randn(4, count)
    m = s.hit.float()
    rock = spectral(d, n, 1.8, low=0.7 / high)
    grit = spectral(d, n, 0.4, low=n / 8)
    sandy = d.chance(0.5)
    bedding = unit_range(spectral(d, n, 2.5, low=2)) * d.uniform(0.3, 0.9)
    above = torch.where(s.hit, s.top, 0.0) - bedding
    m = m * smoothstep(0.0, 0.06, above)
    z = (torch.maximum(above, torch.zeros_like(above)) + bedding * 0.5) * high
    height = to_slope(z, 1.0) + to_slope(grit, d.uniform(0.1, 0.4)) + m * to_slope(rock, d.uniform(0.05, 0.25))
    ground_colour = hsv(d, (0.08, 0.12), (0.15, 0.4), (0.45, 0.75)) if sandy else _earth(d)
    veins = torch.exp(-8 * warp(rock, 0.01 * rock, 0.01 * grit).abs()) * s.per_splat((tones[3] > 1).float())
    top = _stone_colours(d, s, tones, d.uniform(0.06, 0.18)) * (1 + 0.06 * rock) + 0.12 * veins
    contact = unit_range(cavity(z, 0.3 * high))
    bed = ground_colour * (1 + 0.07 * grit) * (0.75 + 0.25 * contact)
    albedo = mix(bed, top, m)
    rough = torch.lerp(d.uniform(0.6, 0.85) + 0.03 * grit, d.uniform(0.35, 0.65) + 0.04 * rock, m)
    return Surface(albedo, height, rough, d.log_uniform(0.35, 1.0), limit=2.0)


def sand(d: Draw, n: int) -> Surface:
    """Grains, wind ripples or footprints, now and then shells and pebbles."""
    grain = spectral(d, n, d.uniform(0.0, 0.8), low=n / 10)
    kind = d.uniform()
    if kind < 0.4:
        _, v = d.grid(n)
        bend = spectral(d, n, 3.0, low=2, batch=2)
        k = d.integer(5, 24)
        phase = v * k + d.uniform(0.3, 0.8) * bend[0] + 0.15 * spectral(d, n, 2.6, low=6)
        saw = torch.remainder(phase, 1)
        skew = d.uniform(0.55, 0.75)
        forms = torch.where(saw < skew, saw / skew, (1 - saw) / (1 - skew)) * (0.7 + 0.3 * bend[1])
        forms = blur(forms, 0.12 / k)
    elif kind < 0.7:
        u, v = d.grid(n)
        w = 0.03 * spectral(d, n, 2.5, low=2, batch=2)
        k = d.integer(5, 14)
        c = worley(d, u + w[0], v + w[1], k, k)
        forms = blur(smoothstep(0.1, 0.9, c.f1) * (0.3 + c.per_cell(d.rand(c.count))), 0.006)
    else:
        forms = spectral(d, n, d.uniform(2.6, 3.4), low=d.uniform(2, 5))
    height = to_slope(forms, 1.0) + to_slope(grain, d.uniform(0.15, 0.9))
    base = (
        hsv(d, (0.07, 0.12), (0.12, 0.45), (0.5, 0.88))
        if d.chance(0.8)
        else hsv(d, (0.05, 0.12), (0.05, 0.3), (0.2, 0.45))
    )
    dark = specks(d, n, d.uniform(0.01, 0.08), n / 3)
    light = specks(d, n, d.uniform(0.0, 0.04), n / 3)
    damp = clouds(d, n, 2.6)
    albedo = base * (1 + d.uniform(0.02, 0.07) * grain + d.uniform(0.02, 0.1) * cavity(forms, 0.03))
    albedo = albedo * (1 - d.uniform(0.2, 0.5) * dark + 0.15 * light) * (1 - d.uniform(0, 0.2) * damp)
    rough = d.uniform(0.5, 0.85) + 0.03 * grain - d.uniform(0, 0.15) * damp - 0.05 * cavity(forms, 0.05)
    s = Surface(albedo, height, rough, d.log_uniform(0.15, 0.6), limit=1.8)
    if d.chance(0.3):
        _add_stones(d, n, s, d.integer(10, 120), 0.003, d.log_uniform(0.008, 0.03))
    return s


def cracked_mud(d: Draw, n: int) -> Surface:
    """Dried mud: curled plates, cracks at two scales, dust."""
    u, v = d.grid(n)
    k = d.integer(4, 14)
    w = (d.uniform(0.04, 0.12) / k) * spectral(d, n, 3.2, low=k / 2, high=6 * k, batch=2)
    c = worley(d, u + w[0], v + w[1], k, k, 0.95)
    width = d.uniform(0.025, 0.09) * torch.exp(0.5 * spectral(d, n, 2.2, low=2))
    gap = smoothstep(1.0, 0.35, c.edge / width)
    fine = cracks(d, u + 0.5 * w[0], v + 0.5 * w[1], 2 * k + d.integer(0, 2 * k), 0.05) * d.uniform(0, 1)
    curl = torch.exp(-c.edge / 0.12) * d.uniform(0.0, 0.5)
    rough_top = spectral(d, n, 2.0, low=k)
    grit = spectral(d, n, 0.6, low=n / 12)
    plate = c.per_cell(d.rand(c.count))
    z = curl * (1 - gap) - d.uniform(0.6, 1.2) * gap - 0.35 * fine + 0.15 * plate * (1 - gap)
    height = to_slope(z, 1.0) + to_slope(rough_top, d.uniform(0.15, 0.4)) + to_slope(grit, d.uniform(0.1, 0.35))
    base = hsv(d, (0.05, 0.11), (0.08, 0.4), (0.4, 0.75))
    tone = 1 + 0.07 * (plate - 0.5) + 0.06 * rough_top + 0.05 * grit + 0.1 * (clouds(d, n) - 0.5)
    albedo = base * tone * (1 - d.uniform(0.45, 0.75) * gap) * (1 - 0.3 * fine) * (1 + 0.1 * curl)
    rough = d.uniform(0.45, 0.75) + d.uniform(0.05, 0.3) * gap + 0.1 * fine + 0.03 * grit
    s = Surface(albedo, height, rough, d.log_uniform(0.3, 0.8), limit=2.0)
    if d.chance(0.4):
        _add_stones(d, n, s, d.integer(20, 200), 0.003, d.log_uniform(0.008, 0.03))
    return s


def grass(d: Draw, n: int) -> Surface:
    """Blades over earth: long and combed, or short turf with clover and straw."""
    turf = d.chance(0.4)
    points = 14
    count = d.integer(2600, 4200) if turf else d.integer(1200, 2600)
    length = (d.uniform(0.03, 0.06) if turf else d.log_uniform(0.07, 0.2)) * (0.5 + d.rand(count))
    comb = d.uniform(0, 2 * math.pi) + d.uniform(0.6, 3.0) * d.randn(count)
    x, y = curves(d, count, points, length, d.uniform(0.3, 1.0), comb)
    t = torch.linspace(0, 1, points, device=d.device)
    width = (0.0022 + 0.0032 * d.rand(count, 1) * (0.6 if turf else 1.0)) * d.uniform(0.8, 1.4)
    width = width.clamp_min(0.8 / n)
    r = width * (1.15 - t**2).clamp_min(0.25)
    z = 1.2 * d.rand(count, 1) * torch.sin(t * 2.2) + 0.4 * d.rand(count, 1)
    s = strokes(n, x, y, z, r, float(r.max()), 0.12)
    hit = s.hit
    owner = torch.div(s.id.clamp_min(0), points, rounding_mode="floor")
    tip = s.per_splat(t.repeat(count))
    green = hsv(d, (0.18, 0.30), (0.35, 0.75), (0.38, 0.7))
    fresh = hsv(d, (0.17, 0.26), (0.4, 0.7), (0.45, 0.75))
    dry = hsv(d, (0.1, 0.15), (0.25, 0.5), (0.5, 0.78))
    sort = d.rand(count)
    dead = (sort < d.uniform(0.0, 0.35)).float()[owner]
    base = mix(mix(green, fresh, d.rand(count)[owner]), dry, torch.maximum(dead, 0.5 * tip**4))
    tone = 1 + 0.14 * d.randn(count)[owner]
    earth = _earth(d) * (0.6 + 0.12 * spectral(d, n, 1.2, low=8))
    top = torch.where(hit, s.top, 0.0)
    depth = unit_range(top)
    rib = torch.where(hit, unit_range(s.dx.abs() + s.dy.abs()), 0.0)
    shade = d.uniform(0.3, 0.7)
    albedo = torch.where(hit, base * tone * (1 + 0.1 * rib), earth) * (1 - shade + shade * depth)
    albedo = albedo * (0.88 + 0.24 * clouds(d, n, 2.0, low=2))
    fuzz = spectral(d, n, 0.6, low=n / 10)
    rough = d.uniform(0.5, 0.72) - d.uniform(-0.05, 0.15) * (depth - 0.5) + 0.03 * fuzz + 0.06 * dead * hit
    height = to_slope(blur(top, 0.0018), 1.0) + to_slope(fuzz, 0.2) + to_slope(spectral(d, n, 2.5, low=3), 0.3)
    return Surface(albedo, height, rough, d.log_uniform(0.45, 1.2), limit=1.7)


def litter(d: Draw, n: int) -> Surface:
    """Fallen leaves, or bark mulch: layers of curled, ribbed, rotting pieces."""
    mulch = d.chance(0.35)
    high = d.log_uniform(0.035, 0.11)
    low = high * d.uniform(0.35, 0.6)
    count = int(d.uniform(1.8, 2.9) / (0.5 * (low + high)) ** 2)
    size = sizes(d, count, low, high, 1.5)
    slim = d.uniform(2.5, 6.0) if mulch else d.uniform(1.3, 2.4)
    p = torch.stack(
        (
            2 * math.pi * d.rand(count),
            slim * (0.8 + 0.5 * d.rand(count)),
            d.randn(count),
            d.randn(count),
            d.randn(count),
            d.rand(count),
        )
    )

    def leaf(x: Tensor, y: Tensor, q: Tensor) -> Tensor:
        c, s = torch.cos(q[0]), torch.sin(q[0])
        a, b = c * x + s * y, (c * y - s * x) * q[1]
        b = b - 0.35 * q[2] * (a * a - 0.4)
        if mulch:
            inside = torch.maximum(a.abs() + 0.1 * torch.sin(9 * b + q[3]), b.abs()) < 0.85
        else:
            lobes = 1 + 0.12 * torch.sin(9 * a + q[3])
            inside = b.abs() < (1 - a * a) * (1 - 0.3 * a) * lobes
        z = q[5] + 0.16 * q[3] * a + 0.12 * q[4] * b + 0.14 * q[2] * (b * b - a * a) - 0.1 * (b.abs() < 0.08).float()
        return torch.where(inside, z, -math.inf)

    s, p = scatter(d, n, size, p, leaf, floor=-0.2)
    hit = s.hit
    turn, thin = s.per_splat(p[0]), s.per_splat(p[1])
    a = torch.cos(turn) * s.dx + torch.sin(turn) * s.dy
    b = (torch.cos(turn) * s.dy - torch.sin(turn) * s.dx) * thin
    b = b - 0.35 * s.per_splat(p[2]) * (a * a - 0.4)
    if mulch:
        veins = torch.sin(26 * b + 6 * s.per_splat(p[3])) * 0.5
    else:
        veins = torch.exp(-((b / 0.06) ** 2)) + 0.4 * torch.exp(
            -(((torch.remainder(4 * (a - 0.6 * b.abs()), 1) - 0.5) / 0.12) ** 2)
        )
    noise, fine = spectral(d, n, 1.8, low=8), spectral(d, n, 0.8, low=n / 14)
    tones = d.randn(3, count)
    first = hsv(d, (0.04, 0.12), (0.2, 0.6), (0.3, 0.72))
    palette = [first * 0.6, first, jitter(d, first, 0.15), hsv(d, (0.06, 0.2), (0.2, 0.6), (0.35, 0.7))]
    base = ramp(0.45 + 0.28 * s.per_splat(tones[0]) + 0.1 * noise, palette)
    rot = blotches(d, n, 0.25, low=20, beta=1.4)
    tone = (1 + 0.12 * s.per_splat(tones[1])) * (1 + d.uniform(0.0, 0.18) * veins) * (1 - 0.4 * rot)
    depth = unit_range(cavity(torch.where(hit, s.top, -0.2), 0.6 * high))
    albedo = torch.where(hit, base * tone, 0.4 * first) * (0.35 + 0.65 * depth**0.8) * (1 + 0.06 * fine)
    z = torch.where(hit, s.top, -0.2) * high * 0.7
    height = to_slope(blur(z, 0.0012), 1.0) + to_slope(noise, 0.3) + to_slope(veins * hit, 0.15) + to_slope(fine, 0.1)
    rough = d.uniform(0.48, 0.75) - d.uniform(0, 0.2) * (depth - 0.5) + 0.04 * s.per_splat(tones[2]) + 0.08 * rot
    return Surface(albedo, height, rough, d.log_uniform(0.45, 1.2), limit=1.8)


def asphalt(d: Draw, n: int) -> Surface:
    """Bound aggregate, worn smooth or open; cracks and tar, pale or dark."""
    u, v = d.grid(n)
    high = d.log_uniform(0.006, 0.02)
    count = int(min(1.6 / high**2, 9000))
    s, tones = _stones(d, n, count, max(0.3 * high, 1.3 / n), high, 1.5)
    m = s.hit.float() * smoothstep(d.uniform(-0.4, 0.9), 1.3, s.top + 0.2 * spectral(d, n, 1.5, low=3))
    grit = spectral(d, n, 0.4, low=n / 8)
    bind = hsv(d, (0.5, 0.7) if d.chance(0.5) else (0.05, 0.12), (0.0, 0.12), (0.15, 0.58))
    contrast = d.uniform(0.06, 0.35)
    top = mix(bind, _stone(d), torch.tensor(d.uniform(0.1, 0.8), device=d.device)) * (
        1 + contrast * s.per_splat(tones[1])
    )
    wear = clouds(d, n, 2.6)
    albedo = mix(bind * (1 + 0.06 * grit), top, m) * (0.9 + 0.2 * wear)
    z = torch.where(s.hit, s.top, -0.3)
    height = to_slope(z, 1.0) + to_slope(grit, d.uniform(0.3, 0.8)) + to_slope(spectral(d, n, 2.5, low=2), 0.15)
    rough = d.uniform(0.48, 0.82) - d.uniform(-0.05, 0.2) * m + 0.035 * grit - d.uniform(0, 0.12) * (wear - 0.5)
    total = d.log_uniform(0.12, 0.6)
    if d.chance(0.35):
        run = cracks(d, u, v, d.integer(2, 4), d.uniform(0.012, 0.03), 0.3) * blotches(d, n, 0.5, low=1.5, soft=0.5)
        albedo = albedo * (1 - 0.7 * run)
        height = height - 0.012 * run
        rough = rough + 0.12 * run
    return Surface(albedo, height, rough, total, limit=1.6)


def snow(d: Draw, n: int) -> Surface:
    """Soft drifts, crust and sparkle."""
    drift = spectral(d, n, 3.2, low=d.uniform(1.5, 4))
    crust = spectral(d, n, d.uniform(1.6, 2.6), low=d.uniform(8, 30))
    if d.chance(0.5):
        crust = -crust.abs()
    grain = spectral(d, n, 0.3, low=n / 8)
    height = to_slope(drift, 1.0) + to_slope(crust, d.uniform(0.2, 1.0)) + to_slope(grain, d.uniform(0.1, 0.6))
    cav = cavity(height, 0.03)
    base = (
        hsv(d, (0.52, 0.62), (0.0, 0.14), (0.8, 0.98))
        if d.chance(0.7)
        else hsv(d, (0.1, 0.15), (0, 0.04), (0.75, 0.92))
    )
    albedo = base * (1 + 0.035 * cav + 0.012 * grain) * (1 - 0.06 * clouds(d, n))
    if d.chance(0.3):
        albedo = mix(albedo, _earth(d), blotches(d, n, 0.08, low=4) * d.uniform(0.2, 0.8))
    rough = d.uniform(0.4, 0.75) + 0.04 * cav + 0.04 * grain + 0.06 * (clouds(d, n) - 0.5)
    return Surface(albedo, height, rough, d.log_uniform(0.1, 0.35), limit=1.6)


def mossy(d: Draw, n: int) -> Surface:
    """Earth or stones half overgrown: moss cushions, sprouts, needles."""
    s = soil(d, n) if d.chance(0.6) else gravel(d, n)
    field = spectral(d, n, 2.2, low=d.uniform(2, 6))
    cover = d.uniform(0.2, 0.7)
    m = blotches(d, n, cover, low=d.uniform(2, 7), beta=1.9, soft=0.25)
    k = int(min(d.log_uniform(40, 110), n / 4))
    u, v = d.grid(n)
    c = worley(d, u, v, k, k)
    tufts = (1 - c.f1).clamp_min(0) * (0.4 + 0.6 * c.per_cell(d.rand(c.count)))
    fuzz = spectral(d, n, 0.4, low=n / 8)
    green = hsv(d, (0.17, 0.29), (0.4, 0.8), (0.25, 0.6))
    moss = mix(green, jitter(d, green, 0.12), clouds(d, n, 1.8, low=3)) * (0.45 + 0.75 * tufts) * (1 + 0.1 * fuzz)
    moss = moss * (1 + 0.15 * c.per_cell(d.randn(c.count)))
    s.albedo = mix(s.albedo, moss, m)
    bulge = m * (1 + 0.3 * field)
    s.height = (
        to_slope(s.height, 1.0) * (1 - 0.6 * m)
        + to_slope(bulge, 0.4)
        + m * (to_slope(tufts, 0.7) + to_slope(fuzz, 0.3))
    )
    s.roughness = torch.lerp(s.roughness, d.uniform(0.6, 0.9) + 0.04 * fuzz, m)
    if d.chance(0.5):
        count = d.integer(50, 500)
        x, y = curves(d, count, 60, 0.03 + 0.03 * d.rand(count), 0.3, 2 * math.pi * d.rand(count))
        needles = lines(n, x, y, 0.4 + 0.6 * d.rand(count, 1))
        s.albedo = mix(s.albedo, hsv(d, (0.06, 0.12), (0.3, 0.6), (0.3, 0.65)), needles * 0.9)
        s.height = s.height + 0.003 * needles
    s.slope = d.log_uniform(0.3, 0.9)
    return s


FAMILIES = {
    "soil": soil,
    "gravel": gravel,
    "pebbles": pebbles,
    "sand": sand,
    "cracked_mud": cracked_mud,
    "grass": grass,
    "litter": litter,
    "asphalt": asphalt,
    "snow": snow,
    "mossy": mossy,
}
