# SPDX-License-Identifier: Apache-2.0
"""Sigma from scenes that the depth network was not trained on: training and calibration."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from tof_infer.batches import Batcher
from tof_infer.samples import Pool, Samples
from tof_infer.sigma_correction_training import train_correction
from tof_infer.validate import validate

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    import torch

    from tof_infer.config import TrainConfig
    from tof_infer.network import RepairNet

MIN_TRAINING = 100
"""Least captures for training the frame-level correction."""


@dataclass(frozen=True, slots=True, eq=False)
class Unseen:
    """Captures of scenes outside the training data: for training the correction of sigma (None: too few), for its calibration (None: none); description for the card."""

    training: Samples | None
    calibrating: Samples | None
    facts: Mapping[str, Any]

    @classmethod
    def of(cls, paths: Sequence[Path], pool: Pool) -> Unseen:
        """Datasets of the camera of `pool`; every third one calibrates."""
        if not paths:
            return cls(None, None, {})
        third = paths[2::3]
        training = _all_of([p for p in paths if p not in third], pool)
        if not third or len(training) < MIN_TRAINING:
            return cls(None, every := _all_of(paths, pool), _facts(paths, pool, 0, len(every)))
        calibrating = _all_of(third, pool)
        return cls(training, calibrating, _facts(paths, pool, len(training), len(calibrating)))


def _all_of(paths: Sequence[Path], pool: Pool) -> Samples:
    """Every capture of datasets of the same camera."""
    other = Pool([pool.datasets[0].path, *paths])  # the first dataset only serves to compare the camera
    return Samples(other, np.arange(pool.datasets[0].views, other.views))


def _facts(paths: Sequence[Path], pool: Pool, taught: int, checked: int) -> dict[str, Any]:
    data = Pool([pool.datasets[0].path, *paths]).facts()[1:]
    return {"unseen_taught_captures": taught, "unseen_checked_captures": checked, "unseen_data": data}


def calibrate_sigma(
    net: RepairNet, checks: Mapping[str, Batcher], others: Unseen, config: TrainConfig, device: torch.device
) -> tuple[dict[str, Any], float]:
    """Train and calibrate sigma; figures for the card (of `checks`, by name), and the sigma in metres above which the raw depth is kept."""
    if others.training is not None:
        net.doubt = train_correction(net, Batcher(others.training, config), device, config.seed).to(device)
    if others.calibrating is not None:
        checks = {**checks, "unseen": Batcher(others.calibrating, config)}
    verdicts = {name: validate(net, batcher, device, config.loss) for name, batcher in checks.items()}
    calibration, limit = list(verdicts.values())[-1].calibrated(config.max_sigma_mm * 1e-3)
    figures = {key: value for name, verdict in verdicts.items() for key, value in verdict.figures(name, calibration, limit).items()}
    weights = sum(p.numel() for p in net.parameters())
    return {**figures, "calibration": asdict(calibration), "weights": weights}, limit
