"""Random relief: fields of slopes that belong to no material, so that a network must read them from the shading.

Where relief and colour always come together a network may guess the one from the other. A crop whose normals are
replaced by such a field has no such hint. Six kinds, all in pixels of the crop, from a NumPy generator: smooth noise,
embossed blobs, warped stripes, cells, crumpled sheets, tiles.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

#: Range of the RMS slope, drawn evenly in its logarithm; and the steepest slope.
STRENGTH, STEEPEST = (0.05, 0.6), 3.0


def noise(rng: np.random.Generator, n: int, power: float) -> np.ndarray:
    """(n,n) of mean 0 and deviation 1 whose amplitude falls as frequency^-power."""
    f = np.fft.fftfreq(n)
    radius = np.hypot(f[:, None], f[None])
    radius[0, 0] = 1
    x = np.fft.ifft2(np.fft.fft2(rng.normal(size=(n, n))) / radius**power).real
    x -= x.mean()
    return x / (x.std() + 1e-9)


def depth_within(mask: np.ndarray, most: int) -> np.ndarray:
    """Distance of each pixel to the nearest one outside `mask`, at most `most`; what lies beyond the picture is
    neither inside nor outside."""
    n, m = mask.shape
    far = most + 1
    line = np.where(mask, far, 0)
    for step in range(1, most + 1):  # along rows
        for shift in (step, -step):
            line = np.minimum(line, np.where(_shifted(mask, 0, shift), far, step))
    best = np.full((n, m), float(most) ** 2)
    for step in range(-most, most + 1):
        other = _shifted(line, step, 0, fill=far)
        best = np.minimum(best, np.where(other <= most, other.astype(float) ** 2 + step * step, best))
    return np.sqrt(best)


def _shifted(x: np.ndarray, down: int, right: int, fill: float = 1) -> np.ndarray:
    """`x` moved; `fill` where nothing came from."""
    out = np.full_like(x, fill)
    n, m = x.shape
    if abs(down) < n and abs(right) < m:
        to = (slice(max(down, 0), n + min(down, 0)), slice(max(right, 0), m + min(right, 0)))
        of = (slice(max(-down, 0), n - max(down, 0)), slice(max(-right, 0), m - max(right, 0)))
        out[to] = x[of]
    return out


def softened(x: np.ndarray, sigma: float) -> np.ndarray:
    """Gaussian blur, the picture continued by its mirror image."""
    r = math.ceil(4 * sigma)
    taps = np.exp(-0.5 * (np.arange(-r, r + 1) / sigma) ** 2)
    taps /= taps.sum()
    for axis in (0, 1):
        wide = np.pad(x, [(r, r) if a == axis else (0, 0) for a in (0, 1)], mode="symmetric")
        size = x.shape[axis]
        x = sum(t * np.take(wide, range(i, i + size), axis) for i, t in enumerate(taps))
    return x


def rolling(rng: np.random.Generator, n: int) -> np.ndarray:
    return noise(rng, n, rng.uniform(1.2, 2.6))


def embossed(rng: np.random.Generator, n: int) -> np.ndarray:
    """Plateaus with bevelled or rounded rims."""
    mask = noise(rng, n, rng.uniform(1.6, 2.6)) > rng.uniform(-0.8, 0.8)
    width = rng.uniform(2, 10)
    h = np.clip(depth_within(mask, math.ceil(width)) / width, 0, 1)
    return h * h * (3 - 2 * h) if rng.random() < 0.5 else h


def stripes(rng: np.random.Generator, n: int) -> np.ndarray:
    """Ridges along a direction, warped, round or flat on top."""
    turn = rng.uniform(0, math.pi)
    y, x = np.mgrid[0:n, 0:n]
    wave = noise(rng, n, 2.4) * rng.uniform(0, 8)
    s = np.sin((x * math.cos(turn) + y * math.sin(turn) + wave) * 2 * math.pi / rng.uniform(6, 48))
    return np.sign(s) * np.abs(s) ** rng.uniform(0.3, 1.5)


def cells(rng: np.random.Generator, n: int) -> np.ndarray:
    """Cones about random points, up or down."""
    y, x = np.mgrid[0:n, 0:n].astype(np.float32)
    d = np.full((n, n), np.inf, np.float32)
    for cy, cx in rng.uniform(0, n, size=(int(rng.integers(8, 120)), 2)):
        np.minimum(d, (y - np.float32(cy)) ** 2 + (x - np.float32(cx)) ** 2, out=d)
    d = np.sqrt(d).astype(float)
    return -d if rng.random() < 0.5 else d


def crumpled(rng: np.random.Generator, n: int) -> np.ndarray:
    """Sharp folds, up or down."""
    h = sum(np.abs(noise(rng, n, rng.uniform(1.8, 2.6))) for _ in range(3))
    return -h if rng.random() < 0.5 else h


def tiled(rng: np.random.Generator, n: int) -> np.ndarray:
    """A lattice of bevelled plates."""
    y, x = np.mgrid[0:n, 0:n]
    turn, wide = rng.uniform(0, math.pi / 2), rng.uniform(12, 64)
    high = wide * rng.uniform(0.4, 2.5)
    u = (x * math.cos(turn) + y * math.sin(turn)) % wide
    v = (y * math.cos(turn) - x * math.sin(turn)) % high
    edge = np.minimum(np.minimum(u, wide - u), np.minimum(v, high - v))
    return np.clip(edge / rng.uniform(1.5, 6), 0, 1)


KINDS: tuple[Callable[[np.random.Generator, int], np.ndarray], ...] = (
    *(rolling, embossed, stripes),
    *(cells, crumpled, tiled),
)


def random_slopes(rng: np.random.Generator, n: int) -> np.ndarray:
    """(2,n,n) float32 slopes, x to the right and y upwards, of a kind and a strength drawn at random."""
    h = softened(KINDS[int(rng.integers(len(KINDS)))](rng, n), rng.uniform(0.5, 2.0))
    down, right = np.gradient(h)
    s = np.stack((right, -down))
    low, high = STRENGTH
    s *= math.exp(rng.uniform(math.log(low), math.log(high))) / (math.sqrt((s**2).sum(axis=0).mean()) + 1e-9)
    return np.clip(s, -STEEPEST, STEEPEST).astype(np.float32)
