"""Errors of predicted maps: the paper's convention, RMSE in [0,1], mean angle, class accuracy, trivial guesses."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from .losses import best_scale


def map_errors(predicted: dict[str, Tensor], target: dict[str, Tensor]) -> dict[str, float]:
    """Means over a batch. `*_mse` is the paper's convention (albedo and roughness on [-1,1]); angle in degrees.

    "scaled" is after each photo's best albedo scale, which no photo of unknown exposure tells.
    """
    a = (predicted["albedo"] - target["albedo"]).square().mean()
    scale = best_scale(predicted["albedo"], target["albedo"])[:, None, None, None]
    scaled = (predicted["albedo"] * scale - target["albedo"]).square().mean()
    n = (predicted["normal"] - target["normal"]).square().mean()
    r = (predicted["roughness"] - target["roughness"]).square().mean()
    cos = (predicted["normal"] * target["normal"]).sum(dim=1).clamp(-1, 1)
    out = {
        "albedo_mse": 4 * float(a),
        "albedo_scaled_mse": 4 * float(scaled),
        "normal_mse": float(n),
        "roughness_mse": 4 * float(r),
        "albedo_rmse": math.sqrt(float(a)),
        "roughness_rmse": math.sqrt(float(r)),
        "angle_deg": math.degrees(float(torch.acos(cos).mean())),
    }
    if "metallic" in predicted and "metallic" in target:
        out["metallic_rmse"] = math.sqrt(float((predicted["metallic"] - target["metallic"]).square().mean()))
    if "class_logits" in predicted:
        out["class_accuracy"] = float((predicted["class_logits"].argmax(dim=1) == target["cls"]).float().mean())
    return out


def trivial(target: dict[str, Tensor], albedo: float, roughness: float) -> dict[str, Tensor]:
    """The guesses any method must beat: flat normals, one albedo, one roughness."""
    flat = torch.zeros_like(target["normal"])
    flat[:, 2] = 1
    return {
        "albedo": torch.full_like(target["albedo"], albedo),
        "normal": flat,
        "roughness": torch.full_like(target["roughness"], roughness),
    }
