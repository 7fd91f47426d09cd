"""Families that real photos asked for: foil and crumpled sheets, printed and embossed metal, paint worn to the metal,
patent leather, lacquer, terry, deep joints, inlays, wet stone. Several are two materials in one picture, and metal in
places."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from .fabric import _cloth_colour, plain_weave
from .leather import _skin
from .metal import METALS, _bare, _polish, _rust, _tarnish
from .noise import Draw, blur, sample, smoothstep, spectral, splat, unit, worley
from .polymer import _handled
from .stone_diff import concrete, sandstone
from .stone_spec import marble
from .structure import Surface, any_colour, cavity, colour, hsv, jitter, mix, rms_slope, to_slope, unit_range
from .tiles import Tiles, basket_tiles, brick_tiles, hexagon_tiles
from .wear import blotches, clouds, dust, mask, scratches, smudges, specks
from .wood import veneer


def _sheen(d: Draw, low: float, high: float) -> float:
    return d.log_uniform(low, high)


def _creases(d: Draw, n: int, low: float, layers: int, sharp: float = 0.0) -> Tensor:
    """Folds of a sheet that was crumpled: smooth facets that meet in sharp lines; `sharp`: blunted over so much of the
    tile."""
    out = torch.zeros(n, n, device=d.device)
    for k in range(layers):
        field = spectral(d, n, d.uniform(3.0, 4.0), low=low * 1.6**k, high=3 * low * 1.6**k)
        fold = field.abs() if d.chance(0.5) else -field.abs()
        out = out + to_slope(fold, 0.75**k)
    return blur(out, sharp) if sharp else out


def foil(d: Draw, n: int) -> Surface:
    """Kitchen or gift foil: crumpled and smoothed out again, bright, sometimes dyed."""
    base = _bare(d, grey=True) if d.chance(0.6) else hsv(d, (0, 1), (0.3, 0.9), (0.5, 0.95))
    fold = _creases(d, n, d.log_uniform(1.2, 4), d.integer(3, 6), d.log_uniform(0.001, 0.004))
    fine = spectral(d, n, 1.2, low=n / 10)
    worn = unit_range(-cavity(fold, 0.01).abs())
    rough = _sheen(d, 0.12, 0.4) + d.uniform(0.0, 0.12) * (1 - worn) + 0.03 * smudges(d, n)
    albedo = base * (1 - d.uniform(0.0, 0.1) * (1 - worn))
    height = to_slope(fold, 1.0) + to_slope(fine, d.uniform(0.02, 0.12))
    return Surface(albedo, height, rough, d.log_uniform(0.06, 0.5), limit=1.6)


def _motif(d: Draw, n: int, k: int) -> Tensor:
    """A repeated figure in [0, 1], `k` across: dots, rings, bars, flowers, waves, letters' boxes."""
    u, v = d.grid(n)
    y = v * k
    row = torch.floor(y)
    x = u * k + (0.5 * (row.long() % 2) if d.chance(0.5) and k % 2 == 0 else 0.0)
    fx, fy = torch.remainder(x, 1) - 0.5, torch.remainder(y, 1) - 0.5
    r, t = torch.hypot(fx, fy), torch.atan2(fy, fx)
    soft = d.uniform(0.02, 0.08)
    kind = d.choice(("dot", "ring", "flower", "bars", "wave", "boxes"))
    if kind == "dot":
        size = d.uniform(0.15, 0.4)
        return smoothstep(size + soft, size - soft, r)
    if kind == "ring":
        return smoothstep(soft, 0.0, (r - d.uniform(0.2, 0.36)).abs() - d.uniform(0.03, 0.09))
    if kind == "flower":
        edge = d.uniform(0.22, 0.3) * (1 + d.uniform(0.2, 0.5) * torch.cos(d.integer(3, 8) * t))
        return smoothstep(edge + soft, edge - soft, r)
    if kind == "bars":
        return smoothstep(soft, 0.0, (fx - fy if d.chance(0.5) else fx).abs() - d.uniform(0.08, 0.25))
    if kind == "wave":
        bend = d.uniform(0.05, 0.3) * torch.sin(2 * math.pi * u * k)
        return smoothstep(soft, 0.0, (torch.remainder(y + bend, 1) - 0.5).abs() - d.uniform(0.08, 0.25))
    box = torch.maximum(fx.abs(), fy.abs() * d.uniform(1.0, 2.5))
    size = d.uniform(0.2, 0.42)
    return smoothstep(size + soft, size - soft, box)


