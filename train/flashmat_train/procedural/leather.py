"""Leathers: pebbled, fine (nappa), aged and cracked, suede, crocodile, stitched, woven, embossed."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from .noise import Draw, blur, smoothstep, spectral, unit, worley
from .structure import Surface, any_colour, cavity, hsv, jitter, mix, to_slope, unit_range
from .wear import blotches, clouds, cracks, scratches


def _hide(d: Draw) -> Tensor:
    pick = d.uniform()
    if pick < 0.5:  # tans and browns
        return hsv(d, (0.015, 0.09), (0.35, 0.8), (0.12, 0.6))
    if pick < 0.65:  # reds
        return hsv(d, (0.95, 1.02), (0.5, 0.95), (0.2, 0.75))
    if pick < 0.8:  # blacks, creams
        return (
            hsv(d, (0.05, 0.12), (0.05, 0.25), (0.7, 0.92)) if d.chance(0.6) else hsv(d, (0, 1), (0, 0.2), (0.06, 0.2))
        )
    return any_colour(d, 0.8, (0.15, 0.85))


def _grain(d: Draw, n: int, k: int, warp: float = 0.35, aspect: float = 1.0) -> tuple[Tensor, Tensor]:
    """Skin grain: pebbles between creases, in about ``k`` rows. Height in [0, 1] and a tone per pebble."""
    u, v = d.grid(n)
    ky = max(3, round(k * aspect))
    w = (warp / k) * spectral(d, n, 3.0, low=k / 3, high=3 * k, batch=2)
    drift = (0.3 / k) * spectral(d, n, 3.0, low=1.5, high=10, batch=2)
    c = worley(d, u + w[0] + drift[0], v + w[1] + drift[1], k, ky, 0.95)
    crease = d.uniform(0.16, 0.4) * torch.exp(0.3 * spectral(d, n, 2.2, low=2))
    dome = 1 - (1 - (c.edge / crease).clamp(0, 1)) ** 2
    # Neighbours run together here and there, as they do on skin.
    fused = smoothstep(0.25, 0.9, spectral(d, n, 2.0, low=k / 3, high=k)) * d.uniform(0.2, 0.9)
    return dome + (0.85 - dome) * fused, c.per_cell(d.randn(c.count))


def _skin(d: Draw, n: int, k: int, warp: float = 0.35, aspect: float = 1.0) -> tuple[Tensor, Tensor]:
    big, tone = _grain(d, n, k, warp, aspect)
    pores = spectral(d, n, 0.5, low=k, high=n / 4)
    height = to_slope(big, 1.0) + to_slope(pores, d.uniform(0.1, 0.35))
    if d.chance(0.6) and 2.2 * k < n / 5:
        height = height + to_slope(_grain(d, n, round(2.2 * k), warp, aspect)[0], d.uniform(0.2, 0.7))
    return height, tone


def _dress(d: Draw, n: int, height: Tensor, tone: Tensor, base: Tensor, k: int, total: float, worn: float) -> Surface:
    """Dye, polish and wear over a grain: creases darker and rougher, rubbed tops paler."""
    relief = unit_range(height)
    deep = smoothstep(0.5, 0.05, relief)
    patch = clouds(d, n, 2.4, low=1.0)
    dye = d.uniform(0.03, 0.4) if d.chance(0.7) else -d.uniform(0.0, 0.15)
    albedo = base * (1 - dye * deep) * (1 + 0.02 * tone + d.uniform(0.02, 0.15) * (patch - 0.5))
    fine = spectral(d, n, 0.8, low=k)
    albedo = albedo * (1 + d.uniform(0.005, 0.03) * fine)
    rough = d.uniform(0.33, 0.55) + d.uniform(-0.08, 0.3) * deep + d.uniform(0.02, 0.14) * (patch - 0.5) + 0.015 * fine
    if worn > 0:
        rub = blotches(d, n, worn, low=1.5, beta=2.0, soft=0.8) * smoothstep(0.25, 0.9, relief)
        pale = jitter(d, base, 0.03) * d.uniform(1.1, 1.8) + d.uniform(0.0, 0.1)
        albedo = mix(albedo, pale, rub * d.uniform(0.3, 0.8))
        rough = rough + d.uniform(-0.08, 0.1) * rub
    folds = spectral(d, n, 3.4, low=1)
    height = to_slope(height, total) + to_slope(folds, total * d.uniform(0.02, 0.25))
    return Surface(albedo, height, rough, total, limit=1.6)


def pebbled(d: Draw, n: int) -> Surface:
    k = int(min(d.log_uniform(14, 60), n / 6))
    height, tone = _skin(d, n, k, d.uniform(0.1, 0.4), d.uniform(0.7, 1.4))
    return _dress(
        d, n, height, tone, _hide(d), k, d.log_uniform(0.06, 0.3), d.uniform(0, 0.5) if d.chance(0.4) else 0.0
    )


def nappa(d: Draw, n: int) -> Surface:
    """Fine smooth grain, hair pores, long soft wrinkles."""
    k = int(min(d.log_uniform(45, 110), n / 4.5))
    height, tone = _skin(d, n, k, 0.4)
    wrinkle = -spectral(d, n, 2.4, low=3, high=24, stretch=(d.uniform(1, 4), 1), angle=d.uniform(0, math.pi)).abs()
    height = to_slope(height, 1.0) + to_slope(wrinkle, d.uniform(0.05, 0.8))
    return _dress(d, n, height, tone, _hide(d), k, d.log_uniform(0.02, 0.14), 0.0)


def aged(d: Draw, n: int) -> Surface:
    """Old and dry: cracked finish, rubbed to the bare hide, scratches."""
    u, v = d.grid(n)
    k = int(min(d.log_uniform(12, 50), n / 6))
    height, tone = _skin(d, n, k, 0.45)
    crack = torch.maximum(cracks(d, u, v, k, 0.2, 0.15), 0.8 * cracks(d, u, v, max(4, k // 3), 0.08, 0.2))
    where = blotches(d, n, d.uniform(0.2, 0.8), low=1.5, beta=2.2, soft=0.7)
    crack = crack * where
    scratch = scratches(d, n, d.integer(10, 90), (0.03, 0.4), 0.8)
    base = hsv(d, (0.0, 0.09), (0.4, 0.8), (0.14, 0.45)) if d.chance(0.7) else _hide(d)
    s = _dress(
        d,
        n,
        to_slope(height, 1.0) - 0.004 * crack,
        tone,
        base,
        k,
        d.log_uniform(0.03, 0.2),
        d.uniform(0.2, 0.7),
    )
    bare = (hsv(d, (0.06, 0.1), (0.3, 0.65), (0.45, 0.75))) if d.chance(0.7) else base * 0.4
    s.albedo = mix(
        s.albedo,
        bare,
        (d.uniform(0.3, 0.9) * crack + 0.5 * scratch + 0.4 * where * unit_range(-s.height) ** 2).clamp(0, 1),
    )
    s.roughness = s.roughness + 0.12 * crack + 0.15 * scratch
    s.height = s.height - 0.0004 * scratch
    return s


def suede(d: Draw, n: int) -> Surface:
    """Napped: soft clouds where a hand brushed it, short fibres."""
    nap = spectral(d, n, 0.9, low=n / 24, stretch=(d.uniform(1, 3), 1), angle=d.uniform(0, math.pi))
    lump = spectral(d, n, 1.8, low=d.log_uniform(6, 40))
    brushed = unit(
        clouds(d, n, 2.6, low=1, swirl=0.1) + 0.3 * spectral(d, n, 2, low=3, stretch=(4, 1), angle=d.uniform(0, 3))
    )
    base = hsv(d, (0.03, 0.1), (0.2, 0.65), (0.25, 0.7)) if d.chance(0.6) else _hide(d)
    albedo = base * (1 + d.uniform(0.02, 0.12) * brushed.clamp(-2, 2) + d.uniform(0.02, 0.07) * nap + 0.04 * lump)
    height = to_slope(nap, 1.0) + to_slope(lump, d.uniform(0.2, 0.9))
    rough = d.uniform(0.5, 0.8) - d.uniform(0, 0.05) * brushed.clamp(-2, 2) + 0.03 * nap
    return Surface(albedo, height, rough, d.log_uniform(0.05, 0.3), limit=1.6)


def crocodile(d: Draw, n: int) -> Surface:
    """Scales in rows, square at the belly, round at the flank; glossy tops, dark seams."""
    u, v = d.grid(n)
    k = d.integer(5, 16)
    ky = max(3, round(k * d.uniform(0.8, 1.8)))
    drift = 0.012 * spectral(d, n, 3.6, low=1, high=6, batch=2)
    w = (0.025 / k) * spectral(d, n, 2.8, low=k, high=3 * k, batch=2)
    c = worley(d, u + w[0] + drift[0], v + w[1] + drift[1], k, ky, d.uniform(0.35, 0.8))
    crease = d.uniform(0.06, 0.16)
    dome = 1 - (1 - (c.edge / (2.2 * crease)).clamp(0, 1)) ** 2.5
    bulge = 0.4 * (1 - c.f1).clamp_min(0)
    seam = smoothstep(crease, 0.25 * crease, c.edge)
    wrinkle = -spectral(d, n, 2.0, low=2 * k, stretch=(1, 2)).abs()
    height = to_slope(dome + bulge - 0.2 * seam, 1.0) + to_slope(wrinkle, d.uniform(0.1, 0.45))
    base = _hide(d)
    fine = spectral(d, n, 1.0, low=n / 16)
    tone = 1 + 0.06 * c.per_cell(d.randn(c.count)) + 0.08 * (clouds(d, n) - 0.5) + 0.02 * fine
    albedo = base * tone * (1 - d.uniform(0.2, 0.65) * seam) * (0.93 + 0.12 * dome)
    rough = d.uniform(0.28, 0.5) + d.uniform(0.1, 0.3) * seam + 0.03 * unit(wrinkle) + 0.015 * fine
    return Surface(albedo, height, rough, d.log_uniform(0.12, 0.4), limit=1.6)


def stitched(d: Draw, n: int) -> Surface:
    """Upholstery: padded diamonds or channels, seams of thread in small holes."""
    u, v = d.grid(n)
    k = int(min(d.log_uniform(30, 100), n / 5))
    grain, tone = _skin(d, n, k, 0.4)
    base = _hide(d)
    s = _dress(d, n, grain, tone, base, k, 1.0, 0.0)
    kx, ky = d.integer(2, 6), d.integer(2, 6)
    w = 0.012 * spectral(d, n, 3.2, low=2, high=6, batch=2)
    kind = d.uniform()
    if kind < 0.6:
        a, b = u * kx + v * ky + w[0], u * kx - v * ky + w[1]
        ea, eb = 0.5 - (torch.remainder(a, 1) - 0.5).abs(), 0.5 - (torch.remainder(b, 1) - 0.5).abs()
        edge = torch.minimum(ea, eb)
        run = torch.where(ea < eb, b, a)
        puff = (1 - (1 - (2 * ea).clamp(0, 1)) ** 2.5) * (1 - (1 - (2 * eb).clamp(0, 1)) ** 2.5)
    else:
        a = v * ky + w[0]
        edge = 0.5 - (torch.remainder(a, 1) - 0.5).abs()
        run = u * ky
        puff = 1 - (1 - (2 * edge).clamp(0, 1)) ** 3
    per = d.integer(7, 14)
    phase = torch.remainder(run * per, 1)
    off = edge - (d.uniform(0.02, 0.05) if d.chance(0.4) else 0.0)
    size = d.uniform(0.012, 0.022)
    across = off / size
    along = (phase - 0.5).abs() / 0.38
    body = (1 - across * across).clamp_min(0).sqrt() * (1 - along**4).clamp_min(0)
    hole = torch.exp(-(((0.5 - (phase - 0.5).abs()) / 0.1) ** 2) - (across / 1.2) ** 2)
    thread = smoothstep(0.05, 0.4, body)
    pucker = spectral(d, n, 2.0, low=8, high=60) * torch.exp(-edge / 0.08)
    share = d.uniform(0.15, 0.6)
    height = to_slope(puff, 1.0) + to_slope(grain, share) + to_slope(pucker, 0.2) + to_slope(0.6 * body - hole, 0.5)
    seam = torch.exp(-((edge / 0.03) ** 2))
    yarn = jitter(d, base, 0.06) if d.chance(0.4) else any_colour(d, 0.5, (0.2, 0.95))
    albedo = s.albedo * (1 - 0.25 * seam) * (1 - 0.6 * hole)
    s.albedo = mix(albedo, yarn * (0.7 + 0.3 * body), thread)
    s.roughness = torch.lerp(s.roughness + 0.12 * seam, torch.full_like(seam, d.uniform(0.6, 0.8)), thread)
    return Surface(s.albedo, height, s.roughness, d.log_uniform(0.08, 0.32), limit=1.6)


def woven(d: Draw, n: int) -> Surface:
    """Plaited straps, grain along each, edges worn."""
    u, v = d.grid(n)
    k = 2 * d.integer(2, 7)
    w = 0.025 * spectral(d, n, 3.0, low=2, high=8, batch=2)
    x, y = u * k + w[0], v * k + w[1]
    i, j = torch.floor(x), torch.floor(y)
    fx, fy = 2 * (x - i) - 1, 2 * (y - j) - 1
    over = ((i + j).long() % 2 == 0).float() * 2 - 1
    lift = torch.cos(math.pi / 2 * fy) * over, -torch.cos(math.pi / 2 * fx) * over
    wide = d.uniform(0.88, 0.97)
    flat = d.uniform(3, 8)
    za = torch.where(fx.abs() < wide, 0.5 * lift[0] + 0.35 * (1 - (fx / wide).abs() ** flat), -0.8)
    zb = torch.where(fy.abs() < wide, 0.5 * lift[1] + 0.35 * (1 - (fy / wide).abs() ** flat), -0.8)
    z = torch.maximum(za, zb)
    top = za > zb
    ident = torch.where(top, i.long() % k, k + j.long() % k)
    side = torch.where(top, fx, fy).abs() / wide
    grain_k = int(min(d.log_uniform(40, 100), n / 5))
    grain, _ = _skin(d, n, grain_k, 0.4)
    height = to_slope(z, 1.0) + to_slope(grain, d.uniform(0.1, 0.4))
    base = _hide(d)
    deep = smoothstep(0.15, -0.6, z)
    fine = spectral(d, n, 1.2, low=12)
    rim = smoothstep(0.8, 1.0, side)
    albedo = base * (1 + 0.07 * d.randn(2 * k)[ident] + 0.03 * fine) * (1 - 0.75 * deep) * (1 - 0.3 * rim)
    albedo = albedo * (1 + 0.06 * cavity(grain, 0.02))
    rough = d.uniform(0.35, 0.55) + 0.12 * deep + d.uniform(0, 0.15) * rim + 0.02 * fine
    s = Surface(albedo, height, rough, d.log_uniform(0.12, 0.35), limit=1.8)
    if d.chance(0.5):  # a stitched line along both edges
        line = torch.exp(-(((side - 0.75) / 0.05) ** 2))
        phase = torch.remainder(torch.where(top, y, x) * 7, 1)
        thread = line * smoothstep(0.1, 0.2, phase) * smoothstep(0.95, 0.85, phase) * (1 - deep)
        s.albedo = mix(s.albedo, any_colour(d, 0.4, (0.3, 0.9)), 0.9 * thread)
        s.roughness = s.roughness + 0.2 * thread
        s.height = s.height + 0.004 * thread
    return s


def embossed(d: Draw, n: int) -> Surface:
    """Saffiano and other stamped grains: a regular cross-hatch or dots in a glossy finish."""
    u, v = d.grid(n)
    k = int(min(d.log_uniform(24, 90), n / 5))
    w = 0.06 * spectral(d, n, 2.6, low=2, high=10, batch=2)
    x, y = u * k + w[0], v * k + w[1]
    if d.chance(0.5):
        a, b = torch.remainder(x + y, 1) - 0.5, torch.remainder(x - y, 1) - 0.5
        height = torch.maximum(a.abs(), d.uniform(0.5, 1.0) * b.abs())
    else:
        height = blur(torch.sin(math.pi * x).abs() * torch.sin(math.pi * y).abs(), 0.1 / k)
    pores = spectral(d, n, 1.0, low=k)
    relief = to_slope(height, 1.0) + to_slope(pores, d.uniform(0.1, 0.4))
    return _dress(
        d,
        n,
        relief,
        pores,
        _hide(d),
        k,
        d.log_uniform(0.05, 0.22),
        d.uniform(0, 0.3) if d.chance(0.3) else 0.0,
    )


FAMILIES = {
    "pebbled": pebbled,
    "nappa": nappa,
    "aged": aged,
    "suede": suede,
    "crocodile": crocodile,
    "stitched": stitched,
    "woven": woven,
    "embossed": embossed,
}
