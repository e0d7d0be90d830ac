# SPDX-License-Identifier: Apache-2.0
"""Parts that are displaced from their CAD, or appear so: a rigid motion of each part, with a size of its own.

Each part has a random effect with its own variance (automatic relevance determination, MacKay 1994). The variance of a part that agrees
with the others goes to zero, and the part determines the cameras. A part that disagrees gets a large variance and loses its influence.
Multipath in a corner, a displaced part and a wrong CAD all move a part mainly as a whole.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from tof_core.stats import grouped

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from tof_align.linearise import Linearised
    from tof_core.arrays import Float, Ints, Mask

MOTIONS = 6
"""Columns of a part: slides along the cell's axes, turns about them through the part's middle."""
PART = "part "
"""Prefix of the name of a part's kind; the part's index in the scene follows."""
LEAST_RADIUS_M = 0.01
"""Least radius of a part, so that the turn of a single pixel stays finite."""


@dataclass(frozen=True, slots=True, eq=False)
class PartFrames:
    """Parts with enough pixels: index (P,) in the scene, middle (P, 3) and radius (P,) of the visible surface, metres."""

    index: Ints
    middle: Float
    radius: Float


class Places(Protocol):
    """Places on the CAD, such as the pixels of a view: point (n, 3), normal (n, 3), part (n,)."""

    @property
    def point(self) -> Float:
        """Metres, cell frame."""

    @property
    def normal(self) -> Float:
        """Of the surface, cell frame."""

    @property
    def part(self) -> Ints:
        """Index in the scene."""


def no_parts() -> PartFrames:
    """No part may move."""
    return PartFrames(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros(0))


def parts_of(views: Sequence[Places], share: float) -> PartFrames:
    """The parts with at least this share of all pixels; none if there is only one."""
    part = np.concatenate([v.part for v in views])
    point = np.concatenate([v.point for v in views])
    index, of, count = np.unique(part, return_inverse=True, return_counts=True)
    kept = count >= share * len(part)
    if kept.sum() < 2:
        return no_parts()
    groups = grouped(of)
    middle = np.stack([groups.sum(point[:, k]) for k in range(3)], axis=1) / count[:, None]
    radius = np.sqrt(groups.sum(((point - middle[of]) ** 2).sum(axis=1)) / count)
    return PartFrames(index[kept], middle[kept], np.maximum(radius, LEAST_RADIUS_M)[kept])


def counts(parts: PartFrames, view: Places) -> Mask:
    """(n,) pixels that may determine the cameras: not those of parts too small for columns, which would count as correctly placed."""
    return np.isin(view.part, parts.index) if len(parts.index) else np.ones(len(view.part), bool)


def part_entries(parts: PartFrames, view: Linearised) -> tuple[NDArray[np.int32], Float]:
    """Places among all 6 P columns, and values (n, 6), of the columns of each pixel's part; zero for other parts.

    Values are metres of z per metre of motion: a turn counts as the motion of a point at the part's radius.
    """
    places, values = np.zeros((len(view.residual), MOTIONS), np.int32), np.zeros((len(view.residual), MOTIONS))
    at, place, normal = _normal_motion(parts, view)
    along = np.einsum("ij,ij->i", view.normal[at], view.ray[at] @ view.T_cell_camera[:3, :3].T)
    places += np.arange(MOTIONS, dtype=np.int32)
    places[at] += MOTIONS * place[:, None].astype(np.int32)
    values[at] = normal / along[:, None]
    return places, values


def stand_off(parts: PartFrames, views: Sequence[Linearised], second: Float) -> Float:
    """(P,) metres: motion of each part along its normal, RMS over its pixels; second (P, 6, 6): second moment of its motion."""
    total, count = np.zeros(len(parts.index)), np.zeros(len(parts.index))
    for view in views:
        _, place, normal = _normal_motion(parts, view)
        total += np.bincount(place, np.einsum("ni,nij,nj->n", normal, second[place], normal, optimize=True), len(total))
        count += np.bincount(place, minlength=len(total))
    return np.asarray(np.sqrt(total / np.maximum(count, 1.0)))


def _normal_motion(parts: PartFrames, view: Linearised) -> tuple[Ints, Ints, Float]:
    """Pixels (k,) of these parts, the index of each pixel's part among them, and its motion along the normal by each column (k, 6)."""
    if not len(parts.index):
        return np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, MOTIONS))
    place = np.searchsorted(parts.index, view.part).clip(0, len(parts.index) - 1)
    at = np.flatnonzero(parts.index[place] == view.part)
    place, normal = place[at], view.normal[at]
    arm = (view.point[at] - parts.middle[place]) / parts.radius[place, None]
    return at, place, np.concatenate([normal, np.cross(arm, normal)], axis=1)
