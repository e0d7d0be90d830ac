# SPDX-License-Identifier: Apache-2.0
"""Fourth question of the demonstration: does the fitted sensor stand for the camera? The day after, by the camera and by simulation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from tof_core.stats import robust_std
from tof_virtual.truth import load_truth
from toftwin.demo.sessions import FITTED, LATER, fitted
from toftwin.inputs import opened

if TYPE_CHECKING:
    from pathlib import Path

    from tof_core.arrays import Float, Mask
    from tof_scene.scene import Scene
    from toftwin.demo.config import DemoConfig

FAR_M = 0.05
"""A larger difference is no effect of the sensor: another surface is seen."""


@dataclass(frozen=True, slots=True, eq=False)
class Replaced:
    """Camera minus simulation over the day after, mean of each view's captures.

    ideal, by_fitted: (V, H, W) metres, with an ideal camera and with the fitted sensor, NaN where not compared;
    noise_mm: standard error of such a mean.
    """

    ideal: Float
    by_fitted: Float
    noise_mm: float

    def mm(self, difference: Float) -> float:
        """RMS of a difference."""
        return 1e3 * float(np.sqrt(np.nanmean(np.square(difference))))

    @property
    def ideal_mm(self) -> float:
        """RMS of the camera minus an ideal one."""
        return self.mm(self.ideal)

    @property
    def fitted_mm(self) -> float:
        """RMS of the camera minus the fitted sensor."""
        return self.mm(self.by_fitted)


def replace_sensor(folder: Path, scene_path: Path, scene: Scene, config: DemoConfig) -> Replaced:
    """Record the day after by simulation, and compare it pixel by pixel with what the camera measured from the same poses."""
    fitted(folder, scene, config)
    return compared(folder, scene_path, config)


def compared(folder: Path, scene_path: Path, config: DemoConfig) -> Replaced:
    """The recorded day after beside its simulation, pixels of parts that were taken away or moved left out."""
    real, noise = _means(folder / LATER, scene_path, config)
    simulated, _ = _means(folder / FITTED, scene_path, config)
    truth, meta = load_truth(folder / "later" / "truth")
    drawn, names = load_truth(folder / "fitted" / "truth")
    same = _same_part(truth["part"], meta["parts"], drawn["part"], names["parts"]) & (np.abs(real - drawn["depth"]) < FAR_M)
    same &= np.isfinite(simulated)
    return Replaced(np.where(same, real - drawn["depth"], np.nan), np.where(same, real - simulated, np.nan), 1e3 * noise)


def _means(bag: Path, scene_path: Path, config: DemoConfig) -> tuple[Float, float]:
    """(V, H, W) mean depth of each view's captures, metres, and the standard error of such a mean."""
    from toftwin.pipeline import PipelineConfig

    with opened(bag, scene_path, PipelineConfig()) as (reader, _):
        depth = np.stack([c.depth for c in reader.captures(repeats=True)])
    views = depth.reshape(config.views, config.later_captures, *depth.shape[1:]).astype(np.float64)
    steps = np.diff(views, axis=1)
    noise = robust_std(steps[np.isfinite(steps)], 0.0) / np.sqrt(2 * config.later_captures)
    return views.mean(axis=1), noise


def _same_part(a: Any, a_names: list[str], b: Any, b_names: list[str]) -> Mask:
    """(V, H, W) where two sessions see the same part, by name."""
    number = np.array([b_names.index(n) if n in b_names else -2 for n in a_names] + [-1])
    return np.asarray((number[a] == b) & (b >= 0))
