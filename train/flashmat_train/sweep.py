"""Errors against the strength of the environment, as in the paper's figure: a picture of what `flashmat eval` wrote.

`flashmat eval testset --sweep phone.csv`, then `python -m flashmat_train sweep --csv phone=phone.csv --out sweep.png`.
"""

from __future__ import annotations

import argparse
import csv
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from .curves import PANEL, Curve, panel

COLOURS = ((0x1F, 0x5F, 0xA8), (0xC0, 0x50, 0x20), (0x2A, 0x80, 0x40), (0x80, 0x40, 0x90), (0x60, 0x60, 0x60))
PANELS = {
    "albedo_mse_paper": "albedo",
    "albedo_scaled_mse_paper": "albedo to scale",
    "normal_mse_paper": "normal",
    "roughness_mse_paper": "roughness",
    "class_right": "class accuracy",
    "relit_rmse": "relit RMSE",
}
LEGEND_HEIGHT = 24


def add_arguments(p: argparse.ArgumentParser) -> None:
    p.add_argument("--csv", action="append", required=True, metavar="LABEL=FILE", help="once for each curve")
    p.add_argument("--out", type=Path, required=True)


def read(path: Path) -> dict[str, Curve]:
    """Curves over the environment's strength; SystemExit when the file has other columns."""
    with path.open(newline="") as f:
        rows = list(csv.DictReader(f))
    if not rows or not {"environment", *PANELS} <= rows[0].keys():
        raise SystemExit(f"{path}: not a file of `flashmat eval --sweep`")
    x = np.array([float(r["environment"]) for r in rows])
    return {k: (x, np.array([float(r[k]) for r in rows])) for k in PANELS}


def run(args: argparse.Namespace) -> None:
    pairs = [text.partition("=") for text in args.csv]
    if not all(label and sign and file for label, sign, file in pairs) or len(pairs) > len(COLOURS):
        raise SystemExit(f"--csv takes LABEL=FILE, at most {len(COLOURS)} times")
    curves = [read(Path(file)) for _, _, file in pairs]
    sheet = Image.new("RGB", (3 * PANEL[0], 2 * PANEL[1] + LEGEND_HEIGHT), "white")
    for i, (key, title) in enumerate(PANELS.items()):
        lines = [(c[key], colour) for c, colour in zip(curves, COLOURS, strict=False)]
        sheet.paste(panel(f"{title} against environment / flash", lines), (i % 3 * PANEL[0], i // 3 * PANEL[1]))
    pen, x = ImageDraw.Draw(sheet), 12
    for (label, _, _), colour in zip(pairs, COLOURS, strict=False):
        pen.text((x, 2 * PANEL[1] + 6), label, fill=colour)
        x += 20 + int(pen.textlength(label))
    args.out.parent.mkdir(parents=True, exist_ok=True)
    sheet.save(args.out)
    print(args.out)
