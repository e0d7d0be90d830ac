# SPDX-License-Identifier: Apache-2.0
"""Frame-level correction of sigma, trained on scenes that the depth network was not trained on.

Errors beyond two sigma are not at edges but on smooth surfaces with bright neighbours (multipath): thousands of pixels at once,
nearly all measured too far, half of them in a tenth of the frames. The scale of a pixel, computed from its surroundings and trained
on known scenes, does not contain these errors. Brightness, width and concavity of the whole frame predict them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional as F  # noqa: N812 (as PyTorch calls it)

from tof_infer.loss import usable
from tof_infer.sigma_calibration import LEAST_CORRECTED

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_infer.batches import Batcher
    from tof_infer.network import RepairNet

CELL = 4
"""Blocks of the finest level along each side of a cell."""
LOWEST = -8.0
"""Log of the smallest scale in metres; smaller ones are set to it."""
STEPS, BATCH, RATE = 1200, 8, 3e-3
STRIDE = 7
"""Step between the pixels used for training."""
LEVELS = ((0.0, 0.6827, 0.05), (math.log(2.0), 0.9545, 0.03))
"""Log of a multiple of sigma, the share of errors within it, and the tolerance of that share."""


class SigmaCorrection(nn.Module):
    """Addend to the log of the scale of each cell of a frame, from the cell, its neighbours, and the frame's mean and maximum."""

    def __init__(self, channels: int, width: int = 16) -> None:
        super().__init__()
        self.see = nn.Conv2d(channels, width, 1)
        self.near = nn.Conv2d(width, width, 3, padding=1)
        self.frame = nn.Conv2d(2 * width, width, 1)
        self.join = nn.Conv2d(width, width, 3, padding=1)
        self.tell = nn.Conv2d(width, 1, 1)
        for zeros in (self.tell.weight, self.tell.bias):
            assert zeros is not None
            nn.init.zeros_(zeros)

    def forward(self, cells: Tensor, share: Tensor) -> Tensor:
        """Addends (N, 1, h, w) of cells (N, channels, h, w) with their shares of valid pixels (N, 1, h, w)."""
        x = F.relu(self.see(cells)) * share
        mean = x.sum((2, 3), keepdim=True) / (share.sum((2, 3), keepdim=True) + 1e-6)
        x = F.relu(self.near(x) + self.frame(torch.cat([mean, x.amax((2, 3), keepdim=True)], 1)))
        addend: Tensor = self.tell(F.relu(self.join(x)))
        return addend


def cells_of(fine: Tensor, smooth: Tensor, valid: Tensor, log: Tensor) -> tuple[Tensor, Tensor]:
    """Features and scale of a frame averaged over cells, and each cell's share of valid pixels."""
    size = CELL * log.shape[-1] // fine.shape[-1]
    share = F.avg_pool2d(valid, size)
    mean = F.avg_pool2d((log - LOWEST) * valid, size) / (share + 1e-3)
    most = F.max_pool2d((log - LOWEST) * valid, size)
    return torch.cat([F.avg_pool2d(smooth, size * smooth.shape[-1] // log.shape[-1]), F.avg_pool2d(fine.abs(), CELL), mean, most], 1), share


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
