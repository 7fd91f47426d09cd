"""Loss and validation curves of a run as one picture: RUN/curves.png.

`python -m flashmat_train curves --run RUN`
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

PANEL = (360, 240)
MARGIN = (56, 26, 12, 24)  # left, top, right, bottom
COLUMNS = 4
TRAIN = (0x1F, 0x5F, 0xA8)
VAL = (0xC0, 0x50, 0x20)
GUESS = (0x90, 0x90, 0x90)

Curve = tuple[np.ndarray, np.ndarray]


def add_arguments(p: argparse.ArgumentParser) -> None:
    p.add_argument("--run", dest="folder", type=Path, required=True, help="run folder")


def run(args: argparse.Namespace) -> None:
    print(draw(args.folder))


def read_train(folder: Path) -> dict[str, Curve]:
    """Scalars train/* from TensorBoard's files."""
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    if not (folder / "tensorboard").is_dir():
        return {}
    events = EventAccumulator(str(folder / "tensorboard"), size_guidance={"scalars": 4000})
    events.Reload()
    out = {}
    for tag in events.Tags()["scalars"]:
        if tag.startswith("train/"):
            points = sorted({e.step: e.value for e in events.Scalars(tag)}.items())
            out[tag[6:]] = (np.array([p[0] for p in points]), np.array([p[1] for p in points]))
    return out


def read_val(folder: Path) -> dict[str, Curve]:
    """Scores from RUN/val.jsonl; of steps seen twice (resumed runs) the later line counts."""
    path = folder / "val.jsonl"
    if not path.is_file():
        return {}
    lines = {row["step"]: row for row in map(json.loads, path.read_text().splitlines())}
    steps = np.array(sorted(lines))
    names = [k for k in next(iter(lines.values()), {}) if k not in ("step", "samples")]
    return {k: (steps, np.array([lines[int(s)].get(k, np.nan) for s in steps])) for k in names}


def smooth(y: np.ndarray, half_life: float) -> np.ndarray:
    """Exponential mean, without the pull of its first value."""
    keep, total, weight = 0.5 ** (1 / half_life), 0.0, 0.0
    out = np.empty_like(y, dtype=float)
    for i, v in enumerate(y):
        total, weight = keep * total + v, keep * weight + 1
        out[i] = total / weight
    return out


def panel(title: str, lines: list[tuple[Curve, tuple[int, int, int]]]) -> Image.Image:
    """One diagram; the vertical axis is logarithmic where all values are positive and spread over a decade."""
    w, h = PANEL
    image = Image.new("RGB", PANEL, "white")
    pen = ImageDraw.Draw(image)
    left, top, right, bottom = MARGIN
    pen.text((left, 6), title, fill="black")
    xs, ys = (np.concatenate([c[k] for c, _ in lines]).astype(float) for k in (0, 1))
    ys = ys[np.isfinite(ys)]
    pen.rectangle((left, top, w - right, h - bottom), outline=(0xC0, 0xC0, 0xC0))
    if not len(ys):
        return image
    log = ys.min() > 0 and ys.max() / ys.min() > 10
    low, high = (np.log10(ys.min()), np.log10(ys.max())) if log else (ys.min(), ys.max())
    pad = 0.05 * max(high - low, 1e-9)
    low, high, last = low - pad, high + pad, float(xs.max()) or 1.0

    def at(x: float, y: float) -> tuple[float, float]:
        v = (np.log10(y) if log else y) - low
        return left + x / last * (w - left - right), h - bottom - v / (high - low) * (h - top - bottom)

    for t in np.linspace(low, high, 5):
        y = at(0, 10**t if log else t)[1]
        pen.line((left, y, w - right, y), fill=(0xE8, 0xE8, 0xE8))
        pen.text((4, y - 6), f"{10**t if log else t:.3g}", fill="black")
    for t in (0.0, 0.5, 1.0):
        pen.text((at(t * last, 10**low if log else low)[0] - 12 * t, h - bottom + 6), f"{t * last:g}", fill="black")
    for (x, y), colour in lines:
        points = [at(a, b) for a, b in zip(x, y, strict=True) if np.isfinite(b)]
        if len(points) > 1:
            pen.line(points, fill=colour, width=2)
        for p in points if len(points) < 40 else []:
            pen.ellipse((p[0] - 2, p[1] - 2, p[0] + 2, p[1] + 2), fill=colour)
    return image


def draw(folder: Path) -> Path:
    """Draws all curves of a run; SystemExit when it has none."""
    train, val = read_train(folder), read_val(folder)
    panels = []
    for name, (x, y) in train.items():
        panels.append(panel(f"train {name}", [((x, smooth(y, 4.0)), TRAIN)]))
    for name, curve in val.items():
        if name.startswith("flat_"):
            continue
        lines = [(curve, VAL)]
        if f"flat_{name}" in val:
            lines.append((val[f"flat_{name}"], GUESS))
        panels.append(panel(f"val {name}" + (" (grey: trivial guess)" if len(lines) > 1 else ""), lines))
    if not panels:
        raise SystemExit(f"{folder}: no curves yet: neither tensorboard/ nor val.jsonl holds any")
    rows = -(-len(panels) // COLUMNS)
    sheet = Image.new("RGB", (COLUMNS * PANEL[0], rows * PANEL[1]), "white")
    for i, p in enumerate(panels):
        sheet.paste(p, (i % COLUMNS * PANEL[0], i // COLUMNS * PANEL[1]))
    path = folder / "curves.png"
    sheet.save(path)
    return path
