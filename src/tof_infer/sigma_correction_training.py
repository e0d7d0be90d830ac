# SPDX-License-Identifier: Apache-2.0
"""Training of the frame-level correction of sigma."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import torch

from tof_infer.loss import usable
from tof_infer.sigma_calibration import LEAST_CORRECTED
from tof_infer.sigma_correction import SigmaCorrection, cells_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from torch import Tensor

    from tof_infer.batches import Batcher
    from tof_infer.network import RepairNet

STEPS, BATCH, RATE = 1200, 8, 3e-3
STRIDE = 7
"""Step between the pixels used for training."""
LEVELS = ((0.0, 0.6827, 0.05), (math.log(2.0), 0.9545, 0.03))
"""Log of a multiple of sigma, the share of errors within it, and the tolerance of that share."""


@dataclass(frozen=True, slots=True, eq=False)
class TrainingFrame:
    """A training frame: cells and their shares of valid pixels; for some pixels the cell, the log error and the log scale."""

    cells: Tensor
    share: Tensor
    cell: Tensor
    error: Tensor
    scale: Tensor


def train_correction(net: RepairNet, batcher: Batcher, device: torch.device, seed: int) -> SigmaCorrection:
    """A correction trained on frames of scenes that the network was not trained on."""
    return fit_correction(_frames(net, batcher, device), seed)


def fit_correction(frames: Sequence[TrainingFrame], seed: int, steps: int = STEPS) -> SigmaCorrection:
    """Train a correction with which 68 and 95 % of the errors lie within one and two sigma, over pixels of small enough scale.

    The loss is the sum of both quantiles' pinball losses, divided by their tolerances; no distribution of the errors is assumed.
    """
    limit = torch.quantile(torch.cat([x.scale[::STRIDE] for x in frames]), LEAST_CORRECTED)
    torch.manual_seed(seed)
    correction = SigmaCorrection(frames[0].cells.shape[0])
    optimiser = torch.optim.AdamW(correction.parameters(), lr=RATE, weight_decay=0.1)
    falling = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, steps)
    rng = np.random.default_rng(seed)
    for _ in range(steps):
        loss = _loss(correction, [frames[int(k)] for k in rng.choice(len(frames), BATCH)], limit)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        falling.step()
    correction.eval()
    return correction


@torch.no_grad()
def _frames(net: RepairNet, batcher: Batcher, device: torch.device) -> list[TrainingFrame]:
    net.eval()
    out = []
    for images, target in batcher.plain():
        images = {k: v.to(device) for k, v in images.items()}
        target = {k: v.to(device) for k, v in target.items()}
        depth, log, features = net.look(images)
        cells, share = cells_of(*features, log)
        pixels = usable(images, target)[0, 0].nonzero()[::STRIDE]
        rows, columns = pixels[:, 0], pixels[:, 1]
        size = log.shape[-1] // cells.shape[-1]
        error = (depth - target["label"])[0, 0, rows, columns].abs()
        cell = rows // size * cells.shape[-1] + columns // size
        found = (cells[0], share[0], cell, torch.log(error + 1e-5), log[0, 0, rows, columns])
        out.append(TrainingFrame(*(x.cpu() for x in found)))
    return out


def _loss(correction: SigmaCorrection, frames: Sequence[TrainingFrame], limit: Tensor) -> Tensor:
    addend = correction(torch.stack([x.cells for x in frames]), torch.stack([x.share for x in frames])).flatten(1)
    beyond = torch.cat([x.error - x.scale - addend[k, x.cell] for k, x in enumerate(frames)])
    counts = (torch.cat([x.scale for x in frames]) <= limit).float()
    losses = [torch.maximum(share * (beyond - far), (share - 1) * (beyond - far)) / tolerance for far, share, tolerance in LEVELS]
    return (sum(losses) * counts).sum() / counts.sum()
