# SPDX-License-Identifier: Apache-2.0
"""Depth that is the distance along the ray, declared as z, is refused before any label is made of it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tof_core.errors import RefusedError
from tof_core.flat.radial import radial_evidence
from tof_core.flat.wide_plane import wide_bend

if TYPE_CHECKING:
    from tof_core.capture import View

SURE = 0.99
"""Probability at which the answer is taken; radial depth on flat parts comes out far beyond it."""
TRIES = 5
"""Views that are asked before the question is dropped: nothing in them is flat and wide."""


class RadialGate:
    """Asks the first views of a session whether their depth is z at all; silent once it is sure."""

    def __init__(self) -> None:
        self._left = TRIES

    def check(self, view: View) -> None:
        """Let the view pass.

        Raises:
            RefusedError: flat surfaces bend as radial depth taken for z does.
        """
        if self._left <= 0:
            return
        found = radial_evidence(view.depth, view.camera)
        wide = None if abs(found.suspicion - 0.5) > SURE - 0.5 else wide_bend(view.depth, view.camera)
        if found.suspicion > SURE or (wide is not None and wide.radial):
            bend = 1e3 * wide.metres if wide is not None else found.bend_z_mm
            msg = f"a plane bends: the depth looks radial (what is flat is off by {bend:.0f} mm when read as z)"
            raise RefusedError(msg, where=f"depth at {view.stamp_ns * 1e-9:.3f} s", todo="pass --depth radial")
        self._left = 0 if found.suspicion < 1 - SURE or wide is not None else self._left - 1
