# SPDX-License-Identifier: Apache-2.0
"""A network against the labels of views that it was not trained on."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from tof_infer.honesty import calibrate, coverage, sigma_limit
from tof_infer.loss import loss_of, usable

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_infer.batches import Batcher
    from tof_infer.network import RepairNet

STRIDE = 7
"""Every so manieth pixel is looked at one by one."""


@dataclass(frozen=True, slots=True, eq=False)
class Verdict:
    """Validation: mean loss, mean absolute errors in metres of the network and of the raw depth, and thinned pixels (n,)."""

    loss: float
    mae: float
    raw_mae: float
    error: Float
    raw_error: Float
    log_scale: Float

    def figures(self, max_sigma_m: float) -> dict[str, Any]:
        """Plain numbers for the card, with the calibration of sigma and the limit to it (chosen here where given as 0) they were reached with."""
        calibration = calibrate(self.error, self.log_scale)
        sigma = calibration.sigma(self.log_scale)
        limit = max_sigma_m or sigma_limit(self.error, self.raw_error, sigma)
        known = sigma <= limit
        one, two = coverage(self.error[known], sigma[known])
        wrong = (np.abs(self.error) > 0.01) & known
        return {
            "val_mae_mm": self.mae * 1e3, "val_raw_mae_mm": self.raw_mae * 1e3,
            "val_mae_known_mm": float(np.abs(self.error[known]).mean() * 1e3) if known.any() else None,
            "val_known": float(known.mean()), "val_within_1_sigma": one, "val_within_2_sigma": two,
            "val_wrong_10mm": float(wrong.mean()), "val_raw_wrong_10mm": float((np.abs(self.raw_error) > 0.01).mean()),
            "calibration": asdict(calibration), "max_sigma_m": limit,
        }


@torch.no_grad()
def judge(net: RepairNet, batcher: Batcher, device: torch.device, kind: str) -> Verdict:
    """Run the network over all samples as they are."""
    net.eval()
    losses: list[float] = []
    errors: list[np.ndarray[Any, Any]] = []
    for images, target in batcher.plain():
        images = {k: v.to(device) for k, v in images.items()}
        target = {k: v.to(device) for k, v in target.items()}
        depth, log_scale = net(images)
        losses.append(float(loss_of(kind, depth, log_scale, images, target)))
        where = usable(images, target)
        rows = [(depth - target["label"])[where], (images["depth"] - target["label"])[where], log_scale[where]]
        errors.append(torch.stack(rows).cpu().numpy())
    every = np.concatenate(errors, axis=1)
    thin = every[:, ::STRIDE].astype(np.float64)
    return Verdict(float(np.mean(losses)), float(np.abs(every[0]).mean()), float(np.abs(every[1]).mean()), thin[0], thin[1], thin[2])
