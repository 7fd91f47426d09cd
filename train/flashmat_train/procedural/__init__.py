"""Procedural materials: tileable, seeded, every one random in colour, scale, relief, wear and roughness.

``generate("wood", 256, torch.Generator().manual_seed(7))`` draws a family of the class and a material of it.
"""

from __future__ import annotations

from collections.abc import Callable

import torch

from . import fabric, ground, leather, metal, mixed, polymer, stone_diff, stone_spec, wood
from .noise import Draw
from .structure import Material, Surface, finish, season

__all__ = ["CLASSES", "FAMILIES", "WEIGHTS", "Material", "generate"]

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
FAMILIES = {cls: families | mixed.FAMILIES.get(cls, {}) for cls, families in FAMILIES.items()}
CLASSES: tuple[str, ...] = tuple(FAMILIES)
# How often a family is drawn, where it is not 1: real sets hold more plain sheets than tread plates.
WEIGHTS: dict[str, float] = {
    "metal/sheet": 4,
    "metal/brushed": 3,
    "metal/scratched": 2,
    "metal/galvanised": 1.5,
    "metal/rusted": 2,
    "metal/perforated": 1.3,
    "metal/tread_plate": 1.5,
    "polymer/smooth": 4,
    "polymer/grained": 2,
    "polymer/paint": 2,
    "polymer/film": 0.7,
    "polymer/foam": 0.6,
    "stone-spec/marble": 2,
    "stone-spec/glazed": 2,
    "stone-spec/ice": 0.5,
    "wood/veneer": 2,
    "wood/planks": 2,
    "wood/bark": 2.5,
    "fabric/plain_weave": 2,
    "fabric/twill": 2,
    "fabric/jersey": 3,
    "fabric/rope": 0.4,
    "fabric/quilt": 0.5,
    "fabric/carpet": 0.7,
    "leather/pebbled": 2,
    "leather/nappa": 1.5,
    "leather/aged": 1.5,
    "leather/patent": 2,
    "fabric/towel": 1.5,
    "metal/printed": 1.5,
    "metal/worn_paint": 2,
    "polymer/lacquer": 1.5,
}


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
    key = family
    if key is None:
        key = d.weighted(tuple(families), [WEIGHTS.get(f"{name}/{f}", 1.0) for f in families])
    if key not in families:
        raise ValueError(f"no family {key!r} of {name}; families: {', '.join(families)}")
    with torch.no_grad():
        return finish(season(d, families[key](d, size), name), CLASSES.index(name), key)
