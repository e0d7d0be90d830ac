# SPDX-License-Identifier: Apache-2.0
"""Adaptation of a trained network to another camera with a few labelled views.

Training continues from all weights of the given network: noise, edges and surfaces look alike for every camera, and few steps
suffice for what differs. Gains and shifts of channels alone (feature-wise modulation) were tried and left larger errors.
"""

from __future__ import annotations

import copy
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from tof_core.config import from_mapping, to_mapping
from tof_core.cores import FREE
from tof_core.errors import RefusedError
from tof_core.hashing import digest_file
from tof_infer.batches import Batcher
from tof_infer.card import Card
from tof_infer.config import NetConfig
from tof_infer.export import export, restore
from tof_infer.passes import State, one_pass
from tof_infer.samples import Pool, Samples
from tof_infer.train import device_of, range_of
from tof_infer.validate import Validation, validate

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from tof_core.arrays import Ints
    from tof_infer.augment import Redraw
    from tof_infer.config import TrainConfig
    from tof_infer.network import RepairNet

MIN_VIEWS = 2
"""Fewest views: sigma is calibrated on views that a network was not trained on."""


def adapt(
    paths: Sequence[Path],
    base: Path,
    out: Path,
    config: TrainConfig,
    *,
    redraw: Redraw | None = None,
    say: Callable[[str], None] = lambda _: None,
) -> Card:
    """Continue the training of the network `base` on datasets of one camera; write `out` and its card.

    Three networks are trained: the written one on all views, and one on each half of the views, validated on the other half. Sigma,
    its limit and the card's figures come from the latter two. They are validated against labels: an error common to all labels of the
    camera (a constant range offset) does not appear in the figures.

    Raises:
        RefusedError: fewer than two views with usable labels.
        DatasetError: a damaged dataset, or several cameras.
        ModelError: `base` is not a network of `toftwin train`.
    """
    net, source = restore(base)
    net.doubt = None  # trained on frames of the other camera
    config = replace(config, net=from_mapping(NetConfig, source.config["net"], where="card"), batch=1, rate=config.adapt.rate)
    device = device_of(config)
    pool = Pool(paths, least=1)
    every = Samples(pool, np.arange(pool.views))
    halves = _halves(every)
    say(f"{len(every)} captures of {sum(len(h) for h in halves)} views to adapt {base.name} to; left out: {dict(every.skipped) or 'none'}")
    verdicts = []
    for number, (shown, held) in enumerate((halves, halves[::-1]), 1):
        half, _ = _trained(net, Batcher(Samples(pool, shown), config, redraw), config.adapt.check_steps, device)
        verdicts.append(validate(half, Batcher(Samples(pool, held), config), device, config.loss))
        say(f"half {number}: MAE {verdicts[-1].mae * 1e3:.2f} mm (raw {verdicts[-1].raw_mae * 1e3:.2f} mm) on the views of the other half")
    verdict = Validation.of_all(verdicts)
    calibration, limit = verdict.calibrated(config.max_sigma_mm * 1e-3)
    adapted, curves = _trained(net, Batcher(every, config, redraw), config.adapt.steps, device)
    weights = sum(p.numel() for p in adapted.parameters())
    card = Card(
        inputs=config.net.names,
        multiple=config.net.multiple,
        camera=pool.camera,
        range_m=range_of(every),
        max_sigma_m=limit,
        config=to_mapping(config),
        data=pool.facts(),
        split=_split(halves, every, config),
        figures={**verdict.figures("val", calibration, limit), "calibration": asdict(calibration), "weights": weights},
        curves=curves,
        base={"name": base.name, "digest": digest_file(base), "camera": asdict(source.camera)},
    )
    out.parent.mkdir(parents=True, exist_ok=True)
    export(adapted.cpu(), calibration, card, out)
    return card


def _halves(every: Samples) -> tuple[Ints, Ints]:
    """Usable views, alternating in two halves, so that both contain every station."""
    views = np.unique([place.pooled for place in every.places])
    if len(views) < MIN_VIEWS:
        raise RefusedError(
            f"{len(views)} view(s) with usable labels are too few to adapt to: {dict(every.skipped) or 'none left out'}",
            where=every.pool.datasets[0].path,
            todo=f"label at least {MIN_VIEWS} views, better five, at different ranges",
        )
    return views[0::2], views[1::2]


def _split(halves: tuple[Ints, Ints], every: Samples, config: TrainConfig) -> dict[str, Any]:
    views = sum(len(h) for h in halves)
    return {"by": "view", "seed": config.seed, "train_views": views, "val_views": views, "test_views": 0, "train_captures": len(every)}


def _trained(net: RepairNet, batcher: Batcher, steps: int, device: torch.device) -> tuple[RepairNet, list[dict[str, float]]]:
    """The network after about `steps` more steps (running average), and the mean loss of each pass."""
    passes = -(-steps // len(batcher.samples))
    config = replace(batcher.config, epochs=passes)
    torch.manual_seed(config.seed)
    torch.set_num_threads(config.threads or FREE.count())
    new = copy.deepcopy(net).to(device)
    optimiser = torch.optim.AdamW(new.parameters(), lr=config.rate, weight_decay=config.decay)
    state = State(new, copy.deepcopy(new), optimiser, 0, [])
    while state.epoch < passes:
        loss = one_pass(state, batcher, config, device)
        state.epoch += 1
        state.curves.append({"epoch": state.epoch, "loss": loss})
    return state.average, state.curves
