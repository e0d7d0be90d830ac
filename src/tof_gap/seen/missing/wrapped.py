# SPDX-License-Identifier: Apache-2.0
"""Wrapped phase: pixels whose errors are jumps of a common size, mostly the unambiguous range."""

from __future__ import annotations

from typing import TYPE_CHECKING

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
LEAST_WRAP_M = LIGHT_M_PER_S / (2e6 * most(PhaseWrap, "modulation_mhz"))
"""Metres: unambiguous range at the highest modulation frequency that the effect allows; no shorter jump is a wrapped phase."""


def phase_wrap(views: Sequence[ViewEvidence], limits: MissingLimits) -> Finding | None:
    """`phase_wrap` where enough pixels jump by one common size."""
    # Edges that blur or move make jumps too: wrapped phase is looked for away from them.
    inner = [~binary_dilation(v.edge, iterations=limits.edge_reach_px) for v in views]
    of_views = [_jumps(v, i, limits) for v, i in zip(views, inner, strict=True)]
    jump = np.concatenate(of_views)
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
    turn = _turn(size, [(v.view.captures, np.abs(j)) for v, j in zip(views, of_views, strict=True)], spread)
    jumps = np.sort(np.concatenate([_whole(turn), [size] if turn > size else [], others]))
    maps = [_wraps(v, jumps, limits) for v in views]
    start, share = _where_wrapped(views, maps, limits, short=short)
    own = [i for i, other in enumerate(others) if not _of_a_mean(other, turn, captures, spread)]
    effect = PhaseWrap(
        modulation_mhz=LIGHT_M_PER_S / (2e6 * turn),
        start_m=start if short else -start,
        share=share,
        others_m=tuple(others[i] for i in own),
        others_share=tuple(others_share[i] for i in own),
    )
    return Finding(effect, CONFIDENT, share=np.stack(maps), corrects=True)


def _jumps(view: ViewEvidence, inner: Mask, limits: MissingLimits) -> Float:
    """(n,) metres along the ray: large errors of the pixels `inner` (H, W)."""
    jump = (view.residual * view.frame.length)[view.gross & inner]
    return np.asarray(jump[np.abs(jump) > limits.turn_least_mm * 1e-3])


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


def _turn(size: float, jumps: Sequence[tuple[int, Float]], spread: float) -> float:
    """The jump of a capture, in metres, of which means of dwells show parts: the least multiple of `size` that makes nearly as many jumps as any.

    It makes jumps of whole multiples of itself, and of its parts where some of a dwell's captures jump and others may be lost.

    jumps: captures of each view and the sizes of its jumps (n,), metres. spread: metres by which jumps of one size differ.
    """

    def made(turn: float) -> int:
        parts = ([*_whole(turn), *(turn * _parts(n))] for n, _ in jumps)
        return sum(int((np.abs(j[:, None] - np.array(p)) < spread).any(axis=1).sum()) for p, (_, j) in zip(parts, jumps, strict=True))

    turns = size * np.arange(1, max(n for n, _ in jumps) + 1)
    count = [made(float(t)) for t in turns]
    return float(next(t for t, c in zip(turns, count, strict=True) if c >= NEARLY * max(count)))


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
