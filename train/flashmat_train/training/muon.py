"""Muon: momentum whose matrix is made orthogonal before the step, for hidden convolutions; AdamW for the rest.

Jordan et al., "Muon: an optimizer for hidden layers in neural networks" (2024). A convolution's weights are read as a
matrix of output channels by everything else. The update's size is that of AdamW's (Liu et al., "Muon is scalable for
LLM training", 2025), so that one learning rate serves both.
"""

from __future__ import annotations

from collections.abc import Iterable

import torch
from torch import Tensor

#: Coefficients of the quintic iteration that draws all singular values to about 1.
QUINTIC = (3.4445, -4.7750, 2.0315)
STEPS = 5


def orthogonal(x: Tensor) -> Tensor:
    """The matrix nearest to `x` whose singular values are all about 1 (0.7 to 1.2), by Newton-Schulz iterations."""
    wide = x if x.shape[0] <= x.shape[1] else x.T
    wide = wide / (wide.norm() + 1e-7)
    a, b, c = QUINTIC
    for _ in range(STEPS):
        square = wide @ wide.T
        wide = a * wide + (b * square + c * square @ square) @ wide
    return wide if x.shape[0] <= x.shape[1] else wide.T


class Muon(torch.optim.Optimizer):
    """For weights of two or more axes; momentum with Nesterov's look ahead, decoupled weight decay."""

    def __init__(self, params: Iterable[Tensor], lr: float, momentum: float = 0.95, weight_decay: float = 1e-2):
        super().__init__(params, {"lr": lr, "momentum": momentum, "weight_decay": weight_decay})

    @torch.no_grad()
    def step(self) -> None:
        for group in self.param_groups:
            for p in group["params"]:
                if p.grad is None:
                    continue
                state = self.state[p]
                if "momentum" not in state:
                    state["momentum"] = torch.zeros_like(p.grad)
                momentum = state["momentum"].lerp_(p.grad, 1 - group["momentum"])
                matrix = p.grad.lerp(momentum, group["momentum"]).flatten(1)
                update = orthogonal(matrix).view(p.shape)
                p.mul_(1 - group["lr"] * group["weight_decay"])
                p.add_(update, alpha=-group["lr"] * 0.2 * max(matrix.shape) ** 0.5)


class Together:
    """Several optimisers stepped as one."""

    def __init__(self, *parts: torch.optim.Optimizer):
        self.parts = parts

    @property
    def param_groups(self) -> list[dict]:
        return [group for part in self.parts for group in part.param_groups]

    def zero_grad(self, set_to_none: bool = True) -> None:
        for part in self.parts:
            part.zero_grad(set_to_none=set_to_none)

    def step(self) -> None:
        for part in self.parts:
            part.step()

    def state_dict(self) -> dict:
        return {"parts": [part.state_dict() for part in self.parts]}

    def load_state_dict(self, state: dict) -> None:
        for part, own in zip(self.parts, state["parts"], strict=True):
            part.load_state_dict(own)


def muon_and_adamw(named: Iterable[tuple[str, torch.nn.Parameter]], hidden: set[str], lr: float) -> Together:
    """Muon for the parameters that `hidden` names, AdamW for the others that learn."""
    named = [(name, p) for name, p in named if p.requires_grad]
    inner = [p for name, p in named if name in hidden]
    outer = [p for name, p in named if name not in hidden]
    return Together(Muon(inner, lr), torch.optim.AdamW(outer, lr=lr, betas=(0.9, 0.99), weight_decay=1e-4))
