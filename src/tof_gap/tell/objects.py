# SPDX-License-Identifier: Apache-2.0
"""Foreign objects that named effects explain: a haze, a lamp's halo or a wrapped phase brings surfaces nearer, as an object before them would."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tof_core import se3
from tof_scene.world.surprises import OBJECT
from tof_sensor.effects.phase_wrap import PhaseWrap

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float
    from tof_core.capture import View
    from tof_gap.tell.account import Account
    from tof_scene.world.foreign import Foreign
    from tof_scene.world.surprises import Surprises

LEFT = 0.5
"""Least share of an object's distance before the CAD that the named effects must leave. Of four false objects in a haze they leave less
than a tenth; a true one keeps its distance but for errors of millimetres."""
BOX_M = 0.05
"""Metres around an object's box within which a pixel is counted as its own: poses move that far once effects are known."""


def unexplained_objects(world: Surprises, recorded: Sequence[View], found: Account) -> Surprises:
    """The same without the foreign objects whose distance before the CAD named effects explain.

    Objects are found at the first poses, before any effect is known.

    Args:
        world: what differs from the CAD, by views as recorded.
        recorded: the views before the pixels of objects were removed.
        found: poses and maps of the named effects.
    """
    # The map of wraps covers measured pixels of the CAD alone, and a wrapped surface hangs in the air before it.
    wraps = [f.effect for f in found.findings if isinstance(f.effect, PhaseWrap)]
    names = [name for name in found.figures.maps if not wraps or name != PhaseWrap.NAME]
    if not (world.foreign and (names or wraps)):
        return world
    number = {v.view.stamp_ns: k for k, v in enumerate(found.solved.evidence)}

    def is_left(thing: Foreign) -> bool:
        before, after = [np.zeros(0)], [np.zeros(0)]
        for of in thing.views:
            k = number.get(recorded[of].stamp_ns)
            if k is None:
                continue
            evidence = found.solved.evidence[k]
            distance = recorded[of].depth - evidence.rendering.depth
            own = (world.pixels[of] == OBJECT) & np.isfinite(distance)
            points = se3.apply(evidence.rendering.T_cell_camera, recorded[of].camera.points(recorded[of].depth)[own])
            own[own] = (np.abs(points - thing.centre_m) <= 0.5 * thing.size_m + BOX_M).all(axis=1)
            before.append(distance[own])
            explained = found.figures.total(names, k) + sum(e.bias(evidence.frame) for e in wraps)
            after.append((distance - explained)[own])
        was, left = (_median_size(np.concatenate(errors)) for errors in (before, after))
        return left >= LEFT * was

    return replace(world, foreign=tuple(thing for thing in world.foreign if is_left(thing)))


def _median_size(errors: Float) -> float:
    """Median of |errors|; 0 of none."""
    return float(np.median(np.abs(errors))) if len(errors) else 0.0
