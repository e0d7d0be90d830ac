# SPDX-License-Identifier: Apache-2.0
"""Effects that missing and grossly wrong pixels show: lost returns, wrapped phase, mixed edges."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tof_gap.seen.missing.filtered import failed_unwrapping, filtered, noise_may_reach
from tof_gap.seen.missing.lost import dropout, least_light, losses_of
from tof_gap.seen.missing.mixed import flying_pixels
from tof_gap.seen.missing.wrapped import phase_wrap
from tof_sensor.effects.dropout import Dropout
from tof_sensor.effects.flying_pixels import FlyingPixels
from tof_sensor.effects.phase_wrap import PhaseWrap
from tof_sensor.stated import NOTHING_STATED

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from collections.abc import Set as AbstractSet

    from tof_gap.limits.missing import MissingLimits
    from tof_gap.seen.evidence.view import ViewEvidence
    from tof_gap.seen.finding import Finding
    from tof_gap.seen.missing.lost import Losses
    from tof_sensor.effects.photon_law import PhotonLaw
    from tof_sensor.stated import StatedNoise


def missing_effects(
    views: Sequence[ViewEvidence],
    limits: MissingLimits,
    left_out: AbstractSet[str] = frozenset(),
    *,
    blurred: bool = False,
    stated: StatedNoise = NOTHING_STATED,
    law: Callable[[], PhotonLaw | None] = lambda: None,
) -> list[Finding]:
    """`dropout`, `phase_wrap` and `flying_pixels` where pixels show them, unless left out.

    blurred: whether motion mixes edges; stated: what the camera is known to do; law: gives the photon law of the session.
    """
    removed = filtered(views, limits)
    losses = losses_of(views, limits, removed.gone)
    detectors: dict[str, Callable[[], Finding | None]] = {
        Dropout.NAME: lambda: _beside_noise(dropout(views, limits, losses, stated, law), views, losses, limits),
        PhaseWrap.NAME: lambda: phase_wrap(views, limits) or failed_unwrapping(views, removed, limits),
        FlyingPixels.NAME: lambda: flying_pixels(views, limits, least_light(views, limits, losses)),
    }
    apart = left_out | ({FlyingPixels.NAME} if blurred else frozenset())
    found = (detect() for name, detect in detectors.items() if name not in apart)
    return [f for f in found if f is not None]


def _beside_noise(found: Finding | None, views: Sequence[ViewEvidence], losses: Losses, limits: MissingLimits) -> Finding | None:
    """The finding `dropout`, by design where a few pixels are lost at random whose noise reaches what a filter in the camera lets pass."""
    if found is None or not isinstance(found.effect, Dropout) or found.effect.threshold > 0.0 or found.expected:
        return found
    few = 0.0 < losses.gone.mean() < limits.filter.outliers
    if not few or not noise_may_reach(views, [np.asarray(share > 0.0) for share in losses.share], limits):
        return found
    return replace(found, expected=True, size=found.effect.stated, by_design="a filter in the camera removes outliers of noise this large")
