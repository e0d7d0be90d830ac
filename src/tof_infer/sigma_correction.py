# SPDX-License-Identifier: Apache-2.0
"""Frame-level correction of sigma, trained on scenes that the depth network was not trained on.

Errors beyond two sigma are not at edges but on smooth surfaces with bright neighbours (multipath): thousands of pixels at once,
nearly all measured too far, half of them in a tenth of the frames. The scale of a pixel, computed from its surroundings and trained
on known scenes, does not contain these errors. Brightness, width and concavity of the whole frame predict them.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional as F  # noqa: N812 (as PyTorch calls it)

CELL = 4
"""Blocks of the finest level along each side of a cell."""
LOWEST = -8.0
"""Log of the smallest scale in metres; smaller ones are set to it."""


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
