"""The sample photo of the quick start: a procedural material under a phone's flash, as a JPEG.

`python -m flashmat_train sample-photo --class leather --seed 3 --out samples/leather.jpg`
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import torch
from PIL import Image

from . import CLASSES, METAL
from .data.pool import srgb_encode
from .render.brdf import blended_f0
from .render.flash import FOV_DEG, render_point, tilted


def add_arguments(p: argparse.ArgumentParser) -> None:
    p.add_argument("--class", dest="cls", default="leather", choices=CLASSES)
    p.add_argument("--family")
    p.add_argument("--seed", type=int, default=1)
    p.add_argument("--size", type=int, default=1024)
    p.add_argument("--ambient", type=float, default=0.05, help="even ambient light, flash = 1")
    p.add_argument("--out", type=Path, required=True)


def run(args: argparse.Namespace) -> None:
    """Renders the photo: handheld (slightly tilted), the flash beside the lens, sensor noise, clipped, sRGB."""
    from .procedural import generate

    m = generate(args.cls, args.size, torch.Generator().manual_seed(args.seed), "cpu", args.family)
    rng = np.random.default_rng(args.seed)
    geometry = tilted(args.size, torch.tensor([FOV_DEG]), torch.tensor(rng.normal(size=(1, 2)) * 0.02).float())
    light = geometry.camera + torch.tensor([[0.03, 0.01, 0.0]])
    f0 = blended_f0(torch.tensor([float(CLASSES.index(args.cls) == METAL)]))
    x = render_point(m.albedo[None], m.normal[None], m.roughness[None], f0, geometry, light)
    x = x + args.ambient * m.albedo[None]
    x = x + torch.tensor(rng.normal(size=tuple(x.shape))).float() * (0.002 + 0.008 * x.clamp(0, 1).sqrt())
    image = (srgb_encode(x.clamp(0, 1))[0].permute(1, 2, 0) * 255 + 0.5).to(torch.uint8).numpy()
    args.out.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(image).save(args.out, quality=90)
    print(f"{args.out}: {args.out.stat().st_size / 1e3:.0f} kB")
