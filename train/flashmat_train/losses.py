"""The paper's losses: L2 on the maps (normals weighted by angle bin), rendering under the input light and novel
lights, class-balanced cross-entropy ("Loss Functions for SVBRDF Estimation")."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor

from .render.brdf import normalise, shade

#: Angle from z under which a bin ends, degrees, and the bin's weight W = 0.7 + 1/(10 P) of the paper's table.
NORMAL_BINS = ((10.0, 0.869), (25.0, 1.060), (90.0, 1.469))


@dataclass(frozen=True)
class LossWeights:
    """The lambdas. The paper has 1 for all maps and 0.0005 for the class; departures are in docs/paper-notes.md."""

    albedo: float = 1.0
    albedo_scaled: float = 2.0  # the same after each albedo's best scale: its structure, whatever its brightness
    unknown: float = 0.25  # share of `albedo` where the exposure is not known: brightness is then a guess
    albedo_l1: float = 0.5  # L1 on gamma-encoded albedo: dark materials count as the eye sees them
    normal: float = 8.0
    roughness: float = 0.7
    render: float = 2.0
    chroma: float = 1.0  # L1 on the hue of 8x8 means: no tint where a highlight was
    bright: float = 3.0  # albedo's errors where the photo is nearly white or mostly highlight count so many times more
    room: float = 1.0  # the guess of the room's light: what tells it apart tells the albedo's brightness
    cls: float = 0.5


def normal_weights(normal: Tensor) -> Tensor:
    """Weight of each pixel's normal, by its angle from z."""
    z = normal[:, 2:]
    w = torch.full_like(z, NORMAL_BINS[-1][1])
    for angle, weight in reversed(NORMAL_BINS[:-1]):
        w = torch.where(z > math.cos(math.radians(angle)), torch.full_like(z, weight), w)
    return w


def tone(x: Tensor) -> Tensor:
    """Clamped to (0,1.5), gamma 2.2, as the paper's reconstruction loss; the offset keeps the gradient finite."""
    return (x.clamp(0, 1.5) + 1e-3) ** (1 / 2.2)


def chroma(albedo: Tensor) -> Tensor:
    """R, G, B shares of 8x8 means, (B,3,n/8,n/8); dark means count less."""
    mean = F.avg_pool2d(albedo, 8)
    return mean / (mean.sum(dim=1, keepdim=True) + 0.06)


def best_scale(predicted: Tensor, target: Tensor) -> Tensor:
    """(B,) factor of each predicted albedo that brings it nearest to the target, within [0.2,5]; without gradient."""
    p, t = predicted.detach(), target
    return ((p * t).sum(dim=(1, 2, 3)) / p.square().sum(dim=(1, 2, 3)).clamp_min(1e-6)).clamp(0.2, 5.0)


def render_pair(maps: dict[str, Tensor], f0: Tensor, view: Tensor, lights: list[tuple[Tensor, Tensor]]) -> Tensor:
    """Tone-mapped renders under each (direction, irradiance/pi) pair, stacked over channels."""
    return torch.cat(
        [tone(shade(maps["albedo"], maps["normal"], maps["roughness"], d, view, f0) * e) for d, e in lights],
        dim=1,
    )


def specular_share(maps: dict[str, Tensor], f0: Tensor, view: Tensor, light: Tensor) -> Tensor:
    """(B,1,H,W) how much of the light that comes back from a light in direction `light` is the highlight's, [0,1]."""
    rest = (maps["normal"], maps["roughness"], light, view, f0)
    gloss = shade(torch.zeros_like(maps["albedo"]), *rest)
    both = shade(maps["albedo"].mean(dim=1, keepdim=True), *rest)
    return gloss.mean(dim=1, keepdim=True) / both.clamp_min(1e-6)


def losses(
    predicted: dict[str, Tensor],
    target: dict[str, Tensor],
    f0: Tensor,
    view: Tensor,
    lights: list[tuple[Tensor, Tensor]],
    class_weight: Tensor,
    weights: LossWeights,
) -> dict[str, Tensor]:
    """Every term and their weighted `total`. Errors of albedo and roughness are on the paper's [-1,1] scale.

    Where the exposure is not known (`target["known"]` 0), an albedo's brightness cannot be: L1 and rendering loss then
    compare it after its best scale.
    """
    w, known = weights, target["known"]
    scale = best_scale(predicted["albedo"], target["albedo"])
    fair = torch.where(known > 0, torch.ones_like(scale), scale)[:, None, None, None]
    predicted = predicted | {"fair": predicted["albedo"] * fair}
    # a highlight covers little of a photo, and what the albedo is below it is the hardest to say
    white = ((target["photo"].amax(dim=1, keepdim=True) - 0.85) / 0.1).clamp(0, 1)
    gloss = ((specular_share(target, f0, view, lights[0][0]) - 0.2) / 0.4).clamp(0, 1)
    heavy = 1 + w.bright * torch.maximum(white, gloss)
    heavy = heavy / heavy.mean(dim=(2, 3), keepdim=True)
    a = 4 * ((predicted["albedo"] - target["albedo"]).square() * heavy).mean(dim=(1, 2, 3))
    a = (a * (known + (1 - known) * w.unknown)).mean()
    scaled = 4 * ((predicted["albedo"] * scale[:, None, None, None] - target["albedo"]).square() * heavy).mean()
    gamma = 1 / 2.2
    l1 = (((predicted["fair"] + 1e-3) ** gamma - (target["albedo"] + 1e-3) ** gamma).abs() * heavy).mean()
    hue = ((chroma(predicted["fair"]) - chroma(target["albedo"])).abs() * F.avg_pool2d(heavy, 8)).mean()
    n = ((predicted["normal"] - target["normal"]).square() * normal_weights(target["normal"])).mean()
    r = 4 * F.mse_loss(predicted["roughness"], target["roughness"])
    want = render_pair(target, f0, view, lights)
    got = render_pair(predicted | {"albedo": predicted["fair"]}, f0, view, lights)
    render = F.mse_loss(got, want)
    c = F.cross_entropy(predicted["class_logits"], target["cls"], weight=class_weight, label_smoothing=0.05)
    room = F.mse_loss(predicted["room"], target["room"]) if "room" in predicted else torch.zeros_like(c)
    total = w.albedo * a + w.albedo_scaled * scaled + w.albedo_l1 * l1 + w.chroma * hue + w.room * room
    total = total + w.normal * n + w.roughness * r + w.render * render + w.cls * c
    return {
        "total": total,
        "albedo": a,
        "albedo_scaled": scaled,
        "albedo_l1": l1,
        "chroma": hue,
        "normal": n,
        "roughness": r,
        "render": render,
        "room": room,
        "cls": c,
    }


def point_lights(points: Tensor, positions: list[Tensor]) -> list[tuple[Tensor, Tensor]]:
    """(unit direction, pi/d²) of point lights at positions (B,3), for `render_pair`."""
    out = []
    for p in positions:
        to = p[:, :, None, None] - points
        d2 = to.square().sum(dim=1, keepdim=True).clamp_min(1e-6)
        out.append((normalise(to), math.pi / d2))
    return out
