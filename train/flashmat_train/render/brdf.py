"""The microfacet BRDF of the paper's appendix, its slips corrected (docs/paper-notes.md).

Tensors are (B, C, H, W); vectors are unit, tangent space (x right, y up, z to the camera); roughness in [0,1].
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

#: Specular reflectance at normal incidence (paper, appendix "Microfacet BRDF Model").
F0_DIELECTRIC = 0.05
F0_METAL = 0.5
#: alpha = roughness² is kept at or above this, so that D stays finite; the Rust renderer uses the same.
ALPHA_MIN = 1e-3


def dot(a: Tensor, b: Tensor) -> Tensor:
    """Dot product over the channel axis, kept as one channel."""
    return (a * b).sum(dim=1, keepdim=True)


def normalise(v: Tensor) -> Tensor:
    """Unit vectors along the channel axis."""
    return v / v.square().sum(dim=1, keepdim=True).clamp_min(1e-12).sqrt()


def distribution(cos2: Tensor, sin2: Tensor, roughness: Tensor) -> Tensor:
    """D: GGX with alpha = r², from cos² and sin² of the angle between n and h.

    sin² + cos² alpha² equals the paper's (n.h)² (alpha² - 1) + 1; next to the peak, 1 - cos² has no digits left.
    """
    a2 = (roughness * roughness).clamp_min(ALPHA_MIN).square()
    return a2 / (math.pi * (sin2 + cos2 * a2).square())


def fresnel(v_dot_h: Tensor, f0: Tensor | float) -> Tensor:
    """F: Schlick's approximation in its spherical-Gaussian form."""
    return f0 + (1.0 - f0) * torch.exp2((-5.55473 * v_dot_h - 6.98316) * v_dot_h)


def geometry_over_cosines(n_dot_l: Tensor, n_dot_v: Tensor, roughness: Tensor) -> Tensor:
    """G / (NdotL NdotV), G = G1(l) G1(v) with k = (r + 1)²/8; the cosines cancel, so grazing angles are safe."""
    k = (roughness + 1.0).square() / 8.0
    return 1.0 / ((n_dot_l * (1.0 - k) + k) * (n_dot_v * (1.0 - k) + k))


def shade(albedo: Tensor, normal: Tensor, roughness: Tensor, light: Tensor, view: Tensor, f0: Tensor | float) -> Tensor:
    """Reflected radiance for a light of unit irradiance at normal incidence: (d/pi + D F G/(4 nl nv)) nl.

    Black where the light or the viewer is below the surface.
    """
    n_dot_v = dot(normal, view)
    n_dot_l = torch.where(n_dot_v > 0, dot(normal, light).clamp_min(0.0), torch.zeros_like(n_dot_v))
    half = normalise(light + view)
    # |n - h|² = 2 - 2 n.h without its cancellation, so sin² = |n - h|² (1 - |n - h|²/4) has all its digits
    gap = (normal - half).square().sum(dim=1, keepdim=True).clamp_max(4.0)
    sin2 = gap * (1.0 - 0.25 * gap)
    specular = (
        distribution(1.0 - sin2, sin2, roughness)
        * fresnel(dot(view, half).clamp(0.0, 1.0), f0)
        * geometry_over_cosines(n_dot_l, n_dot_v.clamp_min(1e-4), roughness)
        / 4.0
    )
    return (albedo / math.pi + specular) * n_dot_l


def blended_f0(metal_probability: Tensor) -> Tensor:
    """F0 blended by P(metal); (B,) in, (B,1,1,1) out."""
    f0 = F0_DIELECTRIC + (F0_METAL - F0_DIELECTRIC) * metal_probability
    return f0[:, None, None, None]
