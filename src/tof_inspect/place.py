# SPDX-License-Identifier: Apache-2.0
"""Whether the place of a part is known well enough to judge its tolerance, and the capture that would achieve it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tof_inspect.displaced import UNKNOWN

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float
    from tof_inspect.config import InspectConfig
    from tof_inspect.displaced import Fit
    from tof_inspect.evidence import Seen
    from tof_scene.raycast import Raycaster
    from tof_scene.scene import Part

JUDGED = 2.0
"""Least tolerance, in standard deviations of the place, that can be judged: a part out of tolerance is then detected."""
FREE_M = 0.35
"""Free distance in front of a part from which a camera can look at it."""
AXES = ("x", "y", "z")


@dataclass(frozen=True, slots=True)
class Place:
    """Accuracy of a part's place.

    judged: whether its tolerance can be judged; std_mm: standard deviation along the least known axis (inf: unknown);
    words: one clause; todo: the capture that would judge it, "" where it is judged.
    """

    judged: bool
    std_mm: float
    words: str = ""
    todo: str = ""


UNSEEN_TODO = "add a view that shows it, closer or from another side"
JUDGED_PLACE = Place(True, 0.0)


def place_of(part: Part, fit: Fit, seen: Sequence[Seen], caster: Raycaster, config: InspectConfig) -> Place:
    """Whether the tolerance of a present part can be judged."""
    values, axes = np.linalg.eigh(fit.cov)
    std, axis = 1e3 * float(np.sqrt(values[-1])), axes[:, -1]
    if JUDGED * std <= part.tolerance_mm:
        return Place(True, std)
    along = f"along {_direction(axis)}"
    if std >= UNKNOWN * config.search_mm:
        words = f"place {along} unknown: tolerance {part.tolerance_mm:g} mm cannot be judged"
        return Place(False, float("inf"), words, _look(part, axis, caster))
    words = f"place known to {std:.1f} mm only, {along}: tolerance {part.tolerance_mm:g} mm cannot be judged"
    return Place(False, std, words, _todo(part, fit, axis, seen, caster))


def _todo(part: Part, fit: Fit, axis: Float, seen: Sequence[Seen], caster: Raycaster) -> str:
    """The capture that reduces the largest cause of the uncertainty along an axis."""
    noise, outline, shared = (1e3 * float(np.sqrt(max(float(axis @ cov @ axis), 0.0))) for cov in (fit.noise, fit.outline, fit.shared))
    if shared >= max(noise, outline):
        return "capture a session of the complete cell and pass it as --reference, or pass the camera's sensor.yaml as --sensor"
    if outline >= noise:
        return _look(part, axis, caster)
    captures = max((s.view.captures for s in seen), default=1)
    needed = int(np.ceil(captures * (JUDGED * noise / (0.7 * part.tolerance_mm)) ** 2))
    return f"take {needed} captures of each view instead of {captures}" if needed <= 16 * captures else _look(part, axis, caster)


def _look(part: Part, axis: Float, caster: Raycaster) -> str:
    """Advice for a view along the axis from a side without obstacle; for closer views where both sides have one."""
    centre, reach = part.vertices.mean(axis=0), 0.5 * float(np.linalg.norm(np.ptp(part.vertices, axis=0)))
    for direction in (axis, -axis):
        if not np.isfinite(caster.cast(centre + direction * (reach + 1e-3), direction[None]).t[0]):
            x, y, z = centre + direction * (reach + FREE_M)
            return f"add a view from ({x:.2f}, {y:.2f}, {z:.2f}) m in the cell, looking along {_direction(-direction)}"
    return "add views from half the distance"


def _direction(axis: Float) -> str:
    """The name of the cell axis within 25 degrees of the direction, otherwise the components."""
    k = int(np.abs(axis).argmax())
    if abs(axis[k]) > np.cos(np.radians(25.0)):
        return f"{'-' if axis[k] < 0 else ''}{AXES[k]}"
    return "({:.1f}, {:.1f}, {:.1f})".format(*(float(a) + 0.0 for a in axis))
