"""The train stage: resuming, distributed processes, learning at all, and its guard."""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import numpy as np
import pytest
import torch
from small_data import material, sky
from torch import Tensor

from flashmat_train import checkpoint, curves
from flashmat_train.data.batches import SceneOptions, render_batch
from flashmat_train.data.pool import Pool
from flashmat_train.losses import LossWeights, losses, point_lights
from flashmat_train.model import PRESETS, Network
from flashmat_train.render.camera import CameraNoise
from flashmat_train.render.envmap import Environments, Source
from flashmat_train.train import add_arguments, run
from flashmat_train.training.step import Learner, Step

Seen = TypeVar("Seen")


def arguments(data: Path, out: Path, *more: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    fixed = ["--preset", "tiny", "--batch", "2", "--warmup", "2", "--no-compile", "--no-bf16", "--device", "cpu"]
    return parser.parse_args(["--data", str(data), "--out", str(out), "--workers", "0", *fixed, *more])


def same(a: dict, b: dict, what: str) -> None:
    assert a.keys() == b.keys()
    for k, v in a.items():
        if torch.is_tensor(v):
            assert torch.equal(v, b[k]), f"{what} {k} differs"


def test_resume_is_bit_for_bit(data_folder: Path, tmp_path: Path) -> None:
    """Three steps, a stop, three more: the weights of six steps at one go; the checkpoint in parts the second time."""
    plan = ("--samples", "12", "--save-every", "3", "--eval-every", "6")
    run(arguments(data_folder, tmp_path / "whole", *plan))
    whole = checkpoint.load(tmp_path / "whole" / "last.pt")
    stopped = arguments(data_folder, tmp_path / "parts", *plan, "--split-checkpoint")
    stopped.minutes = 1e-9  # over after the first step
    run(stopped)
    assert checkpoint.load(tmp_path / "parts" / "last.pt")["step"] == 1
    run(arguments(data_folder, tmp_path / "parts", *plan, "--split-checkpoint"))
    parts = checkpoint.load(tmp_path / "parts" / "last.pt")
    assert whole["step"] == parts["step"] == 6
    same(whole["network"], parts["network"], "network")
    same(whole["ema"], parts["ema"], "average")
    for k, v in whole["optimizer"]["state"].items():
        same(v, parts["optimizer"]["state"][k], f"optimizer {k}")
    scores = json.loads((tmp_path / "whole" / "val.jsonl").read_text().splitlines()[-1])
    assert scores["samples"] == 12 and scores["albedo_mse"] > 0 and "flat_normal_mse" in scores
    assert curves.draw(tmp_path / "whole").stat().st_size > 1000


def whole_and_parts(
    data: Path, out: Path, look: Callable[[Network, Tensor], Seen], *plan: str
) -> tuple[dict, dict, list[Seen]]:
    """Checkpoints of a run at one go and of one that stopped after its first step and went on; and what `look` gives
    for the network and its input at each training step of both, in order."""
    seen: list[Seen] = []
    hook = torch.nn.modules.module.register_module_forward_pre_hook(
        lambda module, inputs: (
            seen.append(look(module, inputs[0])) if isinstance(module, Network) and module.training else None
        )
    )
    try:
        run(arguments(data, out / "whole", *plan))
        stopped = arguments(data, out / "parts", *plan)
        stopped.minutes = 1e-9
        run(stopped)
        run(arguments(data, out / "parts", *plan))
    finally:
        hook.remove()
    return checkpoint.load(out / "whole" / "last.pt"), checkpoint.load(out / "parts" / "last.pt"), seen


def test_folds_see_classifiers_that_do_not_know_them(data_folder: Path, tmp_path: Path) -> None:
    """Photos of fold k are mixed by classifier k; the average keeps the classifier itself; a stop changes nothing."""
    network = Network(PRESETS["tiny"])
    heads = [{k: v + i + 1 for k, v in network.classifier.state_dict().items()} for i in range(2)]
    first = tmp_path / "init.pt"
    checkpoint.save({"config": PRESETS["tiny"].asdict(), "ema": network.state_dict(), "folds": heads}, first)
    plan = ("--samples", "12", "--save-every", "3", "--eval-every", "9", "--init", str(first), "--freeze-classifier")
    bias = network.classifier[2].bias
    whole, parts, used = whole_and_parts(
        data_folder, tmp_path, lambda net, _: round(float((net.classifier[2].bias - bias).detach().mean())), *plan
    )
    assert used == [1, 2] * 6
    same(whole["ema"], parts["ema"], "average")
    for k, v in network.classifier.state_dict().items():
        assert torch.equal(whole["ema"][f"classifier.{k}"], v), k
    assert not torch.equal(whole["ema"]["encoder.0.conv.weight"], network.state_dict()["encoder.0.conv.weight"])


def test_larger_photos_come_in_turn_and_resume(data_folder: Path, tmp_path: Path) -> None:
    """Every second step sees one photo of 256² in place of four of 128²; a stop between changes nothing."""
    plan = ("--samples", "16", "--large-every", "2", "--save-every", "3", "--eval-every", "4", "--batch", "4")
    whole, parts, sizes = whole_and_parts(data_folder, tmp_path, lambda _, x: (len(x), x.shape[-1]), *plan)
    assert sizes == [(4, 128), (1, 256)] * 4
    same(whole["network"], parts["network"], "network")


def test_weights_from_before_the_guess_of_the_room_start_a_run(data_folder: Path, tmp_path: Path) -> None:
    run(arguments(data_folder, tmp_path / "first", "--samples", "2"))
    path = tmp_path / "first" / "last.pt"
    state = checkpoint.load(path)
    state["ema"] = {k: v for k, v in state["ema"].items() if not k.startswith("room.")}
    checkpoint.save(state, path, False)
    run(arguments(data_folder, tmp_path / "next", "--samples", "2", "--init", str(path)))
    assert "room.0.weight" in checkpoint.load(tmp_path / "next" / "last.pt")["ema"]
    del state["ema"]["encoder.0.conv.weight"]
    checkpoint.save(state, path, False)
    with pytest.raises(SystemExit, match=r"encoder\.0\.conv"):
        run(arguments(data_folder, tmp_path / "other", "--samples", "2", "--init", str(path)))


def test_samples_of_earlier_runs_count(data_folder: Path, tmp_path: Path) -> None:
    run(arguments(data_folder, tmp_path / "first", "--samples", "4"))
    run(arguments(data_folder, tmp_path / "next", "--samples", "2", "--init", str(tmp_path / "first" / "last.pt")))
    run(arguments(data_folder, tmp_path / "next", "--samples", "4"))
    state = checkpoint.load(tmp_path / "next" / "last.pt")
    assert (state["step"], state["samples"]) == (2, 8)


def test_another_preset_does_not_resume(data_folder: Path, tmp_path: Path) -> None:
    run(arguments(data_folder, tmp_path, "--samples", "2"))
    with pytest.raises(SystemExit, match="preset tiny"):
        run(arguments(data_folder, tmp_path, "--samples", "4", "--variant", "basic"))


@pytest.mark.parametrize("variant", ["basic", "clsOnly"])
def test_variants_run(data_folder: Path, tmp_path: Path, variant: str) -> None:
    run(arguments(data_folder, tmp_path, "--samples", "2", "--variant", variant, "--light", "env"))
    assert checkpoint.load(tmp_path / "last.pt")["step"] == 1


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (("--size", "100"), "multiple of 128"),
        (("--samples", "1"), "not one batch"),
        (("--data", "nowhere"), "materials"),
    ],
)
def test_bad_options_are_named(data_folder: Path, tmp_path: Path, more: tuple[str, ...], message: str) -> None:
    with pytest.raises(SystemExit, match=message):
        run(arguments(data_folder, tmp_path, *more))


