"""What a phone does to radiance: exposure, white balance, vignette, blur, noise, clipping, 8-bit sRGB, JPEG."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from ..data.pool import srgb_decode, srgb_encode
from .jpeg import jpeg

#: Linear mean that automatic exposure aims at, and the standard deviation of its logarithm: those of real flash
#: photos (median 0.15, 5 % to 95 %: 0.06 to 0.31).
AUTO_MEAN, AUTO_SIGMA = 0.16, 0.45


@dataclass(frozen=True)
class CameraNoise:
    """How much of each a random phone has; standard deviations of the logarithm unless said otherwise."""

    known: float = 0.5  # share of photos whose exposure is known: taken at some exposure, divided by it afterwards
    exposure: float = 0.35  # of a known exposure around the flash's strength 1
    auto: float = 1.0  # share of the others whose automatic exposure pulled the mean towards AUTO_MEAN
    calibration: float = 0.03  # error of a known exposure
    white_balance: float = 0.04  # of a known exposure
    auto_white_balance: float = 0.1  # of the others: the flash and the room hardly ever have one colour
    vignette: float = 0.2  # darkening of the corner, at most, that the phone's own correction leaves
    known_vignette: float = 0.06  # the same where the exposure is known: such photos are processed with more care
    contrast: float = (
        0.5  # strength of a tone curve (an S, or film's shoulder), at most; half of the unknown exposures have one
    )
    local: float = 0.4  # local tone mapping, at most: the power of the surroundings' brightness that is divided out
    blur: float = 0.6  # sigma in pixels, at most
    shot: float = 0.02  # noise at white, at most (linear)
    read: float = 0.004  # noise at black, at most (linear)
    jpeg: float = 0.15  # share of photos that went through JPEG
    plain: float = 0.25  # share of photos with none of these but 8-bit rounding; their exposure is known and 1


def photograph(radiance: Tensor, rng: np.random.Generator, c: CameraNoise) -> tuple[Tensor, Tensor]:
    """Linear radiance (B,3,n,n) to sRGB-encoded photos in [0,1], 8 bit; and (B,) 1 where their exposure is known.

    A photo of known exposure is in units of the flash's strength, whatever it was exposed at.
    """
    b, _, n, _ = radiance.shape
    dev = radiance.device
    noisy = rng.random(b) >= c.plain
    on = torch.tensor(noisy, dtype=torch.float32, device=dev)

    def gauss(*shape: int) -> Tensor:
        return torch.tensor(rng.normal(size=shape), dtype=torch.float32, device=dev)

    def uniform(*shape: int) -> Tensor:
        return torch.tensor(rng.random(shape), dtype=torch.float32, device=dev)

    known = 1 - on * torch.tensor(rng.random(b) >= c.known, dtype=torch.float32, device=dev)
    exposed = torch.exp(on * known * gauss(b) * c.exposure)
    balance = torch.where(known > 0, c.white_balance, c.auto_white_balance)[:, None]
    gain = torch.exp(on[:, None] * (known[:, None] * gauss(b, 1) * c.calibration + gauss(b, 3) * balance))
    x = radiance * (gain * exposed[:, None])[:, :, None, None]
    local = on * (1 - known) * uniform(b) * c.local * torch.tensor(rng.random(b) < 0.3, device=dev)
    x = _tone_mapped(x, local)
    mean = x.clamp(0, 2).mean(dim=(1, 2, 3)).clamp_min(1e-3)
    aim = AUTO_MEAN * torch.exp(gauss(b) * AUTO_SIGMA)
    pull = (1 - known) * torch.tensor(rng.random(b) < c.auto, device=dev) * (0.5 + 0.5 * uniform(b))
    x = x * ((aim / mean) ** pull)[:, None, None, None]
    line = torch.linspace(-1, 1, n, device=dev)
    r2 = (line[:, None] ** 2 + line[None, :] ** 2) / 2
    corner = torch.where(known > 0, c.known_vignette, c.vignette)
    x = x * (1 - (on * uniform(b) * corner)[:, None, None, None] * r2)
    x = _blur(x, on * uniform(b) * c.blur * torch.tensor(rng.random(b) < 0.5, device=dev))
    shot, read = on * uniform(b) * c.shot, on * uniform(b) * c.read
    seed = int(rng.integers(2**62))
    noise = torch.randn(x.shape, generator=torch.Generator(dev).manual_seed(seed), device=dev)
    x = x + noise * (shot[:, None, None, None] ** 2 * x.clamp(0, 1) + read[:, None, None, None] ** 2).sqrt()
    x = srgb_encode(x.clamp(0, 1))
    s = (on * (1 - known) * uniform(b) * c.contrast * torch.tensor(rng.random(b) < 0.5, device=dev))[
        :, None, None, None
    ]
    shoulder = torch.tensor(rng.random(b) < 0.5, device=dev)[:, None, None, None]
    x = x + s * (torch.where(shoulder, (1 - torch.exp(-2.5 * x)) / (1 - math.exp(-2.5)), x * x * (3 - 2 * x)) - x)
    x = torch.round(x * 255) / 255
    chosen = np.flatnonzero((rng.random(b) < c.jpeg) & noisy)
    if len(chosen):
        at = torch.from_numpy(chosen).to(dev)
        x = x.index_copy(0, at, jpeg(x[at], [int(q) for q in rng.integers(80, 98, size=len(chosen))]))
    rescaled = torch.round(srgb_encode((srgb_decode(x) / exposed[:, None, None, None]).clamp(0, 1)) * 255) / 255
    return torch.where((exposed != 1)[:, None, None, None], rescaled, x), known


def _tone_mapped(x: Tensor, power: Tensor) -> Tensor:
    """Divides out a power of the surroundings' brightness, as phones do to hold highlights; the mean stays about."""
    n = x.shape[-1]
    side = max(1, n // 16)
    around = F.avg_pool2d(x.clamp(0, 2).mean(dim=1, keepdim=True), side)
    around = F.avg_pool2d(F.pad(around, (2, 2, 2, 2), mode="replicate"), 5, 1)
    around = F.interpolate(around, size=(n, n), mode="bilinear", align_corners=False).clamp_min(1e-3)
    around = around / around.mean(dim=(2, 3), keepdim=True)
    return x * torch.exp(-power[:, None, None, None] * torch.log(around))


def _blur(x: Tensor, sigma: Tensor) -> Tensor:
    """A 3-tap Gaussian of each photo's own sigma."""
    side = torch.where(sigma > 0.05, torch.exp(-1 / (2 * sigma.clamp_min(0.05) ** 2)), torch.zeros_like(sigma))
    k = torch.stack((side, torch.ones_like(side), side), dim=1)
    k = k / k.sum(dim=1, keepdim=True)
    b, c, h, w = x.shape
    y = F.pad(x, (1, 1, 1, 1), mode="replicate").reshape(1, b * c, h + 2, w + 2)
    k = k.repeat_interleave(c, dim=0)
    y = F.conv2d(y, k[:, None, :, None], groups=b * c)
    y = F.conv2d(y, k[:, None, None, :], groups=b * c)
    return y.reshape(b, c, h, w)
