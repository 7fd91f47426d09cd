"""The classifier on the pretrained trunk: fitted to rendered photos of the training materials, the trunk as it is.

`python -m flashmat_train classifier --init RUN/last.pt --out RUN/class.pt`, then
`train --init RUN/class.pt --freeze-classifier`: the heads get used to the new probabilities. Of materials it was fitted
to a classifier is right and sure far more often than of others. So `--folds K` also fits K classifiers, each to the
materials without one fold; training then mixes each photo's maps by the one that has not seen the photo's material.

Each photo is rendered at twice the training size and seen at both sizes, as the product sees photos. What varies is
what varies in training (paper, "Material Classification": classes weighted by how rare they are).
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor, nn
from tqdm import tqdm

from . import CLASSES, checkpoint, trunk
from .data.batches import Crops, SceneOptions, render_batch
from .data.pool import srgb_decode, srgb_encode
from .model import PRESETS, Network, NetworkConfig
from .render.envmap import Environments
from .training.setup import AnyPool, folded, load_pools
from .training.validate import validation_set

BATCH = 16
EPOCHS, RATE, DECAY, SMOOTHING = 30, 1e-3, 1e-2, 0.1
#: Shares of the means and of the hidden values that are left out at random.
DROPOUT = (0.2, 0.2)


def add_arguments(p: argparse.ArgumentParser) -> None:
    p.add_argument("--init", type=Path, required=True, help="the checkpoint whose other weights are kept")
    p.add_argument("--out", type=Path, required=True, help="the checkpoint to write")
    p.add_argument("--trunk", type=Path, help="EfficientNet-Lite0 state file (default: the installed package's)")
    p.add_argument("--data", help="data folder (default: FLASHMAT_DATA)")
    p.add_argument("--pack", type=Path, help="packed materials instead of --data")
    p.add_argument("--procedural", type=Path, help="folder of procedural materials")
    p.add_argument("--procedural-share", type=float, default=0.35)
    p.add_argument("--photos", type=int, default=6000)
    p.add_argument("--folds", type=int, default=5, help="classifiers for training, each without one fold; 1: none")
    p.add_argument("--size", type=int, default=128, help="the smaller of the two sizes")
    p.add_argument("--seed", type=int, default=1)
    p.add_argument("--threads", type=int, default=0)


def halved(x: Tensor) -> Tensor:
    """Network inputs at half the size; colours are averaged in linear light."""
    return torch.cat((srgb_encode(F.avg_pool2d(srgb_decode(x[:, :3]), 2)), F.avg_pool2d(x[:, 3:], 2)), dim=1)


@torch.no_grad()
def evidence(sees: trunk.Trunk, x: Tensor) -> Tensor:
    """(B,2,width) the trunk's means of photos at half their size and at their own."""
    sizes = (halved(x), x)
    return torch.stack([sees(y.contiguous(memory_format=torch.channels_last)) for y in sizes], dim=1)


def photos(
    pools: list[tuple[AnyPool, float]], env: Environments, size: int, count: int, seed: int
) -> Iterator[tuple[Tensor, Tensor]]:
    """`count` training photos as network inputs, and their classes, in batches."""
    options = SceneOptions()
    crops = Crops(pools, size, seed, options.augment, count)
    for first in range(0, count, BATCH):
        maps, classes = zip(*(crops[i] for i in range(first, min(first + BATCH, count))), strict=True)
        cls = torch.tensor(classes)
        rng = np.random.default_rng((seed, 1 << 41, first))
        yield render_batch(torch.stack(maps), cls, env, options, rng).input, cls


