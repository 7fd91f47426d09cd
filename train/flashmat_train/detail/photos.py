"""Training crops of the detail network: a photo is rendered, and seen by the frozen networks, once for all its crops.

Step s is a function of the seed and s alone, whichever process makes it, so a resumed run sees what one that was never
stopped would have seen.
"""

from __future__ import annotations

import argparse
import contextlib
import itertools
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace

import numpy as np
import torch
from torch import Tensor

from ..data.batches import Batch, Crops, SceneOptions, batches
from ..data.pool import Pool
from ..model import Network
from ..render.envmap import Environments
from ..training.setup import AnyPool, load_pools
from .first_look import global_maps, load_global, trunk_features
from .inputs import GlobalMaps, detail_inputs
from .network import DetailConfig

#: Crops begin at multiples of this, where the trunk's coarsest features do.
GRID = 16
#: Deviation of the flash's place as the network is told it, each axis along the plane, in camera distances.
PLACE_ERROR = 0.03


@dataclass
class DetailBatch:
    """Crops (K of them, side c) and what they are of."""

    input: Tensor  # (K,20,c,c)
    trunk: list[Tensor]  # (K,16,c/2,c/2), (K,24,c/4,c/4), (K,40,c/8,c/8), (K,112,c/16,c/16)
    base: Tensor  # (K,6,c,c) albedo, slopes and roughness of the global network
    metal: Tensor  # (K,) P(metal)
    target: dict[str, Tensor]  # albedo, normal, roughness, metallic if asked for; known (K,)
    points: Tensor  # (K,3,c,c)
    view: Tensor  # (K,3,c,c)
    f0: Tensor  # (K,1,1,1) or (K,1,c,c)
    light: Tensor  # (K,3) where the flash is
    novel: Tensor  # (K,2,3)
    fold: int | None = None  # as of a `Batch`: none

    def to(self, device: torch.device) -> DetailBatch:
        """The same on another device."""

        def moved(x: object) -> object:
            if isinstance(x, Tensor):
                return x.to(device)
            if isinstance(x, dict):
                return {k: v.to(device) for k, v in x.items()}
            return [v.to(device) for v in x] if isinstance(x, list) else x

        return DetailBatch(**{f.name: moved(getattr(self, f.name)) for f in fields(self)})


def cut(
    network: Network,
    batch: Batch,
    config: DetailConfig,
    side: int,
    per_photo: int,
    rng: np.random.Generator,
    bf16: bool,
) -> DetailBatch:
    """`per_photo` crops of side `side` of each photo of a rendered batch, at random places."""
    photo, count = batch.input, len(batch.input)
    kind = photo.device.type
    with torch.no_grad(), torch.autocast(kind, torch.bfloat16) if bf16 else contextlib.nullcontext():
        base = global_maps(network, photo)
        features = [f.float() for f in trunk_features(network, photo)] if config.trunk else []
    error = torch.tensor(rng.normal(size=(count, 3)) * PLACE_ERROR, dtype=torch.float32, device=photo.device)
    error[:, 2] = 0
    x = detail_inputs(photo, base, batch.light + error)
    places = [
        (i, *(GRID * rng.integers(0, (photo.shape[-1] - side) // GRID + 1, 2)))
        for i in range(count)
        for _ in range(per_photo)
    ]

    def crops(whole: Tensor, step: int = 1) -> Tensor:
        if whole.shape[2] == 1:  # one value a photo
            return torch.cat([whole[i : i + 1] for i, _, _ in places])
        n = side // step
        return torch.cat([whole[i : i + 1, :, y // step :, q // step :][:, :, :n, :n] for i, y, q in places])

    of = torch.tensor([i for i, _, _ in places], device=photo.device)
    maps = ("albedo", "normal", "roughness", *(("metallic",) if config.metallic else ()))
    return DetailBatch(
        crops(x),
        [crops(f, photo.shape[-1] // f.shape[-1]) for f in features],
        crops(base.stacked()),
        base.metal[of],
        {name: crops(batch.target[name]) for name in maps} | {"known": batch.target["known"].float()[of]},
        crops(batch.points),
        crops(batch.view),
        crops(batch.f0),
        batch.light[of],
        batch.novel[of],
    )


@dataclass(frozen=True)
class Plan:
    """How many photos of what side a step has, and how many crops of each."""

    photos: int
    size: int
    crop: int
    per_photo: int
    large_every: int = 0  # each so-manieth step has photos of twice the side, a quarter as many, and as many crops

    def of_step(self, step: int) -> tuple[bool, int, int, int]:
        """(large or not, photos, their side, crops of each) of a step."""
        if not self.large_every or (step + 1) % self.large_every:
            return False, self.photos, self.size, self.per_photo
        photos = max(1, self.photos // 4)
        return True, photos, 2 * self.size, self.photos * self.per_photo // photos


def crops_from(
    plan: Plan,
    network: Network,
    pools: list[tuple[AnyPool, float]],
    env: Environments,
    options: SceneOptions,
    config: DetailConfig,
    seed: int,
    start: int,
    relief: float,
    bf16: bool,
    device: torch.device | str = "cpu",
    workers: int = 0,
) -> Iterator[DetailBatch]:
    """Batches from step `start` on, without end."""
    large = start // plan.large_every if plan.large_every else 0
    endless = 10**12

    def photos(size: int, count: int, first: int, seed: int) -> Iterator[Batch]:
        crops = Crops(pools, size, seed, options.augment, endless, relief)
        return batches(crops, env, options, count, first, device, workers)

    usual = photos(plan.size, plan.photos, start - large, seed)
    larger = photos(2 * plan.size, max(1, plan.photos // 4), large, seed + 1000) if plan.large_every else None
    for step in itertools.count(start):
        is_large, _, _, per_photo = plan.of_step(step)
        rng = np.random.default_rng((seed, 1 << 43, step))
        yield cut(network, next(larger if is_large else usual), config, plan.crop, per_photo, rng, bf16)


def plan_of(args: argparse.Namespace) -> Plan:
    """The plan that a stage's options ask for; SystemExit with a sentence where they make none."""
    if args.size % 128 or args.crop % GRID or not 0 < args.crop <= args.size:
        raise SystemExit(
            f"--size {args.size} --crop {args.crop}: photos have a multiple of 128, crops of {GRID}, at most as large"
        )
    if args.photos < 1 or args.crops < 1:
        raise SystemExit(f"--photos {args.photos} --crops {args.crops}: a step needs one of each")
    return Plan(args.photos, args.size, args.crop, args.crops, args.large_every)


def source(
    args: argparse.Namespace,
    config: DetailConfig,
    bf16: bool,
    start: int,
    loaded: tuple[list[tuple[AnyPool, float]], Pool, Environments] | None = None,
) -> Iterator[DetailBatch]:
    """The training crops of a run from step `start` on; loads materials (unless `load_pools` has), environments and the
    global network itself, for a process of its own."""
    network = load_global(args.init_global).to(args.device)
    pools, _, env = loaded or load_pools(args)
    options = replace(SceneOptions(), occlusion=args.occlusion)
    plan = plan_of(args)
    return crops_from(
        *(plan, network, pools, env.to(args.device), options, config, args.seed, start, args.relief, bf16),
        args.device,
        args.workers,
    )


def base_of(batch: DetailBatch) -> GlobalMaps:
    """The global maps of a batch's crops."""
    return GlobalMaps.of_stacked(batch.base, batch.metal)
