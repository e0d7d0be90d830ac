# SPDX-License-Identifier: Apache-2.0
"""Lost pixels that may be outliers, which a filter in the camera removed: the effect that makes the outliers explains the loss."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import label

from tof_gap.seen.missing.lost import NEIGHBOURS
from tof_sensor.effect import Evidence
from tof_sensor.effects.ambient import Ambient
from tof_sensor.effects.dropout import Dropout
from tof_sensor.effects.phase_wrap import PhaseWrap

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Mask
    from tof_gap.limits.filters import FilterLimits
    from tof_gap.seen.finding import Finding


FAILING = 0.06
"""Share of the pixels that fail to merge, from which noise beyond the law may be theirs: of twelve sessions with a second frequency exposed too
briefly, one that loses 11 % has such noise; under strong sunlight 3 % fail to merge."""


def not_outliers(gone: Sequence[Finding], beside: Sequence[Finding], limits: FilterLimits) -> list[Finding]:
    """What is `gone` but for pixels that may be outliers of effects `beside` or of wrong unwrapping, which a filter in the camera removed.

    Wrapped pixels that another effect's outliers explain are none, and explain no loss.
    """
    wrapped = [f for f in gone if not (_removed_wraps(f) and removed_outliers(f, beside, limits))]
    return [f for f in wrapped if _removed_wraps(f) or not removed_outliers(f, [*beside, *wrapped], limits)]


def removed_outliers(loss: Finding, beside: Sequence[Finding], limits: FilterLimits) -> bool:
    """Whether the lost pixels may be outliers that a filter in the camera removed: then the effect `beside` explains them.

    Photon noise makes few outliers in bright light, and even in the dark not every pixel is one. Such loss is neither at random nor
    below a threshold (`rare`). Noise of every pixel at every amplitude makes outliers at random, as many as a filter's limit leaves.
    Pixels that are unwrapped wrongly are outliers at any amplitude; under foreign light its noise makes a few of them. Pixels with a noise of their own are outliers too, more of them in
    weak light, although their phase is unwrapped rightly: the holes are then around these pixels.
    """
    if _removed_wraps(loss):
        if any(isinstance(f.effect, Ambient) for f in beside) and not hides_light(loss):
            return True  # The light's noise makes unwrapping fail.
        return any(f.own_noise is not None and _share_around(f.own_noise, loss.holes) >= limits.around_unstable for f in beside)
    if not isinstance(loss.effect, Dropout):
        return False
    few_at_random = loss.effect.threshold == 0.0 and loss.effect.random < limits.outliers
    return any(
        f.effect.makes_outliers and (loss.rare or f.effect.EVIDENCE is not Evidence.NOISE or (f.everywhere and few_at_random))
        for f in beside
    )


def _share_around(pixels: Mask, holes: Sequence[Mask]) -> float:
    """Share of the views' holes that contain one of these `pixels` (H, W); holes (H, W) per view."""
    found = count = 0
    for of_view in holes:
        which, many = label(of_view, NEIGHBOURS)
        found += len(np.unique(which[of_view & pixels]))
        count += many
    return found / max(count, 1)


def fails_to_merge(found: Finding) -> bool:
    """Whether merging of frequencies fails: single pixels jump, or by lengths that no single frequency has. Beyond its range, most pixels jump."""
    return isinstance(found.effect, PhaseWrap) and (found.effect.makes_outliers or len(found.effect.others_m) > 0)


def hides_light(found: Finding) -> bool:
    """Whether merging of frequencies fails for so many pixels that it may be why noise grows in weak light, as it does by foreign light."""
    return fails_to_merge(found) and _pixels(found) >= FAILING


def _pixels(found: Finding) -> float:
    """Share of the pixels on the CAD that jump, or that the camera removed since they jump."""
    if found.corrects and found.share is not None:
        return float((found.share[np.isfinite(found.share)] != 0).mean())
    return found.lost


def _removed_wraps(found: Finding) -> bool:
    """Whether a finding is of wrapped pixels of which the camera's filter kept none: no map shows their jump."""
    return isinstance(found.effect, PhaseWrap) and not found.corrects
