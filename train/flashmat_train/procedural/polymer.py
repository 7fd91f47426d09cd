"""Polymers: smooth and grained plastic, rubber mats, paint, vinyl, foam, carbon fibre, wrinkled film."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from .noise import Draw, blur, smoothstep, spectral, unit, worley
from .structure import Surface, any_colour, cavity, hsv, jitter, mix, to_slope, unit_range
from .tiles import basket_tiles, hexagon_tiles
from .wear import blotches, clouds, dust, scratches, smudges, specks, streaks


def _plastic_colour(d: Draw) -> Tensor:
    pick = d.uniform()
    if pick < 0.22:
        return hsv(d, (0, 1), (0, 0.12), (0.02, 0.2))
    if pick < 0.42:
        return hsv(d, (0.05, 0.17), (0, 0.1), (0.82, 1.0))
    return any_colour(d, 0.95, (0.15, 0.98))


def _handled(d: Draw, n: int, base: Tensor, level: float) -> tuple[Tensor, Tensor]:
    """Even colour, and a roughness that tells of wiping, grease, runs and scratches."""
    patch = clouds(d, n, d.uniform(1.8, 2.8))
    rough = level + d.uniform(0.01, 0.12) * smudges(d, n) + d.uniform(-0.04, 0.06) * (patch - 0.5)
    albedo = base * (1 + d.uniform(0.0, 0.05) * (patch - 0.5))
    if d.chance(0.6):
        s = scratches(d, n, d.integer(15, 250), (0.03, d.uniform(0.1, 0.7)), d.uniform(0, 1.0))
        rough = rough + d.uniform(0.05, 0.3) * s
        albedo = albedo + d.uniform(-0.03, 0.1) * s
    if d.chance(0.35):
        run = streaks(d, n, d.uniform(0.2, 0.6))
        rough = rough + d.uniform(0.05, 0.35) * run
        albedo = mix(albedo, albedo * 0.7 + 0.2, 0.25 * run)
    if d.chance(0.3):
        spot = specks(d, n, d.uniform(0.002, 0.02), d.uniform(15, n / 3))
        rough = rough + d.uniform(0.05, 0.25) * spot
        albedo = albedo + d.uniform(-0.1, 0.1) * spot
    return albedo, rough


def smooth(d: Draw, n: int) -> Surface:
    """Moulded and polished; faint waves, mould marks."""
    albedo, rough = _handled(d, n, _plastic_colour(d), d.uniform(0.15, 0.5))
    height = to_slope(spectral(d, n, 3.4, low=1), 1.0) + to_slope(spectral(d, n, 1.6, low=10), d.uniform(0.05, 0.8))
    return Surface(albedo, height, rough, d.log_uniform(0.002, 0.04))


def grained(d: Draw, n: int) -> Surface:
    """Textured mouldings: spark-eroded, leather-like or fine matt grain; rubbed tops shine."""
    u, v = d.grid(n)
    kind = d.uniform()
    k = int(min(d.log_uniform(25, 120), n / 5))
    if kind < 0.4:
        f = spectral(d, n, 1.0, low=k / 2, high=2 * k)
        grain = smoothstep(-1.2, 1.0, f)
    elif kind < 0.75:
        w = (0.3 / k) * spectral(d, n, 2.5, low=k / 2, high=3 * k, batch=2)
        c = worley(d, u + w[0], v + w[1], k, k)
        grain = smoothstep(0.0, d.uniform(0.2, 0.4), c.edge) * (0.7 + 0.3 * c.per_cell(d.rand(c.count)))
    else:
        grain = unit_range(spectral(d, n, 0.6, low=n / 8))
    fine = spectral(d, n, 0.6, low=n / 10)
    height = to_slope(grain, 1.0) + to_slope(fine, d.uniform(0.05, 0.4))
    albedo, rough = _handled(d, n, _plastic_colour(d), d.uniform(0.3, 0.65))
    top = unit_range(blur(height, 1.0 / n))
    albedo = albedo * (1 + d.uniform(-0.06, 0.08) * (top - 0.5)) + 0.004 * fine
    rough = rough - d.uniform(-0.08, 0.14) * (top - 0.5) + 0.01 * fine
    return Surface(albedo, height, rough, d.log_uniform(0.01, 0.2), limit=1.6)


def rubber(d: Draw, n: int) -> Surface:
    """Mats and soles: studs, ribs, bars, hexagons or meander; dust in the recesses."""
    u, v = d.grid(n)
    k = 2 * d.integer(2, 12)
    kind = d.choice(("studs", "ribs", "bars", "hexagons", "meander", "plain"))
    soft = d.uniform(0.04, 0.2)
    if kind == "studs":
        y = v * k
        x = u * k + 0.5 * (torch.floor(y).long() % 2)
        fx, fy = torch.remainder(x, 1) - 0.5, torch.remainder(y, 1) - 0.5
        form = smoothstep(0.42, 0.42 - soft, torch.sqrt(fx * fx + fy * fy))
    elif kind == "ribs":
        form = smoothstep(0.45, 0.45 - soft, (torch.remainder(u * k, 1) - 0.5).abs() * d.uniform(1, 1.6))
    elif kind == "bars":
        t = basket_tiles(u, v, max(1, k // 2), d.integer(2, 4))
        form = smoothstep(0.0, soft * 0.4 / k, t.edge - 0.06 / k)
    elif kind == "hexagons":
        t = hexagon_tiles(u, v, k)
        form = smoothstep(0.0, soft / k, t.edge - 0.05 / k)
    elif kind == "meander":
        f = spectral(d, n, 0.0, low=k * 0.8, high=k)
        form = 0.5 + 0.5 * torch.cos(d.uniform(2, 3.5) * f)
    else:
        form = unit_range(spectral(d, n, 3.0, low=2))
    if d.chance(0.3):
        form = 1 - form
    form = blur(form, max(0.02 / k, 0.5 / n))
    grain = spectral(d, n, d.uniform(0.6, 1.6), low=n / 14)
    base = hsv(d, (0, 1), (0, 0.15), (0.06, 0.22)) if d.chance(0.6) else any_colour(d, 0.8, (0.15, 0.75))
    albedo, rough = _handled(d, n, base, d.uniform(0.45, 0.8))
    deep = dust(d, form, d.uniform(0, 0.8))
    albedo = mix(albedo, hsv(d, (0.06, 0.13), (0.05, 0.3), (0.3, 0.6)), 0.35 * deep)
    albedo = albedo * (1 + 0.02 * grain)
    rough = rough + d.uniform(0, 0.2) * deep - d.uniform(0, 0.1) * form + 0.02 * grain
    total = d.log_uniform(0.02, 0.12) if kind == "plain" else d.log_uniform(0.1, 0.5)
    height = to_slope(form, 1.0) + to_slope(grain, d.uniform(0.05, 0.3))
    return Surface(albedo, height, rough, total, limit=1.8)


def paint(d: Draw, n: int) -> Surface:
    """Coats of paint: orange peel, roller stipple or brush marks, drips and runs."""
    kind = d.uniform()
    if kind < 0.35:  # sprayed
        coat = spectral(d, n, 1.5, low=d.uniform(20, 60), high=120)
        total = d.log_uniform(0.01, 0.08)
    elif kind < 0.7:  # rolled
        coat = torch.exp(0.5 * spectral(d, n, 1.4, low=d.uniform(10, 40), high=150))
        total = d.log_uniform(0.03, 0.2)
    else:  # brushed
        angle = d.choice((0.0, math.pi / 2))
        coat = spectral(d, n, 1.0, low=3, high=120, stretch=(d.uniform(6, 20), 1), angle=angle)
        total = d.log_uniform(0.02, 0.15)
    drips = streaks(d, n, d.uniform(0.05, 0.25)) if d.chance(0.4) else torch.zeros(n, n, device=d.device)
    pimples = specks(d, n, 0.01, d.uniform(15, 50)) if d.chance(0.4) else torch.zeros(n, n, device=d.device)
    height = to_slope(coat, 1.0) + to_slope(spectral(d, n, 3.0), d.uniform(0.1, 0.6))
    height = height + 0.01 * blur(drips, 0.004) + 0.004 * blur(pimples, 0.003)
    albedo, rough = _handled(d, n, _plastic_colour(d), d.uniform(0.2, 0.6))
    albedo = albedo * (1 + d.uniform(0.0, 0.06) * cavity(height, 0.02) + 0.04 * drips)
    rough = rough - 0.06 * drips + d.uniform(-0.04, 0.06) * unit(coat).clamp(-2, 2) + 0.1 * pimples
    return Surface(albedo, height, rough, total, limit=1.6)


def vinyl(d: Draw, n: int) -> Surface:
    """Embossed wall covering or flooring: a repeat pattern, printed and pressed, on a fine canvas grain."""
    u, v = d.grid(n)
    k = d.integer(2, 9)
    kind = d.choice(("hexagons", "lattice", "damask", "stripes", "canvas"))
    if kind == "hexagons":
        t = hexagon_tiles(u, v, k)
        line = smoothstep(0.012, 0.004, t.edge)
    elif kind == "lattice":
        a, b = torch.sin(math.pi * k * (u + v)), torch.sin(math.pi * k * (u - v))
        line = smoothstep(0.25, 0.08, torch.minimum(a.abs(), b.abs()))
    elif kind == "damask":
        f = spectral(d, n, 2.0, low=k, high=6 * k)
        f = f + f.flip(-1) + f.flip(-2) + f.flip(-1).flip(-2)
        f = f + torch.roll(f, (n // 2, n // 2), (0, 1))
        line = smoothstep(-0.05, 0.12, unit(f) - d.uniform(0, 0.6))
    elif kind == "stripes":
        line = smoothstep(0.0, 0.1, torch.sin(2 * math.pi * k * u) - d.uniform(-0.4, 0.6))
    else:
        line = torch.zeros(n, n, device=d.device)
    threads = int(min(d.log_uniform(40, 120), n / 4))
    canvas = torch.sin(2 * math.pi * threads * u) * torch.sin(2 * math.pi * threads * v)
    grain = spectral(d, n, 1.0, low=n / 10)
    height = (
        to_slope(blur(line, 1.0 / n), d.uniform(-1, 1)) + to_slope(canvas, d.uniform(0, 0.6)) + to_slope(grain, 0.5)
    )
    base = _plastic_colour(d)
    albedo, rough = _handled(d, n, base, d.uniform(0.3, 0.7))
    ink = jitter(d, base, 0.2) if d.chance(0.6) else _plastic_colour(d)
    albedo = mix(albedo, ink, line * d.uniform(0, 1.0)) * (1 + 0.012 * grain + 0.01 * canvas)
    rough = rough + d.uniform(-0.2, 0.15) * line + 0.015 * grain
    return Surface(albedo, height, rough, d.log_uniform(0.02, 0.2), limit=1.6)


def foam(d: Draw, n: int) -> Surface:
    """Cellular foam and sponge; packing foam of fused beads."""
    u, v = d.grid(n)
    k = int(min(d.log_uniform(8, 40), n / 8))
    w = (0.05 / k) * spectral(d, n, 2.6, low=k / 2, high=3 * k, batch=2)
    c = worley(d, u + w[0], v + w[1], k, k)
    fine = spectral(d, n, 0.8, low=n / 10)
    if d.chance(0.5):  # beads
        bead = (1 - (1 - c.edge / 0.4).clamp(0, 1) ** 2.2) + 0.25 * (c.per_cell(d.rand(c.count)) - 0.5)
        height = to_slope(bead, 1.0) + to_slope(fine, 0.15)
        base = hsv(d, (0.05, 0.65), (0.0, 0.08), (0.85, 1.0)) if d.chance(0.7) else _plastic_colour(d)
        deep = smoothstep(0.12, 0.0, c.edge)
        albedo = base * (1 - d.uniform(0.05, 0.3) * deep) * (1 + 0.02 * c.per_cell(d.randn(c.count)) + 0.01 * fine)
        rough = d.uniform(0.4, 0.65) + 0.1 * deep + 0.03 * c.per_cell(d.randn(c.count)) + 0.01 * fine
    else:  # open cells, all sizes
        size = 0.15 + 0.5 * c.per_cell(d.rand(c.count)) ** 1.5
        hole = smoothstep(1.0, 0.7, c.f1 / size)
        k2 = min(2 * k, n // 5)
        c2 = worley(d, u, v, k2, k2)
        hole = torch.maximum(hole, 0.7 * smoothstep(1.0, 0.6, c2.f1 / (0.1 + 0.4 * c2.per_cell(d.rand(c2.count)))))
        height = to_slope(-hole, 1.0) + to_slope(fine, 0.3)
        base = hsv(d, (0.1, 0.17), (0.2, 0.8), (0.6, 0.95)) if d.chance(0.5) else _plastic_colour(d)
        albedo = base * (1 - d.uniform(0.3, 0.65) * hole) * (1 + 0.03 * fine)
        rough = d.uniform(0.55, 0.85) + 0.1 * hole + 0.02 * fine
    stain = blotches(d, n, 0.2, low=2, soft=0.8) * d.uniform(0, 0.3)
    albedo = mix(albedo, albedo * 0.75, stain)
    return Surface(albedo, height, rough, d.log_uniform(0.08, 0.45), limit=1.8)


def carbon(d: Draw, n: int) -> Surface:
    """Carbon or glass fibre cloth under resin: tows in a twill, each a bundle of fine lines."""
    u, v = d.grid(n)
    k = 4 * d.integer(2, 9)
    x, y = u * k, v * k
    i, j = torch.floor(x), torch.floor(y)
    over = ((i + j).long() % 4 < 2) if d.chance(0.7) else ((i + j).long() % 2 == 0)
    fx, fy = x - i - 0.5, y - j - 0.5
    strand = torch.where(
        over, spectral(d, n, 0.8, low=2 * k, stretch=(1, 24)), spectral(d, n, 0.8, low=2 * k, stretch=(24, 1))
    )
    across = torch.where(over, fx, fy)
    bulge = (1 - (1.9 * across) ** 2).clamp_min(0) ** 0.5
    run = torch.where(over, torch.remainder(y - i, 4), torch.remainder(x - j, 4)) if d.chance(0.5) else across + 0.5
    base = hsv(d, (0.55, 0.7), (0, 0.12), (0.1, 0.3)) if d.chance(0.75) else any_colour(d, 0.8, (0.2, 0.8))
    sheen = torch.where(over, d.uniform(0.7, 1.4), d.uniform(0.7, 1.4))
    albedo, rough = _handled(d, n, base, d.uniform(0.15, 0.4))
    albedo = albedo * sheen * (0.85 + 0.2 * bulge) * (1 + 0.06 * strand) * (1 - 0.05 * run)
    rough = rough + torch.where(over, d.uniform(0, 0.15), 0.0) + 0.03 * strand
    clear = d.chance(0.5)
    height = to_slope(bulge + 0.02 * strand, 1.0)
    total = d.log_uniform(0.004, 0.03) if clear else d.log_uniform(0.05, 0.3)
    return Surface(albedo, height, rough, total, limit=1.8)


def film(d: Draw, n: int) -> Surface:
    """Tarpaulin and crumpled film: facets and creases, whitened where they were folded."""
    u, v = d.grid(n)
    folds = torch.zeros(n, n, device=d.device)
    for k, share in ((d.integer(3, 4), 1.0), (d.integer(5, 8), 0.7), (d.integer(9, 16), 0.4), (22, 0.15)):
        w = (0.2 / k) * spectral(d, n, 3.2, low=max(2, k / 2), high=1.5 * k, batch=2)
        c = worley(d, u + w[0], v + w[1], k, k)
        folds = folds + to_slope(blur(c.f2 - c.f1, 0.002), share * d.choice((-1.0, 1.0)))
    crease = unit_range(cavity(folds, 0.01))
    albedo, rough = _handled(d, n, _plastic_colour(d), d.uniform(0.15, 0.5))
    threads = int(min(d.log_uniform(30, 80), n / 5))
    scrim = torch.maximum(torch.cos(2 * math.pi * threads * u), torch.cos(2 * math.pi * threads * v))
    woven = d.uniform(0.1, 0.5) if d.chance(0.4) else 0.0
    height = folds + to_slope(scrim, woven + 1e-4)
    white = smoothstep(0.7, 1.0, crease)
    albedo = albedo * (1 + 0.05 * woven * scrim) + d.uniform(0.0, 0.12) * white
    rough = rough + d.uniform(0.0, 0.2) * white + 0.03 * woven * scrim
    return Surface(albedo, height, rough, d.log_uniform(0.05, 0.3), limit=1.6)


FAMILIES = {
    "smooth": smooth,
    "grained": grained,
    "rubber": rubber,
    "paint": paint,
    "vinyl": vinyl,
    "foam": foam,
    "carbon": carbon,
    "film": film,
}
