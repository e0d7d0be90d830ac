# SPDX-License-Identifier: Apache-2.0
"""Fewer views of a recording during motion: all at rest, and some in motion."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from tof_sensor.frame import in_motion

if TYPE_CHECKING:
    from collections.abc import Iterable

    from tof_core.capture import View

Placed: TypeAlias = "tuple[int, View]"
"""A view and its place in the bag."""


@dataclass(slots=True)
class _Spread:
    """Views spread evenly over those that were added; at most twice `most` are held: when there are more, every other one is dropped."""

    most: int
    held: list[Placed] = field(default_factory=list)
    every: int = 1
    met: int = 0

    def add(self, one: Placed) -> None:
        """Hold one of `every` views."""
        if self.met % self.every == 0:
            self.held.append(one)
        self.met += 1
        if len(self.held) > 2 * self.most:
            self.held, self.every = self.held[::2], 2 * self.every


def thinned(views: Iterable[View], moving: int) -> list[View]:
    """The views at rest and at most `moving` of those in motion, spread evenly, in their order.

    Effects of motion follow the velocity at the stamp, which is not known where the camera starts or stops, or where TF errs.
    Such views are left out, unless most of the views in motion are of that kind.
    """
    rest: list[Placed] = []
    even, uneven = _Spread(moving), _Spread(moving)
    for place, view in enumerate(views):
        if view.robot is None or view.robot.twist is None or not in_motion(view.robot.twist):
            rest.append((place, view))
        else:
            (uneven if view.robot.uneven else even).add((place, view))
    some = even.held if even.met >= uneven.met else sorted(even.held + uneven.held, key=lambda one: one[0])
    if len(some) > moving:
        some = [some[i] for i in np.linspace(0, len(some) - 1, moving).round().astype(int)]
    return [view for _, view in sorted(rest + some, key=lambda one: one[0])]
