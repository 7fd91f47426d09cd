"""Batches for training: crops on the CPU (workers), rendering on the training device.

Sample i of a run is a function of (seed, i) alone, so a resumed run sees what the first one would have seen.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import torch
from torch import Tensor
from torch.utils.data import DataLoader, Dataset

from .. import METAL
from ..model import network_input
from ..procedural.relief import random_slopes
from ..render.brdf import F0_DIELECTRIC, F0_METAL, blended_f0
from ..render.camera import CameraNoise, photograph
from ..render.envmap import Environments
from ..render.flash import FOV_DEG, render_point, tilted
from ..render.occlusion import ambient_occlusion, between_surfaces
from ..slopes import height_of, normals_of, slopes_of
from .pool import DYED, Pool, blended, dyed, lightened, scale_maps, tinted
from .procedural_fresh import FreshPool

#: Shares of the crops that are blended with another material of their class, tinted, made lighter or darker (metals are
#: not), and, of the dyed classes, dyed.
BLEND_SHARE, TINT_SHARE, LIGHTEN_SHARE, DYE_SHARE = 0.4, 0.5, 0.35, 0.4


#: Of the crops with other relief: the share with another material's, the logarithm of the factor on its slopes, and, of
#: those with a random field, the share that keep their own below it.
BORROWED_SHARE, BORROWED_STRENGTH, ON_TOP_SHARE = 0.4, (-0.3, 1.2), 0.7


@dataclass(frozen=True)
class SceneOptions:
    """How photos vary. Lengths are in units of the camera's distance."""

    environment: tuple[float, float] = (0.0, 0.8)  # luminance of white under the environment, flash = 1
    dark: float = 0.15  # share of photos from the lowest eighth of that range: rooms with the lamps off
    second_lobe: float = 0.3  # share of photos whose highlight has a second lobe, as lacquer and real gloss have
    flash: bool = True  # off: the paper's `env` variant
    light_sigma: float = 0.03  # of the flash around the camera, each axis
    beside: float = 0.5  # share of photos whose flash is beside the camera, as phones' are, or the camera aimed askew
    beside_reach: float = 0.25  # how far at most, in any direction
    tilt_sigma: float = 3.0  # degrees, each axis
    fov_exact: float = 0.4  # share of photos with the field of view of the paper
    fov_range: tuple[float, float] = (32.0, 70.0)
    fov_known: float = 0.75  # share of the others whose field of view the network is told
    augment: bool = True  # the paper's scaling of the maps
    occlusion: float = 0.0  # share of photos whose room is dimmed in crevices, by the height that the normals tell
    camera: CameraNoise = field(default_factory=CameraNoise)


