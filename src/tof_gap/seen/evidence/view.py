# SPDX-License-Identifier: Apache-2.0
"""What one view shows of the gap: its residual against the CAD, the noise of it, and the pixels that fits use."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tof_gap.seen.evidence.correlation import INDEPENDENT
from tof_gap.seen.evidence.level import noise_level

if TYPE_CHECKING:
    from tof_core.arrays import Float, Image, Ints, Mask
    from tof_core.capture import View
    from tof_gap.limits.evidence import EvidenceLimits, LevelLimits
    from tof_gap.seen.evidence.correlation import NoiseCorrelation
    from tof_scene.render import Rendering
    from tof_sensor.frame import Frame


@dataclass(frozen=True, slots=True, eq=False)
class ViewEvidence:
    """One view at its reference pose.

    residual (H, W) metres of z, less what an average over neighbours in the camera makes of curved surfaces, and what rectification by the
    nearest pixel makes of slopes, NaN where measurement or CAD is missing; sigma (H, W) metres, standard deviation of the view's noise, both in single precision as depth is (60 nm of a metre); smooth, edge, gross (H, W) masks; pixels (n,) flat indices for
    fits; concavity (H, W) share of the hemisphere over a pixel that the scene covers, NaN where it was not computed; step_m metres
    between depth codes, 0 where depth is continuous; limits: by which this view's pixels were selected; stepped (H, W): pixels beside
    steps of a named fixed pattern (`seen.missing.steps`), None without one; noise_of_steps: whether noise grows with the steps around a pixel, as
    where the camera's average takes in neighbours beyond them or not; correlation: of the noise of neighbouring pixels.
    """

    view: View
    frame: Frame
    residual: Float
    sigma: Float
    smooth: Mask
    edge: Mask
    gross: Mask
    pixels: Ints
    concavity: Image
    step_m: float
    limits: EvidenceLimits
    stepped: Mask | None = None
    noise_of_steps: bool = False
    correlation: NoiseCorrelation = INDEPENDENT

    @property
    def mean_sigma(self) -> Float:
        """(H, W) metres of z: as `sigma`, of independent pixels whose means over an area have the noise of this view's means."""
        return self._inflated(self.correlation.area)

    @property
    def fit_sigma(self) -> Float:
        """(H, W) metres of z: as `mean_sigma`, for means over the pixels that fits use."""
        return self._inflated(self._of_drawn)

    @property
    def independent(self) -> float:
        """Number of independent pixels whose mean has the noise of the mean of the pixels that fits use."""
        return len(self.pixels) / self._of_drawn

    @property
    def _of_drawn(self) -> float:
        """Variance of the mean of the pixels that fits use, over that of as many independent pixels."""
        return self.correlation.sampled(len(self.pixels) / max(int(self.smooth.sum()), 1))

    def _inflated(self, variance: float) -> Float:
        return self.sigma if variance == 1.0 else self.sigma * np.float32(np.sqrt(variance))

    def noise_of(self, residual: Float) -> Float:
        """(H, W) metres of z: standard deviation of the noise in a residual (H, W) of this view, at least that of the step of its depth code."""
        return noise_of(residual, self.smooth, self.frame.amplitude, self.step_m, self.limits.level, self.correlation)

    def still_gross(self, left: Float) -> Mask:
        """(H, W) gross pixels that `left` (H, W) metres, the residual less some effects, is still too large for."""
        return self.gross & (np.abs(left) > gross_bound(self.sigma, self.limits))

    @property
    def rendering(self) -> Rendering:
        """The CAD at the reference pose."""
        return self.frame.rendering


def noise_of(residual: Float, keep: Mask, amplitude: Float, step_m: float, limits: LevelLimits, correlation: NoiseCorrelation) -> Float:
    """(H, W) metres of z: standard deviation of the noise of single pixels, as a function of amplitude (H, W).

    Differences of the neighbours to `keep` show it. Neighbours rounded to the same code show none: it is at least the standard deviation
    of the step between two codes.
    """
    return np.asarray(np.maximum(noise_level(residual, keep, amplitude, limits, correlation), step_m / np.sqrt(12)))


def gross_bound(sigma: Float, limits: EvidenceLimits) -> Float:
    """(H, W) metres beyond which an error is gross: no bias of the camera, but another surface or a wrapped phase."""
    return np.asarray(np.maximum(limits.gross_mm * 1e-3, np.minimum(limits.gross_sigma * sigma, limits.gross_most_mm * 1e-3)))
