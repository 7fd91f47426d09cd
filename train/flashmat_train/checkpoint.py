"""Checkpoints: one file or several of bounded size, written beside and renamed, so that none is ever half there."""

from __future__ import annotations

import io
import os
from pathlib import Path

import torch

PART = 15 << 20


def save(state: dict, path: Path, split: bool = False) -> None:
    """Writes a checkpoint; `split` writes path.000, path.001, … of at most 15 MiB each instead.

    What an earlier call left in the other form, or of more parts, is removed.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    buffer = io.BytesIO()
    torch.save(state, buffer)
    data = buffer.getvalue()
    if split:
        starts = range(0, len(data), PART)
        files = {path.with_name(f"{path.name}.{i:03d}"): data[at : at + PART] for i, at in enumerate(starts)}
    else:
        files = {path: data}
    for file, content in files.items():
        _beside(file).write_bytes(content)
    for file in files:
        os.replace(_beside(file), file)
    for old in (path, *path.parent.glob(path.name + ".[0-9][0-9][0-9]")):
        if old not in files:
            old.unlink(missing_ok=True)


def load(path: Path) -> dict:
    """Reads a checkpoint in either form; raises FileNotFoundError with the path when there is none."""
    if path.is_file():
        data = path.read_bytes()
    else:
        parts = sorted(path.parent.glob(path.name + ".[0-9][0-9][0-9]"))
        if not parts:
            raise FileNotFoundError(f"{path}: no checkpoint here, whole or in parts")
        data = b"".join(p.read_bytes() for p in parts)
    return torch.load(io.BytesIO(data), map_location="cpu", weights_only=True)


def exists(path: Path) -> bool:
    """Whether `load` would find one."""
    return path.is_file() or path.with_name(path.name + ".000").is_file()


def _beside(path: Path) -> Path:
    return path.with_name(path.name + ".tmp")
