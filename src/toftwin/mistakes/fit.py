# SPDX-License-Identifier: Apache-2.0
"""How well a few views fit the CAD: coarsely at the robot's pose, and after a registration of the base within its usual error."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from tof_align.approach import approach
from tof_align.pixels import take_pixels
from tof_core import se3

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from tof_align.config import AlignConfig
    from tof_align.pixels import Pixels
    from tof_core.arrays import Float
    from tof_core.capture import View
    from tof_scene.raycast import Raycaster
    from toftwin.mistakes.hypotheses import Mistake

LOOSE_M = 0.1
"""Metres of depth up to which a pixel fits at the robot's pose: its base may be 50 mm and 2 degrees off."""
TIGHT_M = 0.015
"""The same once the base has been moved: a camera errs by millimetres, a wrong unit, axis, place or scene by centimetres and more."""
ROOM_M = 1.5
"""Longest side from which a part is a floor, a wall or a table, which many scenes have."""
FEW = 0.03
"""Share of measured pixels below which the pixels on small parts are too few to count."""
PIXELS = 700
"""Pixels of a view that are used."""
STARTS, KEPT = 64, 2
"""Candidate poses of the base, and those from which a descent starts: an eighth of an alignment's, since many mistakes are tried."""


def fitting(metres: float = 1.0) -> str:
    """What a fitting pixel is, in words; `metres`: length of a metre in the CAD's unit, by which the limit differs (`moved`)."""
    return f"within {1e3 * (TIGHT_M if metres == 1.0 else LOOSE_M):.0f} mm of the CAD"


@dataclass(frozen=True, slots=True, eq=False)
class Taken:
    """Pixels of some views of one station, and their cameras (V, 4, 4) by the robot."""

    pixels: tuple[Pixels, ...]
    poses: Float

    def share(self, caster: Raycaster, poses: Float, limit: float) -> float:
        """Share of the measured pixels within `limit` metres of the CAD; a ray that misses the CAD does not fit."""
        fits = count = 0
        for miss, _ in self.misses(caster, poses):
            fits, count = fits + int((miss < limit).sum()), count + len(miss)
        return fits / max(count, 1)

    def misses(self, caster: Raycaster, poses: Float) -> Iterator[tuple[Float, NDArray[np.int16]]]:
        """Of each view's measured pixels the distance to the CAD along the ray in metres, and the part that the ray hits (-1: none)."""
        for p, T in zip(self.pixels, poses, strict=True):
            known = np.isfinite(p.depth.ravel())
            hits = caster.cast(T[:3, 3], p.rays.reshape(-1, 3)[known] @ T[:3, :3].T)
            yield np.abs(p.depth.ravel()[known] - hits.t), hits.part


def on_small(taken: Taken, poses: Float, caster: Raycaster) -> float:
    """Share of fitting pixels among those on parts that are smaller than a room; 1 where they are too few."""
    small = np.array([float(np.ptp(p.vertices, axis=0).max()) < ROOM_M for p in caster.scene.parts])
    fits = count = total = 0
    for miss, part in taken.misses(caster, poses):
        on = (part >= 0) & small[part]
        fits, count, total = fits + int((on & (miss < 2 * TIGHT_M)).sum()), count + int(on.sum()), total + len(miss)
    return fits / count if count > FEW * total else 1.0


def take(views: Sequence[View], mistake: Mistake, config: AlignConfig) -> Taken:
    """Pixels and poses of the views with a mistake undone."""
    undone = [mistake.undone(v) for v in views]
    poses = np.array([v.robot.T_cell_camera for v in undone if v.robot is not None])
    return Taken(tuple(take_pixels(v, config.weights, pixels=PIXELS) for v in undone), poses)


def loose(taken: Taken, caster: Raycaster, metres: float = 1.0) -> float:
    """Share of pixels that fit roughly, at the robot's pose; `metres`: length of a metre in the CAD's unit."""
    return taken.share(caster, taken.poses, LOOSE_M * metres)


def aligned(taken: Taken, caster: Raycaster, config: AlignConfig, metres: float = 1.0) -> float:
    """Share of pixels that fit after a registration of the base within its usual error."""
    return moved(taken, caster, config, metres)[0]


def moved(taken: Taken, caster: Raycaster, config: AlignConfig, metres: float = 1.0) -> tuple[float, Float]:
    """`aligned`, and the poses (V, 4, 4) after the registration."""
    if metres != 1.0:  # Kernels and priors of an alignment are in metres.
        return taken.share(caster, taken.poses, LOOSE_M * metres), taken.poses
    quick = replace(config, approach=replace(config.approach, views=len(taken.pixels), starts=STARTS, kept=KEPT, slides=1, slide_rounds=1))
    frame = taken.poses[0]
    motion = approach(taken.pixels, taken.poses, frame, config.priors.base, caster, quick)
    places = (frame @ motion @ se3.inverse(frame) @ taken.poses, taken.poses)
    shares = [taken.share(caster, poses, TIGHT_M) for poses in places]
    best = int(np.argmax(shares))
    return shares[best], places[best]
