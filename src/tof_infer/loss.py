# SPDX-License-Identifier: Apache-2.0
"""The training loss, over the pixels that have a depth and a label."""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch

if TYPE_CHECKING:
    from torch import Tensor


def usable(images: dict[str, Tensor], target: dict[str, Tensor]) -> Tensor:
    """(N, 1, H, W) pixels with a depth and a usable label."""
    return torch.isfinite(images["depth"]) & (images["depth"] > 0) & target["mask"]


def loss_of(kind: str, depth: Tensor, log_scale: Tensor, images: dict[str, Tensor], target: dict[str, Tensor]) -> Tensor:
    """Mean loss of a batch. The label's standard deviation is added to the predicted scale, since label errors are no errors of the network."""
    where = usable(images, target)
    error = (depth - target["label"])[where]
    if kind == "mse":
        return (error * error).mean()
    scale = torch.sqrt(torch.exp(2 * log_scale[where]) + target["sigma"][where] ** 2)
    if kind == "normal":
        return (0.5 * (error / scale) ** 2 + torch.log(scale)).mean()
    return (error.abs() / scale + torch.log(scale)).mean()