def test_two_processes_agree(data_folder: Path, tmp_path: Path) -> None:
    """DDP with gloo: gradients are averaged, so both ranks hold the same weights after each step; it resumes too."""
    probe = Path(__file__).with_name("ddp_probe.py")
    command = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2", str(probe)]
    env = os.environ | {"OMP_NUM_THREADS": "1", "PYTHONPATH": os.pathsep.join([str(probe.parents[1]), *sys.path])}
    for samples in ("8", "16"):
        done = subprocess.run(
            [*command, str(data_folder), str(tmp_path), samples], env=env, capture_output=True, text=True, timeout=240
        )
        assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-4000:]
    ranks = [torch.load(tmp_path / f"rank{r}.pt") for r in (0, 1)]
    same(ranks[0], ranks[1], "rank 1's")
    state = checkpoint.load(tmp_path / "run" / "last.pt")
    assert state["step"] == 4 and state["samples"] == 16
    learnt = {k: v for k, v in state["network"].items() if "running" not in k and "num_batches" not in k}
    same(learnt, {k: ranks[0][k] for k in learnt}, "checkpoint's")


def one_batch() -> tuple:
    pool = Pool([material(3)])
    env = Environments([Source.of(sky(1))], 1, 0)
    crop = pool.crop(0, 128, 0.9, 0.0, False, (0.5, 0.5))
    options = SceneOptions(camera=CameraNoise(plain=1.0), tilt_sigma=0.0, light_sigma=0.0, beside=0.0, fov_exact=1.0)
    rng = np.random.default_rng(0)
    return render_batch(torch.stack([crop] * 2), torch.zeros(2, dtype=torch.long), env, options, rng), crop


