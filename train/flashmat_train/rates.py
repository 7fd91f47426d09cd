"""Where training time goes: crops alone, rendering alone, the network alone, and all together.

`python -m flashmat_train rates --data DIR [--sizes 128 256]`
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch

from .data.batches import Crops, SceneOptions, batches, render_batch
from .losses import LossWeights
from .model import PRESETS, Network
from .training.setup import class_weights, load_pools
from .training.step import Learner, Step


def add_arguments(p: argparse.ArgumentParser) -> None:
    p.add_argument("--data", help="data folder (default: FLASHMAT_DATA)")
    p.add_argument("--pack", type=Path, help="packed materials instead of --data")
    p.add_argument("--preset", default="phone", choices=sorted(PRESETS))
    p.add_argument("--sizes", type=int, nargs="+", default=[128, 256])
    p.add_argument("--batch", type=int, default=16)
    p.add_argument("--steps", type=int, default=6, help="measured steps, after two to warm up")
    p.add_argument("--workers", type=int, default=0)
    p.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu")
    p.add_argument("--threads", type=int, default=0)
    p.add_argument(
        "--cpu-time",
        action="store_true",
        help="count this process's CPU seconds, not the clock's: for --threads 1 on a machine that others use too",
    )
    p.add_argument("--no-compile", action="store_true")
    p.add_argument("--no-bf16", action="store_true")


def seconds(
    work: Callable[[int], object], steps: int, device: torch.device, clock: Callable[[], float], warm: int = 2
) -> float:
    """Median time of one call."""
    times = []
    for i in range(warm + steps):
        begin = clock()
        work(i)
        if device.type == "cuda":
            torch.cuda.synchronize()
        times.append(clock() - begin)
    return float(np.median(times[warm:]))


def run(args: argparse.Namespace) -> None:
    if args.threads:
        torch.set_num_threads(args.threads)
    device = torch.device(args.device)
    pools, _, env = load_pools(args)
    env = env.to(device)
    print(f"{args.preset}, batch {args.batch}, {device}, {torch.get_num_threads()} threads; samples a second")
    print(f"{'size':>5} {'together':>9} {'crops':>8} {'render':>8} {'network':>8}  network's share of the time")
    for size in args.sizes:
        together, crops, render, network = measure(args, size, pools, env, device)
        b = args.batch
        print(
            f"{size:5d} {b / together:9.1f} {b / crops:8.1f} {b / render:8.1f} {b / network:8.1f}"
            f"  {network / together:.1%}",
            flush=True,
        )


def measure(
    args: argparse.Namespace, size: int, pools: list, env: object, device: torch.device
) -> tuple[float, float, float, float]:
    """Seconds a step: all together, crops alone, rendering alone, network alone."""
    b, count = args.batch, args.steps + 2
    clock = time.process_time if args.cpu_time else time.perf_counter
    data = Crops(pools, size, 1, True, b * count * 2)
    options = SceneOptions()
    crops = seconds(lambda i: [data[i * b + k] for k in range(b)], args.steps, device, clock)
    drawn = [data[k] for k in range(b)]
    maps, cls = torch.stack([m for m, _ in drawn]).to(device), torch.tensor([c for _, c in drawn]).to(device)
    rng = np.random.default_rng(1)
    render = seconds(lambda _: render_batch(maps, cls, env, options, rng), args.steps, device, clock)
    batch = render_batch(maps, cls, env, options, rng)
    net = Network(PRESETS[args.preset]).to(device, memory_format=torch.channels_last).train()
    learner = Learner(net, 0.999, 1e-4)
    module = Step(net, LossWeights(), class_weights(pools).to(device), False)
    forward = module if args.no_compile else torch.compile(module)
    network = seconds(lambda i: learner.step(forward, batch, not args.no_bf16, 1e-4, i), args.steps, device, clock)
    source = batches(data, env, options, b, 0, device, args.workers)
    together = seconds(
        lambda i: learner.step(forward, next(source), not args.no_bf16, 1e-4, i), args.steps, device, clock
    )
    return together, crops, render, network
