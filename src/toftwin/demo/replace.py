# SPDX-License-Identifier: Apache-2.0
"""Fourth question of the demonstration: does the fitted sensor stand for the camera? The day after, by the camera and by simulation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from tof_virtual.truth import load_truth
from toftwin.demo.sessions import FITTED, LATER, fitted
from toftwin.inputs import opened

if TYPE_CHECKING:
    from pathlib import Path

    from tof_core.arrays import Float, Mask
    from tof_scene.scene import Scene
    from toftwin.demo.config import DemoConfig

FAR_M = 0.05
"""Larger differences are not of the sensor: the pixel sees another surface."""

NOISY_M = 0.003
"""Pixels with a larger standard error of the difference are left out: they cannot show an effect of millimetres."""


@dataclass(frozen=True, slots=True, eq=False)
class Replaced:
    """Camera minus simulation over the day after, mean of each view's captures.

    ideal, by_fitted: (V, H, W) metres, with an ideal camera and with the fitted sensor, NaN where not compared;
    ideal_noise, fitted_noise: (V, H, W) variances of these differences by the spread of the captures, metres squared.
    """

    ideal: Float
    by_fitted: Float
    ideal_noise: Float
    fitted_noise: Float

    @property
    def noise_mm(self) -> float:
        """Noise of the camera's means, RMS."""
        return 1e3 * float(np.sqrt(np.nanmean(self.ideal_noise)))

    @property
    def ideal_mm(self) -> float:
        """Difference of the camera and an ideal sensor, RMS above the noise."""
        return _above(self.ideal, self.ideal_noise)

    @property
    def fitted_mm(self) -> float:
        """Camera minus the fitted sensor, RMS above the noise of both."""
        return _above(self.by_fitted, self.fitted_noise)


def _above(difference: Float, noise2: Float) -> float:
    """Millimetres RMS of a difference without its noise."""
    return 1e3 * float(np.sqrt(max(float(np.nanmean(np.square(difference)) - np.nanmean(noise2)), 0.0)))


def replace_sensor(folder: Path, scene_path: Path, scene: Scene, config: DemoConfig) -> Replaced:
    """Simulate the second day, and compare it pixel by pixel with the camera at the same poses."""
    fitted(folder, scene, config)
    return compared(folder, scene_path, config)


def compared(folder: Path, scene_path: Path, config: DemoConfig) -> Replaced:
    """The recorded second day and its simulation, without the pixels of parts that were taken away or moved."""
    real, real_noise = _means(folder / LATER, scene_path, config)
    simulated, noise = _means(folder / FITTED, scene_path, config)
    truth, meta = load_truth(folder / "later" / "truth")
    drawn, names = load_truth(folder / "fitted" / "truth")
    same = _same_part(truth["part"], meta["parts"], drawn["part"], names["parts"]) & (np.abs(real - drawn["depth"]) < FAR_M)
    same &= (np.abs(real - simulated) < FAR_M) & (real_noise + noise < NOISY_M**2)

    def kept(values: Float) -> Float:
        return np.where(same, values, np.nan)

    return Replaced(kept(real - drawn["depth"]), kept(real - simulated), kept(real_noise), kept(real_noise + noise))


def _means(bag: Path, scene_path: Path, config: DemoConfig) -> tuple[Float, Float]:
    """(V, H, W) mean depth of each view's captures, metres, and the variance of that mean."""
    from toftwin.pipeline import PipelineConfig

    with opened(bag, scene_path, PipelineConfig()) as (reader, _):
        depth = np.stack([c.depth for c in reader.captures(repeats=True)])
    views = depth.reshape(config.views, config.later_captures, *depth.shape[1:]).astype(np.float64)
    return views.mean(axis=1), views.var(axis=1, ddof=1) / config.later_captures


def _same_part(a: Any, a_names: list[str], b: Any, b_names: list[str]) -> Mask:
    """(V, H, W) where two sessions see the same part, by name."""
    number = np.array([b_names.index(n) if n in b_names else -2 for n in a_names] + [-1])
    return np.asarray((number[a] == b) & (b >= 0))
