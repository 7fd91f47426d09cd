"""The training stage: resumable, EMA, CPU (bf16, compiled) or GPUs and machines (torchrun).

`python -m flashmat_train train --data DIR --out RUN [--preset phone] ...`
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import torch

from .data.batches import Batch, Crops, SceneOptions, batches
from .model import PRESETS, gmacs
from .training.loop import Trainer, describe
from .training.setup import AnyPool, check_arguments, configure, enter, folded, leave, load_pools
from .training.validate import evaluate, validation_set

__all__ = ["add_arguments", "evaluate", "load_pools", "run", "validation_set"]


def add_arguments(p: argparse.ArgumentParser) -> None:
    cuda = torch.cuda.is_available()
    p.add_argument("--data", help="data folder (default: FLASHMAT_DATA)")
    p.add_argument("--pack", type=Path, help="packed materials instead of --data (see `pack`)")
    p.add_argument("--procedural", type=Path, help="folder of procedural materials (see `procedural`)")
    p.add_argument(
        "--procedural-fresh",
        type=int,
        default=0,
        metavar="N",
        help="make procedural materials in the workers, a new one every N samples of a worker (for many cores)",
    )
    p.add_argument("--procedural-share", type=float, default=0.35)
    p.add_argument("--out", type=Path, required=True, help="run folder: checkpoints, log, curves")
    p.add_argument("--init", type=Path, help="start from these weights (another run's checkpoint)")
    p.add_argument("--trunk", type=Path, help="EfficientNet-Lite0 state file for the classifier (see `classifier`)")
    p.add_argument("--freeze-classifier", action="store_true", help="the maps learn, the classifier stays as it is")
    p.add_argument("--preset", default="phone", choices=sorted(PRESETS))
    p.add_argument("--variant", default="cls", choices=("cls", "basic", "clsOnly"))
    p.add_argument("--light", default="pt", choices=("pt", "env"))
    p.add_argument("--size", type=int, default=128)
    p.add_argument("--batch", type=int, default=16, help="samples a step of each process")
    p.add_argument(
        "--large-every",
        type=int,
        default=0,
        metavar="N",
        help="every N-th step sees a quarter as many photos of twice the size, which count as a whole batch (0: none)",
    )
    p.add_argument("--samples", type=int, default=200_000, help="samples to see in all")
    p.add_argument("--lr", type=float, default=1e-3)
    p.add_argument("--warmup", type=int, default=300)
    p.add_argument("--ema", type=float, default=0.999)
    p.add_argument("--seed", type=int, default=1)
    workers = max(2, (os.cpu_count() or 2) // int(os.environ.get("LOCAL_WORLD_SIZE", 1)) - 1)
    p.add_argument("--workers", type=int, default=min(16, workers) if cuda else 0, help="processes that cut crops")
    p.add_argument("--device", default="cuda" if cuda else "cpu")
    p.add_argument("--threads", type=int, default=0)
    p.add_argument("--no-compile", action="store_true")
    p.add_argument("--no-bf16", action="store_true")
    p.add_argument("--minutes", type=float, default=0, help="stop after this long, with a checkpoint (0: no limit)")
    p.add_argument("--save-every", type=int, default=250, help="steps")
    p.add_argument("--eval-every", type=int, default=1000, help="steps")
    p.add_argument("--split-checkpoint", action="store_true", help="checkpoints as files under 16 MiB")


def mixed(usual: Iterator[Batch], large: Iterator[Batch] | None, every: int, start: int) -> Iterator[Batch]:
    """Batches from step `start` on: each `every`-th from `large`."""
    for step in itertools.count(start):
        yield next(large if large is not None and (step + 1) % every == 0 else usual)


def in_turn(sources: list[Iterator[Batch]], start: int) -> Iterator[Batch]:
    """Batch n, from `start` on, of source n % len(sources), with that number as its fold."""
    for n in itertools.count(start):
        yield replace(next(sources[n % len(sources)]), fold=n % len(sources))


def run(args: argparse.Namespace) -> None:
    """Trains, or goes on training where RUN/last.pt left off."""
    place = enter(args)
    total = check_arguments(args, place.world)
    pools, val_pool, env = load_pools(args)
    config = configure(args)
    val = validation_set(val_pool, env, args.size) if place.first else []
    trainer = Trainer(args, place, pools)
    trainer.build(config)
    if place.first:
        print(f"{sum(len(p) for p, _ in pools)} materials, {len(env)} environments")
        params = sum(p.numel() for p in trainer.network.parameters())
        print(f"{config.name}: {params / 1e6:.2f} M parameters, {gmacs(config):.2f} GMAC at 256²")
        if trainer.start:
            print(f"resumed at step {trainer.start}")
        args.out.mkdir(parents=True, exist_ok=True)
        (args.out / "config.json").write_text(json.dumps(describe(args, config), indent=1))
    options = SceneOptions(flash=args.light == "pt")
    if args.light == "env":
        options = replace(options, environment=(0.5, 1.2), dark=0.0)
    env = env.to(place.device)

    def cut(pools: list[tuple[AnyPool, float]], size: int, batch: int, start: int, seed: int) -> Iterator[Batch]:
        crops = Crops(pools, size, seed, options.augment, total * batch * place.world)
        return batches(crops, env, options, batch, start, place.device, args.workers, place.rank, place.world)

    def photos(size: int, batch: int, start: int, seed: int) -> Iterator[Batch]:
        count = len(trainer.folds)
        if not count:
            return cut(pools, size, batch, start, seed)
        starts = [(start + count - 1 - k) // count for k in range(count)]
        parts = [cut(folded(pools, k, count), size, batch, starts[k], seed + 10_000 * (k + 1)) for k in range(count)]
        return in_turn(parts, start)

    every, large = args.large_every, None
    if every:
        large = photos(2 * args.size, max(1, args.batch // 4), trainer.start // every, args.seed + 1000)
    usual = photos(args.size, args.batch, trainer.start - (trainer.start // every if every else 0), args.seed)
    trainer.fit(mixed(usual, large, every, trainer.start), total, val)
    leave(place)
