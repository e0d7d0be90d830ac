# SPDX-License-Identifier: Apache-2.0
"""Effects that fit, and that the held-out views contradict where the effect acts."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tof_core.stats import touched
from tof_gap.tell.account import unfounded
from tof_gap.tell.block_means import block_means, unbiased2
from tof_gap.tell.by_view import uneven
from tof_gap.tell.figures import away_from_edges
from tof_sensor.effects.interference import Interference
from tof_sensor.registry import EFFECTS

if TYPE_CHECKING:
    from collections.abc import Iterable

    from tof_core.arrays import Float
    from tof_gap.config import GapConfig
    from tof_gap.limits.report import UnexplainedLimits
    from tof_gap.tell.account import Account
    from tof_gap.tell.block_means import BlockMeans


class TakenOut(NamedTuple):
    """A cause that is not believed; contradicted: whether the views contradict its map, so that something without a name acts where it does."""

    name: str
    contradicted: bool


def taken_out(found: Account, config: GapConfig) -> TakenOut | None:
    """The cause with which the solution is not believed: one that is unfounded, contradicted, or uneven; None where all stand.

    Beside another camera's light an uneven one is that light's smooth part: nothing without a name acts there.
    """
    limit = config.report.unexplained
    if (name := unfounded(found, config.noise.foreign_light)) is not None:
        return TakenOut(name, contradicted=False)
    if (name := contradicted(found, limit)) is not None:
        return TakenOut(name, contradicted=True)
    foreign = any(isinstance(f.effect, Interference) for f in found.findings)
    return None if (name := uneven(found, limit)) is None else TakenOut(name, contradicted=not foreign)


def contradicted(found: Account, limit: UnexplainedLimits) -> str | None:
    """The effect where whose map acts most of the gap's structure is left, if that is more than `limit.contradicted`; None where all agree.

    A mechanism that is not in the vocabulary makes some known effect win held-out chi-square, since it acts on the same pixels: a ghost
    image on dark ones, as scattering in the lens does. Over the whole image that hardly shows. Where the map acts, the true effect
    takes nearly all that neighbouring pixels share, and another one does not.
    """
    shares = shares_left(found, limit)
    worst = max(shares, key=shares.__getitem__, default=None)
    return worst if worst is not None and shares[worst] > limit.contradicted else None


def shares_left(found: Account, limit: UnexplainedLimits) -> dict[str, float]:
    """By effect: chi-square above noise of block means that all effects leave on held-out views, over that of the gap there; least value by `limit.sure`.

    Of the blocks away from edges that the effect's map touches. 0 where there are none. The gap is that of all effects of the solution: what
    is left beside a far larger one may be the error of its map. Effects that smear are not judged: they err at edges.
    """
    judged = [name for name in found.solved.maps if not EFFECTS[name].SMEARS]
    if not judged:
        return {}
    figures, held, maps = found.figures, found.solved.split.held_out, found.solved.maps
    errors, every = figures.left(), unbiased2(found)
    views, noise2 = [found.solved.evidence[v] for v in held], [every[v] for v in held]
    left = away_from_edges([figures.edge[v] for v in held], [errors[v] for v in held])

    def means(names: Iterable[str]) -> BlockMeans:
        """Of what is left with the maps of these effects added again."""
        added = [e + sum((np.nan_to_num(maps[n][v]) for n in names), 0.0) for e, v in zip(left, held, strict=True)]
        return block_means(views, added, noise2, limit.contradicted_px, limit.contradicted_pixels)

    after, whole = means([]), means(maps)
    above, gap = (m.excess2 / m.white2 for m in (after, whole))
    shares = {}
    for name in judged:
        acts = touched(means([name]).mean - after.mean)
        sure = float(above[acts].sum()) - limit.sure * _deviation(above[acts])
        shares[name] = max(sure, 0.0) / max(float(gap[acts].sum()), 1.0)
    return shares


def _deviation(above: Float) -> float:
    """Standard deviation of a sum of squares of unit normal deviates about means whose squares are estimated by `above` (n,)."""
    return float(np.sqrt(np.sum(2.0 + 4.0 * np.maximum(above, 0.0))))
