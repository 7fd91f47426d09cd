"""Procedural materials made while training goes on, in the data loader's workers (`--procedural-fresh`).

For machines with many cores and a GPU. Worker w of a loader sees the batches w, w + workers, …; each such lane has
its own row of materials, of which the last few are in use at a time, and a new one enters every `reuse` samples. So
sample i is a function of (seed, i) for a given number of workers, and no worker makes what another has made.
"""

from __future__ import annotations

from collections import OrderedDict

import numpy as np
import torch
from torch import Tensor

from .. import CLASSES
from .materials import Material
from .pool import Pool, to_bytes

#: Materials of a lane in use at a time.
WINDOW = 8


class FreshPool:
    """Stands where a `Pool` stands; its materials are made when they are first drawn from."""

    def __init__(self, seed: int, lanes: int, batch: int, reuse: int, size: int = 512, metallic: bool = False):
        self.seed, self.lanes, self.batch, self.reuse, self.size = seed, lanes, batch, reuse, size
        self.metallic = metallic
        self.classes = np.arange(len(CLASSES))
        self.weight = np.full(len(CLASSES), 1 / len(CLASSES))
        self._made: OrderedDict[int, Pool] = OrderedDict()

    def __len__(self) -> int:
        return len(CLASSES)

    def number(self, rng: np.random.Generator, sample: int) -> int:
        """Which material sample `sample` is cut from."""
        first = sample // self.batch
        lane, turn = first % self.lanes, first // self.lanes * self.batch + sample % self.batch
        newest = turn // self.reuse + WINDOW - 1
        return (newest - int(rng.integers(WINDOW))) * self.lanes + lane

    def draw_for(self, sample: int, rng: np.random.Generator, size: int) -> tuple[Tensor, int]:
        """A random crop for sample number `sample`, and its class."""
        number = self.number(rng, sample)
        if number not in self._made:
            self._made[number] = Pool([self._make(number)], metallic=self.metallic)
            while len(self._made) > WINDOW:
                self._made.popitem(last=False)
        self._made.move_to_end(number)
        return self._made[number].draw(rng, size)

    def _make(self, number: int) -> Material:
        from ..procedural import generate

        seed = int(np.random.default_rng((self.seed, 1 << 41, number)).integers(2**62))
        m = generate(None, self.size, torch.Generator().manual_seed(seed))
        maps = to_bytes(torch.cat((m.albedo, m.normal, m.roughness))).numpy()
        metallic = None if m.metallic is None else (m.metallic[0] * 255 + 0.5).byte().numpy()
        return Material(m.cls, f"fresh-{number}", maps, metallic)
