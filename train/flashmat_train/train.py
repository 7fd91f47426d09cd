"""The training loop: resumable, EMA, CPU (bf16, compiled) or GPUs (torchrun).

`python -m flashmat_train train --data DIR --out RUN [--preset phone] ...`
"""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import os
import time
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import torch
import torch.distributed as dist
from torch import Tensor, nn
from torch.nn.parallel import DistributedDataParallel
from torch.utils.tensorboard import SummaryWriter
from tqdm import tqdm

from . import CLASSES, checkpoint
from .data.batches import Batch, Crops, SceneOptions, batches, render_batch
from .data.materials import data_root, load, scan
from .data.pool import Pool
from .losses import LossWeights, losses, point_lights
from .metrics import map_errors, trivial
from .model import PRESETS, Network, NetworkConfig, gmacs
from .render.camera import CameraNoise
from .render.envmap import Environments

MEAN_ALBEDO, MEAN_ROUGHNESS = 0.22, 0.6


def add_arguments(p: argparse.ArgumentParser) -> None:
    p.add_argument("--data", help="data folder (default: FLASHMAT_DATA)")
    p.add_argument("--pack", type=Path, help="packed materials instead of --data (see `pack`)")
    p.add_argument("--procedural", type=Path, help="folder of procedural materials (see `procedural`)")
    p.add_argument("--procedural-share", type=float, default=0.35)
    p.add_argument("--out", type=Path, required=True, help="run folder: checkpoints, log, curves")
    p.add_argument("--init", type=Path, help="start from these weights (another run's checkpoint)")
    p.add_argument("--preset", default="phone", choices=sorted(PRESETS))
    p.add_argument("--variant", default="cls", choices=("cls", "basic", "clsOnly"))
    p.add_argument("--light", default="pt", choices=("pt", "env"))
    p.add_argument("--size", type=int, default=128)
    p.add_argument("--batch", type=int, default=16)
    p.add_argument("--samples", type=int, default=200_000, help="samples to see in all")
    p.add_argument("--lr", type=float, default=1e-3)
    p.add_argument("--warmup", type=int, default=300)
    p.add_argument("--ema", type=float, default=0.999)
    p.add_argument("--seed", type=int, default=1)
    p.add_argument("--workers", type=int, default=0)
    p.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu")
    p.add_argument("--threads", type=int, default=0)
    p.add_argument("--no-compile", action="store_true")
    p.add_argument("--no-bf16", action="store_true")
    p.add_argument("--minutes", type=float, default=0, help="stop after this long, with a checkpoint (0: no limit)")
    p.add_argument("--save-every", type=int, default=250, help="steps")
    p.add_argument("--eval-every", type=int, default=1000, help="steps")
    p.add_argument("--split-checkpoint", action="store_true", help="checkpoints as files under 16 MiB")


def configure(args: argparse.Namespace) -> NetworkConfig:
    config = PRESETS[args.preset]
    return replace(config, mixing=False) if args.variant == "basic" else config


class Step(nn.Module):
    """Network and losses as one graph, so that the compiler fuses across them."""

    def __init__(self, network: Network, weights: LossWeights, class_weight: Tensor, only_class: bool):
        super().__init__()
        self.network, self.weights, self.only_class = network, weights, only_class
        self.register_buffer("class_weight", class_weight)

    def forward(
        self, x: Tensor, target: dict[str, Tensor], f0: Tensor, points: Tensor, view: Tensor, lights: Tensor
    ) -> dict[str, Tensor]:
        if self.only_class:
            logits = self.network.classify(x)
            c = torch.nn.functional.cross_entropy(logits.float(), target["cls"], weight=self.class_weight)
            return {"total": c, "cls": c}
        predicted = {k: v.float() for k, v in self.network(x).items()}
        pairs = point_lights(points, list(lights.unbind(dim=1)))
        return losses(predicted, target, f0, view, pairs, self.class_weight, self.weights)


def class_weights(pools: list[tuple[Pool, float]]) -> Tensor:
    """Inverse to how often a class is drawn, mean 1 (paper, "Material Classification")."""
    freq = np.zeros(len(CLASSES))
    for pool, share in pools:
        if len(pool) and share > 0:
            freq += share * np.bincount(pool.classes, weights=pool.weight, minlength=len(CLASSES))
    w = 1.0 / np.maximum(freq / freq.sum(), 0.02)
    return torch.tensor(w / w.mean(), dtype=torch.float32)