def embossed_metal(d: Draw, n: int) -> Surface:
    """Stamped sheet: figures raised or sunk, polished on top, dirt in the recesses."""
    k = d.integer(3, 20)
    raised = blur(_motif(d, n, k), d.uniform(0.02, 0.08) / k) * d.choice((1.0, -1.0))
    albedo, rough = _tarnish(d, n, _bare(d))
    top = unit_range(raised)
    deep = dust(d, raised, d.uniform(0, 0.7))
    albedo = albedo * (1 + d.uniform(0, 0.1) * (top - 0.5)) * (1 - 0.4 * deep)
    rough = _polish(d, n) + 0.7 * rough + d.uniform(-0.12, 0.06) * (top - 0.5) + 0.2 * deep
    wave = spectral(d, n, 3.0, low=2)
    height = to_slope(raised, 1.0) + to_slope(wave, d.uniform(0.02, 0.15))
    return Surface(albedo, height, rough, d.log_uniform(0.06, 0.5), limit=2.0)


def printed(d: Draw, n: int) -> Surface:
    """Tins, wrappers, labels on foil: inks that hide the metal or tint it, matt or glossy beside it."""
    u, v = d.grid(n)
    sheet, worn = _tarnish(d, n, _bare(d, grey=True))
    metal_rough = _sheen(d, 0.15, 0.45) + 0.5 * worn
    albedo, rough, bare = sheet, metal_rough, torch.ones(n, n, device=d.device)
    for _ in range(d.integer(1, 3)):
        kind = d.uniform()
        if kind < 0.5:
            ink = _motif(d, n, d.integer(2, 14))
        elif kind < 0.75:
            ink = mask(spectral(d, n, d.uniform(2.2, 3.2), low=d.uniform(1, 4)), d.uniform(0.2, 0.6), 0.02)
        else:
            band = torch.remainder(v * d.integer(1, 5) + d.uniform(), 1.0)
            ink = smoothstep(0.0, 0.01, band) * smoothstep(d.uniform(0.3, 0.7), 0.28, band)
        ink = 1 - ink if d.chance(0.25) else ink
        hue = any_colour(d, 0.95, (0.05, 0.95))
        hides = d.uniform(0.75, 1.0) if d.chance(0.7) else 0.0
        albedo = mix(albedo, hue * hides + (1 - hides) * hue * sheet, ink)
        rough = torch.lerp(rough, torch.full_like(rough, d.uniform(0.15, 0.7)), ink * (0.4 + 0.6 * hides))
        bare = bare * (1 - ink * hides)
    fold = _creases(d, n, d.uniform(1.5, 4), 2, 0.004) if d.chance(0.4) else spectral(d, n, 3.4, low=1)
    height = to_slope(fold, 1.0) - to_slope(bare, d.uniform(0.0, 0.3)) + 0 * u
    return Surface(albedo, height, rough, d.log_uniform(0.004, 0.2), metallic=bare)


