"""The loop of one process: batches, steps, and, on the first process, the log, checkpoints and validation."""

from __future__ import annotations

import argparse
import contextlib
import itertools
import json
import time
from collections.abc import Iterator
from dataclasses import asdict

import torch
import torch.distributed as dist
from torch import Tensor, nn
from torch.nn.parallel import DistributedDataParallel
from torch.utils.tensorboard import SummaryWriter
from tqdm import tqdm

from .. import checkpoint, curves
from ..data.batches import Batch
from ..losses import LossWeights
from ..model import Network, NetworkConfig
from ..trunk import load_pretrained, pretrained_file
from .setup import AnyPool, Place, class_weights
from .step import Learner, Step, learning_rate
from .validate import evaluate

LOG_EVERY = 50
#: Restores in a row, with no good stretch between, after which a run gives up.
MAX_RESTORES = 5


class Stopwatch:
    """Seconds in two phases that alternate; on a GPU by its own events, which nobody waits for until they are read."""

    def __init__(self, device: torch.device):
        self.cuda = device.type == "cuda"
        self.marks: list = []

    def mark(self) -> None:
        """The end of one phase and the start of the other."""
        if self.cuda:
            event = torch.cuda.Event(enable_timing=True)
            event.record()
            self.marks.append(event)
        else:
            self.marks.append(time.monotonic())

    def read(self) -> tuple[float, float]:
        """Totals of the first and the second phase since the last call."""
        marks, self.marks = self.marks, []
        if self.cuda:
            torch.cuda.synchronize()
            steps = [a.elapsed_time(b) / 1e3 for a, b in itertools.pairwise(marks)]
        else:
            steps = [b - a for a, b in itertools.pairwise(marks)]
        # marks come in threes: before the batch, after it, after the step; the third gap lies between two steps
        return sum(steps[0::3]), sum(steps[1::3])


class Trainer:
    """Everything that one process holds while it trains."""

    def __init__(self, args: argparse.Namespace, place: Place, pools: list[tuple[AnyPool, float]] | None):
        self.args, self.place, self.path = args, place, args.out / "last.pt"
        self.start, self.seconds = 0, 0.0
        self.before = 0  # samples that the weights of --init had seen
        self.network: Network
        self.learner: Learner
        self.folds: list[dict[str, Tensor]] = []  # classifiers, each of which has not seen one fold of the materials
        if pools is not None:
            self.weights = class_weights(pools).to(place.device)

    def build(self, config: NetworkConfig) -> None:
        """Makes the network, or takes it up where a checkpoint left it."""
        args, place = self.args, self.place
        self.network = Network(config).to(place.device, memory_format=torch.channels_last)
        self.network.classifier.requires_grad_(not args.freeze_classifier)
        if self.network.trunk is not None and not (args.init or checkpoint.exists(self.path)):
            load_pretrained(self.network.trunk, args.trunk or pretrained_file())
        self.learner = Learner(self.network, args.ema, args.lr)
        if checkpoint.exists(self.path):
            state = checkpoint.load(self.path)
            if NetworkConfig.fromdict(state["config"]) != config:
                raise SystemExit(
                    f"{self.path} holds a network of preset {state['config']['name']} with other widths or heads than "
                    f"--preset {args.preset} --variant {args.variant}; go on with its own, or give another --out"
                )
            self.learner.load(state)
            self.folds = state.get("folds", [])
            self.start, self.seconds = state["step"], state["seconds"]
            self.before = state.get("before", 0)
        elif args.init:
            state = checkpoint.load(args.init)
            self.before = state.get("samples", 0)
            self.folds = state.get("folds", []) if args.freeze_classifier else []
            try:
                fresh = {k: v for k, v in self.network.state_dict().items() if k.startswith("room.")}
                self.network.load_state_dict(fresh | state["ema"])
            except RuntimeError as e:
                raise SystemExit(f"--init {args.init}: not weights of this preset and variant: {e}") from e
            self.learner.ema = type(self.learner.ema)(self.network, args.ema)
        self._agree_on_start()

    def _agree_on_start(self) -> None:
        if self.place.world == 1:
            return
        starts = torch.tensor([self.start], device=self.place.device).repeat(self.place.world)
        dist.all_gather_into_tensor(starts, torch.tensor([self.start], device=self.place.device))
        if len(set(starts.tolist())) > 1:
            raise SystemExit(
                f"processes found checkpoints of different steps {starts.tolist()}: --out must be a folder that all "
                "machines see"
            )

    def module(self) -> nn.Module:
        """The step's graph, distributed and compiled as asked."""
        only_class = self.args.variant == "clsOnly"
        module: nn.Module = Step(self.network, LossWeights(), self.weights, only_class)
        if self.place.world > 1:
            module = DistributedDataParallel(module, find_unused_parameters=only_class)
        # two sizes of photos: one graph for each, not one for any size
        return module if self.args.no_compile else torch.compile(module, dynamic=False)

    def fit(self, source: Iterator[Batch], total: int, val: list[Batch]) -> None:
        """Steps `start` to `total`, or until --minutes are over."""
        args, place, learner = self.args, self.place, self.learner
        forward, watch = self.module(), Stopwatch(place.device)
        log = Log(args, place, total, self.start) if place.first else None
        begin, restores = time.monotonic(), 0
        learner.keep()
        self.network.train()
        step, done = self.start, self.start >= total
        while not done:
            watch.mark()
            batch = next(source)
            watch.mark()
            if batch.fold is not None:  # parameters that do not learn: the average keeps the classifier itself
                self.network.classifier.load_state_dict(self.folds[batch.fold])
            lr = learning_rate(step, total, args.lr, args.warmup)
            learner.step(forward, batch, not args.no_bf16, lr, step)
            watch.mark()
            step += 1
            done = step == total or self._late(begin)
            save = step % args.save_every == 0 or done
            if log:
                log.bar.update()
            if step % LOG_EVERY == 0 or save:
                count = learner.count
                means = learner.take_means()
                bad = learner.check()
                restores = restores + 1 if bad else 0
                if log:
                    log.losses(step, means, count, *watch.read())
                    if bad:
                        log.say(f"step {step}: {bad} steps had a gradient that is not finite; weights restored")
                if restores >= MAX_RESTORES:
                    raise SystemExit(
                        f"step {step}: gradients that are not finite again and again; go on from {self.path} with a "
                        "lower --lr, or with --no-bf16"
                    )
                if not bad and save:
                    learner.keep()
            if log and save:
                self.save(step, self.seconds + time.monotonic() - begin)
            if log and (step % args.eval_every == 0 or done):
                log.scores(step, self.average_scores(val))
        if log:
            log.close()

    def _late(self, begin: float) -> bool:
        """Whether --minutes are over, on the first process's clock."""
        if not self.args.minutes:
            return False
        late = time.monotonic() - begin > self.args.minutes * 60
        if self.place.world > 1:
            flag = torch.tensor([float(late)], device=self.place.device)
            dist.broadcast(flag, 0)
            late = bool(flag.item())
        return late

    def save(self, step: int, seconds: float) -> None:
        """Writes RUN/last.pt."""
        args = self.args
        state = self.learner.state() | {
            "step": step,
            "samples": self.before + step * args.batch * self.place.world,
            "before": self.before,
            "config": self.network.config.asdict(),
            "size": args.size,
            "top_size": 2 * args.size if args.large_every else 0,
            "seconds": seconds,
            "folds": self.folds,
        }
        checkpoint.save(state, self.path, args.split_checkpoint)

    def average_scores(self, val: list[Batch]) -> dict[str, float]:
        """Validation errors of the averaged weights."""
        probe = Network(self.network.config).to(self.place.device, memory_format=torch.channels_last)
        probe.load_state_dict(self.learner.ema.state)
        return evaluate(probe, val, self.place.device)


