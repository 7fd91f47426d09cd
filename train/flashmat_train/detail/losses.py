"""What the detail network learns by: errors of the maps, the energy of their relief, re-renders under new lights."""

from __future__ import annotations

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor

from ..losses import best_scale, render_pair
from ..slopes import radial_tangential, slopes_of

#: Side and step of the windows in which the energy of slopes is compared, pixels; and the energy that counts as none.
WINDOW, STRIDE, QUIET = 32, 16, 2e-4


@dataclass(frozen=True)
class DetailWeights:
    """Weights of the terms of `detail_losses`."""

    normal: float = 8.0
    albedo_scaled: float = 3.0
    albedo: float = 0.5
    albedo_l1: float = 0.5
    roughness: float = 0.7
    energy: float = 0.0  # of local slope energy, radial and tangential parts each
    render: float = 0.0  # re-renders under lights that the photo was not taken in
    metallic: float = 0.3


def slope_energy(normal: Tensor, offset: Tensor) -> Tensor:
    """(B,2,h,w) logarithm of the mean squared radial and tangential slope in windows."""
    parts = torch.cat(radial_tangential(slopes_of(normal), offset), dim=1)
    return torch.log(F.avg_pool2d(parts.square(), WINDOW, STRIDE) + QUIET)


def detail_losses(
    predicted: dict[str, Tensor],
    target: dict[str, Tensor],
    offset: Tensor,
    f0: Tensor,
    view: Tensor,
    lights: list[tuple[Tensor, Tensor]],
    weights: DetailWeights,
) -> dict[str, Tensor]:
    """Every term and their weighted `total`; errors of albedo and roughness on the paper's [-1,1] scale.

    `target` has `albedo`, `normal`, `roughness`, `known` (B,) and, for a network that has that output, `metallic`;
    `offset` (B,2,H,W) points from the flash's foot to each pixel's point; `f0` (B,1,1,1) or (B,1,H,W), `view` and
    `lights` are those of the re-renders (`point_lights`). An albedo counts as it is only where the exposure is known.
    """
    w = weights
    true = target["albedo"]
    scale = best_scale(predicted["albedo"], true)[:, None, None, None]
    scaled = predicted["albedo"] * scale
    out = {
        "normal": F.mse_loss(predicted["normal"], target["normal"]),
        "albedo_scaled": 4 * F.mse_loss(scaled, true),
        "albedo": 4 * ((predicted["albedo"] - true).square().mean(dim=(1, 2, 3)) * target["known"]).mean(),
        "albedo_l1": ((scaled + 1e-3) ** (1 / 2.2) - (true + 1e-3) ** (1 / 2.2)).abs().mean(),
        "roughness": 4 * F.mse_loss(predicted["roughness"], target["roughness"]),
    }
    out["energy"] = F.mse_loss(slope_energy(predicted["normal"], offset), slope_energy(target["normal"], offset))
    if w.render:
        want = render_pair(target, f0, view, lights)
        out["render"] = F.mse_loss(render_pair(predicted | {"albedo": scaled}, f0, view, lights), want)
    if "metallic" in predicted:
        out["metallic"] = F.binary_cross_entropy(predicted["metallic"], target["metallic"])
    total = sum(getattr(w, name) * term for name, term in out.items() if getattr(w, name))
    return {"total": total, **out}
