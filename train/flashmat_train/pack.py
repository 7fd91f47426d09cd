"""One compact file of the training and validation materials and environments, for machines that see nothing else.

`python -m flashmat_train pack --data DIR --out materials.pack`, then `train --pack materials.pack` in place of --data.

A zip: `index.json` (class, name, split of each material), `NNNN.albedo.jpg`, `NNNN.normal.jpg` (no chroma
subsampling), `NNNN.roughness.jpg`, all scaled to --size; `environments.npz` (96x48 half floats and the brightest
pixels apart, as `Environments` filters them). The quality falls until the file is under the limit.
"""

from __future__ import annotations

import argparse
import io
import json
import zipfile
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from PIL import Image
from tqdm import tqdm

from . import CLASSES
from .data.materials import Entry, Material, data_root, load, scan
from .data.pool import to_bytes, to_float
from .render.envmap import Environments, Source
from .render.hdr import read_hdr

#: File limit that most ways of sending a file accept.
LIMIT_MIB = 55.0
QUALITIES = (93, 90, 87, 84, 80, 75, 70, 60, 50)
MAPS = {"albedo": slice(0, 3), "normal": slice(3, 6), "roughness": slice(6, 7)}


def add_arguments(p: argparse.ArgumentParser) -> None:
    p.add_argument("--data", help="data folder (default: FLASHMAT_DATA)")
    p.add_argument("--out", type=Path, required=True)
    p.add_argument("--size", type=int, default=512, help="shorter side of the packed maps")
    p.add_argument("--limit-mib", type=float, default=LIMIT_MIB)


def shrink(maps: np.ndarray, size: int) -> np.ndarray:
    """uint8 (7,H,W) with its shorter side at most `size`; filtered in linear light, normals made unit again."""
    h, w = maps.shape[1:]
    if min(h, w) <= size:
        return maps
    to = (round(h * size / min(h, w)), round(w * size / min(h, w)))
    x = to_float(torch.from_numpy(maps))
    x = F.interpolate(x[None], size=to, mode="bilinear", antialias=True)[0]
    n = x[3:6]
    x[3:6] = n / n.square().sum(dim=0, keepdim=True).sqrt().clamp_min(1e-6)
    return to_bytes(x).numpy()


def encode(maps: np.ndarray, quality: int) -> dict[str, bytes]:
    """The three JPEG files of a material."""
    out = {}
    for name, planes in MAPS.items():
        x = maps[planes].transpose(1, 2, 0)
        image = Image.fromarray(x if x.shape[2] == 3 else x[..., 0])
        buffer = io.BytesIO()
        image.save(buffer, "JPEG", quality=quality, subsampling=2 if name == "albedo" else 0)
        out[name] = buffer.getvalue()
    return out


def decode(files: dict[str, bytes]) -> np.ndarray:
    """The inverse of `encode`."""
    planes = [np.asarray(Image.open(io.BytesIO(files[name]))) for name in MAPS]
    return np.ascontiguousarray(
        np.concatenate([p if p.ndim == 3 else p[..., None] for p in planes], 2).transpose(2, 0, 1)
    )


def environment_bytes(sources: list[Source]) -> bytes:
    """environments.npz."""
    buffer = io.BytesIO()
    np.savez(
        buffer,
        radiance=np.stack([s.radiance.numpy() for s in sources]).clip(0, 6e4).astype(np.float16),
        sun_direction=np.stack([s.sun_direction.numpy() for s in sources]),
        sun_flux=np.stack([s.sun_flux.numpy() for s in sources]),
    )
    return buffer.getvalue()


def pack(entries: list[Entry], environments: list[Source], out: Path, size: int, limit_mib: float) -> int:
    """Writes the file; returns the JPEG quality that fitted. SystemExit when none does."""
    materials = [(e, shrink(load(e).maps, size)) for e in tqdm(entries, desc="read", mininterval=10)]
    light = environment_bytes(environments)
    index = [{"class": CLASSES[e.cls], "name": e.name, "split": e.split} for e in entries]
    for quality in QUALITIES:
        files = [encode(maps, quality) for _, maps in tqdm(materials, desc=f"quality {quality}", mininterval=10)]
        total = sum(len(data) for f in files for data in f.values()) + len(light) + 400 * len(files)
        if total <= limit_mib * 2**20:
            break
    else:
        raise SystemExit(f"{len(entries)} materials do not fit {limit_mib} MiB; give a smaller --size")
    out.parent.mkdir(parents=True, exist_ok=True)
    beside = out.with_name(out.name + ".tmp")
    with zipfile.ZipFile(beside, "w", zipfile.ZIP_STORED) as z:
        z.writestr("index.json", json.dumps({"quality": quality, "materials": index}))
        z.writestr("environments.npz", light)
        for i, f in enumerate(files):
            for name, data in f.items():
                z.writestr(f"{i:04d}.{name}.jpg", data)
    beside.replace(out)
    return quality


def unpack(path: Path, rotations: int = 6) -> tuple[list[Material], list[Material], Environments]:
    """(training materials, validation materials, environments); SystemExit when it is not such a file."""
    try:
        with zipfile.ZipFile(path) as z:
            index = json.loads(z.read("index.json"))["materials"]
            split: dict[str, list[Material]] = {"train": [], "val": []}
            for i, entry in enumerate(index):
                maps = decode({name: z.read(f"{i:04d}.{name}.jpg") for name in MAPS})
                split[entry["split"]].append(Material(CLASSES.index(entry["class"]), entry["name"], maps))
            light = np.load(io.BytesIO(z.read("environments.npz")))
    except (OSError, KeyError, ValueError, zipfile.BadZipFile) as e:
        raise SystemExit(f"{path}: not a pack of materials, or a damaged one ({e})") from e
    columns = (light[k].astype(np.float32) for k in ("radiance", "sun_direction", "sun_flux"))
    sources = [Source(*map(torch.from_numpy, row)) for row in zip(*columns, strict=True)]
    return split["train"], split["val"], Environments(sources, rotations, 7)


def run(args: argparse.Namespace) -> None:
    root = data_root(args.data)
    entries, problems = scan(root)
    for line in problems:
        print("skipped", line)
    entries = [e for e in entries if e.split in ("train", "val")]
    environments = [Source.of(read_hdr(f)) for f in sorted((root / "envmaps").glob("*.hdr"))]
    quality = pack(entries, environments, args.out, args.size, args.limit_mib)
    size = args.out.stat().st_size / 2**20
    print(f"{args.out}: {len(entries)} materials, {len(environments)} environments, quality {quality}, {size:.1f} MiB")
