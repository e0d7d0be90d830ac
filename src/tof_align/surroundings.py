# SPDX-License-Identifier: Apache-2.0
"""Surfaces around the first view of a live session: where the next views will look, before they are taken.

The columns of the surface's errors and of displaced parts are chosen once for many views. In the causal mode the later views are not
known. They look at the same place from other sides, so rays are cast from there.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tof_align.camera_error import beyond_data
from tof_align.discrepancy import surface_columns
from tof_align.parts import counts
from tof_core import se3

if TYPE_CHECKING:
    from tof_align.config import DiscrepancyConfig
    from tof_align.discrepancy import Basis
    from tof_align.linearise import Linearised
    from tof_core.arrays import Float, Ints, Mask
    from tof_scene.raycast import Raycaster

AROUND_DEG = (-100.0, -50.0, 0.0, 50.0, 100.0)
"""Turns about the vertical through the middle of the view: an arm looks at a part from the side on which its base stands."""
WIDER = 1.5
"""Angle of the cast rays over that of the view's: the next view looks beside it, too."""
RAYS = 600
"""Rays from each place: a tenth of them decides on a centre (`SURFACE_STRIDE`), and centres are a few dozen."""
LEAST_DESCRIBED = 0.15
"""Share of the variance of a surface's error from which columns describe it: what a centre at 0.4 m on the same face describes."""
EVERY = 16
"""Of so many pixels of a view, one is looked at."""


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """Places on the CAD: point (n, 3), normal (n, 3), cell frame; part (n,): index in the scene."""

    point: Float
    normal: Float
    part: Ints


def surroundings(view: Linearised, caster: Raycaster) -> Surface:
    """What of the CAD is seen from around the middle of a view, no farther than the view sees (vertical: the cell's z axis, REP 103)."""
    middle = np.median(view.point, axis=0)
    spread = view.ray * np.array([WIDER, WIDER, 1.0])
    rays = spread[:: max(1, len(spread) // RAYS)]
    found = []
    for degrees in AROUND_DEG:
        turn = se3.exp(np.array([0.0, 0.0, 0.0, 0.0, 0.0, np.radians(degrees)]))
        T = turn @ view.T_cell_camera
        T[:3, 3] = middle + turn[:3, :3] @ (view.T_cell_camera[:3, 3] - middle)
        directions = rays @ T[:3, :3].T
        hits = caster.cast(T[:3, 3], directions)
        z, normal = np.asarray(hits.t, float), np.asarray(hits.normal, float)
        seen = (z < WIDER * view.depth.max()) & (np.einsum("ij,ij->i", normal, directions) < 0)
        found.append(Surface(T[:3, 3] + z[seen, None] * directions[seen], normal[seen], hits.part[seen].astype(np.int64)))
    return Surface(*(np.concatenate([getattr(f, name) for f in found]) for name in ("point", "normal", "part")))


def unseen(basis: Basis, view: Linearised, sizes: dict[str, float], config: DiscrepancyConfig) -> Float:
    """(n, 2) metres: standard deviation of the errors by range and by amplitude beyond the columns of the basis."""
    none = np.zeros(len(view.depth))
    return beyond_data(basis, view.depth * view.ray_length, none if view.log_amplitude is None else view.log_amplitude, none, sizes, config)


def within(basis: Basis, view: Linearised) -> Mask:
    """(n,) whether the columns of range and amplitude reach over each pixel."""
    values = [(basis.knots_range, view.depth * view.ray_length), (basis.knots_amplitude, view.log_amplitude)]
    inside = [(x >= knots[1]) & (x <= knots[-2]) | ~np.isfinite(x) for knots, x in values if x is not None and len(knots)]
    return np.asarray(np.logical_and.reduce(inside)) if inside else np.ones(len(view.depth), np.bool_)


def described(basis: Basis, view: Linearised) -> Mask:
    """(n,) of every `EVERY`-th pixel: whether the basis has columns for errors by its range, of its surface and for the motion of its part."""
    few = Surface(view.point[::EVERY], view.normal[::EVERY], view.part[::EVERY])
    of_surface = surface_columns(basis, few) @ basis.root_object
    return np.asarray(
        within(basis, view)[::EVERY] & counts(basis.parts, few) & (np.einsum("ij,ij->i", of_surface, of_surface) >= LEAST_DESCRIBED)
    )
