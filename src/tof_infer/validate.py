# SPDX-License-Identifier: Apache-2.0
"""Validation of a network against the labels of views that it was not trained on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from tof_infer.loss import loss_of, usable
from tof_infer.sigma_calibration import Calibration, calibrate, coverage, sigma_limit

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float
    from tof_infer.batches import Batcher
    from tof_infer.network import RepairNet

STRIDE = 7
"""Step between the pixels whose errors are stored individually."""


@dataclass(frozen=True, slots=True, eq=False)
class Validation:
    """Validation: mean loss, mean absolute errors in metres of the network and of the raw depth, and thinned pixels (n,).

    log_scale: with the frame-level correction; own: from the pixel's surroundings alone.
    """

    loss: float
    mae: float
    raw_mae: float
    error: Float
    raw_error: Float
    log_scale: Float
    own: Float

    @classmethod
    def of_all(cls, verdicts: Sequence[Validation]) -> Validation:
        """Several validations as one; means are weighted by the number of pixels."""
        pixels = [len(v.error) for v in verdicts]
        loss, mae, raw = (float(np.average([getattr(v, n) for v in verdicts], weights=pixels)) for n in ("loss", "mae", "raw_mae"))
        thin = (np.concatenate([getattr(v, n) for v in verdicts]) for n in ("error", "raw_error", "log_scale", "own"))
        return cls(loss, mae, raw, *thin)

    def calibrated(self, max_sigma_m: float = 0.0) -> tuple[Calibration, float]:
        """The calibration of sigma for these errors, and the sigma in metres above which raw depth is kept (`max_sigma_m`, chosen here if 0)."""
        calibration = calibrate(self.error, self.log_scale, self.own)
        return calibration, max_sigma_m or sigma_limit(self.error, self.raw_error, calibration.sigma(self.own))

    def figures(self, name: str, calibration: Calibration, limit: float) -> dict[str, Any]:
        """Plain numbers for the card; their names begin with `name`."""
        sigma = calibration.sigma(self.log_scale)
        known = calibration.sigma(self.own) <= limit
        one, two = coverage(self.error[known], sigma[known])
        wrong = (np.abs(self.error) > 0.01) & known
        values = {
            "mae_mm": self.mae * 1e3,
            "raw_mae_mm": self.raw_mae * 1e3,
            "mae_known_mm": float(np.abs(self.error[known]).mean() * 1e3) if known.any() else None,
            "known": float(known.mean()),
            "within_1_sigma": one,
            "within_2_sigma": two,
            "wrong_10mm": float(wrong.mean()),
            "raw_wrong_10mm": float((np.abs(self.raw_error) > 0.01).mean()),
        }
        return {f"{name}_{key}": value for key, value in values.items()}


@torch.no_grad()
def validate(net: RepairNet, batcher: Batcher, device: torch.device, kind: str) -> Validation:
    """Run the network over all samples without augmentation."""
    net.eval()
    losses: list[float] = []
    errors: list[np.ndarray[Any, Any]] = []
    for images, target in batcher.plain():
        images = {k: v.to(device) for k, v in images.items()}
        target = {k: v.to(device) for k, v in target.items()}
        depth, log_scale, own = net.with_correction(images)
        losses.append(float(loss_of(kind, depth, own, images, target)))
        where = usable(images, target)
        rows = [(depth - target["label"])[where], (images["depth"] - target["label"])[where], log_scale[where], own[where]]
        errors.append(torch.stack(rows).cpu().numpy())
    every = np.concatenate(errors, axis=1)
    thin = every[:, ::STRIDE].astype(np.float64)
    return Validation(float(np.mean(losses)), float(np.abs(every[0]).mean()), float(np.abs(every[1]).mean()), *thin)
