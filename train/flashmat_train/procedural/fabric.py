"""Fabrics: weaves (plain, twill, satin, checks), denim, knits and jersey, carpets, felt, corduroy, quilts, ropes."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from .noise import Draw, sample, smoothstep, spectral, splat, unit, warp
from .scatter import curves, strokes
from .structure import Surface, any_colour, blur, cavity, hsv, jitter, mix, to_slope, unit_range
from .wear import clouds, mask


def _cloth_colour(d: Draw) -> Tensor:
    pick = d.uniform()
    if pick < 0.3:  # undyed: ecru, linen, greys
        return hsv(d, (0.06, 0.14), (0.02, 0.22), (0.4, 0.95))
    if pick < 0.4:
        return hsv(d, (0.5, 0.75), (0.02, 0.2), (0.1, 0.9))
    return any_colour(d, 0.95, (0.12, 0.9))


def _pattern(d: Draw, kind: str) -> Tensor:
    """Which crossings show the warp: a small periodic bool matrix (weft row, warp column)."""
    if kind == "plain":
        return torch.tensor([[1, 0], [0, 1]]).bool()
    if kind == "basket":
        return torch.tensor([[1, 0], [0, 1]]).repeat_interleave(2, 0).repeat_interleave(2, 1).bool()
    if kind == "rep":
        return torch.tensor([[1, 0], [0, 1]]).repeat_interleave(d.integer(2, 3), d.integer(0, 1)).bool()
    if kind == "satin":
        size, step = d.choice(((5, 2), (8, 3), (5, 3), (8, 5)))
        p = torch.zeros(size, size)
        p[torch.arange(size), (torch.arange(size) * step) % size] = 1
        return (p < 0.5) if d.chance(0.5) else p.bool()
    if kind == "dobby":
        size = d.integer(4, 8)
        p = torch.rand(size, size, generator=d.rng, device=d.rng.device).cpu() < 0.5
        return torch.cat((torch.cat((p, p.flip(1)), 1), torch.cat((p.flip(0), p.flip(0).flip(1)), 1)), 0)
    up, down = d.choice(((2, 2), (3, 1), (1, 3), (2, 1), (3, 3), (1, 2)))
    size = up + down
    i, j = torch.meshgrid(torch.arange(size), torch.arange(size), indexing="ij")
    p = (i + j) % size < up
    if kind == "herringbone":
        p = p.repeat(1, d.integer(1, 3))
        p = torch.cat((p, p.flip(1)), 1)
    return p if d.chance(0.5) else p.flip(1)


def _stripes(d: Draw, count: int, colours: list[Tensor]) -> Tensor:
    """A colour for each of ``count`` threads, (3, count): one colour, or mirrored bands as in tartan."""
    if len(colours) == 1:
        return colours[0].view(3, 1).expand(3, count)
    ids: list[int] = []
    while len(ids) < count // 2 + 1:
        ids += [d.integer(0, len(colours) - 1)] * max(1, int(d.uniform(0.02, 0.25) * count))
    half = ids[: count // 2 + 1]
    ids = (half + half[::-1])[:count]
    return torch.cat([colours[i].view(3, 1) for i in ids], 1)


def _melange(d: Draw, n: int, threads: float, stretch: tuple[float, float]) -> Tensor:
    """A factor (3, n, n) near 1: yarn spun from fibres of several shades, lighter and darker along each thread."""
    flecks = spectral(d, n, d.uniform(0.2, 1.2), low=threads * d.uniform(0.1, 0.5), stretch=stretch)
    if d.chance(0.4):  # few dark or light fibres among the others
        flecks = unit((flecks - d.uniform(0.3, 1.2)).clamp_min(0)) * d.choice((-1.0, 1.0))
    tint = 1 + 0.15 * d.randn(3).view(3, 1, 1)
    return (1 + d.log_uniform(0.05, 0.4) * tint * flecks).clamp(0.15, 2.5)


def _weave(d: Draw, n: int, kind: str, warps: list[Tensor], wefts: list[Tensor], fine: float = 1.0) -> Surface:
    u, v = d.grid(n)
    p = _pattern(d, kind).to(d.device)
    ph, pw = p.shape
    most = n * fine / 4.5
    threads = min(d.log_uniform(22, 150), most)
    aspect = d.uniform(0.75, 1.3)
    kx = max(1, round(threads / pw)) * pw
    ky = max(1, round(threads * aspect / ph)) * ph
    sag = d.uniform(0.0, 0.25)
    bend = spectral(d, n, 2.8, low=2, high=14, batch=2)
    kink = spectral(d, n, 1.0, low=threads / 5, high=threads / 2, batch=2)
    x = u * kx + sag * (bend[0] + 0.4 * kink[0])
    y = v * ky + sag * (bend[1] + 0.4 * kink[1])
    i, j = torch.floor(x), torch.floor(y)
    fx, fy = x - i - 0.5, y - j - 0.5
    ii, jj = i.long() % kx, j.long() % ky

    def over(a: Tensor, b: Tensor) -> Tensor:
        return p[a % ph, b % pw].float() * 2 - 1

    here = over(jj, ii)
    # A thread rises and falls half-way between crossings.
    sx, sy = torch.sign(fx), torch.sign(fy)
    side_x, side_y = over(jj, ii + sx.long()), over(jj + sy.long(), ii)
    ease = d.uniform(0.15, 0.5)
    tx = 0.5 * smoothstep(0.5 - ease, 0.5 + ease, fx.abs())
    ty = 0.5 * smoothstep(0.5 - ease, 0.5 + ease, fy.abs())
    lift_warp = torch.lerp(here, side_y, ty)
    lift_weft = -torch.lerp(here, side_x, tx)
    wide = d.uniform(0.78, 1.02), d.uniform(0.78, 1.02)
    slub = spectral(d, n, 1.2, low=3, stretch=(1, 14)), spectral(d, n, 1.2, low=3, stretch=(14, 1))
    uneven = d.log_uniform(0.01, 0.14)
    wa = wide[0] * (1 + uneven * (slub[0] + d.randn(kx)[ii])).clamp(0.6, 1.3)
    wb = wide[1] * (1 + uneven * (slub[1] + d.randn(ky)[jj])).clamp(0.6, 1.3)
    a, b = 2 * fx / wa, 2 * fy / wb
    round_a, round_b = (1 - a * a).clamp_min(0).sqrt(), (1 - b * b).clamp_min(0).sqrt()
    swing = d.uniform(0.25, 0.7)
    za = torch.where(a.abs() < 1, swing * lift_warp + 0.55 * round_a, -1.0)
    zb = torch.where(b.abs() < 1, swing * lift_weft + 0.55 * round_b, -1.0)
    z = torch.maximum(za, zb).clamp_min(-0.7)
    top = za > zb
    # Twisted fibres within each thread.
    turns, lean = d.uniform(1.0, 3.0), d.uniform(0.3, 1.2)
    ply_a = torch.sin(2 * math.pi * (turns * (y + lean * fx)) + 6.3 * d.rand(kx)[ii])
    ply_b = torch.sin(2 * math.pi * (turns * (x + lean * fy)) + 6.3 * d.rand(ky)[jj])
    ply = torch.where(top, ply_a, ply_b)
    fibre = torch.where(top, slub[0], slub[1])
    fuzz = spectral(d, n, 0.6, low=threads * 0.4)
    detail = d.uniform(0.0, 0.08) * ply + d.uniform(0.01, 0.06) * fuzz
    ground = torch.maximum(za, zb) <= -0.7
    tone_a, tone_b = d.log_uniform(0.01, 0.07), d.log_uniform(0.01, 0.07)
    ca = _stripes(d, kx, warps)[:, ii] * (1 + tone_a * d.randn(kx)[ii])
    cb = _stripes(d, ky, wefts)[:, jj] * (1 + tone_b * d.randn(ky)[jj])
    if d.chance(0.3):
        long = d.uniform(2, 10)
        ca, cb = ca * _melange(d, n, threads, (1, long)), cb * _melange(d, n, threads, (long, 1))
    base = torch.where(top, ca, cb)
    depth = unit_range(z)
    shade = d.uniform(0.1, 0.5)
    dark = (1 - shade) + shade * depth**0.7
    albedo = base * dark * (1 + d.uniform(0.01, 0.06) * fibre + d.uniform(0.01, 0.05) * fuzz + 0.04 * ply * depth)
    albedo = torch.where(ground, albedo * 0.6, albedo) * (1 + d.uniform(0, 0.05) * (clouds(d, n) - 0.5))
    spread = d.log_uniform(0.03, 0.5)
    rough = d.uniform(0.56, 0.88) - spread * (depth - 0.6) + 0.018 * fuzz + 0.018 * fibre
    folds = spectral(d, n, 3.6, low=d.uniform(1, 3), high=12)
    total = d.log_uniform(0.1, 0.75)
    height = to_slope(z + detail, total) + to_slope(folds, total * d.uniform(0.02, 0.28))
    return Surface(albedo, height, rough, total, limit=2.0)


def plain_weave(d: Draw, n: int) -> Surface:
    base = _cloth_colour(d)
    other = jitter(d, base, 0.06) if d.chance(0.7) else _cloth_colour(d)
    return _weave(d, n, d.choice(("plain", "plain", "basket", "rep")), [base], [other])


def twill(d: Draw, n: int) -> Surface:
    base = _cloth_colour(d)
    other = jitter(d, base, 0.08) if d.chance(0.5) else _cloth_colour(d)
    return _weave(d, n, d.choice(("twill", "herringbone")), [base], [other])


def satin(d: Draw, n: int) -> Surface:
    base = _cloth_colour(d)
    s = _weave(d, n, d.choice(("satin", "dobby")), [base], [jitter(d, base, 0.12)], fine=1.3)
    s.roughness = s.roughness - d.uniform(0.05, 0.25)
    return s


def checked(d: Draw, n: int) -> Surface:
    colours = [_cloth_colour(d) for _ in range(d.integer(2, 4))]
    wefts = colours if d.chance(0.7) else [colours[0]]
    return _weave(d, n, d.choice(("plain", "twill")), colours, wefts)


def denim(d: Draw, n: int) -> Surface:
    blue = hsv(d, (0.56, 0.66), (0.25, 0.75), (0.2, 0.6)) if d.chance(0.7) else hsv(d, (0, 1), (0, 0.1), (0.1, 0.4))
    white = hsv(d, (0.08, 0.6), (0.0, 0.12), (0.5, 0.95))
    s = _weave(d, n, "twill", [blue], [white])
    fade = clouds(d, n, 2.8, swirl=0.02)
    s.albedo = mix(s.albedo, s.albedo * 0.5 + 0.5 * white * 0.8, d.uniform(0, 0.6) * fade * unit_range(s.height))
    return s


def knit(d: Draw, n: int) -> Surface:
    return _knit(d, n, int(min(d.log_uniform(6, 40), n / 9)), d.log_uniform(0.25, 0.85), 0.3)


def jersey(d: Draw, n: int) -> Surface:
    """Knit of fine yarn, as in shirts and pullovers: stitches near the photo's resolution, hardly any relief, often of
    mixed yarn; it may be napped."""
    s = _knit(d, n, int(d.log_uniform(n / 14, n / 5)), d.log_uniform(0.06, 0.35), 0.65)
    if d.chance(0.3):
        s.albedo = blur(s.albedo, d.uniform(0.5, 1.5) / n) * (
            1 + d.uniform(0.02, 0.08) * spectral(d, n, 0.8, low=n / 16)
        )
    return s


def _knit(d: Draw, n: int, kx: int, total: float, mixed: float) -> Surface:
    """`kx` wales across; `mixed`: how often the yarn is of several shades."""
    u, v = d.grid(n)
    ky = max(2, round(kx * d.uniform(1.1, 1.6)))
    bend = spectral(d, n, 2.8, low=2, high=14, batch=2)
    sag = d.uniform(0.02, 0.14)
    x, y = u * kx + sag * bend[0], v * ky + sag * bend[1]
    i, j = torch.floor(x), torch.floor(y)
    fx, fy = x - i - 0.5, y - j
    ii, jj = i.long() % kx, j.long() % ky
    rib = torch.ones(kx, device=d.device)
    if d.chance(0.35):  # ribbing: every few wales turn under
        rib = ((torch.arange(kx, device=d.device) // d.integer(1, 3)) % 2).float() * 2 - 1
    ax = fx.abs() * 2
    lean, thick, rise = d.uniform(0.5, 0.75), d.uniform(0.26, 0.36), d.uniform(1.2, 1.7)
    best = torch.full_like(x, -1.0)
    along = torch.zeros_like(x)
    across = torch.zeros_like(x)
    row = jj
    inner = 0.14
    for o in (-1, 0, 1):
        yy = 1 - (fy - o)  # up within the stitch
        # The leg runs from the foot at the middle up and outwards.
        dirx, diry = lean, rise * 0.72
        length = dirx * dirx + diry * diry
        t = ((ax - inner) * dirx + (yy + 0.3) * diry) / length
        tc = t.clamp(0, 1)
        ex, ey = ax - inner - tc * dirx, yy + 0.3 - tc * diry
        dist = torch.sqrt((ex * ex) + (0.8 * ey) ** 2) / thick
        z = (1 - dist * dist).clamp_min(0).sqrt() * 0.8 + 0.5 * torch.sin(math.pi * (0.12 + 0.76 * tc)) - 0.25 * tc
        z = torch.where(dist < 1, z, -1.0)
        near = z > best
        best = torch.where(near, z, best)
        along, across = torch.where(near, t, along), torch.where(near, ex, across)
        row = torch.where(near, (jj + o) % ky, row)
    z = best.clamp_min(-0.4)
    turns = d.uniform(2, 4)
    ply = torch.sin(2 * math.pi * (turns * along + 2.2 * across + 0.5 * torch.sign(fx)))
    fuzz = spectral(d, n, 0.8, low=kx * 1.5)
    hairs = unit(spectral(d, n, 1.0, low=kx, stretch=(3, 1), angle=0.9) * torch.sign(fx))
    colours = [_cloth_colour(d)]
    pick = d.uniform()
    if pick < 0.2:  # stripes
        colours.append(_cloth_colour(d))
        base = _stripes(d, ky, colours)[:, row]
    elif pick < 0.4:  # fair isle motif
        colours.append(_cloth_colour(d))
        motif = _motif(d, ky, kx)[row, ii]
        base = mix(colours[0], colours[1], motif.float())
    else:
        base = colours[0].expand(3, n, n)
    if d.chance(mixed):
        base = base * _melange(d, n, kx, (d.uniform(1, 4), 1) if d.chance(0.5) else (1, d.uniform(1, 4)))
    depth = unit_range(z)
    shade = d.uniform(0.35, 0.75)
    albedo = base * ((1 - shade) + shade * depth) * (1 + 0.05 * ply + 0.05 * fuzz + 0.04 * hairs)
    rough = d.uniform(0.62, 0.88) - d.log_uniform(0.03, 0.35) * (depth - 0.6) + 0.02 * fuzz
    z = z + 0.5 * blur(rib[ii], 0.25 / kx, 0.01 / kx) + 0.07 * ply * depth + d.uniform(0.02, 0.07) * (fuzz + hairs)
    return Surface(albedo, to_slope(z, total) + to_slope(bend[0], 0.1 * total), rough, total, limit=1.8)


def _motif(d: Draw, rows: int, columns: int) -> Tensor:
    """A mirrored bool pattern, as of knitted or printed cloth."""
    f = torch.randn(rows, columns, generator=d.rng, device=d.rng.device).cpu()
    f = f + 1.5 * torch.roll(f, 1, 0) + 1.5 * torch.roll(f, (1, 1), (0, 1))
    f = f + f.flip(0) + f.flip(1) + f.flip(0).flip(1)
    return (f > f.std() * d.uniform(0, 0.8)).to(d.device)


def carpet(d: Draw, n: int) -> Surface:
    """Loop or cut pile: tufts in rows, each with its own lean, yarn twist and shade."""
    k = int(min(d.log_uniform(16, 70), n / 6))
    rows = max(2, round(k * d.uniform(0.8, 1.2)))
    count = k * rows
    index = torch.arange(count, device=d.device)
    order = d.uniform(0.1, 1.0)
    cx = (index % k + 0.5 * ((index // k) % 2) + 0.5 * order * d.randn(count)) / k
    cy = (index // k + 0.5 * order * d.randn(count)) / rows
    turn = d.uniform(0, math.pi) + d.uniform(0.1, 1.2) * d.randn(count)
    r = (0.75 / k) * (1 + 0.15 * d.randn(count)).clamp(0.6, 1.4)
    c, s = torch.cos(turn)[:, None], torch.sin(turn)[:, None]
    lift = 0.5 * d.rand(count)[:, None]
    long = d.uniform(1.0, 1.6)

    def tuft(dx: Tensor, dy: Tensor) -> Tensor:
        x, y = (c * dx + s * dy) / r[:, None], long * (c * dy - s * dx) / r[:, None]
        rho = x * x + y * y
        return torch.where(rho < 1, lift + 0.9 * torch.sqrt((1 - rho).clamp_min(0)), -math.inf)

    t = splat(n, cx, cy, float(r.max()), tuft, floor=-0.3)
    turn_at = t.per_splat(turn)
    x = (torch.cos(turn_at) * t.dx + torch.sin(turn_at) * t.dy) * k
    y = (torch.cos(turn_at) * t.dy - torch.sin(turn_at) * t.dx) * k
    ply = torch.sin(2 * math.pi * (d.uniform(2, 4) * x + d.uniform(0.5, 1.5) * y))
    fuzz = spectral(d, n, 0.3, low=k)
    cut = d.uniform(0, 1)
    if d.chance(0.35):
        a, b = _cloth_colour(d), _cloth_colour(d)
        pick = (d.rand(count) < d.uniform(0.2, 0.5)).float()
        if d.chance(0.5):
            field = mask(spectral(d, n, 2.5, low=d.uniform(1, 4)), 0.45, 0.01)
            pick = sample(field, cx[None], cy[None])[0]
        base = mix(a, b, t.per_splat(pick))
    else:
        base = _cloth_colour(d).expand(3, n, n)
    tone = 1 + d.uniform(0.02, 0.14) * t.per_splat(d.randn(count)) + 0.06 * fuzz + 0.05 * ply * (1 - cut)
    depth = unit_range(t.top + 0.06 * fuzz)
    shade = d.uniform(0.4, 0.8)
    albedo = base * ((1 - shade) + shade * depth) * tone
    z = t.top + 0.06 * ply * (1 - cut) + (0.05 + 0.15 * cut) * fuzz
    rough = d.uniform(0.65, 0.92) - d.log_uniform(0.04, 0.3) * (depth - 0.5) + 0.02 * fuzz
    return Surface(albedo, z, rough, d.log_uniform(0.4, 1.1), limit=1.8)


def felt(d: Draw, n: int) -> Surface:
    """Pressed fibres every way, mottled; or fleece with more relief."""
    fields = [spectral(d, n, 1.2, low=6, stretch=(d.uniform(6, 14), 1), angle=d.uniform(0, math.pi)) for _ in range(4)]
    fibres = unit(torch.stack(fields).amax(0))
    count = int(n * d.uniform(1.0, 4.0))
    x, y = curves(d, count, 40, 0.14, 1.2, 2 * math.pi * d.rand(count))
    z = 0.3 * d.rand(count, 1).expand_as(x)
    width = max(0.8 / n, 0.0022)
    s = strokes(n, x, y, z, torch.full_like(x, width), width, 0.1)
    hair = s.per_splat((d.rand(count) - 0.3).repeat_interleave(40)) * s.hit
    base = _cloth_colour(d)
    lumps = spectral(d, n, 2.0, low=d.log_uniform(4, 30))
    tone = 1 + d.uniform(0.02, 0.08) * fibres + d.uniform(0.03, 0.15) * hair + d.uniform(0.01, 0.06) * lumps
    height = to_slope(fibres, 0.5) + to_slope(lumps, d.uniform(0.2, 1.0)) + to_slope(s.top * s.hit, 0.35)
    rough = d.uniform(0.65, 0.95) + 0.025 * fibres - 0.04 * hair
    tint = spectral(d, n, 2.4, low=2)
    albedo = mix(base * tone, jitter(d, base, 0.05), 0.3 * mask(tint, 0.5, 0.8))
    if d.chance(0.4):
        albedo = albedo * _melange(d, n, n * d.uniform(0.05, 0.3), (1, 1))
    return Surface(albedo, height, rough, d.log_uniform(0.08, 0.5), limit=2.0)


def corduroy(d: Draw, n: int) -> Surface:
    """Ribs of pile with soft, broken edges."""
    u, _ = d.grid(n)
    k = d.integer(8, 40)
    w = spectral(d, n, 2.2, low=3, stretch=(1, 3), batch=2)
    x = u * k + d.uniform(0.01, 0.12) * w[0]
    pile = spectral(d, n, 0.8, low=k, stretch=(1, d.uniform(1, 3)))
    f = torch.remainder(x, 1) - 0.5 + 0.05 * pile
    rib = (1 - (2.1 * f) ** 2).clamp_min(0).sqrt() ** d.uniform(0.6, 1.2)
    rib = (rib + 0.06 * pile + 0.08 * rib * w[1]).clamp_min(0)
    base = _cloth_colour(d)
    shade = d.uniform(0.3, 0.75)
    albedo = base * (1 - shade + shade * rib.clamp(0, 1)) * (1 + 0.07 * pile + 0.05 * w[1])
    rough = d.uniform(0.6, 0.88) - d.log_uniform(0.04, 0.35) * (rib - 0.6) + 0.03 * pile
    s = Surface(albedo, rib + 0.03 * pile, rough, d.log_uniform(0.2, 0.7), limit=2.0)
    return _turned(s) if d.chance(0.5) else s


def _turned(s: Surface) -> Surface:
    s.albedo, s.height, s.roughness = (t.transpose(-1, -2).contiguous() for t in (s.albedo, s.height, s.roughness))
    return s


def quilt(d: Draw, n: int) -> Surface:
    """Padded cells between seams, puckered along them, the cloth's weave on top."""
    u, v = d.grid(n)
    k = d.integer(2, 7)
    w = spectral(d, n, 3.0, low=2, high=8, batch=2)
    x, y = u * k + 0.02 * w[0], v * k + 0.02 * w[1]
    if d.chance(0.4):
        x, y = x + y, x - y
    ex, ey = 0.5 - (torch.remainder(x, 1) - 0.5).abs(), 0.5 - (torch.remainder(y, 1) - 0.5).abs()
    edge = torch.minimum(ex, ey)
    puff = (1 - (1 - (2 * ex).clamp(0, 1)) ** 3) * (1 - (1 - (2 * ey).clamp(0, 1)) ** 3)
    pucker = spectral(d, n, 1.8, low=2 * k, high=12 * k)
    wrinkle = -spectral(d, n, 2.6, low=k).abs()
    threads = int(min(d.log_uniform(40, 120), n / 4))
    fine = torch.sin(2 * math.pi * u * threads) * torch.sin(2 * math.pi * v * threads)
    fuzz = spectral(d, n, 0.5, low=threads / 2)
    height = to_slope(puff, 0.6) + to_slope(pucker * torch.exp(-6 * edge), 0.22) + to_slope(wrinkle, 0.2)
    height = height + to_slope(fine + 0.5 * fuzz, d.uniform(0.02, 0.25))
    stitch = (torch.exp(-((edge / 0.018) ** 2))) * (torch.sin(2 * math.pi * 9 * (x + y)) > -0.3)
    base = _cloth_colour(d)
    seam = torch.exp(-((edge / 0.05) ** 2))
    albedo = base * (1 - d.uniform(0.1, 0.4) * seam) * (1 + 0.03 * fine + 0.03 * fuzz + 0.05 * cavity(wrinkle, 0.02))
    albedo = mix(albedo, _cloth_colour(d) if d.chance(0.3) else base * 1.1, 0.7 * stitch)
    rough = d.uniform(0.45, 0.75) + d.uniform(0.02, 0.25) * (seam - 0.3) + 0.02 * fuzz
    return Surface(albedo, height, rough, d.log_uniform(0.2, 0.5), limit=2.0)