def validation_set(pool: Pool, env: Environments, size: int, per_material: int = 3) -> list[Batch]:
    """Fixed photos of the validation materials: the scales and lights vary, nothing else is random."""
    options = SceneOptions(
        augment=False, fov_exact=1.0, tilt_sigma=0.0, camera=CameraNoise(plain=1.0), environment=(0.0, 0.4)
    )
    out = []
    for i in range(len(pool)):
        rng = np.random.default_rng((99, i))
        crops = [
            pool.crop(i, size, float(rng.choice((0.4, 0.6, 1.0))), 0.0, False, rng.random(2))
            for _ in range(per_material)
        ]
        cls = torch.full((per_material,), int(pool.classes[i]))
        out.append(render_batch(torch.stack(crops), cls, env, options, rng))
    return out


@torch.no_grad()
def evaluate(network: Network, val: list[Batch], device: str) -> dict[str, float]:
    """Mean errors over the validation photos, and those of the trivial guesses (`flat_*`)."""
    network.eval()
    rows = []
    for b in val:
        out = {k: v.float().cpu() for k, v in network(b.input.to(device)).items()}
        row = map_errors(out, b.target)
        base = map_errors(trivial(b.target, MEAN_ALBEDO, MEAN_ROUGHNESS), b.target)
        rows.append(row | {f"flat_{k}": v for k, v in base.items()})
    return {k: float(np.mean([r[k] for r in rows])) for k in rows[0]}


class Ema:
    """Exponential moving average of all weights and statistics, warmed up."""

    def __init__(self, network: nn.Module, decay: float):
        self.decay = decay
        self.state = {k: v.detach().clone() for k, v in network.state_dict().items()}

    def update(self, network: nn.Module, step: int) -> None:
        d = min(self.decay, (1 + step) / (10 + step))
        for k, v in network.state_dict().items():
            if v.dtype.is_floating_point:
                self.state[k].lerp_(v.detach(), 1 - d)
            else:
                self.state[k].copy_(v)


def learning_rate(step: int, total: int, args: argparse.Namespace) -> float:
    """Linear warm-up, then cosine to 1 %."""
    if step < args.warmup:
        return args.lr * (step + 1) / args.warmup
    t = (step - args.warmup) / max(1, total - args.warmup)
    return args.lr * (0.01 + 0.99 * 0.5 * (1 + math.cos(math.pi * min(1.0, t))))


def load_pools(args: argparse.Namespace) -> tuple[list[tuple[Pool, float]], Pool, Environments]:
    """(training pools with shares, validation pool, environments), from folders or a pack."""
    if args.pack:
        from .pack import unpack

        train, val, env = unpack(args.pack)
    else:
        root = data_root(args.data)
        entries, problems = scan(root)
        for line in problems:
            print("skipped", line)
        train = [load(e) for e in entries if e.split == "train"]
        val = [load(e) for e in entries if e.split == "val"]
        env = Environments.from_folder(root / "envmaps")
    pools = [(Pool(train), 1.0)]
    if args.procedural:
        from .data.procedural_pool import read_pool

        pools = [(pools[0][0], 1.0 - args.procedural_share), (Pool(read_pool(args.procedural)), args.procedural_share)]
    return pools, Pool(val), env


