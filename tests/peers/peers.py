"""Our network and its peers', the same weights and the same photo, in turn, one thread each: medians and ratios.

    pip install -e train -r tests/peers/requirements.txt
    cargo build --release -p flashmat-tests --features tract --example peer
    python tests/peers/peers.py [--model models/phone.fmat] [--size 256] [--rounds 40]

Ours: int8 on the fastest level and on AVX2; tract running the float network. ONNX Runtime: its own static quantisation
of the exported graph (QDQ, per-channel s8 weights, u8 activations, every convolution), float, and both in a copy held
to AVX2. Times are CPU milliseconds of the calling thread, which other programs disturb less than the wall clock; ours
include the conversion of the photo to the network's input, ONNX Runtime's do not. Shares are of the level's peak,
measured in the same turns.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import onnxruntime

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
sys.path[:0] = [str(HERE), str(ROOT / "train")]

import graphs
import limit
from flashmat_train import modelfile


class Engine:
    """A process that runs when told to."""

    def __init__(self, name: str, command: list[str], **env: str) -> None:
        self.name, self.times, self.peaks = name, [], []
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env={**os.environ, **env}
        )
        self.words = self.process.stdout.readline().split()

    @property
    def ready(self) -> bool:
        return bool(self.words) and self.words[0] == "ready"

    def ask(self, what: str) -> list[float]:
        self.process.stdin.write(what + "\n")
        self.process.stdin.flush()
        return [float(word) for word in self.process.stdout.readline().split()]

    def turn(self, ours: bool) -> None:
        self.times.append(self.ask("run")[1])
        if ours:
            self.peaks.append(self.ask("peak")[0])

    @property
    def median(self) -> float:
        return statistics.median(self.times)


def photo(size: int, seed: int) -> np.ndarray:
    """A flash photo of a made-up surface: planar linear RGB."""
    rng = np.random.default_rng(seed)
    y, x = (np.mgrid[:size, :size] + 0.5) / size * 2 - 1
    waves = sum(np.sin(rng.uniform(3, 40) * (x * np.cos(a) + y * np.sin(a))) for a in rng.uniform(0, 6, 4)) / 8
    colour = rng.uniform(0.2, 0.8, 3)[:, None, None]
    return (colour * (0.6 + waves + rng.normal(0, 0.05, (3, size, size))) * np.exp(-1.5 * (x * x + y * y))).clip(0, 1)


def network_input(rgb: np.ndarray) -> np.ndarray:
    """What core/src/net/op_input.rs makes of a photo: 8-bit sRGB codes and the coordinates, (1,6,n,n), light unknown."""
    size = rgb.shape[1]
    encoded = np.where(rgb <= 0.0031308, 12.92 * rgb, 1.055 * np.maximum(rgb, 1e-9) ** (1 / 2.4) - 0.055)
    reach = np.tan(np.deg2rad(43.35) / 2) / 0.75
    centre = (((2 * np.arange(size) + 1) / size - 1) * reach + 1) / 2
    across = np.broadcast_to(centre, (size, size))
    planes = np.stack([*encoded, across, np.ascontiguousarray(across[::-1, ::-1].T), np.zeros((size, size))])
    return (np.rint(planes * 255) / 255).astype(np.float32)[None]


def arguments() -> argparse.Namespace:
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--model", type=Path, default=ROOT / "models/phone.fmat")
    p.add_argument("--size", type=int, default=256)
    p.add_argument("--rounds", type=int, default=40)
    target = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
    p.add_argument("--peer", type=Path, default=target / "release/examples/peer")
    p.add_argument(
        "--levels", nargs="*", default=["avx512vnni", "avx2"], help="ours; those that the CPU lacks are left out"
    )
    return p.parse_args()


def engines(args: argparse.Namespace, folder: Path) -> dict[str, Engine]:
    """All that run here, ours first."""
    model = modelfile.read_model(args.model)
    rgb = photo(args.size, 1)
    rgb.astype("<f4").tofile(folder / "photo")
    out: dict[str, Engine] = {}
    for level in [*args.levels, "float"]:
        name = "tract float" if level == "float" else f"flashmat int8 {level}"
        line = [args.peer, args.model, args.size, folder / "photo", folder / f"{level}.maps", level]
        engine = Engine(name, [str(word) for word in line])
        if engine.ready:
            out[level] = engine
        else:
            print(f"NOT RUN: {name}")
    if not any(level in out for level in args.levels):
        raise SystemExit("none of our levels runs; build the example `peer` first")
    first = next(out[level] for level in args.levels if level in out)
    calibration = [network_input(photo(args.size, seed)) for seed in range(2, 10)]
    probabilities = np.array([float(p) for p in first.words[2:]])
    plain, int8 = graphs.write(model, probabilities, calibration, folder)
    np.save(folder / "input.npy", network_input(rgb))
    package = Path(onnxruntime.__file__).parent
    limited = limit.copy(package, folder / "limited")
    workers = {"ort-int8": ("ONNX Runtime int8", int8, {}), "ort-float": ("ONNX Runtime float", plain, {})}
    if limited:
        workers["ort-int8-avx2"] = ("ONNX Runtime int8, AVX2", int8, {"PYTHONPATH": str(folder / "limited")})
        workers["ort-float-avx2"] = ("ONNX Runtime float, AVX2", plain, {"PYTHONPATH": str(folder / "limited")})
    else:
        print("NOT RUN: ONNX Runtime limited to AVX2: its library has other code than limit.py expects")
    for key, (name, graph, env) in workers.items():
        line = [sys.executable, HERE / "ort_worker.py", graph, folder / "input.npy", folder / f"{key}.npz"]
        out[key] = Engine(name, [str(word) for word in line], **env)
        if not out[key].ready:
            raise SystemExit(f"{name} does not run")
    return out


def maps_of(key: str, folder: Path, size: int) -> np.ndarray:
    """Albedo, normal, roughness: (7,n,n)."""
    if (folder / f"{key}.maps").exists():
        return np.fromfile(folder / f"{key}.maps", "<f4").reshape(7, size, size)
    with np.load(folder / f"{key}.npz") as file:
        return np.concatenate([file[name][0] for name in ("albedo", "normal", "roughness")])


def main() -> None:
    args = arguments()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        running = engines(args, folder)
        for _ in range(args.rounds):
            for key, engine in running.items():
                engine.turn(key in args.levels)
        exact = maps_of("ort-float", folder, args.size)
        work = float(running[next(k for k in running if k in args.levels)].words[1])
        print(
            f"\n{args.model.name}, {work:.3f} GMAC at {args.size}; medians of {args.rounds} turns, one thread, CPU time"
        )
        print(f"{'engine':26} {'ms':>8} {'GMAC/s':>8} {'peak':>7} {'share':>6} {'RMS to ORT float':>17}")
        for key, engine in running.items():
            rate, peak = work / engine.median * 1e3, statistics.median(engine.peaks or [0]) * 1e-9
            share = f"{peak:7.1f} {100 * rate / peak:4.0f} %" if peak else f"{'-':>7} {'-':>6}"
            gap = np.sqrt(np.mean((maps_of(key, folder, args.size) - exact) ** 2))
            print(f"{engine.name:26} {engine.median:8.2f} {rate:8.1f} {share} {gap:17.4f}")
        print()
        best = next(k for k in args.levels if k in running)
        pairs = [(best, other) for other in ("ort-int8", "ort-float", "float")]
        pairs += [("avx2", "ort-int8-avx2"), ("avx2", "ort-float-avx2"), ("avx2", "float")]
        for ours, other in pairs:
            if ours in running and other in running:
                ratios = [b / a for a, b in zip(running[ours].times, running[other].times, strict=True)]
                low, _, high = statistics.quantiles(ratios, n=4)
                ratio = running[other].median / running[ours].median
                print(
                    f"{running[ours].name} is {ratio:.2f} times as fast as {running[other].name}"
                    f" (half of the turns between {low:.2f} and {high:.2f})"
                )


if __name__ == "__main__":
    main()
