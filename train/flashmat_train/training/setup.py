"""From options to the things that a run is made of: processes and device, material pools, class weights."""

from __future__ import annotations

import argparse
import os
from dataclasses import dataclass, replace

import numpy as np
import torch
import torch.distributed as dist
from torch import Tensor

from .. import CLASSES
from ..data.materials import data_root, load, scan
from ..data.pool import Pool
from ..data.procedural_fresh import FreshPool
from ..data.procedural_pool import read_pool
from ..model import PRESETS, NetworkConfig
from ..render.envmap import Environments

AnyPool = Pool | FreshPool


@dataclass(frozen=True)
class Place:
    """Where this process runs: rank `rank` of `world`, on `device`."""

    device: torch.device
    rank: int
    world: int

    @property
    def first(self) -> bool:
        return self.rank == 0


def enter(args: argparse.Namespace) -> Place:
    """Joins the other processes that torchrun started, if any, and settles device, threads and seeds."""
    world, rank = int(os.environ.get("WORLD_SIZE", 1)), int(os.environ.get("RANK", 0))
    device = torch.device(args.device)
    if device.type == "cuda":
        if not torch.cuda.is_available():
            raise SystemExit("--device cuda, but PyTorch sees no GPU here")
        device = torch.device("cuda", int(os.environ.get("LOCAL_RANK", 0)) if device.index is None else device.index)
        torch.cuda.set_device(device)
        torch.backends.cudnn.benchmark = True
    if world > 1:
        dist.init_process_group("nccl" if device.type == "cuda" else "gloo")
    if args.threads:
        torch.set_num_threads(args.threads)
    torch.manual_seed(args.seed)
    return Place(device, rank, world)


def leave(place: Place) -> None:
    """Parts from the other processes."""
    if place.world > 1:
        dist.destroy_process_group()


def check_arguments(args: argparse.Namespace, world: int) -> int:
    """Number of steps; SystemExit with a sentence when the options make no run."""
    if args.size % 128:
        raise SystemExit(f"--size {args.size}: must be a multiple of 128, the network halves it seven times")
    if args.batch < 1 or args.samples < args.batch * world:
        raise SystemExit(f"--samples {args.samples} is not one batch of {args.batch} for each of {world} processes")
    if not 0 <= args.procedural_share <= 1:
        raise SystemExit(f"--procedural-share {args.procedural_share}: a share is between 0 and 1")
    return args.samples // (args.batch * world)


def configure(args: argparse.Namespace) -> NetworkConfig:
    """The preset, as the variant changes it."""
    config = PRESETS[args.preset]
    return replace(config, mixing=False) if args.variant == "basic" else config


def load_pools(
    args: argparse.Namespace, training: bool = True
) -> tuple[list[tuple[AnyPool, float]], Pool, Environments]:
    """(training pools with shares, validation pool, environments), from folders or a pack; with --metallic, crops have
    that channel; the first are none if not `training`."""
    metallic = getattr(args, "metallic", False)
    if args.pack:
        from ..pack import unpack

        train, val, env = unpack(args.pack)
    else:
        root = data_root(args.data)
        entries, problems = scan(root)
        for line in problems:
            print("skipped", line)
        train = [load(e, metallic) for e in entries if e.split == "train" and training]
        val = [load(e, metallic) for e in entries if e.split == "val"]
        env = Environments.from_folder(root / "envmaps")
    if not training:
        return [], Pool(val, metallic=metallic), env
    procedural: AnyPool | None = None
    if getattr(args, "procedural", None):
        procedural = Pool(read_pool(args.procedural), metallic=metallic)
    elif getattr(args, "procedural_fresh", 0):
        procedural = FreshPool(
            args.seed, lanes=max(1, args.workers), batch=args.batch, reuse=args.procedural_fresh, metallic=metallic
        )
    share = args.procedural_share if procedural is not None else 0.0
    if not train and share < 1:
        raise SystemExit("no training materials: the data folder has none of split 'train' with all its maps")
    pools: list[tuple[AnyPool, float]] = [(Pool(train, metallic=metallic), 1.0 - share)] if train else []
    if procedural is not None:
        pools.append((procedural, share))
    return pools, Pool(val, metallic=metallic), env


def folded(pools: list[tuple[AnyPool, float]], k: int, count: int) -> list[tuple[AnyPool, float]]:
    """The same shares of fold `k` of `count` of each pool."""
    parts = []
    for pool, share in pools:
        if not isinstance(pool, Pool):
            raise SystemExit("--procedural-fresh has no folds; give --procedural, or an --init without folds")
        parts.append((pool.fold(k, count), share))
        if not len(parts[-1][0]):
            raise SystemExit(f"fold {k} of {count} is empty: {len(pool)} materials are too few for so many folds")
    return parts


def class_weights(pools: list[tuple[AnyPool, float]]) -> Tensor:
    """Inverse to how often a class is drawn, mean 1 (paper, "Material Classification")."""
    freq = np.zeros(len(CLASSES))
    for pool, share in pools:
        if len(pool) and share > 0:
            freq += share * np.bincount(pool.classes, weights=pool.weight, minlength=len(CLASSES))
    w = 1.0 / np.maximum(freq / freq.sum(), 0.02)
    return torch.tensor(w / w.mean(), dtype=torch.float32)