class Log:
    """The first process's progress bar, TensorBoard, RUN/val.jsonl and RUN/curves.png."""

    def __init__(self, args: argparse.Namespace, place: Place, total: int, start: int):
        self.args, self.per_step = args, args.batch * place.world
        args.out.mkdir(parents=True, exist_ok=True)
        self.writer = SummaryWriter(args.out / "tensorboard")
        self.bar = tqdm(total=total, initial=start, mininterval=10, dynamic_ncols=True)
        self.world = place.world

    def say(self, line: str) -> None:
        tqdm.write(line)

    def losses(self, step: int, means: dict[str, float], count: int, render: float, network: float) -> None:
        """Mean losses and rates of the last `count` steps of this process."""
        n = count * self.args.batch
        rates = {
            "samples_per_s": n * self.world / max(render + network, 1e-9),
            "render_only": n / max(render, 1e-9),
            "network_only": n / max(network, 1e-9),
        }
        for k, v in (means | rates).items():
            self.writer.add_scalar(f"train/{k}", v, step)
        shown = {k: v for k, v in (means | rates).items() if k != "albedo_l1"}
        self.bar.set_postfix_str(" ".join(f"{k}={v:.4g}" for k, v in shown.items()))

    def scores(self, step: int, scores: dict[str, float]) -> None:
        """One line of RUN/val.jsonl; the curves are drawn anew."""
        for k, v in scores.items():
            self.writer.add_scalar(f"val/{k}", v, step)
        line = {"step": step, "samples": step * self.per_step, **scores}
        with (self.args.out / "val.jsonl").open("a") as f:
            f.write(json.dumps(line) + "\n")
        self.say(json.dumps({k: round(v, 5) for k, v in line.items()}))
        self.writer.flush()
        with contextlib.suppress(OSError):
            curves.draw(self.args.out)

    def close(self) -> None:
        self.bar.close()
        self.writer.close()


def describe(args: argparse.Namespace, config: NetworkConfig) -> dict:
    """RUN/config.json."""
    return {
        "args": {k: str(v) for k, v in vars(args).items()},
        "network": config.asdict(),
        "losses": asdict(LossWeights()),
    }
