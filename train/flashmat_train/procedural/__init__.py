"""Procedural materials: tileable, seeded, every one random in colour, scale, relief, wear and roughness.

``generate("wood", 256, torch.Generator().manual_seed(7))`` draws a family of the class and a material of it.
"""

from __future__ import annotations

from collections.abc import Callable

import torch

from . import fabric, ground, leather, metal, polymer, stone_diff, stone_spec, wood
from .noise import Draw
from .structure import Material, Surface, finish

__all__ = ["CLASSES", "FAMILIES", "Material", "generate"]

Family = Callable[[Draw, int], Surface]

FAMILIES: dict[str, dict[str, Family]] = {
    "fabric": fabric.FAMILIES,
    "ground": ground.FAMILIES,
    "leather": leather.FAMILIES,
    "metal": metal.FAMILIES,
    "stone-diff": stone_diff.FAMILIES,
    "stone-spec": stone_spec.FAMILIES,
    "polymer": polymer.FAMILIES,
    "wood": wood.FAMILIES,
}
CLASSES: tuple[str, ...] = tuple(FAMILIES)


def generate(
    cls: str | int | None,
    size: int,
    rng: torch.Generator,
    device: torch.device | str = "cpu",
    family: str | None = None,
) -> Material:
    """One material, ``size`` square; ``cls`` None draws the class, ``family`` None the family.

    The same seed gives the same material. Maps lie on ``device``.
    """
    d = Draw(rng, device)
    drawn = d.choice(CLASSES) if cls is None else cls
    name = CLASSES[drawn] if isinstance(drawn, int) else drawn
    if name not in FAMILIES:
        raise ValueError(f"no material class {name!r}; classes: {', '.join(CLASSES)}")
    families = FAMILIES[name]
    key = family if family is not None else d.choice(tuple(families))
    if key not in families:
        raise ValueError(f"no family {key!r} of {name}; families: {', '.join(families)}")
    with torch.no_grad():
        return finish(families[key](d, size), CLASSES.index(name), key)