def test_losses_see_tints_highlights_and_the_room() -> None:
    """What each of these terms is for raises it and no other: a tint, an error below a highlight, a wrong room."""
    batch, _ = one_batch()
    bright = torch.full_like(batch.input[:, :3], 0.3)
    bright[:, :, 40:60, 40:60] = 1.0
    target = batch.target | {"photo": bright}
    fine = {k: target[k].clone() for k in ("albedo", "normal", "roughness", "room")}
    fine["albedo"] = target["albedo"] = target["albedo"].clamp(0.1, 0.7)
    fine["roughness"] = target["roughness"] = torch.ones_like(target["roughness"])  # no highlight but the bright square
    fine["class_logits"] = torch.zeros(2, 8)

    def terms(**changed: torch.Tensor) -> dict[str, float]:
        lights = point_lights(batch.points, [batch.light])
        out = losses(fine | changed, target, batch.f0, batch.view, lights, torch.ones(8), LossWeights())
        return {k: float(v) for k, v in out.items()}

    zero = terms()
    assert zero["albedo"] == zero["chroma"] == zero["room"] == 0
    tint = torch.tensor([1.1, 1.0, 0.9])[None, :, None, None]
    assert terms(albedo=fine["albedo"] * tint)["chroma"] > 10 * terms(albedo=fine["albedo"] * 0.9)["chroma"]
    below, beside = fine["albedo"].clone(), fine["albedo"].clone()
    below[:, :, 40:60, 40:60] += 0.1
    beside[:, :, 80:100, 40:60] += 0.1
    w = LossWeights().bright
    assert terms(albedo=below)["albedo"] == pytest.approx((1 + w) * terms(albedo=beside)["albedo"], rel=1e-4)
    # glossy now, and photographed dark: the highlight in the middle counts by itself
    fine["roughness"] = target["roughness"] = torch.full_like(target["roughness"], 0.3)
    flat = torch.tensor([0.0, 0.0, 1.0])[None, :, None, None].expand_as(target["normal"])
    fine["normal"] = target["normal"] = flat
    target["photo"] = torch.full_like(bright, 0.3)
    middle, corner = fine["albedo"].clone(), fine["albedo"].clone()
    middle[:, :, 60:68, 60:68] += 0.1
    corner[:, :, :8, :8] += 0.1
    assert terms(albedo=middle)["albedo"] == pytest.approx((1 + w) * terms(albedo=corner)["albedo"], rel=0.05)
    assert terms(room=fine["room"] + 0.2)["room"] == pytest.approx(0.04, rel=1e-4)


def learner(lr: float = 4e-3) -> tuple[Learner, Step]:
    torch.manual_seed(0)
    net = Network(PRESETS["tiny"]).to(memory_format=torch.channels_last).train()
    return Learner(net, 0.9, lr), Step(net, LossWeights(), torch.ones(8), False)


def test_overfits_one_material() -> None:
    """Errors fall to a small part of what a flat guess makes."""
    batch, _ = one_batch()
    a, step = learner()
    first = None
    for i in range(260):
        a.step(step, batch, False, 4e-3 * min(1.0, (260 - i) / 100), i)
        if i in (0, 219):
            means = a.take_means()
            first = first or means
    last = a.take_means()  # of the last 40 steps
    print("first", first, "last", last)
    assert last["albedo"] < 0.03 * first["albedo"]
    assert last["normal"] < 0.15 * first["normal"]
    assert last["roughness"] < 0.05 * first["roughness"]
    assert last["render"] < 0.05 * first["render"]


def test_bad_gradients_are_undone() -> None:
    batch, _ = one_batch()
    a, step = learner()
    for i in range(3):
        a.step(step, batch, False, 1e-3, i)
    a.keep()
    want = {k: v.clone() for k, v in a.network.state_dict().items()}
    batch.input[0, 0, 5, 5] = float("nan")
    a.step(step, batch, False, 1e-3, 3)
    assert not torch.isfinite(a.network.encoder[0].norm.running_mean).all()  # what the guard is for
    means = a.take_means()
    assert all(np.isfinite(v) for v in means.values())
    assert a.check() == 1 and a.check() == 0
    same(want, a.network.state_dict(), "restored")
