"""The columns of fine structure, on fields whose columns are known."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from flashmat_train.fine_metrics import COLUMNS, FineScores, fine
from flashmat_train.render.flash import pixel_positions
from flashmat_train.slopes import normals_of

N = 64


def noise(seed: int, channels: int) -> Tensor:
    return torch.randn(1, channels, N, N, generator=torch.Generator().manual_seed(seed))


def maps(slopes: Tensor, roughness: Tensor | None = None, albedo: Tensor | None = None) -> dict[str, Tensor]:
    flat = torch.full((1, 1, N, N), 0.5)
    return {
        "normal": normals_of(slopes),
        "roughness": flat if roughness is None else roughness,
        "albedo": flat.expand(1, 3, N, N) if albedo is None else albedo,
    }


def columns(*pairs: tuple[dict[str, Tensor], dict[str, Tensor]]) -> dict[str, float]:
    scores = FineScores()
    for predicted, target in pairs:
        scores.add(predicted, target)
    return scores.columns()


def test_truth_scores_one_and_half_the_slopes_half_the_strength() -> None:
    true = maps(0.2 * noise(1, 2), 0.5 + 0.1 * noise(2, 1), 0.5 + 0.1 * noise(3, 3))
    same = columns((true, true))
    assert tuple(same) == COLUMNS
    assert all(v == pytest.approx(1, abs=1e-4) for v in same.values()), same
    half = columns((maps(0.1 * noise(1, 2)), true))
    assert half["strength"] == pytest.approx(0.5, abs=1e-3)
    for name in ("slope_corr", "slope_corr_total", "evenness", "balance"):
        assert half[name] == pytest.approx(1, abs=1e-3), name
    assert abs(half["roughness_detail"]) < 1e-6 and abs(half["albedo_detail"]) < 1e-6
    wrong = columns((maps(-0.2 * noise(1, 2)), true))
    assert wrong["slope_corr"] == pytest.approx(-1, abs=1e-4) and wrong["strength"] == pytest.approx(1, abs=1e-4)


def test_strangers_do_not_correlate() -> None:
    got = columns((maps(0.2 * noise(4, 2), 0.5 + 0.1 * noise(5, 1)), maps(0.2 * noise(1, 2), 0.5 + 0.1 * noise(2, 1))))
    assert abs(got["slope_corr"]) < 0.05 and abs(got["roughness_detail"]) < 0.05


def test_relief_that_fades_below_the_flash_and_rings() -> None:
    true = 0.2 * noise(1, 2)
    p = pixel_positions(N)[None]
    radius = p.norm(dim=1, keepdim=True)
    faded = torch.where(radius < 0.6, 0.4 * true, true)
    assert columns((maps(faded), maps(true)))["evenness"] == pytest.approx(0.4, abs=1e-3)
    u = p / radius
    along = (true * u).sum(dim=1, keepdim=True) * u
    rings = along + 0.3 * (true - along)
    got = columns((maps(rings), maps(true)))
    assert got["balance"] == pytest.approx(0.3, abs=0.01)
    assert got["evenness"] == pytest.approx(1, abs=0.05)
    assert 0.7 < got["slope_corr"] < 0.95


def test_photos_count_alike_in_the_mean_and_by_relief_in_the_total() -> None:
    """A steep photo that is right and a shallower one that is nothing."""
    steep, shallow = 0.3 * noise(1, 2), 0.1 * noise(2, 2)
    got = columns((maps(steep), maps(steep)), (maps(0.1 * noise(3, 2)), maps(shallow)))
    assert got["slope_corr"] == pytest.approx(0.5, abs=0.02)
    assert got["slope_corr_total"] == pytest.approx(0.9, abs=0.03)


def test_flat_truths_say_nothing_of_strength() -> None:
    flat = torch.zeros(1, 2, N, N)
    assert not columns((maps(0.2 * noise(1, 2)), maps(flat)))
    some = columns((maps(flat), maps(0.01 * noise(1, 2))))
    assert some == {"slope_corr": 0.0, "slope_corr_total": 0.0}
    assert columns() == {}


def test_fine_structure_is_what_windows_do_not_hold() -> None:
    x = torch.linspace(0, 1, N).expand(1, 1, N, N)
    stripes = torch.sin(torch.arange(N) * (2 * math.pi / 8)).expand(1, 1, N, N)
    assert float(fine(x)[..., 8:-8].abs().max()) < 0.02
    assert torch.allclose(fine(x + stripes)[..., 8:-8], stripes[..., 8:-8], atol=0.02)
