# SPDX-License-Identifier: Apache-2.0
"""Sigma from scenes that the depth network was not trained on: training, calibration, and renewal for an existing network."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from tof_core.config import from_mapping
from tof_infer.batches import Batcher
from tof_infer.config import TrainConfig
from tof_infer.doubt import learn_doubt
from tof_infer.export import export, restore
from tof_infer.honesty import Calibration
from tof_infer.judge import judge
from tof_infer.samples import Pool, Samples

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from tof_infer.card import Card
    from tof_infer.network import RepairNet

MIN_TAUGHT = 100
"""Least captures for training the frame-level correction."""
OF_DEPTH = ("val_mae_mm", "val_raw_mae_mm")
"""Figures of the validation views that do not depend on sigma."""


@dataclass(frozen=True, slots=True, eq=False)
class Unseen:
    """Captures of scenes outside the training data: those that train sigma, those that calibrate it (None: too few), and their description."""

    teaching: Samples | None
    checking: Samples | None
    facts: Mapping[str, Any]

    @classmethod
    def of(cls, paths: Sequence[Path], pool: Pool) -> Unseen:
        """Datasets of the camera of `pool`; every third one calibrates."""
        if not paths:
            return cls(None, None, {})
        third = paths[2::3]
        teaching = _all_of([p for p in paths if p not in third], pool)
        if not third or len(teaching) < MIN_TAUGHT:
            return cls(None, every := _all_of(paths, pool), _facts(paths, pool, 0, len(every)))
        checking = _all_of(third, pool)
        return cls(teaching, checking, _facts(paths, pool, len(teaching), len(checking)))


def _all_of(paths: Sequence[Path], pool: Pool) -> Samples:
    """Every capture of datasets of the same camera."""
    other = Pool([pool.datasets[0].path, *paths])  # the first dataset only serves to compare the camera
    return Samples(other, np.arange(pool.datasets[0].views, other.views))


def _facts(paths: Sequence[Path], pool: Pool, taught: int, checked: int) -> dict[str, Any]:
    data = Pool([pool.datasets[0].path, *paths]).facts()[1:]
    return {"unseen_taught_captures": taught, "unseen_checked_captures": checked, "unseen_data": data}


def make_sure(
    net: RepairNet, checks: Mapping[str, Batcher], others: Unseen, config: TrainConfig, device: torch.device
) -> tuple[dict[str, Any], float]:
    """Train and calibrate sigma; figures for the card (of `checks`, by name), and the sigma in metres above which the raw depth is kept."""
    if others.teaching is not None:
        net.doubt = learn_doubt(net, Batcher(others.teaching, config), device, config.seed).to(device)
    if others.checking is not None:
        checks = {**checks, "unseen": Batcher(others.checking, config)}
    verdicts = {name: judge(net, batcher, device, config.loss) for name, batcher in checks.items()}
    calibration, limit = list(verdicts.values())[-1].honest(config.max_sigma_mm * 1e-3)
    figures = {key: value for name, verdict in verdicts.items() for key, value in verdict.figures(name, calibration, limit).items()}
    weights = sum(p.numel() for p in net.parameters())
    return {**figures, "calibration": asdict(calibration), "weights": weights}, limit


def make_sure_again(model: Path, unseen: Sequence[Path], out: Path) -> Card:
    """The same network with a sigma from these datasets; its depth stays as it is.

    Raises:
        ModelError: not a network of `toftwin train`.
        RefusedError: too few stations.
        DatasetError: a damaged dataset, or of another camera than the first.
    """
    net, card = restore(model)
    net.doubt = None
    config = from_mapping(TrainConfig, card.config, where="card")
    torch.set_num_threads(max(config.threads, 1))
    others = Unseen.of(unseen, Pool(unseen))
    figures, limit = make_sure(net, {}, others, config, torch.device("cpu"))
    kept = {name: card.figures[name] for name in OF_DEPTH if name in card.figures}
    split = {name: value for name, value in card.split.items() if not name.startswith("unseen")}
    card = replace(card, figures={**kept, **figures}, max_sigma_m=limit, split={**split, **others.facts})
    export(net, Calibration(**figures["calibration"]), card, out)
    return card