def worn_paint(d: Draw, n: int) -> Surface:
    """Paint chipped and rubbed through to the metal, with rust where it has been bare for long."""
    metal, marks = _tarnish(d, n, _bare(d, grey=True))
    relief = spectral(d, n, d.uniform(1.2, 2.4), low=d.uniform(3, 20))
    field = spectral(d, n, d.uniform(1.4, 2.6), low=d.uniform(1.5, 6))
    rub = unit(field + d.uniform(0.0, 0.8) * relief)
    chips = mask(rub, d.uniform(0.08, 0.5), d.uniform(0.01, 0.08))
    chips = torch.maximum(chips, scratches(d, n, d.integer(5, 120), (0.03, 0.5), 0.5) > 0.35)
    coat = 1 - chips
    edge = (blur(coat, 0.004) - coat).abs()
    paint, gloss = _handled(d, n, any_colour(d, 0.9, (0.08, 0.92)), d.uniform(0.15, 0.6))
    rust = blotches(d, n, d.uniform(0.1, 0.6), low=3, soft=0.5) * chips if d.chance(0.5) else torch.zeros_like(chips)
    albedo = mix(paint * (1 - 0.5 * edge), mix(metal, _rust(d, n), rust), chips)
    rough = torch.lerp(gloss, torch.lerp(_polish(d, n) + marks, torch.full_like(rust, 0.75), rust), chips)
    height = to_slope(blur(coat, 1.0 / n), 1.0) + to_slope(relief, d.uniform(0.1, 0.8))
    height = height + to_slope(rust * spectral(d, n, 1.0, low=n / 14), 0.3) if bool(rust.any()) else height
    return Surface(albedo, height, rough, d.log_uniform(0.02, 0.25), limit=1.6, metallic=chips * (1 - rust))


def patent(d: Draw, n: int) -> Surface:
    """Glossy dark leather: a finish so thick that the grain only ripples it; creases where it was bent."""
    k = int(min(d.log_uniform(16, 90), n / 5))
    grain, tone = _skin(d, n, k, d.uniform(0.2, 0.4))
    grain = blur(grain, d.uniform(0.0, 0.15) / k)
    crease = _creases(d, n, d.uniform(1.5, 5), 2, 0.003)
    base = hsv(d, (0.95, 1.1), (0.0, 0.6), (0.03, 0.16)) if d.chance(0.75) else any_colour(d, 0.9, (0.1, 0.5))
    worn = clouds(d, n, 2.4, low=1.5)
    rough = _sheen(d, 0.1, 0.3) + d.uniform(0.0, 0.12) * (worn - 0.5) + d.uniform(0.0, 0.1) * (1 - unit_range(grain))
    rough = rough + d.uniform(0.0, 0.2) * scratches(d, n, d.integer(5, 150), (0.02, 0.3), 0.8) + 0.03 * smudges(d, n)
    albedo = base * (1 + 0.03 * tone + d.uniform(0.0, 0.2) * (unit_range(grain) - 0.5))
    height = to_slope(grain, 1.0) + to_slope(crease, d.uniform(0.0, 0.8))
    return Surface(albedo, height, rough, d.log_uniform(0.02, 0.2), limit=1.6)


def lacquer(d: Draw, n: int) -> Surface:
    """Piano black, car paint, lacquer ware: dark and nearly a mirror; orange peel, dust, polishing swirls."""
    base = hsv(d, (0, 1), (0.0, 0.3), (0.01, 0.12)) if d.chance(0.65) else any_colour(d, 0.95, (0.08, 0.6))
    albedo, handled = _handled(d, n, base, 0.0)
    if d.chance(0.35):  # flakes
        flake = specks(d, n, d.uniform(0.02, 0.1), n / 3)
        albedo = albedo + d.uniform(0.03, 0.2) * flake * colour(d, METALS[d.choice(("aluminium", "gold", "copper"))])
    peel = spectral(d, n, d.uniform(0.5, 1.5), low=d.log_uniform(8, 40), high=d.log_uniform(50, 120))
    dirt = specks(d, n, d.uniform(0.001, 0.01), d.uniform(20, n / 4))
    rough = _sheen(d, 0.07, 0.25) + d.uniform(0.3, 1.0) * handled.clamp_min(-0.03) + d.uniform(0.1, 0.5) * dirt
    height = to_slope(peel, 1.0) + to_slope(spectral(d, n, 3.4), 0.5) + to_slope(blur(dirt, 0.002), d.uniform(0.0, 0.6))
    return Surface(mix(albedo, albedo * 0.6 + 0.25, 0.5 * dirt), height, rough, d.log_uniform(0.004, 0.05))


