# SPDX-License-Identifier: Apache-2.0
"""Training: from datasets to a model and its card. After an interruption the same call continues at the last checkpoint."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from tof_core.config import to_mapping
from tof_core.cores import FREE
from tof_core.errors import ModelError, RefusedError
from tof_core.hashing import digest_config
from tof_infer.batches import Batcher
from tof_infer.card import Card
from tof_infer.export import export
from tof_infer.network import RepairNet
from tof_infer.passes import State, one_pass
from tof_infer.samples import Pool, Samples
from tof_infer.sigma_calibration import Calibration
from tof_infer.unseen import Unseen, calibrate_sigma
from tof_infer.validate import validate

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from tof_core.arrays import Ints
    from tof_infer.augment import Redraw
    from tof_infer.config import TrainConfig
    from tof_sim_label.split import Split


def train(
    paths: Sequence[Path],
    out: Path,
    config: TrainConfig,
    *,
    redraw: Redraw | None = None,
    fresh: bool = False,
    unseen: Sequence[Path] = (),
    say: Callable[[str], None] = lambda _: None,
) -> Card:
    """Train on datasets; write `out` and its card. During training, the checkpoint is `<out>.ckpt`.

    `unseen` are datasets of other scenes: errors on new stations of a trained scene are smaller than on a new scene. Two of
    three train the frame-level correction of sigma, the others calibrate sigma. Without them the validation views calibrate it.

    Raises:
        RefusedError: too few stations, or no usable label.
        DatasetError: a damaged dataset, or several cameras.
        ModelError: the checkpoint belongs to other data or settings.
    """
    config = config.resolved
    pool = Pool(paths)
    split = pool.split(config.val, config.test, config.seed)
    training, validation = _samples(pool, split, config)
    others = Unseen.of(unseen, pool)
    say(
        f"{len(training)} captures to train on, {len(validation)} to check on, {pool.stations} stations; "
        f"left out: {dict(training.skipped + validation.skipped) or 'none'}"
    )
    torch.manual_seed(config.seed)
    device = device_of(config)
    state = _new_state(config, training, device)
    digest = digest_config({"config": _of_weights(config), "data": pool.facts(), "redraw": repr(redraw)})
    checkpoint = out.with_name(out.name + ".ckpt")
    if not fresh and checkpoint.exists():
        _resume(checkpoint, state, digest)
        say(f"resuming after epoch {state.epoch}")
    batcher, checker = Batcher(training, config, redraw), Batcher(validation, config)
    while state.epoch < config.epochs:
        torch.set_num_threads(config.threads or FREE.count())
        line = _one_epoch(state, batcher, checker, device)
        _save(checkpoint, state, digest)
        say(line)
    figures, limit = calibrate_sigma(state.average, {"val": checker}, others, config, device)
    card = _card(config, pool, split, training, state, figures, limit, others)
    out.parent.mkdir(parents=True, exist_ok=True)
    export(state.average.cpu(), Calibration(**card.figures["calibration"]), card, out)
    checkpoint.unlink(missing_ok=True)
    return card


def _of_weights(config: TrainConfig) -> dict[str, Any]:
    """The settings that decide what is learnt. A checkpoint may be continued on another device, or with other threads."""
    return {name: value for name, value in to_mapping(config).items() if name not in {"device", "threads"}}


def _one_epoch(state: State, batcher: Batcher, checker: Batcher, device: torch.device) -> str:
    """Train over all samples once, validate at intervals; returns the progress line."""
    config, started = batcher.config, time.monotonic()
    every = -(-2 * len(checker.samples) // len(batcher.samples))  # validation must not take longer than training
    point = {"epoch": state.epoch + 1, "loss": one_pass(state, batcher, config, device)}
    state.epoch += 1
    line = f"epoch {state.epoch}/{config.epochs}: loss {point['loss']:.4f}"
    if state.epoch % every == 0:
        verdict = validate(state.average, checker, device, config.loss)
        point |= {"val_loss": verdict.loss, "val_mae_mm": verdict.mae * 1e3}
        line += f", validation {verdict.loss:.4f}, MAE {verdict.mae * 1e3:.2f} mm (raw {verdict.raw_mae * 1e3:.2f} mm)"
    state.curves.append(point)
    return f"{line}, {time.monotonic() - started:.1f} s"


def _samples(pool: Pool, split: Split, config: TrainConfig) -> tuple[Samples, Samples]:
    views = split.train
    if config.limit:
        views = thinned(views, config.limit)
    training, validation = Samples(pool, views), Samples(pool, split.val)
    for name, samples in (("training", training), ("validation", validation)):
        if not len(samples):
            why = ", ".join(f"{n} with {reason}" for reason, n in samples.skipped.items()) or "no captures"
            raise RefusedError(
                f"nothing to learn from in the {name} views ({why})",
                where=pool.datasets[0].path,
                todo="label again, and look at its verdicts",
            )
    return training, validation


def thinned(views: Ints, count: int) -> Ints:
    """`count` of the views, spread evenly."""
    return np.asarray(views[np.unique(np.linspace(0, len(views) - 1, min(count, len(views))).astype(int))])


def device_of(config: TrainConfig) -> torch.device:
    """The device to train on.

    Raises:
        RefusedError: CUDA is requested but not available.
    """
    if config.device == "cuda" and not torch.cuda.is_available():
        raise RefusedError("there is no CUDA device", where="train.device", todo="train with --device cpu")
    return torch.device("cuda" if config.device != "cpu" and torch.cuda.is_available() else "cpu")


def _new_state(config: TrainConfig, training: Samples, device: torch.device) -> State:
    net, average = RepairNet(config.net), RepairNet(config.net)
    measure_amplitude(net, training)
    average.load_state_dict(net.state_dict())
    net.to(device)
    average.to(device)
    optimiser = torch.optim.AdamW(net.parameters(), lr=config.rate, weight_decay=config.decay)
    return State(net, average, optimiser, 0, [])


def measure_amplitude(net: RepairNet, samples: Samples) -> None:
    """Set the mean and standard deviation that normalise log amplitude to those of the samples."""
    amplitude = np.concatenate([_logs(samples[i].amplitude) for i in range(0, len(samples), max(len(samples) // 50, 1))])
    if amplitude.size:
        net.features.log_amplitude.copy_(torch.tensor([float(amplitude.mean()), float(amplitude.std()) + 1e-3]))


def _logs(amplitude: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    seen = amplitude[np.isfinite(amplitude) & (amplitude > 0)]
    return np.asarray(np.log(seen[::17].astype(np.float64)))


def _save(path: Path, state: State, digest: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(path.name + ".tmp")
    torch.save(
        {
            "digest": digest,
            "epoch": state.epoch,
            "curves": state.curves,
            "net": state.net.state_dict(),
            "average": state.average.state_dict(),
            "optimiser": state.optimiser.state_dict(),
        },
        temporary,
    )
    temporary.replace(path)


def _resume(path: Path, state: State, digest: str) -> None:
    try:
        saved = torch.load(path, weights_only=True, map_location="cpu")
    except Exception as error:
        raise ModelError("the checkpoint is damaged", where=path, todo="remove it, or pass --fresh") from error
    if saved["digest"] != digest:
        raise ModelError("the checkpoint is of other data or settings", where=path, todo="pass --fresh to begin anew, or the old settings")
    state.net.load_state_dict(saved["net"])
    state.average.load_state_dict(saved["average"])
    state.optimiser.load_state_dict(saved["optimiser"])
    state.epoch, state.curves = saved["epoch"], saved["curves"]


def range_of(training: Samples) -> tuple[float, float]:
    """Least and largest depth of the labels in metres, without the outermost 0.2 %."""
    low, high = np.quantile(np.concatenate([training[i].label[training[i].mask][::101] for i in range(len(training))]), [0.002, 0.998])
    return float(low), float(high)


def _card(
    config: TrainConfig,
    pool: Pool,
    split: Split,
    training: Samples,
    state: State,
    figures: dict[str, Any],
    limit: float,
    others: Unseen,
) -> Card:
    return Card(
        inputs=config.net.names,
        multiple=config.net.multiple,
        camera=pool.camera,
        range_m=range_of(training),
        max_sigma_m=limit,
        config=to_mapping(config),
        data=pool.facts(),
        split={
            "by": "station",
            "seed": config.seed,
            "train_views": len(split.train),
            "val_views": len(split.val),
            "test_views": len(split.test),
            "train_captures": len(training),
            **others.facts,
        },
        figures=figures,
        curves=state.curves,
    )
