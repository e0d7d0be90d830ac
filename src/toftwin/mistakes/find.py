# SPDX-License-Identifier: Apache-2.0
"""The usual mistake that explains why views do not fit their scene."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tof_align.config import AlignConfig
from tof_core.errors import RefusedError
from tof_core.shares import in_percent
from toftwin.mistakes.fit import aligned, fitting, loose, moved, on_small, take
from toftwin.mistakes.hypotheses import none, usual
from toftwin.mistakes.parts import wrong_part

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.capture import View
    from tof_core.options import BagOptions
    from tof_scene.raycast import Raycaster
    from toftwin.mistakes.fit import Taken
    from toftwin.mistakes.hypotheses import Mistake

VIEWS = 3
"""Views of one station that are rendered."""
TRIED = 8
"""Number of mistakes, those that fit best at the robot's pose, for which the base is registered too."""
FITS = 0.75
"""Share of fitting pixels from which bag and scene agree: missing parts, foreign objects and edges leave this much in a healthy session."""
SURE = 0.9
"""Share of fitting pixels from which no other mistake is tried."""
NAMED = 0.45
"""Share of fitting pixels from which a mistake is named."""
BETTER = 0.6
"""Largest ratio of the misses without a mistake to those with it."""
NOWHERE = 0.35
"""Share of fitting pixels below which the camera sees another scene, whatever the mistake."""


@dataclass(frozen=True, slots=True)
class Found:
    """The result of a search.

    share: of the pixels, those that fit the bag and scene as given; small: the same on small parts alone; undone: those that fit
    without the mistake. `mistake` is None where bag and scene agree, or where no common mistake explains the misfit.
    """

    share: float
    small: float = 1.0
    mistake: Mistake | None = None
    undone: float = 0.0

    @property
    def fits(self) -> bool:
        """Whether the views fit the scene as they are."""
        return self.share >= FITS

    @property
    def nowhere(self) -> bool:
        """Whether the views fit the scene nowhere, and no mistake explains it."""
        return self.mistake is None and not self.fits and min(self.share, self.small) < NOWHERE


def find_mistake(views: Sequence[View], caster: Raycaster, options: BagOptions, config: AlignConfig | None = None) -> Found:
    """Try the common mistakes on some views of one station, each with its robot pose."""
    config = config or AlignConfig()
    some = _some(views)
    if not some:
        return Found(0.0)
    before = take(some, none(), config)
    share, poses = moved(before, caster, config)
    if share >= FITS:
        return Found(share)
    tried = [(take(some, m, config), m) for m in usual(some[0].camera, options)]
    tried.sort(key=lambda t: -loose(t[0], caster, t[1].metres))
    undone, mistake = _best(tried[:TRIED], caster, config)
    if undone < SURE and (of_part := wrong_part(before, caster)) is not None:
        undone, mistake = max((undone, mistake), of_part, key=lambda f: f[0])
    if undone >= NAMED and 1 - undone <= BETTER * (1 - share):
        return Found(share, 1.0, mistake, undone)
    return Found(share, on_small(before, poses, caster))


def _best(tried: Sequence[tuple[Taken, Mistake]], caster: Raycaster, config: AlignConfig) -> tuple[float, Mistake]:
    """The mistake whose removal lets most pixels fit, and their share; the first one with nearly all ends the search."""
    best = (0.0, tried[0][1])
    for taken, mistake in tried:
        share = aligned(taken, caster, config, mistake.metres)
        if share > best[0]:
            best = (share, mistake)
        if share >= SURE:
            break
    return best


def _some(views: Sequence[View]) -> list[View]:
    """Views of the station with most views, spread over it; of neighbours the one with most measured pixels."""
    usable = [v for v in views if v.robot is not None and np.isfinite(v.depth).any()]
    if not usable:
        return []
    stations = [v.station for v in usable]
    of_one = [v for v in usable if v.station == max(set(stations), key=stations.count)]
    return [of_one[int(k)] for k in np.unique(np.linspace(0, len(of_one) - 1, min(VIEWS, len(of_one))).round())]


def explained(error: RefusedError, views: Sequence[View], caster: Raycaster, options: BagOptions, align: AlignConfig) -> RefusedError:
    """The refusal with the line to change, if a common mistake explains it; else the unchanged refusal."""
    found = find_mistake(views, caster, options, align)
    if found.mistake is None:
        return error
    without = f"without that {in_percent(found.undone)} of the pixels are {fitting(found.mistake.metres)}"
    why = f"{error.what}; {found.mistake.what}: {without}, with it {in_percent(found.share)} are {fitting()}"
    return RefusedError(why, where=error.where, todo=found.mistake.todo)
