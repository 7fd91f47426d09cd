"""Contact sheets: procedural materials of a class, with real ones beside them.

``python -m flashmat_train.procedural.contact_sheet --class wood --data MATERIALS --out sheets``

Each material is a block of four: albedo (sRGB), normal, roughness, and a flash photo (by the default
camera: field of view 43.35 degrees, flash and camera at distance 1).
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import numpy as np
import torch
from PIL import Image, ImageDraw
from torch import Tensor

from . import CLASSES, FAMILIES, generate
from .structure import Material, linear_to_srgb, srgb_to_linear

FOV = math.radians(43.35)


def flash_photo(m: Material) -> Tensor:
    """The material under a flash at the camera: linear (3, n, n), not clamped."""
    n = m.albedo.shape[-1]
    device = m.albedo.device
    p = ((torch.arange(n, device=device, dtype=torch.float32) + 0.5) / n * 2 - 1) * math.tan(FOV / 2)
    x, y = p.expand(n, n), -p[:, None].expand(n, n)
    square = x * x + y * y + 1
    light = torch.stack((-x, -y, torch.ones_like(x))) * torch.rsqrt(square)
    nl = (m.normal * light).sum(0).clamp(1e-3, 1)
    r = m.roughness[0]
    a2 = r.pow(4).clamp_min(1e-6)
    k = (r + 1) ** 2 / 8
    f0 = 0.5 if CLASSES[m.cls] == "metal" else 0.05
    fresnel = f0 + (1 - f0) * 2 ** (-5.55473 - 6.98316)
    lobe = a2 / (math.pi * (nl * nl * (a2 - 1) + 1) ** 2)
    shadow = (nl / (nl * (1 - k) + k)) ** 2
    specular = lobe * fresnel * shadow / (4 * nl * nl)
    return (m.albedo / math.pi + specular) * nl * math.pi / square


def block(m: Material, cell: int, label: str) -> Image.Image:
    """Albedo and normal above, roughness and flash photo below."""
    views = (
        linear_to_srgb(m.albedo),
        (m.normal + 1) / 2,
        m.roughness.expand(3, -1, -1),
        linear_to_srgb(flash_photo(m).clamp(0, 1)),
    )
    out = Image.new("RGB", (2 * cell, 2 * cell))
    for i, view in enumerate(views):
        pixels = (view.clamp(0, 1) * 255).round().byte().permute(1, 2, 0).cpu().numpy()
        image = Image.fromarray(pixels)
        if image.width != cell:
            image = image.resize((cell, cell), Image.Resampling.LANCZOS)
        out.paste(image, ((i % 2) * cell, (i // 2) * cell))
    ImageDraw.Draw(out).text((3, 2), label, fill=(255, 255, 0), stroke_width=1, stroke_fill=(0, 0, 0))
    return out


def _read(folder: Path, name: str, mode: str, size: int) -> Tensor:
    path = next(iter(sorted(folder.glob(f"{name}.*"))))
    image = Image.open(path)
    if image.mode.startswith("I"):
        image = Image.fromarray((np.asarray(image) / 257).astype(np.uint8))
    image = image.convert(mode)
    side = min(*image.size, 2 * size)
    image = image.crop((0, 0, side, side)).resize((size, size), Image.Resampling.LANCZOS)
    x = torch.from_numpy(np.asarray(image).astype(np.float32) / 255)
    return x[None] if mode == "L" else x.permute(2, 0, 1)


def real_materials(data: Path, cls: str, size: int, splits: Path | None) -> list[tuple[str, Material]]:
    """The training materials of a class, at half the stored resolution where they are large enough."""
    train: set[str] | None = None
    if splits is not None:
        rows = [line.split("\t") for line in splits.read_text().splitlines()[1:]]
        train = {r[1] for r in rows if r[0] == cls and r[2] == "train"}
    out = []
    for folder in sorted((data / cls).iterdir()):
        if train is not None and folder.name not in train:
            continue
        normal = _read(folder, "normal", "RGB", size) * 2 - 1
        normal = normal / normal.norm(dim=0, keepdim=True).clamp_min(1e-6)
        albedo = srgb_to_linear(_read(folder, "albedo", "RGB", size))
        rough = _read(folder, "roughness", "L", size)
        out.append((folder.name, Material(albedo, normal, rough, CLASSES.index(cls), "real")))
    return out


def sheet(blocks: list[Image.Image], columns: int) -> Image.Image:
    w, h = blocks[0].size
    rows = (len(blocks) + columns - 1) // columns
    out = Image.new("RGB", (columns * (w + 4), rows * (h + 4)), (40, 40, 40))
    for i, b in enumerate(blocks):
        out.paste(b, ((i % columns) * (w + 4), (i // columns) * (h + 4)))
    return out


def main(argv: list[str] | None = None) -> int:
    p = argparse.ArgumentParser(description="contact sheets of procedural materials beside real ones")
    p.add_argument("--class", dest="cls", action="append", choices=CLASSES, help="default: every class")
    p.add_argument("--family", help="only this family")
    p.add_argument("--each", type=int, default=3, help="materials of each family")
    p.add_argument("--size", type=int, default=256)
    p.add_argument("--cell", type=int, default=128, help="pixels of one map on the sheet")
    p.add_argument("--columns", type=int, default=6)
    p.add_argument("--seed", type=int, default=0)
    p.add_argument("--data", type=Path, help="folder of real materials by class")
    p.add_argument("--splits", type=Path, help="splits.tsv: only its train materials are shown")
    p.add_argument("--reals", type=int, default=6, help="how many real ones")
    p.add_argument("--shuffle", action="store_true", help="mix real and procedural, unlabelled; names are printed")
    p.add_argument("--device", default="cpu")
    p.add_argument("--out", type=Path, default=Path("."))
    args = p.parse_args(argv)
    args.out.mkdir(parents=True, exist_ok=True)
    for cls in args.cls or CLASSES:
        shown: list[tuple[str, Material]] = []
        for family in FAMILIES[cls]:
            if args.family is not None and family != args.family:
                continue
            for i in range(args.each):
                rng = torch.Generator().manual_seed(args.seed + i)
                shown.append((f"{family} {args.seed + i}", generate(cls, args.size, rng, args.device, family)))
        order = torch.Generator().manual_seed(args.seed)
        if args.data is not None:
            real = real_materials(args.data, cls, args.size, args.splits)
            pick = torch.randperm(len(real), generator=order)[: args.reals].tolist()
            shown += [(f"REAL {real[i][0]}", real[i][1]) for i in pick]
        if args.shuffle:
            shown = [shown[i] for i in torch.randperm(len(shown), generator=order).tolist()]
            for i, (name, _) in enumerate(shown):
                print(i, name)
        blocks = [block(m, args.cell, str(i) if args.shuffle else name) for i, (name, m) in enumerate(shown)]
        path = args.out / (f"{cls}.png" if args.family is None else f"{cls}-{args.family}.png")
        sheet(blocks, args.columns).save(path)
        print(path)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