class Crops(Dataset):
    """Crop i: (7 or 8,n,n) maps and the class, from real or procedural materials; in a share `relief` of them other
    relief takes the place of the material's."""

    def __init__(
        self,
        pools: list[tuple[Pool | FreshPool, float]],
        size: int,
        seed: int,
        augment: bool,
        length: int,
        relief: float = 0.0,
    ):
        self.pools = [p for p, share in pools if share > 0 and len(p) > 0]
        shares = np.array([share for p, share in pools if share > 0 and len(p) > 0])
        self.shares = shares / shares.sum()
        self.size, self.seed, self.augment, self.length = size, seed, augment, length
        self.relief = relief

    def __len__(self) -> int:
        return self.length

    def __getitem__(self, i: int) -> tuple[Tensor, int]:
        rng = np.random.default_rng((self.seed, i))
        pool = self.pools[int(rng.choice(len(self.pools), p=self.shares))]
        maps, cls = pool.draw(rng, self.size) if isinstance(pool, Pool) else pool.draw_for(i, rng, self.size)
        maps = self.varied(maps, cls, rng) if self.augment else maps
        return (self.other_relief(maps, i) if self.relief else maps), cls

    def varied(self, maps: Tensor, cls: int, rng: np.random.Generator) -> Tensor:
        """The maps blended with another material's of the class, tinted, lightened, dyed and scaled, each at random."""
        if rng.random() < BLEND_SHARE:
            other = self.pools[int(rng.choice(len(self.pools), p=self.shares))]
            if isinstance(other, Pool) and cls in other.classes:
                maps = blended(maps, other.draw(rng, self.size, cls)[0], float(rng.uniform(0.15, 0.85)))
        if rng.random() < TINT_SHARE:
            maps = tinted(maps, rng)
        if cls != METAL and rng.random() < LIGHTEN_SHARE:
            maps = lightened(maps, rng)
        if cls in DYED and rng.random() < DYE_SHARE:
            maps = dyed(maps, rng)
        return scale_maps(maps, cls, rng)

    def other_relief(self, maps: Tensor, i: int) -> Tensor:
        """The maps of crop i, in a share `relief` of crops with other normals: another material's, of another
        strength, or a random field's, alone or on top of their own."""
        rng = np.random.default_rng((self.seed, 1 << 42, i))
        if rng.random() >= self.relief:
            return maps
        if rng.random() < BORROWED_SHARE:
            other = self.pools[int(rng.choice(len(self.pools), p=self.shares))]
            drawn = other.draw(rng, self.size) if isinstance(other, Pool) else other.draw_for(i, rng, self.size)
            slopes = slopes_of(drawn[0][None, 3:6]) * math.exp(rng.uniform(*BORROWED_STRENGTH))
        else:
            slopes = torch.from_numpy(random_slopes(rng, self.size))[None]
            if rng.random() < ON_TOP_SHARE:
                slopes = slopes + slopes_of(maps[None, 3:6])
        return torch.cat((maps[:3], normals_of(slopes)[0], maps[6:]))


@dataclass
class Batch:
    """A rendered batch on the training device."""

    input: Tensor  # (B,6,n,n)
    target: dict[
        str, Tensor
    ]  # maps, cls, metallic if it has any; known (B,): the flash's strength is; room (B,): the environment's over it
    f0: Tensor  # (B,1,1,1); (B,1,n,n) where maps have a metallic channel
    points: Tensor  # (B,3,n,n)
    view: Tensor  # (B,3,n,n)
    light: Tensor  # (B,3) the flash
    novel: Tensor  # (B,2,3) lights not in the photo
    fold: int | None = None  # which fold of the materials, if they are told apart (`Pool.fold`)