def creased(d: Draw, n: int) -> Surface:
    """Crumpled plastic bags, tape, coated paper: flat facets, sharp folds."""
    fold = _creases(d, n, d.log_uniform(1.2, 4), d.integer(2, 5), d.log_uniform(0.001, 0.006))
    albedo, rough = _handled(d, n, any_colour(d, 0.9, (0.04, 0.97)), _sheen(d, 0.12, 0.6))
    line = 1 - unit_range(-cavity(fold, 0.008).abs())
    albedo = mix(albedo, albedo * 0.5 + 0.45, d.uniform(0.0, 0.35) * line)
    return Surface(albedo, fold, rough + d.uniform(0.0, 0.25) * line, d.log_uniform(0.05, 0.5), limit=1.6)


def crumpled_cloth(d: Draw, n: int) -> Surface:
    """Cloth that lies in folds, its weave on top."""
    s = plain_weave(d, n)
    fold = _creases(d, n, d.uniform(1.0, 2.0), d.integer(1, 3), d.log_uniform(0.006, 0.02))
    total = d.log_uniform(0.12, 0.5)
    height = to_slope(s.height, d.uniform(0.2, 0.8) * s.slope) + to_slope(fold, total)
    return Surface(s.albedo, height, s.roughness, rms_slope(height), limit=2.0)


