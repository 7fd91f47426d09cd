"""The stage `detail`: crops of rendered photos, the second process, resuming, learning, weights from elsewhere."""

from __future__ import annotations

import argparse
import itertools
import json
from collections.abc import Iterator
from functools import lru_cache, partial
from pathlib import Path

import numpy as np
import pytest
import torch
from small_data import material, sky
from test_detail_network import SMALL, global_network, trial_state
from test_training import same

from flashmat_train import checkpoint
from flashmat_train.data.batches import SceneOptions
from flashmat_train.data.pool import Pool
from flashmat_train.detail import stage
from flashmat_train.detail.losses import DetailWeights
from flashmat_train.detail.network import DetailConfig, DetailNetwork, corrected
from flashmat_train.detail.photos import Plan, base_of, crops_from, source
from flashmat_train.detail.stage import DetailLearner, DetailStep, add_arguments, run, widened
from flashmat_train.render.envmap import Environments, Source
from flashmat_train.training.prefetch import Prefetch


@pytest.fixture(scope="module")
def global_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    network, path = global_network(), tmp_path_factory.mktemp("global") / "g.pt"
    checkpoint.save({"config": network.config.asdict(), "ema": network.state_dict()}, path)
    return path


def arguments(data: Path, out: Path, first: Path, *more: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    fixed = ["--widths", "8", "8", "12", "12", "--fine", "4", "--size", "128", "--crop", "64", "--photos", "1"]
    fixed += ["--crops", "2", "--warmup", "2", "--no-compile", "--device", "cpu", "--relief", "0.5"]
    return parser.parse_args(["--data", str(data), "--out", str(out), "--init-global", str(first), *fixed, *more])


@lru_cache
def room() -> Environments:
    return Environments([Source.of(sky(1))], 1, 0)


def stream(plan: Plan, start: int = 0, metallic: bool = False, config: DetailConfig = SMALL) -> Iterator:
    pool = Pool([material(3), material(4, 3)], metallic=metallic)
    options = SceneOptions(occlusion=0.5)
    return crops_from(plan, global_network(), [(pool, 1.0)], room(), options, config, 5, start, 0.3, False)


def test_crops_are_parts_of_one_photo_and_line_up() -> None:
    """Each crop is found in its photo, and so are all that belongs to it and the trunk's features."""
    plan = Plan(2, 128, 64, 3)
    batch = next(stream(plan))
    assert (
        batch.input.shape == (6, 20, 64, 64) and batch.base.shape == (6, 6, 64, 64) and batch.novel.shape == (6, 2, 3)
    )
    assert [tuple(f.shape) for f in batch.trunk] == [(6, 16, 32, 32), (6, 24, 16, 16), (6, 40, 8, 8), (6, 112, 4, 4)]
    whole = next(stream(Plan(2, 128, 128, 1)))
    for k in range(6):
        photo, red = whole.input[k // 3, 0], batch.input[k, 0]
        places = [(y, x) for y in range(0, 65, 16) for x in range(0, 65, 16)]
        found = [(y, x) for y, x in places if torch.equal(photo[y : y + 64, x : x + 64], red)]
        assert found, k
        y, x = found[0]
        assert torch.equal(whole.target["normal"][k // 3][:, y : y + 64, x : x + 64], batch.target["normal"][k])
        assert torch.equal(whole.points[k // 3][:, y : y + 64, x : x + 64], batch.points[k])
        for step, (part, all_of) in enumerate(zip(batch.trunk, whole.trunk, strict=True), 1):
            a, b, n = y >> step, x >> step, 64 >> step
            assert torch.equal(all_of[k // 3][:, a : a + n, b : b + n], part[k])
    base = base_of(batch)
    assert torch.equal(base.metal, batch.input[:, 16, 0, 0])
    assert torch.allclose(base.slopes, batch.input[:, 13:15], atol=1e-6)


def test_larger_photos_come_in_turn_from_any_step() -> None:
    plan = Plan(4, 128, 64, 1, large_every=2)
    assert [plan.of_step(s) for s in (0, 1)] == [(False, 4, 128, 1), (True, 1, 256, 4)]
    first = list(itertools.islice(stream(plan), 3))
    assert all(len(b.input) == 4 for b in first)
    for start in (1, 2):
        again = next(stream(plan, start))
        assert torch.equal(again.input, first[start].input) and torch.equal(again.trunk[2], first[start].trunk[2])


def test_learns_slopes_and_metal() -> None:
    """On the crops of one step: errors fall to a part of the global maps'."""
    config = DetailConfig((16, 16, 24, 24), 8, metallic=True)
    batch = next(stream(Plan(2, 128, 64, 1), metallic=True, config=config))
    torch.manual_seed(1)
    network = DetailNetwork(config).train()
    weights = DetailWeights(energy=0.01, render=0.5)
    learner, step = DetailLearner(network, 0.9, 1e-2), DetailStep(network, weights)
    means = []
    for i in range(60):
        learner.step(step, batch, False, 1e-2 * min(1.0, (60 - i) / 30), i)
        if i in (0, 49):
            means.append(learner.take_means())
    first, last = means[0], learner.take_means()
    print(first, last)
    for name, share in (
        ("normal", 0.3),
        ("albedo_scaled", 0.3),
        ("roughness", 0.3),
        ("metallic", 0.2),
        ("render", 0.5),
    ):
        assert last[name] < share * first[name], name
    assert learner.check() == 0
    with torch.no_grad():
        out = corrected(network.eval()(batch.input, batch.trunk), base_of(batch))
    assert set(out) == {"albedo", "normal", "roughness", "metallic"}


@pytest.fixture
def few_rooms(monkeypatch: pytest.MonkeyPatch) -> None:
    """Environments under one rotation in place of six, which takes a sixth of the time."""
    whole = Environments.from_folder
    monkeypatch.setattr(Environments, "from_folder", lambda folder: whole(folder, rotations=1))


def test_another_process_makes_the_same_crops(data_folder: Path, global_file: Path, tmp_path: Path) -> None:
    """From any step on, bit for bit."""
    args = arguments(data_folder, tmp_path, global_file, "--occlusion", "0.5", "--metallic")
    config = DetailConfig((8, 8, 12, 12), 4, metallic=True)
    with Prefetch(partial(source, args, config, True, 1), 1) as there:
        here = list(itertools.islice(source(args, config, True, 0), 3))[1:]
        for a, b in zip(here, there, strict=False):
            assert torch.equal(a.input, b.input) and torch.equal(a.base, b.base) and torch.equal(a.f0, b.f0)
            assert all(torch.equal(x, y) for x, y in zip(a.trunk, b.trunk, strict=True))
            same(a.target, b.target, "target")


def test_resume_is_bit_for_bit(
    few_rooms: None, monkeypatch: pytest.MonkeyPatch, data_folder: Path, global_file: Path, tmp_path: Path
) -> None:
    """Four steps at one go; one step, a stop, three more: the same weights."""
    plan = ("--samples", "8", "--save-every", "2", "--eval-every", "4", "--metallic", "--no-prefetch")
    run(arguments(data_folder, tmp_path / "whole", global_file, *plan))
    whole = checkpoint.load(tmp_path / "whole" / "last.pt")
    stopped = arguments(data_folder, tmp_path / "parts", global_file, *plan, "--val-photos", "0")
    stopped.minutes = 1e-9
    monkeypatch.setattr(stage, "bf16_pays", lambda _: whole["bf16"])
    run(stopped)
    # goes on as it began, whatever would be the faster now
    monkeypatch.setattr(stage, "bf16_pays", lambda _: not whole["bf16"])
    assert checkpoint.load(tmp_path / "parts" / "last.pt")["step"] == 1
    run(arguments(data_folder, tmp_path / "parts", global_file, *plan, "--val-photos", "0"))
    parts = checkpoint.load(tmp_path / "parts" / "last.pt")
    assert whole["step"] == parts["step"] == 4 and whole["samples"] == 8
    same(whole["network"], parts["network"], "network")
    same(whole["ema"], parts["ema"], "average")
    for a, b in zip(whole["optimizer"]["parts"], parts["optimizer"]["parts"], strict=True):
        for k, v in a["state"].items():
            same(v, b["state"][k], f"optimizer {k}")
    line = json.loads((tmp_path / "whole" / "val.jsonl").read_text().splitlines()[-1])
    assert {"slope_corr", "strength", "balance", "global_slope_corr", "metallic_rmse", "flat_normal_mse"} <= set(line)
    # and beside another global network the run does not go on
    other = checkpoint.load(global_file)
    other["ema"]["encoder.0.conv.weight"] += 0.1
    checkpoint.save(other, tmp_path / "other.pt")
    with pytest.raises(SystemExit, match="another global network"):
        run(arguments(data_folder, tmp_path / "parts", tmp_path / "other.pt", *plan))


def test_starts_from_a_trials_weights(few_rooms: None, data_folder: Path, global_file: Path, tmp_path: Path) -> None:
    state = trial_state(SMALL, norms=False)
    checkpoint.save(state, tmp_path / "trial.pt")
    args = arguments(data_folder, tmp_path / "run", global_file, "--samples", "2", "--no-prefetch", "--val-photos", "0")
    args.init, args.lr = tmp_path / "trial.pt", 0.0
    run(args)
    got = checkpoint.load(tmp_path / "run" / "last.pt")
    assert torch.equal(got["network"]["skip.1.scale"], state["tn.1.k"])
    assert torch.allclose(got["network"]["up.0.conv.weight"], state["dec.0.c.weight"], atol=1e-6)
    wide = widened(got["ema"], 7)
    assert wide["half_head.weight"].shape[0] == 28 and not wide["half_head.weight"][24:].any()
    assert torch.equal(wide["full_head.bias"][:6], got["ema"]["full_head.bias"])


def test_bad_options_are_named(data_folder: Path, global_file: Path, tmp_path: Path) -> None:
    for more, message in ((("--crop", "72"), "multiple of 128"), (("--samples", "1"), "one step of 2 crops")):
        with pytest.raises(SystemExit, match=message):
            run(arguments(data_folder, tmp_path, global_file, *more))
    with pytest.raises(SystemExit, match="not a detail network"):
        run(arguments(data_folder, tmp_path, global_file, "--init", str(global_file)))


def numbers(count: int) -> Iterator[dict]:
    for i in range(count):
        yield {"n": i, "x": torch.full((3,), float(i))}


def trouble() -> Iterator[int]:
    yield 1
    raise ValueError("no such material")


def test_a_second_process_gives_all_in_order_and_says_what_is_wrong() -> None:
    with Prefetch(Numbers(5), 2) as items:
        assert [(i["n"], float(i["x"].sum())) for i in items] == [(k, 3.0 * k) for k in range(5)]
    with Prefetch(trouble) as items:
        assert next(items) == 1
        with pytest.raises(RuntimeError, match="no such material"):
            next(items)
    assert not items.process.is_alive()


class Numbers:
    """`numbers` as something that can be pickled with its argument."""

    def __init__(self, count: int):
        self.count = count

    def __call__(self) -> Iterator[dict]:
        return numbers(self.count)


def test_flash_is_told_with_an_error() -> None:
    """What the network is told of the flash's place differs from crop to crop only between photos."""
    batch = next(stream(Plan(2, 128, 64, 2)))
    told = batch.input[:, 17:19, 0, 0]
    assert torch.equal(told[0], told[1]) and torch.equal(told[2], told[3])
    error = (told - batch.light[:, :2]).abs()
    assert 0 < float(error.max()) < 0.15
    assert np.isfinite(batch.input.numpy()).all()
