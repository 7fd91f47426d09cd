"""The stage `detail`: trains a detail network beside a frozen global one.

`python -m flashmat_train detail --init-global G.pt --out RUN [--procedural DIR] ...`; the same command goes on where
RUN/last.pt left off, and the weights are then, bit for bit, those of a run that was never stopped.

A second process renders the photos, runs the global network and the trunk on each, and cuts the crops (`photos.py`);
this one trains. The averaged weights are scored on the validation photos at `--eval-every`.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import time
import zlib
from collections.abc import Iterator
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path

import torch
from torch import Tensor, nn

from .. import checkpoint
from ..data.batches import Batch
from ..data.pool import Pool
from ..losses import point_lights
from ..model import Network
from ..render.envmap import Environments
from ..training.loop import Trainer
from ..training.muon import Together, muon_and_adamw
from ..training.prefetch import Prefetch
from ..training.setup import Place, enter, leave, load_pools
from ..training.step import Ema, Learner
from ..training.validate import scores, validation_set
from . import trial
from .first_look import global_maps, load_global, trunk_features
from .inputs import GlobalMaps, detail_inputs
from .losses import DetailWeights, detail_losses
from .network import OUTPUTS, DetailConfig, DetailNetwork, corrected, gmacs
from .photos import DetailBatch, plan_of, source


def add_arguments(p: argparse.ArgumentParser) -> None:
    cuda = torch.cuda.is_available()
    p.add_argument("--init-global", type=Path, required=True, help="checkpoint of the global network, with its trunk")
    p.add_argument("--out", type=Path, required=True, help="run folder: checkpoints, log, curves")
    p.add_argument("--init", type=Path, help="start from these weights (a run's of this stage, or a trial's)")
    p.add_argument("--data", help="data folder (default: FLASHMAT_DATA)")
    p.add_argument("--pack", type=Path, help="packed materials instead of --data (see `pack`)")
    p.add_argument("--procedural", type=Path, help="folder of procedural materials (see `procedural`)")
    p.add_argument("--procedural-share", type=float, default=0.3)
    p.add_argument("--widths", type=int, nargs=4, default=list(DetailConfig().widths))
    p.add_argument("--fine", type=int, default=DetailConfig().fine, help="channels at full resolution")
    p.add_argument("--no-trunk", action="store_true", help="does not read the trunk's feature maps")
    p.add_argument("--metallic", action="store_true", help="metallic maps in the renders, and as an output")
    p.add_argument("--relief", type=float, default=0.3, help="share of crops with other relief than their own")
    p.add_argument("--occlusion", type=float, default=0.0, help="share of photos whose room is dimmed in crevices")
    p.add_argument("--photos", type=int, default=4, help="photos a step")
    p.add_argument("--crops", type=int, default=4, help="crops of each photo")
    p.add_argument("--size", type=int, default=256, help="side of a photo")
    p.add_argument("--crop", type=int, default=128, help="side of a crop")
    p.add_argument(
        "--large-every",
        type=int,
        default=0,
        metavar="N",
        help="every N-th step sees a quarter as many photos of twice the side, and as many crops in all (0: none)",
    )
    p.add_argument("--samples", type=int, default=1_500_000, help="crops to see in all")
    p.add_argument("--lr", type=float, default=2e-3)
    p.add_argument("--warmup", type=int, default=100)
    p.add_argument("--ema", type=float, default=0.999)
    for name, value in asdict(DetailWeights()).items():
        p.add_argument(f"--weight-{name.replace('_', '-')}", type=float, default=value, metavar="W")
    p.add_argument("--seed", type=int, default=1)
    p.add_argument("--workers", type=int, default=0, help="processes that cut materials, beside the one that renders")
    p.add_argument("--no-prefetch", action="store_true", help="photos are rendered in this process, between the steps")
    p.add_argument("--ahead", type=int, default=4, help="steps that the other process may be ahead")
    p.add_argument("--device", default="cuda" if cuda else "cpu")
    p.add_argument("--threads", type=int, default=0)
    p.add_argument("--no-compile", action="store_true")
    p.add_argument("--no-bf16", action="store_true", help="single precision also where bf16 is the faster")
    p.add_argument("--minutes", type=float, default=0, help="stop after this long, with a checkpoint (0: no limit)")
    p.add_argument("--save-every", type=int, default=500, help="steps")
    p.add_argument("--eval-every", type=int, default=2000, help="steps")
    p.add_argument("--val-photos", type=int, default=1, help="validation photos of each material, of either exposure")
    p.add_argument("--split-checkpoint", action="store_true", help="checkpoints as files under 16 MiB")


def bf16_pays(device: torch.device) -> bool:
    """Whether convolutions take less time in bf16 than in single precision, as measured here: some processors have
    instructions for bf16 that are slower than those for floats."""
    if device.type == "cuda":
        return True
    if not torch.cpu._is_avx512_bf16_supported():
        return False

    def seconds(kind: torch.dtype) -> float:
        x = torch.ones(4, 64, 64, 64, dtype=kind).contiguous(memory_format=torch.channels_last)
        weight = torch.ones(64, 64, 3, 3, dtype=kind)
        times = []
        for _ in range(5):
            begin = time.process_time()
            torch.nn.functional.conv2d(x, weight, padding=1)
            times.append(time.process_time() - begin)
        return min(times)

    return seconds(torch.bfloat16) < seconds(torch.float32)


def weights_of(args: argparse.Namespace) -> DetailWeights:
    """The losses' weights."""
    return DetailWeights(**{name: getattr(args, f"weight_{name}") for name in asdict(DetailWeights())})


