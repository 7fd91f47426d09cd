"""Differentiable rendering of material maps: the BRDF, the flash, the environment and the camera."""