def towel(d: Draw, n: int) -> Surface:
    """Terry: loops of yarn standing every way, in rows, shaded deep between; bands without loops now and then."""
    u, v = d.grid(n)
    k = int(min(d.log_uniform(24, 80), n / 5))
    rows = max(2, round(k * d.uniform(0.7, 1.1)))
    count = k * rows
    at = torch.arange(count, device=d.device)
    loose = d.uniform(0.15, 0.5)
    cx = (at % k + 0.5 * ((at // k) % 2) + loose * d.randn(count)) / k
    cy = (at // k + loose * d.randn(count)) / rows
    turn = math.pi * d.rand(count) if d.chance(0.6) else d.uniform(0, math.pi) + 0.5 * d.randn(count)
    size = (d.uniform(0.75, 1.1) / k) * (1 + 0.2 * d.randn(count)).clamp(0.6, 1.5)
    c, s = torch.cos(turn)[:, None], torch.sin(turn)[:, None]
    thin, lift = d.uniform(0.3, 0.5), 0.6 * d.rand(count)[:, None]
    hole = d.uniform(0.0, 0.45)

    def loop(dx: Tensor, dy: Tensor) -> Tensor:
        x, y = (c * dx + s * dy) / size[:, None], (c * dy - s * dx) / (thin * size[:, None])
        rho = torch.sqrt(x * x + y * y)
        arch = torch.sqrt((1 - rho * rho).clamp_min(0)) - hole * torch.exp(-((rho / 0.4) ** 2))
        return torch.where(rho < 1, lift + 0.8 * arch, -math.inf)

    t = splat(n, cx, cy, float(size.max()), loop, floor=-0.5)
    angle = t.per_splat(turn)
    across = (torch.cos(angle) * t.dy - torch.sin(angle) * t.dx) * k
    along = (torch.cos(angle) * t.dx + torch.sin(angle) * t.dy) * k
    ply = torch.sin(2 * math.pi * (d.uniform(1.5, 3) * along + d.uniform(1, 3) * across))
    fuzz = spectral(d, n, 0.4, low=k)
    z = torch.where(t.hit, t.top, -0.5) + 0.05 * ply + 0.08 * fuzz
    # white and pale ones are the more frequent
    base = hsv(d, (0, 1), (0.0, 0.3), (0.7, 1.0)) if d.chance(0.45) else _cloth_colour(d)
    albedo = base * (1 + d.uniform(0.02, 0.1) * t.per_splat(d.randn(count)) + 0.04 * fuzz + 0.05 * ply)
    flat = torch.zeros(n, n, device=d.device)
    if d.chance(0.25):
        place = torch.remainder(v + d.uniform(), 1.0)
        flat = smoothstep(0.0, 0.01, place) * smoothstep(d.uniform(0.12, 0.3), 0.1, place)
        rib = 0.15 * torch.sin(2 * math.pi * 2 * rows * v) + 0.05 * torch.sin(2 * math.pi * 2 * k * u)
        z = torch.lerp(z, rib - 0.1, flat)
        albedo = mix(albedo, (jitter(d, base, 0.1) if d.chance(0.6) else _cloth_colour(d)).expand(3, n, n), flat)
    depth = unit_range(z, 0.05)
    shade = d.uniform(0.2, 0.6) * (1 - flat)
    albedo = albedo * (1 - shade * (1 - depth))
    rough = d.uniform(0.7, 0.95) - d.uniform(0.0, 0.15) * (depth - 0.5) + 0.02 * fuzz
    return Surface(albedo, z, rough, d.log_uniform(0.4, 1.1), limit=1.8)


def deep_joints(d: Draw, n: int) -> Surface:
    """Dry walls and worn setts: stones with rounded shoulders, gaps as deep as the stones are wide, dirt or moss in
    them."""
    u, v = d.grid(n)
    k = d.integer(3, 9)
    rows = max(2, round(k * d.uniform(0.6, 1.6)))
    wobble = (d.uniform(0.01, 0.06) / k) * spectral(d, n, 2.8, low=k, high=4 * k, batch=2)
    if d.chance(0.5):
        c = worley(d, u + wobble[0], v + wobble[1], k, rows, d.uniform(0.4, 0.9))
        edge, stone, count = c.edge / math.sqrt(k * rows), c.id, c.count
        dx, dy = c.dx / k, c.dy / k
    else:
        t: Tiles = brick_tiles(u + wobble[0], v + wobble[1], k, 2 * ((rows + 1) // 2), 0.5)
        edge, stone, count, dx, dy = t.edge, t.id, t.count, t.dx, t.dy
    width = d.uniform(0.02, 0.08) / k * (1 + 0.3 * spectral(d, n, 2.0, low=k))
    shoulder = d.uniform(0.1, 0.35) / k
    body = ((edge - width) / shoulder).clamp(0, 1)
    dome = 1 - (1 - body) ** d.uniform(1.6, 3.0)
    tilt = d.randn(count)[stone] * dx + d.randn(count)[stone] * dy
    face = sandstone(d, n) if d.chance(0.5) else concrete(d, n)
    tone = (1 + d.uniform(0.05, 0.25) * d.randn(count)[stone]).clamp(0.4, 1.6)
    gap = smoothstep(0.3, 0.0, body)
    soil = (
        hsv(d, (0.05, 0.12), (0.2, 0.6), (0.05, 0.3)) if d.chance(0.7) else hsv(d, (0.2, 0.3), (0.3, 0.7), (0.1, 0.35))
    )
    grit = 1 + 0.2 * spectral(d, n, 0.6, low=n / 12)
    albedo = mix(face.albedo * tone, soil * grit, gap)
    floor = spectral(d, n, 1.0, low=n / 12)
    height = to_slope(dome, 1.0) + to_slope(tilt * body, d.uniform(0.05, 0.3))
    height = height + (1 - gap) * to_slope(face.height, d.uniform(0.1, 0.5)) + gap * to_slope(floor, 0.3)
    rough = torch.lerp(face.roughness, torch.full_like(gap, d.uniform(0.8, 0.95)), gap)
    return Surface(albedo, height, rough, d.log_uniform(0.35, 1.0), limit=2.5)


def combined(a: Surface, b: Surface, t: Tensor, step: float = 0.0) -> Surface:
    """`a` with `b` where the mask is 1; `step`: slopes of the rim between them, for what stands out or lies deeper."""
    height = torch.lerp(to_slope(a.height, a.slope), to_slope(b.height, b.slope), t)
    if step:
        height = height + to_slope(blur(t, 1.0 / t.shape[-1]), step)
    rough = torch.lerp(a.roughness, b.roughness, t)
    return Surface(mix(a.albedo, b.albedo, t), height, rough, rms_slope(height), max(a.limit, b.limit))


def _figure(d: Draw, n: int) -> tuple[Tensor, Tensor]:
    """Where an inlay lies, and the line along its border, both in [0, 1]."""
    u, v = d.grid(n)
    pick = d.uniform()
    if pick < 0.4:
        field = _motif(d, n, d.integer(2, 6))
        near = (blur(field, 0.006) - field).abs()
        return field, smoothstep(0.1, 0.3, near)
    if pick < 0.7:
        t = hexagon_tiles(u, v, 2 * d.integer(1, 4)) if d.chance(0.5) else basket_tiles(u, v, d.integer(1, 3), 2)
        field = (d.rand(t.count) < 0.5).float()[t.id]
        return field, smoothstep(0.006, 0.003, t.edge)
    edge = spectral(d, n, d.uniform(2.6, 3.6), low=d.uniform(1, 3))
    return (edge > 0).float(), smoothstep(0.09, 0.05, edge.abs())


def _brass(d: Draw, s: Surface, line: Tensor) -> Surface:
    """A metal line let into a surface."""
    n = line.shape[-1]
    metal, marks = _tarnish(d, n, jitter(d, colour(d, METALS[d.choice(("brass", "gold", "copper", "steel"))]), 0.05))
    s.albedo = mix(s.albedo, metal, line)
    s.roughness = torch.lerp(s.roughness, _polish(d, n) + marks, line)
    s.metallic = line
    return s


def wood_inlay(d: Draw, n: int) -> Surface:
    """Marquetry: two veneers in a pattern, with a line of brass between now and then; one finish over both."""
    where, line = _figure(d, n)
    s = combined(veneer(d, n), veneer(d, n), where, d.uniform(0.0, 0.02))
    gloss = torch.full_like(where, _sheen(d, 0.15, 0.5)) + 0.06 * smudges(d, n)
    s.roughness = torch.lerp(s.roughness, gloss, d.uniform(0.3, 1.0))
    return _brass(d, s, line) if d.chance(0.6) else s


def stone_inlay(d: Draw, n: int) -> Surface:
    """Two polished stones in a pattern, joined by metal or by a dark joint."""
    where, line = _figure(d, n)
    s = combined(marble(d, n), marble(d, n), where)
    if d.chance(0.6):
        return _brass(d, s, line)
    s.albedo = mix(s.albedo, hsv(d, (0.05, 0.15), (0, 0.3), (0.1, 0.6)).expand(3, n, n), line)
    s.roughness = torch.lerp(s.roughness, torch.full_like(line, d.uniform(0.5, 0.9)), line)
    height = to_slope(s.height, s.slope) - to_slope(blur(line, 0.002), d.uniform(0.01, 0.1))
    return Surface(s.albedo, height, s.roughness, rms_slope(height))


def wet(d: Draw, n: int) -> Surface:
    """Stone or plaster with wet or oily patches: darker, glossy, their pores filled."""
    s = concrete(d, n) if d.chance(0.6) else sandstone(d, n)
    field = spectral(d, n, d.uniform(2.0, 3.2), low=d.uniform(1, 4)) - d.uniform(0.0, 0.8) * unit(s.height)
    damp = mask(unit(field), d.uniform(0.2, 0.7), d.uniform(0.3, 1.0))
    pool = mask(unit(field), d.uniform(0.05, 0.3), d.uniform(0.03, 0.2)) * damp
    hue = s.albedo.clamp(0, 1)
    soaked = hue ** d.uniform(1.3, 2.0) * d.uniform(0.55, 0.8)
    albedo = mix(hue, soaked, torch.maximum(damp, pool))
    rough = torch.lerp(s.roughness, s.roughness * d.uniform(0.6, 0.85), damp)
    rough = torch.lerp(rough, torch.full_like(rough, d.uniform(0.08, 0.3)), pool)
    rock = to_slope(s.height, s.slope)
    height = torch.lerp(rock, to_slope(sample(rock, *d.grid(n)), 0.15 * s.slope), pool)
    return Surface(albedo, height, rough, rms_slope(height), s.limit)


FAMILIES = {
    "fabric": {"towel": towel, "crumpled_cloth": crumpled_cloth},
    "leather": {"patent": patent},
    "metal": {"foil": foil, "embossed_metal": embossed_metal, "printed": printed, "worn_paint": worn_paint},
    "polymer": {"lacquer": lacquer, "creased": creased},
    "stone-diff": {"deep_joints": deep_joints, "wet": wet},
    "stone-spec": {"stone_inlay": stone_inlay},
    "wood": {"wood_inlay": wood_inlay},
}