def render_batch(
    maps: Tensor, cls: Tensor, env: Environments, options: SceneOptions, rng: np.random.Generator
) -> Batch:
    """Renders crops (B,7 or 8,n,n) into photos under a random flash, environment and camera."""
    b, _, n, _ = maps.shape
    dev = maps.device

    def tensor(x: np.ndarray) -> Tensor:
        return torch.tensor(x, dtype=torch.float32, device=dev)

    albedo, normal, rough, metallic = maps[:, :3], maps[:, 3:6], maps[:, 6:7], maps[:, 7:].clamp(0, 1)
    f0 = (
        F0_DIELECTRIC + (F0_METAL - F0_DIELECTRIC) * metallic
        if maps.shape[1] > 7
        else blended_f0((cls == METAL).float())
    )
    exact = rng.random(b) < options.fov_exact
    fov = np.where(exact, FOV_DEG, rng.uniform(*options.fov_range, size=b))
    told = np.where(rng.random(b) < options.fov_known, fov, FOV_DEG)
    tilt = rng.normal(size=(b, 2)) * math.radians(options.tilt_sigma) * (rng.random((b, 1)) < 0.7)
    geometry = tilted(n, tensor(fov), tensor(tilt), dev)
    light = geometry.camera + tensor(rng.normal(size=(b, 3)) * options.light_sigma + beside(rng, b, options))
    radiance = torch.zeros_like(albedo)
    if options.flash:
        radiance = render_point(albedo, normal, rough, f0, geometry, light)
        share = tensor((rng.random(b) < options.second_lobe) * rng.uniform(0.1, 0.6, size=b))[:, None, None, None]
        other = (rough * tensor(np.exp(rng.normal(size=b) * 0.5))[:, None, None, None]).clamp(0.05, 1)
        radiance = radiance + share * (render_point(albedo, normal, other, f0, geometry, light) - radiance)
    low, high = options.environment
    reach = np.where(rng.random(b) < options.dark, 0.125, 1.0)
    strength = tensor(low + (high - low) * reach * rng.random(b))
    index = torch.tensor(rng.integers(len(env), size=b), device=dev)
    spin = tensor(rng.uniform(0, 2 * math.pi, size=b))
    ambient = env.render(index, spin, albedo, normal, rough, f0, geometry.view)
    if options.occlusion:
        dimmed = tensor(rng.random(b) < options.occlusion)[:, None, None, None] > 0
        seen = between_surfaces(ambient_occlusion(height_of(slopes_of(normal))), albedo)
        ambient = torch.where(dimmed, ambient * seen, ambient)
    radiance = radiance + ambient * strength[:, None, None, None]
    photo, known = photograph(radiance, rng, options.camera)
    target = {"albedo": albedo, "normal": normal, "roughness": rough, "cls": cls, "known": known, "room": strength}
    if maps.shape[1] > 7:
        target["metallic"] = metallic
    return Batch(
        network_input(photo, known, tensor(told)),
        target,
        f0,
        geometry.points,
        geometry.view,
        light,
        tensor(novel_lights(rng, b)),
    )


def beside(rng: np.random.Generator, b: int, options: SceneOptions) -> np.ndarray:
    """How far the flash is beside the camera, parallel to the plane; (b,3), zeros for the photos that have it there."""
    reach = options.beside_reach * rng.random(b) * (rng.random(b) < options.beside)
    phi = rng.uniform(0, 2 * math.pi, size=b)
    return np.stack((reach * np.cos(phi), reach * np.sin(phi), np.zeros(b)), axis=-1)


def novel_lights(rng: np.random.Generator, b: int) -> np.ndarray:
    """Two lights each, on the upper hemisphere of radius 1 to 1.6, not too grazing; (b,2,3)."""
    z = rng.uniform(0.35, 1.0, size=(b, 2))
    phi = rng.uniform(0, 2 * math.pi, size=(b, 2))
    s = np.sqrt(1 - z * z)
    return np.stack((s * np.cos(phi), s * np.sin(phi), z), axis=-1) * rng.uniform(1.0, 1.6, size=(b, 2, 1))


def batches(
    crops: Crops,
    env: Environments,
    options: SceneOptions,
    batch: int,
    start: int,
    device: torch.device | str,
    workers: int,
    rank: int = 0,
    world: int = 1,
) -> Iterator[Batch]:
    """Batches from step `start` on; rank r of w sees every w-th batch."""
    order = _Order(batch, start, len(crops), rank, world)
    loader = DataLoader(
        crops,
        batch_sampler=order,
        num_workers=workers,
        prefetch_factor=4 if workers else None,
        pin_memory=torch.device(device).type == "cuda",
    )
    for step, (maps, cls) in enumerate(loader, start):
        rng = np.random.default_rng((crops.seed, 1 << 40, step, rank))
        yield render_batch(maps.to(device, non_blocking=True), cls.to(device, non_blocking=True), env, options, rng)


class _Order:
    """Batches of consecutive sample numbers."""

    def __init__(self, batch: int, start: int, length: int, rank: int, world: int):
        self.batch, self.start, self.length, self.rank, self.world = batch, start, length, rank, world

    def __iter__(self) -> Iterator[list[int]]:
        step = self.start
        while (first := (step * self.world + self.rank) * self.batch) + self.batch <= self.length:
            yield list(range(first, first + self.batch))
            step += 1

    def __len__(self) -> int:
        return self.length // (self.batch * self.world) - self.start
