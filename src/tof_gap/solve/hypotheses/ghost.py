# SPDX-License-Identifier: Apache-2.0
"""Light that the lens mirrors through its axis, as a ghost image: a formula of no named effect."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from tof_gap.solve.hypotheses.candidate import Candidate
from tof_gap.solve.hypotheses.crosstalk import tried_mhz
from tof_gap.solve.hypotheses.free import UNKNOWN
from tof_gap.solve.hypotheses.nameless import Nameless, inverse_light
from tof_sensor.frame import LIGHT_M_PER_S

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float, Ints, Mask
    from tof_core.camera import Camera
    from tof_gap.seen.evidence.view import ViewEvidence

GHOST = "ghost"


@dataclass(frozen=True, slots=True)
class Ghost(Nameless):
    """An error along the ray by a share of the light of the pixel on the other side of the optical axis.

    Two reflections between lens surfaces, or sensor and window, image the scene once more, turned by 180 degrees about the axis. The sum
    of a pixel's phasor A exp(i phi), with phi = 4 pi f r / c, and of a share of its counterpart's turns by that share times
    (A' / A) sin(phi' - phi), to first order: one column in metres.
    """

    modulation_mhz: float
    means: tuple[float, ...] = (0.0,)
    quantity: str = GHOST
    FORMULA: ClassVar[bool] = True

    def along_ray(self, view: ViewEvidence, at: Ints) -> Float:
        """(n, 1) error along the ray if the counterpart's whole light were added, to first order; NaN where it sees nothing of the CAD."""
        turn = 4e6 * np.pi * self.modulation_mhz / LIGHT_M_PER_S
        there, inside = counterparts(view.frame.camera, at)
        radial, light = view.frame.radial.ravel().astype(np.float64), view.frame.amplitude.ravel()
        beat = light[there] * np.sin(turn * (radial[there] - radial[at])) / turn
        return np.where(inside, beat, np.nan)[:, None] * inverse_light(view, at)


def counterparts(camera: Camera, at: Ints) -> tuple[Ints, Mask]:
    """Flat indices (n,) of the pixels on the other side of the optical axis of pixels `at` (n,), and whether these are in the image (n,)."""
    row, column = np.divmod(at, camera.width)
    row, column = np.rint(2 * camera.cy - row).astype(np.int64), np.rint(2 * camera.cx - column).astype(np.int64)
    inside = (row >= 0) & (row < camera.height) & (column >= 0) & (column < camera.width)
    return np.where(inside, row * camera.width + column, at), inside


def ghosts(views: Sequence[ViewEvidence], stated_mhz: tuple[float, ...]) -> list[Candidate]:
    """One candidate per frequency of `tried_mhz`."""
    return [Candidate(UNKNOWN, None, GHOST, Ghost(mhz)) for mhz in tried_mhz(views, stated_mhz)]
