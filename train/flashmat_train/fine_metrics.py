"""How much of a material's fine structure predicted maps have: what mean errors hide, since flat and blurred maps err
little.

Columns, over all photos that were added:

    slope_corr          mean over photos of the cosine between the two slope fields (x, y; no mean taken out): 1 is
                        right up to strength, 0 knows nothing
    slope_corr_total    the same of all pixels of all photos: steep materials count more
    strength            RMS slope over the true one
    evenness            RMS slope of the inner disc over the outer ring's, over the same of the truth: under 1 it fades
                        below the flash
    balance             RMS tangential over RMS radial slope, over the same of the truth: under 1 bumps are rings
    roughness_detail    mean over photos of the correlation of what 16x16 means leave of roughness
    albedo_detail       the same of albedo

Strength, evenness and balance are medians over the photos whose true RMS slope is at least `RELIEF`; the correlations
leave out photos whose truth has nothing to correlate with. A column without photos is left out.
"""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor

from .render.flash import pixel_positions
from .slopes import radial_tangential, slopes_of

#: Least true RMS slope of a photo that says something of strength, evenness and balance.
RELIEF = 0.03
#: Radius of the inner disc; radii of the outer ring; half the picture's side is 1.
INNER, OUTER = 0.5, (0.7, 1.0)
#: Window of the means that fine structure is what is left of; RMS of it under which there is none.
WINDOW, NOTHING = 16, 1e-3


def fine(x: Tensor) -> Tensor:
    """What smoothly interpolated means over windows leave of (B,C,n,n); n is a multiple of the window."""
    return x - F.interpolate(F.avg_pool2d(x, WINDOW), scale_factor=WINDOW, mode="bilinear", align_corners=False)


def products(a: Tensor, b: Tensor) -> Tensor:
    """(B,3) sums of ab, aa and bb over each photo, in double precision."""
    a, b = a.double(), b.double()
    return torch.stack([(x * y).sum(dim=(1, 2, 3)) for x, y in ((a, b), (a, a), (b, b))], dim=1)


def cosine(sums: Tensor) -> Tensor:
    """The cosine that sums (...,3) of `products` tell; 0 where one of the two is nothing."""
    return sums[..., 0] / (sums[..., 1] * sums[..., 2]).clamp_min(1e-24).sqrt()


def relief(normal: Tensor) -> Tensor:
    """(B,3) RMS slope, inner over outer, tangential over radial of each photo."""
    s = slopes_of(normal)
    p = pixel_positions(s.shape[-1], s.device)[None]
    radius = p.square().sum(dim=1, keepdim=True).sqrt()
    along, across = (x.square() for x in radial_tangential(s, p))
    energy = along + across

    def over(mask: Tensor) -> Tensor:
        return (energy * mask).sum(dim=(1, 2, 3)) / mask.sum()

    inner = over((radius < INNER).float())
    outer = over(((radius > OUTER[0]) & (radius < OUTER[1])).float())
    sides = across.mean(dim=(1, 2, 3)), along.mean(dim=(1, 2, 3))
    total = s.square().sum(dim=1).mean(dim=(1, 2))
    ratios = [a / b.clamp_min(1e-9) for a, b in ((inner, outer), sides)]
    return torch.stack((total, *ratios), dim=1).sqrt()


#: Names of the columns.
COLUMNS = (
    *("slope_corr", "slope_corr_total"),
    *("strength", "evenness", "balance"),
    *("roughness_detail", "albedo_detail"),
)


class FineScores:
    """Collects photos and gives the columns."""

    def __init__(self) -> None:
        self.slopes: list[Tensor] = []
        self.details: dict[str, list[Tensor]] = {"roughness": [], "albedo": []}
        self.ratios: list[Tensor] = []

    def add(self, predicted: dict[str, Tensor], target: dict[str, Tensor]) -> None:
        """Takes a batch of maps (`albedo`, `normal`, `roughness`) in."""
        self.slopes.append(products(slopes_of(predicted["normal"]), slopes_of(target["normal"])))
        for name, rows in self.details.items():
            rows.append(products(fine(predicted[name]), fine(target[name])) / target[name][0].numel())
        got, true = relief(predicted["normal"]), relief(target["normal"])
        self.ratios.append((got / true.clamp_min(1e-6))[true[:, 0] >= RELIEF])

    def columns(self) -> dict[str, float]:
        """The columns of the photos so far; {} without photos."""
        if not self.slopes:
            return {}
        slopes, out = torch.cat(self.slopes), {}
        some = slopes[slopes[:, 2] > 0]
        if len(some):
            out["slope_corr"] = float(cosine(some).mean())
            out["slope_corr_total"] = float(cosine(some.sum(dim=0)))
        ratios = torch.cat(self.ratios)
        if len(ratios):
            out |= dict(zip(COLUMNS[2:5], ratios.median(dim=0).values.tolist(), strict=True))
        for name, rows in self.details.items():
            sums = torch.cat(rows)
            sums = sums[sums[:, 2] > NOTHING**2]
            if len(sums):
                out[f"{name}_detail"] = float(cosine(sums).mean())
        return out
