# SPDX-License-Identifier: Apache-2.0
"""Fewer views of a recording during motion: all at rest, and some in motion."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_sensor.frame import in_motion

if TYPE_CHECKING:
    from collections.abc import Iterable

    from tof_core.capture import View


def thinned(views: Iterable[View], moving: int) -> list[View]:
    """The views at rest and at most `moving` of those in motion, spread evenly, in their order.

    At most twice `moving` views in motion are held: whenever there are more, every other one is dropped.
    """
    rest: list[tuple[int, View]] = []
    some: list[tuple[int, View]] = []
    every, met = 1, 0
    for place, view in enumerate(views):
        if view.robot is None or view.robot.twist is None or not in_motion(view.robot.twist):
            rest.append((place, view))
            continue
        if met % every == 0:
            some.append((place, view))
        met += 1
        if len(some) > 2 * moving:
            some, every = some[::2], 2 * every
    if len(some) > moving:
        some = [some[i] for i in np.linspace(0, len(some) - 1, moving).round().astype(int)]
    return [view for _, view in sorted(rest + some, key=lambda one: one[0])]
