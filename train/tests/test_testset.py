"""The stage `testset`: files, seeds, resumption, and that both renderers show the same scenes."""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
import zlib
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from flashmat_train.__main__ import main
from flashmat_train.data.materials import load, scan
from flashmat_train.data.pool import srgb_encode
from flashmat_train.png16 import write_png16
from flashmat_train.render.envmap import random_rotation
from flashmat_train.testset import ENVIRONMENT_WHITE, shots, white_luminance

FILES = {"photo.png", "albedo.png", "normal.png", "roughness.png", "environment.png", "scene.json"}


def read_png16(path: Path) -> np.ndarray:
    """What `write_png16` wrote, in [0,1], (n,n,channels); a second reading of the format, for its filter 2 alone."""
    data = path.read_bytes()
    w, h = (int.from_bytes(data[at : at + 4]) for at in (16, 20))
    channels = {0: 1, 2: 3}[data[25]]
    start = data.index(b"IDAT")
    length = int.from_bytes(data[start - 4 : start])
    lines = np.frombuffer(zlib.decompress(data[start + 4 : start + 4 + length]), np.uint8).reshape(h, -1)
    assert (lines[:, 0] == 2).all()
    wide = np.cumsum(lines[:, 1:].astype(np.uint64), axis=0).astype(np.uint8)
    return np.frombuffer(wide.tobytes(), ">u2").reshape(h, w, channels) / 65535.0


def options(data: Path, out: Path, *more: str) -> list[str]:
    return ["testset", "--data", str(data), "--out", str(out), "--split", "val", "--size", "32", *more]


def test_png16_holds_16_bits_and_pillow_reads_it(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    for shape in ((5, 7), (5, 7, 3)):
        x = rng.random(shape)
        write_png16(tmp_path / "x.png", x)
        assert np.abs(read_png16(tmp_path / "x.png").reshape(shape) - x).max() <= 0.5 / 65535 + 1e-9
        with Image.open(tmp_path / "x.png") as image:
            assert image.size == (7, 5)
            seen = np.asarray(image).astype(float)
        assert np.abs(seen / (255 if x.ndim == 3 else 65535) - x).max() < 0.005


def test_white_is_white_under_a_constant_environment_however_it_is_turned() -> None:
    rng = np.random.default_rng(2)
    for _ in range(3):
        assert abs(white_luminance(np.full((64, 128, 3), 2.5), random_rotation(rng)) - 2.5) < 2e-3


def test_shots_take_all_materials_in_turn_and_depend_on_the_seed_alone(data_folder: Path) -> None:
    entries = [e for e in scan(data_folder)[0] if e.split == "val"]
    files = sorted((data_folder / "envmaps").glob("*.hdr"))
    one, more, other = (shots(entries, files, k, 0.8, seed) for k, seed in ((1, 5), (3, 5), (1, 6)))
    assert [s.entry for s in one] == entries and len(more) == 3 * len(entries)
    assert [s.strength for s in one] == [s.strength for s in more[: len(one)]] != [s.strength for s in other]
    assert all(0 <= s.strength <= 0.8 for s in more) and len({s.name for s in more}) == len(more)


def test_photo_maps_and_scene_agree_and_a_second_run_makes_only_what_is_missing(
    data_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    args = options(data_folder, tmp_path / "set", "--renderer", "ours", "--per-material", "1")
    main(args)
    folders = sorted((tmp_path / "set").glob("*/*/"))
    assert len(folders) == 8 and all({f.name for f in folder.iterdir()} == FILES for folder in folders)
    folder = folders[2]
    facts = json.loads((folder / "scene.json").read_text())
    assert folder.parent.name == facts["class"] and folder.name == facts["material"] + "__00"
    # under the flash the plane is at most as bright as its albedo, where its highlight is not; the environment adds
    around = read_png16(folder / "environment.png") * ENVIRONMENT_WHITE
    photo = np.asarray(Image.open(folder / "photo.png")) / 255.0
    least = srgb_encode(torch.from_numpy(facts["environment_strength"] * around).clamp(0, 1)).numpy()
    assert (photo >= least - 0.6 / 255).all() and photo.max() > least.max()
    albedo = read_png16(folder / "albedo.png")
    entry = next(e for e in scan(data_folder)[0] if e.name == facts["material"])
    assert albedo.min() >= load(entry).maps[:3].min() / 255 - 0.01

    before = (folder / "photo.png").stat().st_mtime_ns, (folders[0] / "photo.png").read_bytes()
    for file in folders[0].iterdir():
        file.unlink()
    folders[0].rmdir()
    capsys.readouterr()
    main(args)
    assert "1 to make" in capsys.readouterr().out
    assert ((folder / "photo.png").stat().st_mtime_ns, (folders[0] / "photo.png").read_bytes()) == before
    with pytest.raises(SystemExit, match="other options"):
        main([*args, "--seed", "1"])


def test_mitsuba_shows_the_same_scenes(data_folder: Path, tmp_path: Path) -> None:
    required = bool(os.environ.get("FLASHMAT_REQUIRE_MITSUBA"))
    if importlib.util.find_spec("mitsuba") is None and not required:
        pytest.skip("Mitsuba 3 is not installed (pip install mitsuba): no photos were compared")
    path = os.pathsep.join([str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH", "")])
    # in a process of its own: an LLVM too old for Dr.Jit aborts the process
    args = options(data_folder, tmp_path / "theirs", "--per-material", "1", "--spp", "1024")
    done = subprocess.run(
        [sys.executable, "-m", "flashmat_train", *args],
        env=os.environ | {"PYTHONPATH": path},
        capture_output=True,
        text=True,
        timeout=900,
    )
    if not required and ("Mitsuba has no variant that runs here" in done.stderr or "LLVM ERROR" in done.stderr):
        pytest.skip("Mitsuba has no usable LLVM here: no photos were compared")
    assert done.returncode == 0, done.stdout + done.stderr[-2000:]
    main(options(data_folder, tmp_path / "ours", "--renderer", "ours", "--per-material", "1"))
    for ours in sorted((tmp_path / "ours").glob("*/*/")):
        theirs = tmp_path / "theirs" / ours.relative_to(tmp_path / "ours")
        for name in FILES - {"photo.png", "environment.png"}:
            assert (ours / name).read_bytes() == (theirs / name).read_bytes(), name
        photos = [np.asarray(Image.open(f / "photo.png")).astype(float) for f in (ours, theirs)]
        print(ours.name, np.abs(photos[0] - photos[1]).mean())
        assert np.abs(photos[0] - photos[1]).mean() < 3