def fit(means: Tensor, cls: Tensor, hidden: int, seed: int) -> nn.Sequential:
    """Linear, ReLU, linear, fitted to (N,V,width) means of N photos seen V ways and their classes (N,)."""
    n, views, width = means.shape
    flat = means.reshape(-1, width).float()
    mean, spread = flat.mean(dim=0), flat.std(dim=0) + 1e-3
    counts = torch.bincount(cls, minlength=len(CLASSES)).float()
    weight = torch.where(counts > 0, counts.sum() / counts.clamp_min(1), 0.0)
    weight = weight / weight[weight > 0].mean()
    generator = torch.Generator().manual_seed(seed)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        first, last = nn.Linear(width, hidden), nn.Linear(hidden, len(CLASSES))
        head = nn.Sequential(nn.Dropout(DROPOUT[0]), first, nn.ReLU(), nn.Dropout(DROPOUT[1]), last)
        steps = EPOCHS * max(1, n // 64)
        optimizer = torch.optim.AdamW(head.parameters(), lr=RATE, weight_decay=DECAY)
        rate = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps)
        for _ in range(EPOCHS):
            order = torch.randperm(n, generator=generator)
            for start in range(0, max(1, n // 64) * 64, 64):
                index = order[start : start + 64]
                view = torch.randint(views, (len(index),), generator=generator)
                x = (means[index, view].float() - mean) / spread
                loss = F.cross_entropy(head(x), cls[index], weight=weight, label_smoothing=SMOOTHING)
                optimizer.zero_grad()
                loss.backward()
                optimizer.step()
                rate.step()
    with torch.no_grad():  # the means' own mean and spread belong to the first layer
        first.bias -= first.weight @ (mean / spread)
        first.weight /= spread
    return nn.Sequential(first, nn.ReLU(), last)


def observe(
    sees: trunk.Trunk, pools: list[tuple[AnyPool, float]], env: Environments, args: argparse.Namespace
) -> tuple[Tensor, Tensor, Tensor]:
    """(N,2,width) the trunk's means of `args.photos` training photos, (N,) their classes and (N,) folds."""
    means, classes, folds = [], [], []
    count = max(1, args.folds)
    bar = tqdm(total=args.photos, mininterval=10)
    for k in range(count):
        part = folded(pools, k, count) if count > 1 else pools
        share = args.photos // count + (k < args.photos % count)
        for x, cls in photos(part, env, 2 * args.size, share, args.seed + k):
            means.append(evidence(sees, x).half())
            classes.append(cls)
            folds.append(torch.full_like(cls, k))
            bar.update(len(cls))
    bar.close()
    return torch.cat(means), torch.cat(classes), torch.cat(folds)


def run(args: argparse.Namespace) -> None:
    """Writes the checkpoint and prints the accuracy on the validation photos."""
    if args.threads:
        torch.set_num_threads(args.threads)
    state = checkpoint.load(args.init)
    old = NetworkConfig.fromdict(state["config"])
    model = PRESETS.get(old.name, PRESETS["phone"])
    config = replace(old, trunk=model.trunk or PRESETS["phone"].trunk, classifier=model.classifier, room=0)
    network = Network(config).eval()
    kept = {k: v for k, v in state["ema"].items() if not k.startswith(("classifier.", "trunk.", "room."))}
    network.load_state_dict(kept, strict=False)
    trunk.load_pretrained(network.trunk, args.trunk or trunk.pretrained_file())
    sees = network.trunk.to(memory_format=torch.channels_last)
    pools, val_pool, env = load_pools(args)
    size = 2 * args.size
    means, cls, fold = observe(sees, pools, env, args)
    network.classifier = fit(means, cls, config.classifier, args.seed)
    state["folds"] = []
    for k in range(args.folds if args.folds > 1 else 0):
        others = fold != k
        head = fit(means[others], cls[others], config.classifier, args.seed + k)
        right = head(means[~others].float()).argmax(dim=2) == cls[~others, None]
        print(f"without fold {k}: class {right.float().mean():.1%} of its photos")
        state["folds"].append(head.state_dict())
    right: list[Tensor] = []
    for batch in validation_set(val_pool, env, size):
        logits = network.classifier(evidence(sees, batch.input)).detach()
        right.append((logits.log_softmax(dim=2).sum(dim=1).argmax(dim=1) == batch.target["cls"]).float())
    checkpoint.save(state | {"config": config.asdict(), "ema": network.state_dict(), "step": 0}, args.out)
    if right:
        print(f"validation: class {torch.cat(right).mean():.1%} of {len(torch.cat(right))} photos")
    print(f"{args.out}: the classifier reads {trunk.width(config.trunk)} means of {config.trunk} blocks")
