"""Fixed photos of the validation materials, and the errors of a network on them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor, nn

from ..data.batches import Batch, SceneOptions, render_batch
from ..data.pool import Pool
from ..fine_metrics import FineScores
from ..metrics import map_errors, trivial
from ..render.camera import CameraNoise
from ..render.envmap import Environments

MEAN_ALBEDO, MEAN_ROUGHNESS = 0.22, 0.6


def validation_set(pool: Pool, env: Environments, size: int, per_material: int = 3) -> list[Batch]:
    """For each material a batch at the flash's known strength, where scales and lights vary and nothing else is random,
    and one as a phone's automatic exposure takes them."""
    plain = {"augment": False, "fov_exact": 1.0, "tilt_sigma": 0.0, "dark": 0.0, "second_lobe": 0.0, "beside": 0.0}
    base = SceneOptions(environment=(0.0, 0.4), **plain)
    known = replace(base, camera=CameraNoise(plain=1.0))
    phone = replace(base, camera=CameraNoise(plain=0.0, known=0.0))
    out = []
    for i in range(len(pool)):
        rng = np.random.default_rng((99, i))
        crops = [
            pool.crop(i, size, float(rng.choice((0.4, 0.6, 1.0))), 0.0, False, rng.random(2))
            for _ in range(per_material)
        ]
        cls = torch.full((per_material,), int(pool.classes[i]))
        out += [render_batch(torch.stack(crops), cls, env, options, rng) for options in (known, phone)]
    return out


@torch.no_grad()
def evaluate(network: nn.Module, val: list[Batch], device: torch.device | str) -> dict[str, float]:
    """The errors (`scores`) of the network on the validation photos."""
    network.eval()
    return scores(val, lambda b: {k: v.float().cpu() for k, v in network(b.input.to(device)).items()})


def scores(val: list[Batch], predict: Callable[[Batch], dict[str, Tensor]]) -> dict[str, float]:
    """Mean errors over the validation photos of known exposure and the columns of `fine_metrics`, the errors of the
    trivial guesses (`flat_*`), and those over the photos of unknown exposure (`phone_*`); {} without photos."""
    rows: list[dict[str, float]] = []
    phone: list[dict[str, float]] = []
    fine, phone_fine = FineScores(), FineScores()
    for b in val:
        out = predict(b)
        row = map_errors(out, b.target)
        if not b.target["known"].any():
            phone.append({f"phone_{k}": v for k, v in row.items()})
            phone_fine.add(out, b.target)
            continue
        base = map_errors(trivial(b.target, MEAN_ALBEDO, MEAN_ROUGHNESS), b.target)
        rows.append(row | {f"flat_{k}": v for k, v in base.items()})
        fine.add(out, b.target)
    means = {k: float(np.mean([r[k] for r in part])) for part in (rows, phone) if part for k in part[0]}
    return means | fine.columns() | {f"phone_{k}": v for k, v in phone_fine.columns().items()}
