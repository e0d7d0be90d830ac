# SPDX-License-Identifier: Apache-2.0
"""Effects that fit the session, but that held-out views contradict where the effect acts."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tof_core import se3
from tof_core.stats import touched
from tof_gap.seen.foreign.arm_steps import following, means
from tof_gap.tell.account import steps_along, unfounded
from tof_gap.tell.block_means import block_means, unbiased2
from tof_gap.tell.by_view import uneven
from tof_gap.tell.figures.session import away_from_edges, no_jumps
from tof_sensor.effects.hand_eye import HandEye
from tof_sensor.effects.interference import Interference
from tof_sensor.effects.intrinsics import Intrinsics
from tof_sensor.registry import EFFECTS

if TYPE_CHECKING:
    from collections.abc import Iterable

    from tof_core.arrays import Float
    from tof_core.calibration import Calibration
    from tof_gap.config import GapConfig
    from tof_gap.limits.foreign import ForeignLightLimits
    from tof_gap.limits.report import UnexplainedLimits
    from tof_gap.tell.account import Account
    from tof_gap.tell.block_means import BlockMeans


MOUNT = 2.0
"""Distance or turn of hand-eye, over the stated calibration's, from which a lens is not believed that needs it. In 252 sessions without a named
hand-eye it was 1.1 at most; 4.5 where a crack in the cover glass was a lens with the principal point off by 4.5 pixels."""

FINER = 2
"""Side of the blocks over that of finer ones. Of a box that stands 0 to 10 mm out of a crate, which passed for a bent crate, blocks of 8 pixels showed 0.18
left and blocks of 4 pixels 0.50; true effects of 58 sessions leave 0.06 at most in these."""


class TakenOut(NamedTuple):
    """A cause that is not believed; contradicted: whether the views contradict its map, so that a mechanism without a name acts there."""

    name: str
    contradicted: bool


def taken_out(found: Account, config: GapConfig) -> TakenOut | None:
    """The next cause that is not believed; None where all are believed.

    An unfounded one, else a contradicted, an uneven, an absorbed, a lens that the mount contradicts, an unchosen or a cancelling one.

    Beside another camera's light, an uneven cause is the smooth part of that light, and no mechanism without a name acts there. Nor does
    one where a cause was only suspected.
    """
    limit = config.report.unexplained
    if (name := unfounded(found, config.noise.foreign_light)) is not None:
        return TakenOut(name, contradicted=False)
    suspected = {n.name for n in found.solved.named if n.suspected}
    if (name := contradicted(found, limit)) is not None:
        return TakenOut(name, contradicted=name not in suspected)
    foreign = any(isinstance(f.effect, Interference) for f in found.findings)
    if (name := uneven(found, limit, config.noise)) is not None:
        return TakenOut(name, contradicted=not foreign and name not in suspected)
    if found.sags and found.solved.names(HandEye.NAME):  # The camera's place on the hand changes with attitude: it is no constant.
        return TakenOut(HandEye.NAME, contradicted=True)
    if not foreign and (name := absorbed(found, config.noise.foreign_light)) is not None:
        return TakenOut(name, contradicted=name not in suspected)
    name = unmounted(found, config.calibration) or unchosen(found, limit) or cancelling(found, limit)
    return None if name is None else TakenOut(name, contradicted=True)


def absorbed(found: Account, limits: ForeignLightLimits) -> str | None:
    """The effect whose mean over each view the steps of the camera along its axis follow best, if hardly by chance; else None.

    Its size between views then differs from that within views, so that it is not the mechanism. Steps beside motion are no evidence.
    """
    if not found.follows:
        return None
    solved = found.solved
    chance = {
        name: following(steps_along(solved), means(solved.evidence, maps), solved.chain.station).chance
        for name, maps in solved.maps.items()
        if not EFFECTS[name].SMEARS
    }
    best = min(chance, key=chance.__getitem__, default=None)
    return best if best is not None and chance[best] < limits.chance_follows else None


def unmounted(found: Account, stated: Calibration) -> str | None:
    """`intrinsics`, if the camera must sit elsewhere in the hand than its calibration allows (`MOUNT`), but `hand_eye` is not named; else None.

    To first order a turn of the camera in the hand is a shift of the principal point: each takes back most of the other.
    """
    if not found.solved.names(Intrinsics.NAME) or found.solved.names(HandEye.NAME) or not all(stated.hand_eye_most):
        return None
    metres, degrees = se3.distance(np.eye(4), found.solved.hand_eye)
    over = max(1e3 * metres / stated.hand_eye.translation_mm, degrees / stated.hand_eye.rotation_deg)
    return Intrinsics.NAME if over > MOUNT else None


def unchosen(found: Account, limit: UnexplainedLimits) -> str | None:
    """The cause that the fewest resampled sets of views choose, if less than `limit.chosen` of them do; else None.

    Selection adds a cause for its gain when added. Beside later ones, and at the final poses, the gain may be lost.
    """
    share = {n.name: n.confidence for n in found.solved.named if not n.suspected}
    least = min(share, key=share.__getitem__, default=None)
    return least if least is not None and share[least] < limit.chosen else None


def cancelling(found: Account, limit: UnexplainedLimits) -> str | None:
    """The cause that alone enlarges the gap most, if two causes or more do so by `limit.enlarges`; else None.

    One cause may hide a part of another. Two that are both larger than the gap, and leave little together, are a coincidence: free
    columns that fit an error without a name.
    """
    alone = {c.named.name: c.alone.shrink for c in found.causes if c.alone.shrink is not None and not c.named.suspected}
    larger = {name: shrink for name, shrink in alone.items() if shrink < -limit.enlarges}
    return min(larger, key=larger.__getitem__) if len(larger) > 1 else None


def contradicted(found: Account, limit: UnexplainedLimits) -> str | None:
    """The effect that leaves most of the gap's structure where its own map acts, if more than `limit.contradicted`; else None.

    A mechanism that is not in the vocabulary may act on the same pixels as a known effect. A ghost image, for instance, changes dark
    pixels, as scattering in the lens does; the known effect then wins held-out chi-square. Over the whole image that hardly shows.
    Where the map acts, the true effect removes nearly all of the error that neighbouring pixels share; another effect does not.
    """
    shares = shares_left(found, limit)
    worst = max(shares, key=shares.__getitem__, default=None)
    return worst if worst is not None and shares[worst] > limit.contradicted else None


def shares_left(found: Account, limit: UnexplainedLimits) -> dict[str, float]:
    """Share of the gap's structure that is left where each effect's map acts, on held-out views; 0 where it acts on no block.

    Structure is the chi-square of block means above that of noise, and of named errors that neighbours share, away from edges. The share is
    that left by all effects over that before any effect of the solution: an error beside a far larger effect may be that of the larger
    one's map. The share is stated `limit.sure` standard deviations too low. It is that of the blocks or of finer ones (`FINER`), whichever is
    larger: a small thing fills no large block. Effects that smear depth edges are not judged: their maps err at edges.
    """
    judged = [name for name in found.solved.maps if not EFFECTS[name].SMEARS]
    if not judged:
        return {}
    figures, held, maps = found.figures, found.solved.split.held_out, found.solved.maps
    views, noise2 = [found.solved.evidence[v] for v in held], unbiased2(found, held)
    left = no_jumps(views, away_from_edges([figures.edge[v] for v in held], figures.left(held)))

    def means(names: Iterable[str], finer: int) -> BlockMeans:
        """Of the remaining error, with the maps of these effects added again."""
        added = [e + sum((np.nan_to_num(maps[n][v]) for n in names), 0.0) for e, v in zip(left, held, strict=True)]
        return block_means(views, added, noise2, limit.contradicted_px // finer, limit.contradicted_pixels // finer**2)

    shares = dict.fromkeys(judged, 0.0)
    for finer in (1, FINER):
        after, whole = means([], finer), means(maps, finer)
        above, gap = ((m.excess2 - figures.alike_m**2) / m.white2 for m in (after, whole))
        for name in judged:
            acts = touched(means([name], finer).mean - after.mean)
            sure = float(above[acts].sum()) - limit.sure * _deviation(above[acts])
            shares[name] = max(shares[name], sure / max(float(gap[acts].sum()), 1.0))
    return shares


def _deviation(above: Float) -> float:
    """Standard deviation of a sum of squares of unit normal deviates about means whose squares are estimated by `above` (n,)."""
    return float(np.sqrt(np.sum(2.0 + 4.0 * np.maximum(above, 0.0))))
