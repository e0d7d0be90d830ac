# SPDX-License-Identifier: Apache-2.0
"""Effects that missing and grossly wrong pixels show: lost returns, wrapped phase, mixed edges."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tof_gap.seen.filtered import failed_unwrapping, filtered
from tof_gap.seen.lost import dropout, least_light, losses_of
from tof_gap.seen.mixed import flying_pixels
from tof_gap.seen.wrapped import phase_wrap
from tof_sensor.effects.dropout import Dropout
from tof_sensor.effects.flying_pixels import FlyingPixels
from tof_sensor.effects.phase_wrap import PhaseWrap
from tof_sensor.stated import NOTHING_STATED

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from collections.abc import Set as AbstractSet

    from tof_gap.limits.missing import MissingLimits
    from tof_gap.seen.finding import Finding
    from tof_gap.seen.residual import ViewEvidence
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
    holes = filtered(views, limits)
    losses = losses_of(views, limits, holes)
    detectors: dict[str, Callable[[], Finding | None]] = {
        Dropout.NAME: lambda: dropout(views, limits, losses, stated, law),
        PhaseWrap.NAME: lambda: phase_wrap(views, limits) or failed_unwrapping(views, holes, limits),
        FlyingPixels.NAME: lambda: flying_pixels(views, limits, least_light(views, limits, losses)),
    }
    apart = left_out | ({FlyingPixels.NAME} if blurred else frozenset())
    found = (detect() for name, detect in detectors.items() if name not in apart)
    return [f for f in found if f is not None]
