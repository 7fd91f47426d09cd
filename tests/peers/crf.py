"""One bilateral kernel, position and colour, over a three-channel map: our sampled graph, a dense-CRF library's
permutohedral lattice and the plain sum over all pairs, in turn, one thread each: medians, ratios, and errors.

    pip install "cython<3.1" "setuptools<80" wheel "numpy>=2,<3"
    pip install --no-build-isolation -r tests/peers/requirements-crf.txt
    cargo build --release -p flashmat-tests --example crf_peer
    python tests/peers/crf.py [--size 256] [--rounds 20] [--scenes tiles noise]

All three compute L x with (L x)_i = sum_j Kn(i,j) (x_i - x_j) of the same symmetrically normalised Gaussian kernel of
the same inputs; errors are |L x - exact| / |exact| against the plain sum. The library filters inside a mean-field step,
whose time without a kernel is taken off its time with one. The plain sum is only run once for the errors, and at
--naive pixels per side for its time. Times are CPU milliseconds of the calling thread.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pydensecrf.densecrf as dense

ROOT = Path(__file__).parents[2]
# Positions in units of half the image's width, colours in linear light: a CRF's usual widths (core/src/crf/feature.rs).
SIGMA_POSITION, SIGMA_COLOUR = 0.06, 0.1


def scene(size: int, kind: str) -> tuple[np.ndarray, np.ndarray]:
    """Colours, (3,n,n), and a map to filter of the same shape: smooth shapes with a grain, or white noise."""
    rng = np.random.default_rng(1)
    if kind == "noise":
        return rng.random((3, size, size)), rng.random((3, size, size))
    y, x = (np.mgrid[:size, :size] + 0.5) / size
    tile = (np.floor(4 * (x + 0.05 * np.sin(9 * y))) + 4 * np.floor(4 * (y + 0.04 * np.cos(7 * x)))).astype(int) % 16
    grain = 0.85 + 0.15 * np.sin(60 * x + 8 * np.sin(11 * y)) * np.cos(40 * y)
    colours = rng.uniform(0.15, 0.75, (16, 3))[tile].transpose(2, 0, 1) * grain
    colours = (colours + rng.uniform(-0.01, 0.01, colours.shape)).clip(0, 1)
    return colours, (colours + rng.uniform(-0.05, 0.05, colours.shape)).clip(0, 1)


class Ours:
    """The process of crf_server.rs."""

    def __init__(self, peer: Path, folder: Path, features: np.ndarray, x: np.ndarray) -> None:
        self.size, self.out = x.shape[1], folder / f"{x.shape[1]}.out"
        source = folder / f"{self.size}.in"
        np.concatenate([features, x]).astype("<f4").tofile(source)
        command = [str(word) for word in (peer, self.size, source, self.out)]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self.level = self.process.stdout.readline().split()[1]

    def ask(self, what: str) -> float:
        self.process.stdin.write(what + "\n")
        self.process.stdin.flush()
        return float(self.process.stdout.readline())

    def result(self) -> np.ndarray:
        return np.fromfile(self.out, "<f4").reshape(3, self.size, self.size)


def clock(work: Callable[[], object]) -> float:
    start = time.thread_time()
    work()
    return (time.thread_time() - start) * 1e3


class Lattice:
    """pydensecrf2's kernel: Krähenbühl and Koltun's permutohedral lattice."""

    def __init__(self, features: np.ndarray) -> None:
        size = features.shape[1]
        y, x = np.mgrid[:size, :size] / (0.5 * SIGMA_POSITION * size)
        self.features = np.ascontiguousarray(np.stack([x, y, *features]).reshape(5, -1), np.float32)

    def crf(self, q: np.ndarray, weights: np.ndarray | None) -> dense.DenseCRF:
        """A CRF whose unaries ask for the distributions `q`, (labels, pixels)."""
        crf = dense.DenseCRF(q.shape[1], len(q))
        crf.setUnaryEnergy(np.ascontiguousarray(-np.log(q), np.float32))
        if weights is not None:
            crf.addPairwiseEnergy(self.features, weights, dense.CONST_KERNEL, dense.NORMALIZE_SYMMETRIC)
        return crf

    def times(self, x: np.ndarray) -> tuple[float, float]:
        """Building the lattice with its normalisation, and filtering three channels."""
        q = (x / x.sum(0)).clip(1e-6).reshape(3, -1)
        plain, full = self.crf(q, None), self.crf(q, None)
        ones = np.ones(3, np.float32)
        build = clock(
            lambda: full.addPairwiseEnergy(self.features, ones, dense.CONST_KERNEL, dense.NORMALIZE_SYMMETRIC)
        )
        return build, self.step(full) - self.step(plain)

    @staticmethod
    def step(crf: dense.DenseCRF) -> float:
        state = crf.startInference()
        return clock(lambda: crf.stepInference(*state))

    def filtered(self, channels: np.ndarray) -> np.ndarray:
        """Kn times channels in (0,1) whose sum is below 1, through a mean-field step: a fourth label without a weight
        tells what the others' logarithms moved by."""
        q = np.concatenate([channels, 1 - channels.sum(0, keepdims=True)])
        crf = self.crf(q, np.array([1, 1, 1, 0], np.float32))
        state = crf.startInference()
        before = np.log(np.array(state[0], np.float64))
        crf.stepInference(*state)
        moved = np.log(np.array(state[0], np.float64)) - before
        return np.abs(moved[:3] - moved[3])

    def laplacian(self, x: np.ndarray) -> np.ndarray:
        scaled = (0.01 + 0.29 * x).reshape(3, -1)
        row_sums = self.filtered(np.full_like(scaled, 0.25)) / 0.25
        return ((row_sums * scaled - self.filtered(scaled)) / 0.29).reshape(x.shape)


