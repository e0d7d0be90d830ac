# SPDX-License-Identifier: Apache-2.0
"""Wrapped phase: pixels whose errors are jumps of a common size, mostly the unambiguous range."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.ndimage import binary_dilation

from tof_gap.seen.finding import CONFIDENT, Finding, most
from tof_sensor.effects.phase_wrap import PhaseWrap
from tof_sensor.frame import LIGHT_M_PER_S

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float, Mask
    from tof_gap.limits.missing import MissingLimits
    from tof_gap.seen.evidence.view import ViewEvidence

MOST_TURNS = 3
"""Largest error in whole periods: usual cameras merge frequencies over at most as many."""
NEARLY = 0.95
"""Share of the jumps that the best size makes, from which a smaller one is taken: chance meets and outliers are a few per cent."""
APART = 0.05
"""Standard error of a mean of captures over its jump, from which captures differ by as much as the mean jumps, so that only some of them jump: 0.2 to
0.5 of means of two and three captures; noise is 0.01 of a jump."""
LEAST_WRAP_M = LIGHT_M_PER_S / (2e6 * most(PhaseWrap, "modulation_mhz"))
"""Metres: unambiguous range at the highest modulation frequency that the effect allows; no shorter jump is a wrapped phase."""


def phase_wrap(views: Sequence[ViewEvidence], limits: MissingLimits) -> Finding | None:
    """`phase_wrap` where enough pixels jump by one common size."""
    # Edges that blur or move make jumps too: wrapped phase is looked for away from them.
    inner = [~binary_dilation(v.edge, iterations=limits.edge_reach_px) for v in views]
    of_views = [_jumps(v, i, limits) for v, i in zip(views, inner, strict=True)]
    jump, apart = (np.concatenate(a) for a in zip(*((j.metres, j.apart) for j in of_views), strict=True))
    total = sum(int((np.isfinite(v.residual) & i).sum()) for v, i in zip(views, inner, strict=True))
    if len(jump) < limits.turn_share * max(total, 1):
        return None
    size = _common_size(np.abs(jump), limits.turn_spread_mm * 1e-3)
    if size < LEAST_WRAP_M:
        return None
    near = np.abs(jump - _nearest(jump, _whole(size))) < limits.turn_spread_mm * 1e-3
    if near.sum() < limits.turn_share * total or near.mean() < limits.turn_majority:
        return None
    short = bool(np.median(jump[near]) < 0)
    others, others_share = _other_jumps(np.abs(jump), size, limits, limits.turn_share * total)
    captures, spread = max(v.view.captures for v in views), limits.turn_spread_mm * 1e-3
    turn = _turn(size, of_views, spread)
    jumps = np.sort(np.concatenate([_whole(turn), [size] if turn > size else [], others]))
    maps = [_wraps(v, jumps, limits) for v in views]
    start, share = _where_wrapped(views, maps, limits, short=short)
    own = _of_captures(others, turn, jump, apart, captures, spread)
    effect = PhaseWrap(
        modulation_mhz=LIGHT_M_PER_S / (2e6 * turn),
        start_m=start if short else -start,
        share=share,
        others_m=tuple(others[i] for i in own),
        others_share=tuple(_with_parts(i, others, others_share, captures, spread) for i in own),
    )
    return Finding(effect, CONFIDENT, share=np.stack(maps), corrects=True)


class _Jumps(NamedTuple):
    """Large errors of a view of so many captures: metres along the ray (n,), and whether the captures of a pixel lie apart (n,) (`APART`)."""

    captures: int
    metres: Float
    apart: Mask


def _jumps(view: ViewEvidence, inner: Mask, limits: MissingLimits) -> _Jumps:
    """The large errors of the pixels `inner` (H, W)."""
    jump = view.residual * view.frame.length
    at = view.gross & inner & (np.abs(jump) > limits.turn_least_mm * 1e-3)
    apart = (view.view.count[at] > 1) & (view.view.sigma[at] > APART * np.abs(view.residual[at]))
    return _Jumps(view.view.captures, jump[at], apart)


def _common_size(sizes: Float, spread: float) -> float:
    """Metres: median of the jumps (n,) within `spread` of the most frequent size."""
    ordered = np.sort(sizes)
    counts = np.searchsorted(ordered, ordered + 2 * spread) - np.arange(len(ordered))
    first = int(np.argmax(counts))
    return float(np.median(ordered[first : first + counts[first]]))


def _other_jumps(sizes: Float, size: float, limits: MissingLimits, least: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Other sizes than `size` that at least the share `least` of the jumps (n,) has: metres, most frequent first, and the share of each.

    A wrong choice among three frequencies gives combinations of their periods that are no multiple of any one of them.
    """
    spread = limits.turn_spread_mm * 1e-3
    found: list[tuple[float, float]] = []
    left = sizes[np.abs(sizes - size) >= spread]
    while len(left) > least:
        jump = _common_size(left, spread)
        own = np.abs(left - jump) < spread
        if own.sum() < least:
            break
        found.append((jump, float(own.sum()) / len(sizes)))
        left = left[~own]
    return tuple(jump for jump, _ in found), tuple(share for _, share in found)


