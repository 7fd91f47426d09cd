"""Folders of PBR materials: <root>/materials/<class>/<name>/{albedo,normal,roughness[,metallic]}.{jpg,png}.

Albedo is sRGB 8 bit, normals OpenGL (+Y up), roughness perceptual (alpha = r²), as the data set's README says. A bad
folder is named and skipped, never silently: `scan` returns the reasons beside the materials.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from .. import CLASSES

MAPS = ("albedo", "normal", "roughness")
EXTENSIONS = (".png", ".jpg", ".jpeg", ".webp", ".tif", ".tiff")


@dataclass(frozen=True)
class Entry:
    """One material folder that has all its maps."""

    cls: int
    name: str
    split: str
    folder: Path
    files: dict[str, Path]


@dataclass
class Material:
    """Maps of one material, uint8: albedo sRGB (3), normal (3, (n+1)/2 * 255), roughness (1), stacked (7,H,W); and,
    where it has one and it was asked for, the metallic map (H,W)."""

    cls: int
    name: str
    maps: np.ndarray
    metallic: np.ndarray | None = None


def data_root(option: str | None) -> Path:
    """The data folder: the option, else FLASHMAT_DATA."""
    root = option or os.environ.get("FLASHMAT_DATA")
    if not root:
        raise SystemExit("no data folder: give --data DIR or set FLASHMAT_DATA (it holds materials/<class>/<name>/)")
    path = Path(root)
    if not (path / "materials").is_dir():
        raise SystemExit(f"{path}: has no folder 'materials'; see train/README.md for the layout")
    return path


def read_splits(path: Path) -> dict[tuple[str, str], str]:
    """splits.tsv (class, name, split) as a table; materials it does not list are for training."""
    if not path.is_file():
        return {}
    rows = (line.rstrip("\n").split("\t") for line in path.read_text().splitlines()[1:])
    return {(r[0], r[1]): r[2] for r in rows if len(r) == 3}


def scan(root: Path) -> tuple[list[Entry], list[str]]:
    """All usable material folders, and a line for each folder that is not, saying why."""
    splits = read_splits(root / "splits.tsv")
    entries, problems = [], []
    for cls_dir in sorted((root / "materials").iterdir()):
        if not cls_dir.is_dir():
            continue
        if cls_dir.name not in CLASSES:
            problems.append(f"{cls_dir}: not one of the classes {', '.join(CLASSES)}")
            continue
        for folder in sorted(p for p in cls_dir.iterdir() if p.is_dir()):
            files = {m: f for m in (*MAPS, "metallic") if (f := _find(folder, m))}
            missing = [m for m in MAPS if m not in files]
            if missing:
                problems.append(f"{folder}: no {', '.join(missing)} map")
                continue
            try:
                sizes = {m: _size(f) for m, f in files.items()}
            except (OSError, ValueError) as e:
                problems.append(f"{folder}: {e}")
                continue
            if len(set(sizes.values())) > 1:
                problems.append(f"{folder}: map sizes differ: {sizes}")
                continue
            if min(next(iter(sizes.values()))) < 128:
                problems.append(f"{folder}: maps under 128 pixels: {sizes}")
                continue
            split = splits.get((cls_dir.name, folder.name), "train")
            entries.append(Entry(CLASSES.index(cls_dir.name), folder.name, split, folder, files))
    return entries, problems


def load(entry: Entry, metallic: bool = False) -> Material:
    """Reads the maps of one folder, the metallic map only if asked to; raises OSError or ValueError with the file's
    name."""
    try:
        albedo = np.asarray(Image.open(entry.files["albedo"]).convert("RGB"))
        normal = np.asarray(Image.open(entry.files["normal"]).convert("RGB"))
        rough = np.asarray(Image.open(entry.files["roughness"]).convert("L"))[..., None]
        metal = None
        if metallic and "metallic" in entry.files:
            metal = np.asarray(Image.open(entry.files["metallic"]).convert("L"))
    except OSError as e:
        raise OSError(f"{entry.folder}: {e}") from e
    maps = np.concatenate((albedo, normal, rough), axis=2).transpose(2, 0, 1)
    return Material(entry.cls, entry.name, np.ascontiguousarray(maps), metal)


def _find(folder: Path, name: str) -> Path | None:
    return next((f for e in EXTENSIONS if (f := folder / (name + e)).is_file()), None)


def _size(path: Path) -> tuple[int, int]:
    with Image.open(path) as image:
        return image.size
