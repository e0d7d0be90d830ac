# SPDX-License-Identifier: Apache-2.0
"""Check that depth is z: radial distance declared as z is refused before any label is made."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tof_core.errors import RefusedError
from tof_core.flat.radial import radial_evidence
from tof_core.flat.wide_plane import wide_bend

if TYPE_CHECKING:
    from tof_core.capture import View

SURE = 0.99
"""Probability that decides; radial depth on flat parts reaches far more."""
TRIES = 5
"""Views after which the check ends without a decision, since no surface in them is flat and wide."""


class RadialGate:
    """Tests the first views of a session for radial depth; ends once the depth is known to be z."""

    def __init__(self) -> None:
        self._left = TRIES

    def check(self, view: View) -> None:
        """Check one view.

        Raises:
            RefusedError: flat surfaces appear bent as they do if radial distance is read as z.
        """
        if self._left <= 0:
            return
        found = radial_evidence(view.depth, view.camera)
        wide = None if abs(found.suspicion - 0.5) > SURE - 0.5 else wide_bend(view.depth, view.camera)
        if found.suspicion > SURE or (wide is not None and wide.radial):
            bend = 1e3 * wide.metres if wide is not None else found.bend_z_mm
            msg = f"a plane bends: the depth looks radial (read as z, a flat surface is off by {bend:.0f} mm)"
            raise RefusedError(msg, where=f"depth at {view.stamp_ns * 1e-9:.3f} s", todo="pass --depth radial")
        self._left = 0 if found.suspicion < 1 - SURE or wide is not None else self._left - 1
