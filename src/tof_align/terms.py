# SPDX-License-Identifier: Apache-2.0
"""Extra columns of a session: what a caller's own terms add to the depth of each view, fitted beside the poses."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tof_core.arrays import Float

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_align.fit import Columns
    from tof_align.linearise import Linearised
    from tof_core.capture import View
    from tof_scene.raycast import Raycaster
    from tof_scene.render import Rendering


@dataclass(frozen=True, slots=True, eq=False)
class PosedView:
    """A view with the CAD rendered (pixel centres) where its camera is believed to be."""

    view: View
    rendering: Rendering


Terms = Callable[[PosedView], Float]
"""Extra columns (H*W, k): metres of z per unit of each of k coefficients."""


def columns_of_terms(terms: Terms, views: Sequence[View], caster: Raycaster) -> Columns:
    """Ask for a view's columns where its camera is believed to be, and keep the raster's pixels."""
    from tof_scene.render import render

    def at(v: int, lin: Linearised) -> Float:
        picture = render(caster, views[v].camera, lin.T_cell_camera, footprints=False)
        return np.asarray(terms(PosedView(views[v], picture)), float)[lin.index]

    return at
