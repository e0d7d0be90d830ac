# SPDX-License-Identifier: Apache-2.0
"""Depth bias by light of other parts (multipath with one bounce), as columns with a size to be estimated.

Surfaces in concave places light each other. The error has one sign and a pattern that a pose can imitate. One size is estimated for the
light of all parts; single parts may send more or less than their stated albedo predicts.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tof_scene.bounce import one_bounce

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_align.linearise import Linearised
    from tof_align.pixels import Pixels
    from tof_core.arrays import Float, Ints
    from tof_core.camera import Camera
    from tof_scene.raycast import Raycaster

RAYS = 48
"""Rays per point: light is known to a few per cent."""
SPACING = 4
"""Raster pixels between the points that are computed: indirect light is smooth on a part."""
ALBEDO_OFF = 0.5
"""Relative deviation of one part's light from that by its stated albedo: infrared albedo is hardly known."""
LEAST_SHARE = 0.02
"""Share of the light of all parts below which a part has no column of its own."""


@dataclass(frozen=True, slots=True, eq=False)
class Emitters:
    """Parts whose light has a column of its own: indices (E,) in the scene; scale: RMS in metres of the light of all parts."""

    index: Ints
    scale: float

    @property
    def count(self) -> int:
        """Columns: the light of all parts, then of each of these alone."""
        return 1 + len(self.index) if self.scale > 0 else 0


def no_emitters() -> Emitters:
    """No light of other parts."""
    return Emitters(np.zeros(0, np.int64), 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class Light:
    """Light of other parts in a view: row, column, part (k,) of the pixels where it is computed, metres (k, P) along their rays.

    nearest, of_part (h*w,): for pixels of the view's raster, the nearest of these pixels that sees the part `of_part`, which is -1 where
    none was looked for: most pixels see the same part in every step of an alignment.
    """

    row: Ints
    column: Ints
    part: Ints
    metres: Float
    nearest: Ints
    of_part: Ints

    def over(self, view: Linearised, pixels: Pixels) -> Float:
        """(n, P) metres of z at the pixels of a view: those of the nearest pixel that sees the same part."""
        if not len(self.part):
            return np.zeros((len(view.index), self.metres.shape[1]))
        new = np.flatnonzero(self.of_part[view.cell] != view.part)
        if len(new):
            self.nearest[view.cell[new]] = self._found(view.index[new], view.part[new], pixels.camera)
            self.of_part[view.cell[new]] = view.part[new]
        return np.asarray(self.metres[self.nearest[view.cell]] / view.ray_length[:, None])

    def _found(self, index: Ints, part: Ints, camera: Camera) -> Ints:
        """(n,) the nearest of the computed pixels to pixels (flat indices) that see these parts."""
        from scipy.spatial import cKDTree

        height, width = camera.shape
        apart = 2.0 * (height + width)  # Another part counts as farther than the whole image.
        row, column = np.divmod(index, width)
        tree = cKDTree(np.column_stack([self.row, self.column, self.part * apart]))
        return np.asarray(tree.query(np.column_stack([row, column, part * apart]))[1])


def light_in(view: Linearised, pixels: Pixels, caster: Raycaster) -> Light:
    """The light of other parts at every `SPACING`-th pixel of the raster."""
    row, column = np.divmod(view.cell, view.raster[1])
    chosen = np.flatnonzero((row % SPACING == SPACING // 2) & (column % SPACING == SPACING // 2))
    metres = one_bounce(caster, view.T_cell_camera[:3, 3], view.point[chosen], view.normal[chosen], RAYS)
    every = view.raster[0] * view.raster[1]
    none = np.zeros(every, np.int64), np.full(every, -1, np.int64)
    return Light(*np.divmod(view.index[chosen], pixels.camera.width), view.part[chosen], metres, *none)


def emitters_of(views: Sequence[Linearised]) -> Emitters:
    """The parts that light others in these views."""
    light = [v.bounced for v in views if v.bounced is not None]
    if len(light) < len(views):
        return no_emitters()
    everything = np.concatenate(light)
    scale = float(np.sqrt((everything.sum(axis=1) ** 2).mean()))
    if not scale > 0:
        return no_emitters()
    alone = np.sqrt((everything**2).mean(axis=0))
    return Emitters(np.flatnonzero(alone > LEAST_SHARE * scale), scale)


def bounced_columns(emitters: Emitters, view: Linearised) -> Float:
    """(n, 1 + E) columns: the light of all parts, with unit RMS, and deviations of single parts from it."""
    if view.bounced is None or not emitters.count:
        return np.zeros((len(view.residual), 0))
    return np.column_stack([view.bounced.sum(axis=1), ALBEDO_OFF * view.bounced[:, emitters.index]]) / emitters.scale
