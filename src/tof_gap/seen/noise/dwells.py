# SPDX-License-Identifier: Apache-2.0
"""How the captures of a dwell differ, beside how neighbouring pixels do."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_gap.seen.evidence.view import ViewEvidence
    from tof_sensor.effects.photon_law import PhotonLaw
    from tof_sensor.session import NoiseBins


def between_captures2(view: ViewEvidence) -> Float:
    """(H, W) m^2 along the ray: variance of one capture as the captures of the dwell differ; NaN for one capture."""
    if view.view.captures < 2:
        return np.full(view.residual.shape, np.nan)
    return np.asarray(view.view.count * (view.view.sigma * view.frame.length) ** 2)


def between_ratio(b: NoiseBins) -> float:
    """Variance between captures over that among neighbours in the darker half of the bins, where noise outweighs structure; 0: unknown.

    A camera that filters over captures makes them alike, one that filters over neighbours makes these alike.
    """
    if b.between is None or not len(b.amplitude):
        return 0.0
    dark = (b.amplitude <= np.median(b.amplitude)) & np.isfinite(b.between)
    return float(np.median(b.between[dark] / np.maximum(b.variance[dark], 1e-14))) if dark.any() else 0.0


def usual_ratio(b: NoiseBins, law: PhotonLaw | None) -> float:
    """`between_ratio` of the camera: of a healthy session where a stated law has it, else of this one."""
    return law.between if law is not None and law.between > 0.0 else between_ratio(b)


def as_captures_differ(b: NoiseBins, ratio: float) -> NoiseBins:
    """The bins with at most the variance by which captures differ, over `ratio` (`usual_ratio`; 0: no change).

    What neighbours do not share may be structure: the rest of a fixed pattern, mirror images, edges of texture. Captures share it.
    """
    if ratio <= 0.0 or b.between is None:
        return b
    return replace(b, variance=np.fmin(b.variance, b.between / ratio))