def run(args: argparse.Namespace) -> None:
    world, rank = int(os.environ.get("WORLD_SIZE", 1)), int(os.environ.get("RANK", 0))
    device = args.device
    if world > 1:
        dist.init_process_group("nccl" if device == "cuda" else "gloo")
        if device == "cuda":
            device = f"cuda:{os.environ.get('LOCAL_RANK', 0)}"
            torch.cuda.set_device(device)
    if args.threads:
        torch.set_num_threads(args.threads)
    torch.manual_seed(args.seed)
    pools, val_pool, env = load_pools(args)
    print(f"{sum(len(p) for p, _ in pools)} materials, {len(env)} environments")
    val = validation_set(val_pool, env, args.size)
    env = env.to(device)
    config = configure(args)
    network = Network(config).to(device, memory_format=torch.channels_last)
    params = sum(p.numel() for p in network.parameters())
    print(f"{config.name}: {params / 1e6:.2f} M parameters, {gmacs(config):.2f} GMAC at 256²")
    ema = Ema(network, args.ema)
    optimizer = torch.optim.AdamW(network.parameters(), lr=args.lr, betas=(0.9, 0.99), weight_decay=1e-4, fused=True)
    ckpt, start, seen_s = args.out / "last.pt", 0, 0.0
    if checkpoint.exists(ckpt):
        state = checkpoint.load(ckpt)
        network.load_state_dict(state["network"])
        ema.state = {k: v.to(device) for k, v in state["ema"].items()}
        optimizer.load_state_dict(state["optimizer"])
        start, seen_s = state["step"], state["seconds"]
        print(f"resumed at step {start}")
    elif args.init:
        state = checkpoint.load(args.init)
        network.load_state_dict(state["ema"])
        ema = Ema(network, args.ema)
    step_module: nn.Module = Step(network, LossWeights(), class_weights(pools).to(device), args.variant == "clsOnly")
    if world > 1:
        step_module = DistributedDataParallel(step_module, find_unused_parameters=args.variant == "clsOnly")
    forward = step_module if args.no_compile else torch.compile(step_module)
    options = SceneOptions(flash=args.light == "pt")
    if args.light == "env":
        options = replace(options, environment=(0.5, 1.2))
    total = args.samples // (args.batch * world)
    crops = Crops(pools, args.size, args.seed, options.augment, total * args.batch * world)
    source = batches(crops, env, options, args.batch, start, device, args.workers, rank, world)
    writer = SummaryWriter(args.out / "tensorboard") if rank == 0 else None
    if rank == 0:
        args.out.mkdir(parents=True, exist_ok=True)
        (args.out / "config.json").write_text(
            json.dumps(
                {
                    "args": {k: str(v) for k, v in vars(args).items()},
                    "network": config.asdict(),
                    "losses": asdict(LossWeights()),
                },
                indent=1,
            )
        )
    network.train()
    begin, render_s, net_s = time.monotonic(), 0.0, 0.0
    recent: list[dict[str, float]] = []
    bar = tqdm(total=total, initial=start, disable=rank != 0, mininterval=10, dynamic_ncols=True)
    step, done = start, False
    while step < total and not done:
        t0 = time.monotonic()
        b = next(source)
        t1 = time.monotonic()
        for g in optimizer.param_groups:
            g["lr"] = learning_rate(step, total, args)
        kind = torch.device(device).type
        cast = contextlib.nullcontext() if args.no_bf16 else torch.autocast(kind, torch.bfloat16)
        with cast:
            x = b.input.contiguous(memory_format=torch.channels_last)
            lights = torch.cat((b.light[:, None], b.novel), dim=1)
            out = forward(x, b.target, b.f0, b.points, b.view, lights)
        optimizer.zero_grad(set_to_none=True)
        out["total"].backward()
        nn.utils.clip_grad_norm_(network.parameters(), 1.0)
        optimizer.step()
        ema.update(network, step)
        step += 1
        recent.append({k: float(v) for k, v in out.items()})
        render_s, net_s = render_s + (t1 - t0), net_s + (time.monotonic() - t1)
        bar.update()
        late = args.minutes and time.monotonic() - begin > args.minutes * 60
        done = bool(late) or step == total
        if rank == 0 and step % 50 == 0:
            mean = {k: float(np.mean([r[k] for r in recent])) for k in recent[0]}
            n = len(recent) * args.batch
            rates = {
                "samples_per_s": n * world / (render_s + net_s),
                "render_only": n / max(render_s, 1e-9),
                "network_only": n / net_s,
            }
            recent, render_s, net_s = [], 0.0, 0.0
            for k, v in (mean | rates).items():
                writer.add_scalar(f"train/{k}", v, step)
            bar.set_postfix_str(" ".join(f"{k}={v:.4g}" for k, v in (mean | rates).items() if k != "albedo_l1"))
        if rank == 0 and (step % args.save_every == 0 or done):
            checkpoint.save(
                {
                    "network": network.state_dict(),
                    "ema": ema.state,
                    "optimizer": optimizer.state_dict(),
                    "step": step,
                    "samples": step * args.batch * world,
                    "config": config.asdict(),
                    "seconds": seen_s + time.monotonic() - begin,
                },
                ckpt,
                args.split_checkpoint,
            )
        if rank == 0 and (step % args.eval_every == 0 or done):
            probe = Network(config).to(device, memory_format=torch.channels_last)
            probe.load_state_dict(ema.state)
            scores = evaluate(probe, val, device)
            for k, v in scores.items():
                writer.add_scalar(f"val/{k}", v, step)
            line = {"step": step, "samples": step * args.batch * world, **scores}
            with (args.out / "val.jsonl").open("a") as f:
                f.write(json.dumps(line) + "\n")
            tqdm.write(json.dumps({k: round(v, 5) for k, v in line.items()}))
    bar.close()
    if world > 1:
        dist.destroy_process_group()