def _of_captures(others: Sequence[float], turn: float, jump: Float, apart: Mask, captures: int, spread: float) -> list[int]:
    """Which of the other sizes are jumps of captures: no part of `turn`, and of the jumps (n,) of most such pixels the captures are not `apart`."""

    def of_one(other: float) -> bool:
        return not (
            abs(other - turn) < spread
            or _of_a_mean(other, turn, captures, spread)
            or apart[np.abs(np.abs(jump) - other) < spread].mean() > 0.5
        )

    return [i for i, other in enumerate(others) if of_one(other)]


def _with_parts(i: int, sizes: Sequence[float], shares: Sequence[float], captures: int, spread: float) -> float:
    """Share of the jumps that are of size number `i`, or a part of it in a mean of captures."""
    return sum(
        share for k, (size, share) in enumerate(zip(sizes, shares, strict=True)) if k == i or _of_a_mean(size, sizes[i], captures, spread)
    )


def _turn(size: float, jumps: Sequence[_Jumps], spread: float) -> float:
    """The jump of a capture, in metres, of which means of dwells show parts: the least multiple of `size` that makes nearly as many jumps as any.

    It makes jumps of whole multiples of itself where the captures agree, and of its parts where some of a dwell's captures jump and others may
    be lost. spread: metres by which jumps of one size differ.
    """

    def made(turn: float) -> int:
        whole = (_at(j, _whole(turn), spread) & ~j.apart for j in jumps)
        return sum(int((w | _at(j, turn * _parts(j.captures), spread)).sum()) for w, j in zip(whole, jumps, strict=True))

    turns = size * np.arange(1, max(j.captures for j in jumps) + 1)
    count = [made(float(t)) for t in turns]
    return float(next(t for t, c in zip(turns, count, strict=True) if c >= NEARLY * max(count)))


def _at(jumps: _Jumps, sizes: Float, spread: float) -> Mask:
    """(n,) which jumps are of one of the sizes, in metres."""
    return np.asarray((np.abs(np.abs(jumps.metres)[:, None] - sizes) < spread).any(axis=1))


def _of_a_mean(jump: float, size: float, captures: int, spread: float) -> bool:
    """Whether some of the captures of a mean jump by `size` and the others do not: no capture jumps by `jump`."""
    return bool((np.abs(jump - size * _parts(captures)) < spread).any())


def _parts(captures: int) -> Float:
    """Shares of up to `captures` captures that some of them are."""
    return np.unique([k / n for n in range(2, captures + 1) for k in range(1, n)])


def _wraps(view: ViewEvidence, jumps: Float, limits: MissingLimits) -> Float:
    """(H, W) metres of z that wrapping adds; NaN where nothing is measured."""
    r = view.residual * view.frame.length
    nearest = _nearest(r, jumps)
    # Once the jumps are known, a residual nearer to one of them than to zero is wrapped, at any amplitude.
    wrapped = np.abs(r - nearest) < max(limits.turn_spread_mm * 1e-3, limits.turn_reach * float(jumps[0]))
    return np.where(np.isfinite(r), np.where(wrapped, nearest / view.frame.length, 0.0), np.nan)


def _whole(size: float) -> Float:
    """(MOST_TURNS,) metres of 1, 2, ... periods: merging two frequencies wrongly may cost more than one."""
    return size * np.arange(1.0, MOST_TURNS + 1)


def _nearest(error: Float, jumps: Float) -> Float:
    """For each error, the nearest of the ascending jumps (n,), with the sign of the error."""
    at = np.searchsorted(0.5 * (jumps[1:] + jumps[:-1]), np.abs(error))
    return np.asarray(np.sign(error) * jumps[at])


def _where_wrapped(views: Sequence[ViewEvidence], maps: Sequence[Float], limits: MissingLimits, *, short: bool) -> tuple[float, float]:
    """Range in metres beyond which phases wrap, or up to which if not `short`, and the share of wrapped pixels there."""
    wrapped = np.concatenate([m[np.isfinite(v.residual)] != 0 for v, m in zip(views, maps, strict=True)])
    radial = np.concatenate([v.frame.radial[np.isfinite(v.residual)] for v in views])
    start = float(np.quantile(radial[wrapped], limits.turn_start if short else 1.0 - limits.turn_start))
    inside = radial > start if short else radial < start
    return start, float(wrapped[inside].mean())