class DetailStep(nn.Module):
    """Network and losses as one graph."""

    def __init__(self, network: DetailNetwork, weights: DetailWeights):
        super().__init__()
        self.network, self.weights = network, weights

    def forward(
        self,
        x: Tensor,
        trunk: list[Tensor],
        base: GlobalMaps,
        target: dict[str, Tensor],
        scene: tuple[Tensor, ...],
    ) -> dict[str, Tensor]:
        raw = self.network(x, trunk)
        points, view, f0, light, novel = scene
        with torch.autocast(x.device.type, enabled=False):
            lights = point_lights(points, list(novel.unbind(dim=1))) if self.weights.render else []
            offset = points[:, :2] - light[:, :2, None, None]
            return detail_losses(corrected(raw, base), target, offset, f0, view, lights, self.weights)


class DetailLearner(Learner):
    """A learner whose hidden convolutions are stepped by Muon."""

    def make_optimizer(self, lr: float) -> Together:
        return muon_and_adamw(self.network.named_parameters(), self.network.hidden(), lr)

    def losses(self, module: nn.Module, batch: DetailBatch, bf16: bool) -> dict[str, Tensor]:
        b = batch
        with torch.autocast(b.input.device.type, torch.bfloat16) if bf16 else contextlib.nullcontext():
            x = b.input.contiguous(memory_format=torch.channels_last)
            base = GlobalMaps.of_stacked(b.base, b.metal)
            return module(x, b.trunk, base, b.target, (b.points, b.view, b.f0, b.light, b.novel))


def fingerprint(network: nn.Module) -> int:
    """A number that tells one network's weights from another's."""
    crc = 0
    for name, value in sorted(network.state_dict().items()):
        crc = zlib.crc32(value.detach().cpu().contiguous().numpy().tobytes(), zlib.crc32(name.encode(), crc))
    return crc


def widened(state: dict[str, Tensor], outputs: int) -> dict[str, Tensor]:
    """Weights whose heads have `outputs` outputs: those that they did not have are zeros, and change nothing."""
    out = dict(state)
    for head, count in (("half_head", 4 * outputs), ("full_head", outputs)):
        for kind in ("weight", "bias"):
            old = state[f"{head}.{kind}"]
            new = old.new_zeros(count, *old.shape[1:])
            new[: len(old)] = old[: len(new)]
            out[f"{head}.{kind}"] = new
    return out


class DetailTrainer(Trainer):
    """The loop of `train` over a detail network's steps."""

    def __init__(self, args: argparse.Namespace, place: Place, first: Network):
        super().__init__(args, place, None)
        self.first, self.global_scores = first, {}
        self.bf16: bool | None = None  # what the checkpoint says that the run has learned in

    def build(self, config: DetailConfig) -> None:
        """Makes the network, or takes it up where a checkpoint left it."""
        args, device = self.args, self.place.device
        self.network = DetailNetwork(config).to(device, memory_format=torch.channels_last)
        self.learner = DetailLearner(self.network, args.ema, args.lr)
        self.fingerprint = fingerprint(self.first)
        if checkpoint.exists(self.path):
            state = checkpoint.load(self.path)
            if state.get("kind") != "detail" or DetailConfig.fromdict(state["config"]) != config:
                raise SystemExit(f"{self.path} holds another network than these options; give another --out")
            if state["global"] != self.fingerprint:
                raise SystemExit(
                    f"{self.path} has learned beside another global network than --init-global {args.init_global}; "
                    "start a new run from it: --init and another --out"
                )
            self.learner.load(state)
            self.start, self.seconds, self.before = state["step"], state["seconds"], state["before"]
            self.bf16 = state["bf16"]
        elif args.init:
            self.begin_from(args.init, config)

    def begin_from(self, path: Path, config: DetailConfig) -> None:
        """Takes the averaged weights of a run over; of a trial's run also the network itself and its momentum."""
        state = checkpoint.load(path)
        momentum = None
        if trial.is_trial(state):
            per_step = state.get("args", {})
            state = trial.read_trial(state)
            crops = per_step.get("photos", 0) * per_step.get("crops", 0)
            state["samples"], momentum = state.get("step", 0) * crops, state.get("optimizer")
        elif state.get("kind") != "detail":
            raise SystemExit(f"--init {path}: not a detail network's weights")
        had = DetailConfig.fromdict(state["config"])
        if replace(had, metallic=config.metallic) != config:
            raise SystemExit(f"--init {path}: a network of {had}, the options ask for {config}")
        self.before = state["samples"]
        ema = widened(state["ema"], config.outputs)
        self.network.load_state_dict(widened(state["network"], config.outputs) if momentum else ema)
        self.learner.ema = Ema(self.network, self.args.ema)
        if momentum:
            self.learner.ema.state = {k: v.clone().to(self.place.device) for k, v in ema.items()}
            if had.outputs == config.outputs:
                trial.take_optimizer(self.learner.optimizer, momentum)

    def module(self) -> nn.Module:
        """The step's graph, compiled as asked."""
        step = DetailStep(self.network, weights_of(self.args))
        return step if self.args.no_compile else torch.compile(step, dynamic=False)

    def save(self, step: int, seconds: float) -> None:
        """Writes RUN/last.pt."""
        state = self.learner.state() | {
            "kind": "detail",
            "step": step,
            "samples": self.before + step * self.args.batch,
            "before": self.before,
            "config": self.network.config.asdict(),
            "global": self.fingerprint,
            "bf16": not self.args.no_bf16,
            "seconds": seconds,
        }
        checkpoint.save(state, self.path, self.args.split_checkpoint)

    def average_scores(self, val: list[Batch]) -> dict[str, float]:
        """Validation errors of the averaged weights, and, as `global_*`, those of the global network alone."""
        probe = DetailNetwork(self.network.config).to(self.place.device, memory_format=torch.channels_last)
        probe.load_state_dict(self.learner.ema.state)
        if not self.global_scores:
            alone = scores(val, partial(predict, self.first, None))
            self.global_scores = {f"global_{k}": v for k, v in alone.items() if not k.startswith(("flat_", "phone_"))}
        return scores(val, partial(predict, self.first, probe.eval())) | self.global_scores


