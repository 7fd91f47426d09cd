"""A small generated data folder in the layout of the real one, so that tests need no download."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from PIL import Image

from flashmat_train import CLASSES
from flashmat_train.data.materials import Material
from flashmat_train.data.pool import to_bytes

SIZE = 160


def random_maps(seed: int, size: int = SIZE, coarse: int = 12) -> torch.Tensor:
    """Smooth float maps (7,size,size): linear albedo, unit normal, roughness."""
    g = torch.Generator().manual_seed(seed)
    x = F.interpolate(torch.rand(1, 6, coarse, coarse, generator=g), size=(size, size), mode="bicubic")[0].clamp(0, 1)
    n = torch.cat(((x[3:5] - 0.5) * 0.8, torch.ones(1, size, size)))
    return torch.cat((0.05 + 0.85 * x[:3], n / n.norm(dim=0), 0.3 + 0.6 * x[5:]))


def material(seed: int, cls: int = 0, size: int = SIZE) -> Material:
    return Material(cls, f"m{seed}", to_bytes(random_maps(seed, size)).numpy())


def write_material(folder: Path, seed: int, size: int = SIZE) -> None:
    """albedo, normal and roughness as PNG."""
    folder.mkdir(parents=True)
    maps = to_bytes(random_maps(seed, size)).numpy()
    for name, planes in (("albedo", maps[:3]), ("normal", maps[3:6]), ("roughness", maps[6:])):
        x = planes.transpose(1, 2, 0)
        Image.fromarray(x if x.shape[2] == 3 else x[..., 0]).save(folder / f"{name}.png")


def write_hdr(path: Path, pixels: np.ndarray) -> None:
    """Radiance RGBE, not run-length encoded."""
    top = np.maximum(pixels.max(axis=2), 1e-32)
    e = np.ceil(np.log2(top)).astype(int)
    rgb = np.clip(pixels * 256.0 / np.exp2(e)[..., None], 0, 255).astype(np.uint8)
    data = np.concatenate((rgb, (e + 128).astype(np.uint8)[..., None]), axis=2)
    h, w = top.shape
    path.write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y %d +X %d\n" % (h, w) + data.tobytes())


def sky(seed: int, h: int = 64) -> np.ndarray:
    """An environment (h,2h,3): a gradient, blobs and a small sun."""
    rng = np.random.default_rng(seed)
    up = np.linspace(1, 0.1, h)[:, None, None] * rng.uniform(0.3, 1.0, 3)
    x = np.broadcast_to(up, (h, 2 * h, 3)).copy()
    for _ in range(6):
        y, c = rng.integers(h), rng.integers(2 * h - 8)
        x[y : y + 6, c : c + 8] += rng.uniform(0, 3, 3)
    x[rng.integers(4, h // 3), rng.integers(2 * h)] += 900.0
    return x.astype(np.float32)


def write_data(root: Path, environments: int = 2) -> Path:
    """Two training materials and one for validation of each class, and environments."""
    lines = ["class\tname\tsplit"]
    for c, cls in enumerate(CLASSES):
        for k, split in enumerate(("train", "train", "val")):
            write_material(root / "materials" / cls / f"{cls}{k}", 10 * c + k)
            lines.append(f"{cls}\t{cls}{k}\t{split}")
    (root / "splits.tsv").write_text("\n".join(lines) + "\n")
    (root / "envmaps").mkdir()
    for i in range(environments):
        write_hdr(root / "envmaps" / f"sky{i}.hdr", sky(i))
    return root
