"""A folder of procedural materials (.npy, uint8 (7,H,W), or (8,H,W) where a material is metal in places, named
<class>--<family>--<seed>.npy): written and read."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import torch
from tqdm import tqdm

from .. import CLASSES
from .materials import Material
from .pool import to_bytes


def add_arguments(p: argparse.ArgumentParser) -> None:
    p.add_argument("--out", type=Path, required=True)
    p.add_argument("--count", type=int, default=800)
    p.add_argument("--size", type=int, default=512)
    p.add_argument("--seed", type=int, default=1)
    p.add_argument("--threads", type=int, default=1)


def run(args: argparse.Namespace) -> None:
    """Makes `count` materials, classes in turn, families as often as they are meant to be; those already there stay."""
    from ..procedural import FAMILIES, WEIGHTS, generate

    torch.set_num_threads(args.threads)
    args.out.mkdir(parents=True, exist_ok=True)
    for i in tqdm(range(args.count), mininterval=10):
        seed = args.seed * 1_000_000 + i
        cls = CLASSES[i % len(CLASSES)]
        share = np.array([WEIGHTS.get(f"{cls}/{name}", 1.0) for name in FAMILIES[cls]])
        family = str(np.random.default_rng(seed).choice(list(FAMILIES[cls]), p=share / share.sum()))
        path = args.out / f"{cls}--{family}--{seed}.npy"
        if path.exists():
            continue
        m = generate(cls, args.size, torch.Generator().manual_seed(seed), "cpu", family)
        parts = (m.albedo, m.normal, m.roughness)
        maps = to_bytes(torch.cat(parts if m.metallic is None else (*parts, m.metallic))).numpy()
        beside = path.with_suffix(".tmp.npy")
        np.save(beside, maps)
        beside.replace(path)


def read_pool(folder: Path) -> list[Material]:
    """All materials of such a folder; a file that is not one is an error that names it."""
    out = []
    for path in sorted(folder.glob("*--*--*.npy")):
        if path.name.endswith(".tmp.npy"):
            continue
        maps = np.load(path)
        if maps.dtype != np.uint8 or maps.ndim != 3 or maps.shape[0] not in (7, 8):
            raise SystemExit(f"{path}: not a procedural material (uint8, 7 or 8 channels)")
        metallic = maps[7] if len(maps) == 8 else None
        out.append(Material(CLASSES.index(path.name.split("--")[0]), path.stem, maps[:7], metallic))
    if not out:
        raise SystemExit(f"{folder}: no procedural materials; make some with `python -m flashmat_train procedural`")
    return out
