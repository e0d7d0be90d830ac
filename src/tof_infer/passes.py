# SPDX-License-Identifier: Apache-2.0
"""One pass of training over all samples: steps, their rate, and the running average of the weights."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import torch

from tof_core.errors import RefusedError
from tof_core.progress import progress
from tof_infer.loss import loss_of

if TYPE_CHECKING:
    from tof_infer.batches import Batcher
    from tof_infer.config import TrainConfig
    from tof_infer.network import RepairNet

AVERAGED = 0.998
"""Weight of the previous value in the running average of the weights; the average is exported."""
WARM = 0.02
FALLS_FROM = 0.4
"""Share of all steps after which the rate falls."""
CLIP = 1.0


@dataclass(slots=True, eq=False)
class State:
    """Networks, optimiser and progress of a training."""

    net: RepairNet
    average: RepairNet
    optimiser: torch.optim.Optimizer
    epoch: int
    curves: list[dict[str, float]]


def learning_rate(step: int, steps: int, config: TrainConfig) -> float:
    """Learning rate: linear warm-up, constant, then a cosine decay."""
    share = step / max(steps, 1)
    if share < WARM:
        return config.rate * (step + 1) / (WARM * steps + 1)
    if share < FALLS_FROM:
        return config.rate
    return config.rate * (0.01 + 0.99 * 0.5 * (1 + math.cos(math.pi * (share - FALLS_FROM) / (1 - FALLS_FROM))))


def one_pass(state: State, batcher: Batcher, config: TrainConfig, device: torch.device) -> float:
    """Train over all samples once; returns the mean loss.

    Raises:
        RefusedError: the loss is no number any more.
    """
    state.net.train()
    per_epoch = -(-len(batcher.samples) // config.batch)
    total, count = 0.0, 0
    for number, (images, target) in enumerate(progress(batcher.epoch(state.epoch), f"epoch {state.epoch + 1}", per_epoch)):
        for group in state.optimiser.param_groups:
            group["lr"] = learning_rate(state.epoch * per_epoch + number, config.epochs * per_epoch, config)
        images = {k: v.to(device) for k, v in images.items()}
        depth, log_scale = state.net(images)
        loss = loss_of(config.loss, depth, log_scale, images, {k: v.to(device) for k, v in target.items()})
        state.optimiser.zero_grad(set_to_none=True)
        loss.backward()
        torch.nn.utils.clip_grad_norm_(state.net.parameters(), CLIP)
        state.optimiser.step()
        _average(state, state.epoch * per_epoch + number)
        total, count = total + float(loss.detach()), count + 1
    if not math.isfinite(total):
        raise RefusedError("the loss is no number any more", where=f"epoch {state.epoch + 1}", todo="train with a smaller --rate")
    return total / max(count, 1)


@torch.no_grad()
def _average(state: State, step: int) -> None:
    keep = min(AVERAGED, (1 + step) / (10 + step))
    for mine, new in zip(state.average.parameters(), state.net.parameters(), strict=True):
        mine.lerp_(new, 1 - keep)