@torch.no_grad()
def predict(first: Network, detail: DetailNetwork | None, batch: Batch) -> dict[str, Tensor]:
    """The maps of a batch of photos as the product makes them, in float: two looks of the global network, then the
    detail network, which is told where the flash is; without one the global maps alone."""
    device = next(first.parameters()).device
    photo = batch.input.to(device)
    base = global_maps(first, photo, looks=2)
    if detail is None:
        raw = torch.zeros(len(photo), len(OUTPUTS), *photo.shape[2:], device=device)
    else:
        x = detail_inputs(photo, base, batch.light.to(device)).contiguous(memory_format=torch.channels_last)
        raw = detail(x, trunk_features(first, photo) if detail.config.trunk else [])
    return {k: v.cpu() for k, v in corrected(raw, base).items()}


def validation(args: argparse.Namespace, pool: Pool, env: Environments) -> list[Batch]:
    """The validation photos, without what only losses read."""
    if not args.val_photos:
        return []
    photos = validation_set(pool, env, args.size, args.val_photos)
    corner = (slice(None), slice(None), slice(0, 1), slice(0, 1))
    return [replace(b, points=b.points[corner].clone(), view=b.view[corner].clone()) for b in photos]


def run(args: argparse.Namespace) -> None:
    """Trains, or goes on training where RUN/last.pt left off."""
    if int(os.environ.get("WORLD_SIZE", 1)) > 1:
        raise SystemExit("the stage `detail` runs as one process")
    plan_of(args)
    args.batch = args.photos * args.crops
    if args.samples < args.batch:
        raise SystemExit(f"--samples {args.samples} is not one step of {args.batch} crops")
    place = enter(args)
    if place.device.type == "cuda":
        args.no_prefetch = True  # the card renders as well
    config = DetailConfig(tuple(args.widths), args.fine, not args.no_trunk, args.metallic)
    trainer = DetailTrainer(args, place, load_global(args.init_global).to(place.device))
    trainer.build(config)
    # a run goes on as it began, so that its weights are the same bit for bit
    bf16 = not args.no_bf16 and (bf16_pays(place.device) if trainer.bf16 is None else trainer.bf16)
    args.no_bf16 = not bf16
    params = sum(p.numel() for p in trainer.network.parameters())
    print(f"detail: {params / 1e6:.2f} M parameters, {gmacs(config):.2f} GMAC at 256², {'bf16' if bf16 else 'float'}")
    if trainer.start:
        print(f"resumed at step {trainer.start}")
    args.out.mkdir(parents=True, exist_ok=True)
    described = {"args": {k: str(v) for k, v in vars(args).items()}, "network": config.asdict()}
    (args.out / "config.json").write_text(json.dumps(described, indent=1))
    make = partial(source, args, config, bf16, trainer.start)
    with contextlib.ExitStack() as stack:
        if args.no_prefetch:
            loaded = load_pools(args)
            crops: Iterator[DetailBatch] = make(loaded)
        else:
            crops = stack.enter_context(Prefetch(make, args.ahead))
            loaded = load_pools(args, training=False)
        trainer.fit(crops, args.samples // args.batch, validation(args, *loaded[1:]))
    leave(place)
