"""One optimiser step: network and losses as one graph, gradients clipped, bad steps undone."""

from __future__ import annotations

import contextlib
import copy
import math

import torch
from torch import Tensor, nn

from ..data.batches import Batch
from ..losses import LossWeights, losses, point_lights
from ..model import Network


class Step(nn.Module):
    """Network and losses as one graph, so that the compiler fuses across them."""

    def __init__(self, network: Network, weights: LossWeights, class_weight: Tensor, only_class: bool):
        super().__init__()
        self.network, self.weights, self.only_class = network, weights, only_class
        self.register_buffer("class_weight", class_weight)

    def forward(
        self, x: Tensor, target: dict[str, Tensor], f0: Tensor, points: Tensor, view: Tensor, lights: Tensor
    ) -> dict[str, Tensor]:
        if self.only_class:
            logits = self.network.classify(x)
            c = torch.nn.functional.cross_entropy(logits.float(), target["cls"], weight=self.class_weight)
            return {"total": c, "cls": c}
        predicted = {k: v.float() for k, v in self.network(x).items()}
        pairs = point_lights(points, list(lights.unbind(dim=1)))
        target = target | {"photo": x[:, :3].float()}
        return losses(predicted, target, f0, view, pairs, self.class_weight, self.weights)


class Ema:
    """Exponential moving average of all weights that learn and of all statistics, warmed up."""

    def __init__(self, network: nn.Module, decay: float):
        self.decay = decay
        self.fixed = {k for k, p in network.named_parameters() if not p.requires_grad}
        self.state = {k: v.detach().clone() for k, v in network.state_dict().items()}

    def update(self, network: nn.Module, step: int) -> None:
        """Takes the weights of `network` after step `step` in."""
        d = min(self.decay, (1 + step) / (10 + step))
        for k, v in network.state_dict().items():
            if k in self.fixed:
                continue
            if v.dtype.is_floating_point:
                self.state[k].lerp_(v.detach(), 1 - d)
            else:
                self.state[k].copy_(v)


def learning_rate(step: int, total: int, peak: float, warmup: int) -> float:
    """Linear warm-up, then cosine to 1 %."""
    if step < warmup:
        return peak * (step + 1) / warmup
    t = (step - warmup) / max(1, total - warmup)
    return peak * (0.01 + 0.99 * 0.5 * (1 + math.cos(math.pi * min(1.0, t))))


def forward_losses(module: nn.Module, batch: Batch, bf16: bool) -> dict[str, Tensor]:
    """The losses of a batch, computed by a `Step`, wrapped or compiled or not."""
    kind = batch.input.device.type
    with torch.autocast(kind, torch.bfloat16) if bf16 else contextlib.nullcontext():
        x = batch.input.contiguous(memory_format=torch.channels_last)
        lights = torch.cat((batch.light[:, None], batch.novel), dim=1)
        return module(x, batch.target, batch.f0, batch.points, batch.view, lights)


class Learner:
    """Network, its average and the optimiser, stepped together.

    A step whose gradient is not finite changes nothing that the gradient reaches: its gradient is set to zero on the
    device, without waiting for it. Batch statistics may have been spoilt all the same; so `check`, called at times,
    says how many such steps there were and, if any, goes back to the last state that `keep` kept.
    """

    def __init__(self, network: nn.Module, ema_decay: float, lr: float):
        self.network, self.ema = network, Ema(network, ema_decay)
        self.parameters = [p for p in network.parameters() if p.requires_grad]
        self.optimizer = self.make_optimizer(lr)
        self.device = self.parameters[0].device
        self.bad = torch.zeros((), device=self.device)
        self.sums: dict[str, Tensor] = {}
        self.count = 0
        self._kept: dict | None = None

    def make_optimizer(self, lr: float) -> torch.optim.Optimizer:
        """What steps the parameters."""
        return torch.optim.AdamW(self.parameters, lr=lr, betas=(0.9, 0.99), weight_decay=1e-4, fused=True)

    def losses(self, module: nn.Module, batch: Batch, bf16: bool) -> dict[str, Tensor]:
        """The losses of a batch; `total` is what the step lowers."""
        return forward_losses(module, batch, bf16)

    def step(self, module: nn.Module, batch: Batch, bf16: bool, lr: float, step: int) -> None:
        """One step; losses are summed on the device until `take_means`."""
        for g in self.optimizer.param_groups:
            g["lr"] = lr
        out = self.losses(module, batch, bf16)
        self.optimizer.zero_grad(set_to_none=True)
        out["total"].backward()
        norm = nn.utils.clip_grad_norm_(self.parameters, 1.0)
        fine = torch.isfinite(norm)
        grads = [p.grad for p in self.parameters if p.grad is not None]
        for g in grads:
            g.masked_fill_(~fine, 0.0)
        self.optimizer.step()
        self.ema.update(self.network, step)
        self.bad += (~fine).float()
        for k, v in out.items():
            v = torch.where(fine, v.detach().float(), 0.0)
            self.sums[k] = self.sums[k] + v if k in self.sums else v
        self.count += 1

    def take_means(self) -> dict[str, float]:
        """Mean losses since the last call; waits for the device."""
        good = max(self.count - float(self.bad), 1.0)
        means = {k: float(v) / good for k, v in self.sums.items()}
        self.sums, self.count = {}, 0
        return means

    def state(self) -> dict:
        """What a checkpoint holds of this."""
        return {
            "network": self.network.state_dict(),
            "ema": self.ema.state,
            "optimizer": self.optimizer.state_dict(),
        }

    def load(self, state: dict) -> None:
        """The inverse of `state`."""
        self.network.load_state_dict(state["network"])
        self.ema.state = {k: v.detach().clone().to(self.device) for k, v in state["ema"].items()}
        self.optimizer.load_state_dict(state["optimizer"])

    def keep(self) -> None:
        """Remembers the present state for `check` to go back to."""
        self._kept = copy.deepcopy(self.state())

    def check(self) -> int:
        """Number of steps since the last call whose gradient was not finite; if any, the kept state is back."""
        bad = int(self.bad)
        self.bad.zero_()
        if bad and self._kept is not None:
            self.load(copy.deepcopy(self._kept))
        return bad
