# SPDX-License-Identifier: Apache-2.0
"""Baselines tuned on the training stations of datasets: filter parameters searched, and a sensor model fitted."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from tof_core.capture import Capture
from tof_core.config import from_mapping
from tof_core.progress import progress
from tof_core.reasons import Reason
from tof_core.stats import robust_std
from tof_eval.pooled import PooledError
from tof_preproc.config import PreprocConfig
from toftwin.evaluating import measured_frame

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float, Image, Mask
    from tof_sensor.model import SensorModel
    from tof_sim_label.dataset import Dataset

MIN_COVERAGE = 0.8
ORDERS = (
    PreprocConfig().order,
    "range,accumulate",
    "range,accumulate,flying",
    "range,accumulate,flying,grazing",
    "range,accumulate,sor",
    "range,accumulate,flying,grazing,sor",
    "range,flying,accumulate,sor",
)
STEPS: dict[str, tuple[Any, ...]] = {
    "order": ORDERS,
    "flying.ratio": (1.5, 2.5, 4.0, 6.0),
    "flying.slope_deg": (50.0, 60.0, 70.0, 80.0),
    "grazing.max_deg": (65.0, 75.0, 82.0),
    "sor.ratio": (0.5, 1.0, 2.0, 3.0),
    "sor.neighbours": (10, 20, 40),
}
TRIM = 3.0
"""Residuals beyond so many robust deviations take no part in the fit (flying pixels, other surfaces)."""


@dataclass(frozen=True, slots=True, eq=False)
class Example:
    """A capture of a training station with its label (H, W), NaN where it may not be used."""

    capture: Capture
    label: Image


def examples(dataset: Dataset, views: Sequence[int]) -> list[Example]:
    """One capture of each of some views of a dataset."""
    number, temperature, stamps = (dataset.column(f"captures/{n}") for n in ("view", "temperature", "stamp_ns"))
    out = []
    for view in views:
        k = int(np.flatnonzero(number == view)[0])
        depth, amplitude = dataset.frame("captures/raw", k), dataset.frame("captures/amplitude", k)
        reason = np.where(np.isfinite(depth), np.uint8(Reason.VALID), np.uint8(Reason.NO_RETURN))
        label = np.where(dataset.frame("views/mask", view) > 0, dataset.frame("views/label", view), np.float32(np.nan))
        out.append(Example(Capture(int(stamps[k]), dataset.camera, depth, reason, None, amplitude, None, float(temperature[k])), label))
    return out


def search_rules(shown: Sequence[Example], rounds: int = 2) -> tuple[PreprocConfig, dict[str, float]]:
    """Filter parameters with the least MAE at 80 % coverage or more: one parameter after the other, over and over."""
    chosen: dict[str, Any] = {"order": ORDERS[0]}
    best = _mae(shown, chosen)
    trials = [(name, value) for _ in range(rounds) for name, values in STEPS.items() for value in values]
    for name, value in progress(trials, "search rules", len(trials)):
        stage = name.partition(".")[0]
        if chosen.get(name) == value or (stage != "order" and stage not in chosen["order"]):
            continue
        tried = {**chosen, name: value}
        if (mae := _mae(shown, tried)) < best:
            chosen, best = tried, mae
    return from_mapping(PreprocConfig, chosen), {"train_mae_mm": best * 1e3}


def _mae(shown: Sequence[Example], values: dict[str, Any]) -> float:
    from tof_preproc.preprocessor import Preprocessor

    config, pooled = from_mapping(PreprocConfig, values), PooledError()
    for example in shown:
        pooled.add(Preprocessor(config).push(example.capture).depth, example.label)
    e = pooled.error
    return e.mae if e.completeness >= MIN_COVERAGE else float("inf")


def fit_correction(shown: Sequence[Example], modulation_mhz: float = 100.0) -> SensorModel:
    """A sensor model by trimmed least squares of its columns: offset, scale, wiggling, amplitude bias.

    These need nothing but the frame; multipath and flying pixels need the geometry that is to be measured.
    """
    from tof_sensor.effects.amplitude_bias import AmplitudeBias
    from tof_sensor.effects.depth_scale import DepthScale
    from tof_sensor.effects.range_offset import RangeOffset
    from tof_sensor.effects.wiggling import Wiggling
    from tof_sensor.model import SensorModel

    reference = float(
        np.exp(
            np.median(
                np.concatenate(
                    [np.log(e.capture.amplitude[e.capture.amplitude > 0]) for e in shown if e.capture.amplitude is not None]
                    or [np.zeros(1)]
                )
            )
        )
    )
    effects = (RangeOffset(), DepthScale(), Wiggling(modulation_mhz=modulation_mhz), AmplitudeBias(reference=reference))
    columns, residual = [], []
    for example in shown:
        frame = measured_frame(example.capture)
        use = np.isfinite(example.label) & np.isfinite(example.capture.depth) & frame.valid
        columns.append(np.concatenate([e.columns(frame)[use] for e in effects], axis=1)[::7])
        residual.append((example.capture.depth - example.label)[use][::7])
    x = _trimmed(np.concatenate(columns), np.concatenate(residual).astype(float))
    sizes = np.cumsum([0, *(e.coefficients.size for e in effects)])
    return SensorModel(tuple(e.with_coefficients(x[a:b]) for e, a, b in zip(effects, sizes, sizes[1:], strict=False)))


def _trimmed(A: Float, b: Float) -> Float:
    keep: Mask = np.ones(len(b), bool)
    x: Float = np.zeros(A.shape[1])
    for _ in range(6):
        x = np.asarray(np.linalg.lstsq(A[keep], b[keep], rcond=None)[0], float)
        r = b - A @ x
        keep = np.abs(r) <= TRIM * robust_std(r[keep], 0.0)
    return x
