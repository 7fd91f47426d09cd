#!/usr/bin/env python3
"""Writes the tables of docs/results.md from what the programs measured.

    flashmat eval TESTSET --light-scale 1 --compare --csv eval.csv --sweep sweep.csv
    flashmat bench > bench.txt
    tools/results.py --accuracy eval.csv --sweep sweep.csv --speed bench.txt --command 'flashmat eval ...'

A section whose file is not given stays as it is, with the commit and the network that it was measured with. The first
line of each section says these two. The network's hash leaves out the card, so a new card does not make tables old.
Standard library only.
"""

from __future__ import annotations

import argparse
import csv
import hashlib
import re
import struct
import subprocess
from collections.abc import Callable, Iterable
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
# What decides a capture: graph, weights, CRF coefficients, the training's light and camera.
NETWORK_SECTIONS = (b"GRPH", b"WGT8", b"PARM", b"CRFC", b"DFLT")
# Heading, column of the CSV, format.
ERRORS = (
    ("albedo", "albedo_mse_paper", "{:.4f}"),
    ("scale-invariant", "albedo_scaled_mse_paper", "{:.4f}"),
    ("normal", "normal_mse_paper", "{:.4f}"),
    ("roughness", "roughness_mse_paper", "{:.4f}"),
    ("angle", "angle_deg", "{:.1f}°"),
    ("class", "right", "{:.0f} %"),
    ("relighting RMSE", "relit_rmse", "{:.3f}"),
)


class ResultsError(Exception):
    """A file that is not what the option asks for."""


def model_hashes(data: bytes) -> tuple[str, str]:
    """SHA-256 of the whole file, and the first eight digits of that of its network, card left out."""
    if data[:8] != b"FLASHMAT":
        raise ResultsError("not a model file")
    network = hashlib.sha256()
    (count,) = struct.unpack_from("<I", data, 12)
    for i in range(count):
        kind, _, offset, length, _ = struct.unpack_from("<4sIQQQ", data, 64 + 32 * i)
        if kind in NETWORK_SECTIONS:
            network.update(data[offset : offset + length])
    return hashlib.sha256(data).hexdigest(), network.hexdigest()[:8]


def table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """A Markdown table."""
    head = list(head)
    lines = [head, ["---"] * len(head), *map(list, rows)]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def read_csv(path: Path, needed: Iterable[str]) -> list[dict[str, str]]:
    """The rows; all of `needed` are among the columns."""
    with path.open(newline="") as f:
        rows = list(csv.DictReader(f))
    missing = [name for name in needed if not rows or name not in rows[0]]
    if missing:
        raise ResultsError(f"{path}: no rows, or no column {missing[0]!r}")
    return rows


def accuracy(path: Path) -> str:
    """Means of `flashmat eval --csv`: every method, and the first method by class."""
    rows = read_csv(path, ["method", "class", "found", *(key for _, key, _ in ERRORS if key != "right")])
    for row in rows:
        row["right"] = "100" if row["class"] == row["found"] else "0"

    def cells(name: str, chosen: list[dict[str, str]]) -> list[str]:
        means = [sum(float(row[key]) for row in chosen) / len(chosen) for _, key, _ in ERRORS]
        return [name, *(form.format(mean) for (_, _, form), mean in zip(ERRORS, means, strict=True))]

    methods = list(dict.fromkeys(row["method"] for row in rows))
    first = [row for row in rows if row["method"] == methods[0]]
    classes = list(dict.fromkeys(row["class"] for row in first))
    heads = ["", *(head for head, _, _ in ERRORS)]
    whole = table(heads, (cells(m, [row for row in rows if row["method"] == m]) for m in methods))
    by_class = []
    for name in classes:
        chosen = [row for row in first if row["class"] == name]
        by_class.append(cells(f"{name} ({len(chosen)})", chosen))
    return f"{whole}\n\nBy class, {methods[0]}, {len(first)} photos:\n\n{table(heads, by_class)}"


def sweep(path: Path) -> str:
    """`flashmat eval --sweep`, a column for each strength of the room's light."""
    keys = ("albedo_mse_paper", "albedo_scaled_mse_paper", "normal_mse_paper", "roughness_mse_paper", "class_right")
    rows = read_csv(path, ["environment", *keys])
    forms: tuple[Callable[[float], str], ...] = (*("{:.4f}".format for _ in range(4)), lambda x: f"{100 * x:.0f} %")
    names = ("albedo", "scale-invariant", "normal", "roughness", "class")
    head = ["room / flash", *(f"{float(row['environment']):g}" for row in rows)]
    return table(head, ([n, *(f(float(row[k])) for row in rows)] for n, k, f in zip(names, keys, forms, strict=True)))


def speed(path: Path) -> str:
    """The first table of `flashmat bench`, columns as it names them."""
    lines = [line.replace("|", " ").split() for line in path.read_text().splitlines()]
    start = next((i for i, line in enumerate(lines) if line[:2] == ["size", "level"]), None)
    if start is None:
        raise ResultsError(f"{path}: not what `flashmat bench` prints")
    rows = []
    for line in lines[start + 1 :]:
        if not line:
            break
        rows.append([f"{line[0]}²", *line[1:-2], " ".join(line[-2:])])
    return table(lines[start], rows)


def replaced(text: str, name: str, body: str) -> str:
    """`text` with another body between the marks of a section."""
    pattern = re.compile(rf"(<!-- begin {name} -->\n).*?(\n<!-- end {name} -->)", re.S)
    if not pattern.search(text):
        raise ResultsError(f"docs/results.md has no section {name!r}")
    return pattern.sub(lambda m: m[1] + body + m[2], text, count=1)


def main() -> None:
    """Reads the command line, writes the page."""
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--accuracy", type=Path, metavar="CSV")
    p.add_argument("--sweep", type=Path, metavar="CSV")
    p.add_argument("--speed", type=Path, metavar="TEXT")
    p.add_argument("--command", default="", help="what was run, in one line")
    p.add_argument("--machine", default="", help="CPU, and what ran beside it")
    p.add_argument("--model", type=Path, default=ROOT / "models/phone.fmat")
    p.add_argument("--page", type=Path, default=ROOT / "docs/results.md")
    args = p.parse_args()
    whole, network = model_hashes(args.model.read_bytes())
    commit = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, check=True, capture_output=True, text=True
    ).stdout.strip()
    source = f"Commit {commit}, network {network}."
    if args.command:
        source += f"\n`{args.command}`"
    if args.machine:
        source += f"\n{args.machine}"
    text = args.page.read_text()
    text = replaced(text, "model", f"`models/{args.model.name}`: network {network}, SHA-256 of the file\n`{whole}`.")
    for name, make in (("accuracy", accuracy), ("sweep", sweep), ("speed", speed)):
        path = getattr(args, name)
        if path is not None:
            text = replaced(text, name, f"{source}\n\n{make(path)}")
    args.page.write_text(text)


if __name__ == "__main__":
    try:
        main()
    except (OSError, ResultsError) as error:
        raise SystemExit(f"results.py: {error}") from error
