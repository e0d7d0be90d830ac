# SPDX-License-Identifier: Apache-2.0
"""Extra columns of a session: changes of depth by a caller's own terms, fitted together with the poses."""

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
    """A view with the CAD rendered (at pixel centres) from the estimated pose of its camera."""

    view: View
    rendering: Rendering


Terms = Callable[[PosedView], Float]
"""Extra columns (H*W, k): metres of z per unit of each of k coefficients."""


def columns_of_terms(terms: Terms, views: Sequence[View], caster: Raycaster) -> Columns:
    """The columns of a view by `terms` at the estimated pose of its camera, at the raster's pixels."""
    from tof_scene.render import render

    def at(v: int, lin: Linearised) -> Float:
        picture = render(caster, views[v].camera, lin.T_cell_camera, footprints=False)
        return np.asarray(terms(PosedView(views[v], picture)), float)[lin.index]

    return at
