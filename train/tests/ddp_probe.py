"""Run by torchrun in test_training.py: trains, then writes this rank's weights, without the batch statistics."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import torch
from test_training import arguments

from flashmat_train import train
from flashmat_train.training import loop

if __name__ == "__main__":
    data, folder, samples = sys.argv[1:]
    torch.set_num_threads(1)
    kept = []
    fit = loop.Trainer.fit

    def watched(self: loop.Trainer, *rest: object) -> None:
        kept.append(self)
        fit(self, *rest)

    loop.Trainer.fit = watched
    train.run(arguments(Path(data), Path(folder) / "run", "--samples", samples, "--save-every", "1"))
    weights = {k: v.detach().clone() for k, v in kept[0].network.named_parameters()}
    torch.save(weights, Path(folder) / f"rank{os.environ['RANK']}.pt")