def rope(d: Draw, n: int) -> Surface:
    """Cords side by side, or braided rugs: rows of slanted strands."""
    u, v = d.grid(n)
    rows, strands = d.integer(4, 18), d.integer(1, 4)
    across = rows * strands
    w = spectral(d, n, 2.5, low=2, high=10, batch=2)
    y = v * rows + 0.05 * w[0]
    j = torch.floor(y)
    fy = y - j - 0.5
    body = (1 - (2.05 * fy) ** 2).clamp_min(0).sqrt()
    lean = d.uniform(0.5, 1.6) * torch.where((j.long() % 2 == 1) if d.chance(0.5) else (j < -1), -1.0, 1.0)
    k = across * d.integer(1, 3)
    x = u * k + 0.08 * w[1] + lean * 1.4 * torch.asin((2 * fy).clamp(-1, 1)) + d.rand(rows)[j.long() % rows] * k
    i = torch.floor(x)
    fx = x - i - 0.5
    strand = (1 - (2 * fx) ** 2).clamp_min(0).sqrt()
    ident = (i.long() % k) + k * (j.long() % rows)
    hair = warp(spectral(d, n, 1.0, low=rows * 2, stretch=(1, 5)), 0.03 * fy * lean, torch.zeros_like(fy))
    z = body + 0.35 * strand * body + 0.05 * hair
    base, other = _cloth_colour(d), _cloth_colour(d)
    pick = (d.rand(k * rows) < d.choice((0.0, 0.0, 0.3))).float()[ident]
    tone = 1 + 0.08 * d.randn(k * rows)[ident] + 0.08 * hair
    shade = unit_range(z)
    albedo = mix(base, other, pick) * tone * (0.3 + 0.7 * shade)
    rough = d.uniform(0.55, 0.85) - d.log_uniform(0.08, 0.45) * (shade - 0.5) + 0.03 * hair
    s = Surface(albedo, z, rough, d.log_uniform(0.4, 0.9), limit=2.0)
    return _turned(s) if d.chance(0.5) else s


FAMILIES = {
    "plain_weave": plain_weave,
    "twill": twill,
    "satin": satin,
    "checked": checked,
    "denim": denim,
    "knit": knit,
    "jersey": jersey,
    "carpet": carpet,
    "felt": felt,
    "corduroy": corduroy,
    "quilt": quilt,
    "rope": rope,
}