def error(found: np.ndarray, exact: np.ndarray) -> float:
    return float(np.linalg.norm(found - exact) / np.linalg.norm(exact))


def measure(kind: str, size: int, rounds: int, naive_too: bool, peer: Path, folder: Path) -> None:
    """One table: every engine on the same inputs, in turn."""
    colours, x = scene(size, kind)
    features = colours / SIGMA_COLOUR
    ours, lattice = Ours(peer, folder, features, x), Lattice(features)
    times: dict[str, list[float]] = {name: [] for name in ("build", "apply", "lattice build", "lattice apply", "naive")}
    for _ in range(rounds):
        times["build"].append(ours.ask("build"))
        times["apply"].append(ours.ask("apply"))
        build, apply = lattice.times(x)
        times["lattice build"].append(build)
        times["lattice apply"].append(apply)
        if naive_too:
            times["naive"].append(ours.ask("naive"))
    ours.ask("apply")
    graph = ours.result()
    once = ours.ask("naive")
    exact = ours.result()
    times["naive"].append(once)
    ms = {name: statistics.median(values) for name, values in times.items()}
    print(f"\n{kind}, {size} x {size}, medians of {rounds} turns, ours on {ours.level}")
    print(f"{'':12}{'build ms':>10}{'apply ms':>10}{'error':>10}")
    print(f"{'ours':12}{ms['build']:10.2f}{ms['apply']:10.2f}{error(graph, exact):10.1e}")
    found = error(lattice.laplacian(x), exact)
    print(f"{'pydensecrf2':12}{ms['lattice build']:10.2f}{ms['lattice apply']:10.2f}{found:10.1e}")
    print(f"{'all pairs':12}{'':10}{ms['naive']:10.0f}{'exact':>10}{'' if naive_too else '  (timed once)'}")
    print(
        f"ours is {ms['lattice build'] / ms['build']:.1f} times as fast to build and"
        f" {ms['lattice apply'] / ms['apply']:.1f} times to apply as pydensecrf2,"
        f" {ms['naive'] / (ms['build'] + ms['apply']):.0f} times (both) as all pairs"
    )


def main() -> None:
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--size", type=int, default=256)
    p.add_argument("--naive", type=int, default=64, help="pixels per side at which the plain sum takes turns")
    p.add_argument("--rounds", type=int, default=20)
    p.add_argument("--scenes", nargs="*", default=["tiles", "noise"])
    target = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
    p.add_argument("--peer", type=Path, default=target / "release/examples/crf_peer")
    args = p.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        for kind in args.scenes:
            for size in (args.naive, args.size):
                measure(kind, size, args.rounds, size == args.naive, args.peer, Path(folder))


if __name__ == "__main__":
    main()
