# SPDX-License-Identifier: Apache-2.0
"""The score of foreign sessions as a table: all sessions first, separable ones second, and every miss."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from benchmarks.calibration import calibration_error
from benchmarks.gap_check.table import wilson

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from benchmarks.gap_check.foreign.score import ForeignRow

TOGETHER = ("single", "pair", "triple")


def figures(rows: Sequence[ForeignRow]) -> list[tuple[str, str, str, str]]:
    """(what, over all sessions, over separable ones, bar)."""

    def share(what: str, good: Callable[[ForeignRow], bool], kinds: tuple[str, ...], bar: str) -> tuple[str, str, str, str]:
        chosen = [r for r in rows if r.kind in kinds]
        return what, _share([good(r) for r in chosen]), _share([good(r) for r in chosen if r.separable]), bar

    everything = tuple({r.kind for r in rows})
    out = [
        share("one effect, strengths 0.5 to 2: named, nothing else", lambda r: r.hit, ("single",), "92 %"),
        share("pairs: both named, nothing else", lambda r: r.hit, ("pair",), "85 %"),
        share("three: every effect above 15 % of the gap named", lambda r: r.hit, ("triple",), "75 %"),
        share("healthy: none", lambda r: r.hit, ("null",), "97 %"),
        share("outside the vocabulary: unknown, nothing else", lambda r: r.hit, ("outside",), "85 %"),
        share("left out: unknown, nothing else", lambda r: r.hit, ("left-out",), "85 %"),
        share("a wrong effect asserted, any session", lambda r: bool(r.wrong), everything, "at most 3 %"),
    ]
    found = [r for r in rows if r.kind in TOGETHER]
    out += [
        _quantile("map of effects everywhere, correlation, 10 % quantile", found, lambda r: r.likeness, 0.1, "0.9"),
        _quantile("place of localised effects, AUROC, 10 % quantile", found, lambda r: r.place, 0.1, "0.85"),
        _quantile("stated shrink off the re-rendered one, points, 90 % quantile", found, _off, 0.9, "at most 5"),
        _held([r for r in found if r.covered is not None]),
        ("an effect that was not found is smaller than the report's bound", *_bounded(found), "90 %"),
        # Labels have their bar in `--step labels`, through the lens found and less the common range offset.
        _quantile("depth at the poses found, stated lens, mm off, median", rows, lambda r: r.label_mm, 0.5, ""),
        _quantile("depth at the poses found, stated lens, mm off, 90 % quantile", rows, lambda r: r.label_mm, 0.9, ""),
        _quantile("processor seconds a session, 90 % quantile", rows, lambda r: r.cpu_s, 0.9, ""),
    ]
    return out


def _held(rows: Sequence[ForeignRow]) -> tuple[str, str, str, str]:
    """Of the sessions that state a shrink, those whose interval holds the re-rendered one."""
    whole, part = (_share([bool(r.covered) for r in chosen]) for chosen in (rows, [r for r in rows if r.separable]))
    return "its 95 % interval holds the re-rendered shrink", whole, part, "92 to 98 %"


def _bounded(rows: Sequence[ForeignRow]) -> tuple[str, str]:
    """Of the effects that are there and were not found, those that are smaller than what the report says they stay below."""
    whole, part = (
        _share([true <= below for r in chosen for _, below, true in r.below]) for chosen in (rows, [r for r in rows if r.separable])
    )
    return whole, part


def _off(row: ForeignRow) -> float | None:
    return None if row.shrink is None or row.true_shrink is None else 100 * abs(row.shrink - row.true_shrink)


def _share(hits: Sequence[bool]) -> str:
    n, k = len(hits), sum(hits)
    if not n:
        return "none drawn"
    low, high = wilson(k, n)
    return f"{100 * k / n:.0f} % ({k} of {n}; {100 * max(low, 0.0):.0f} to {100 * high:.0f})"


def _quantile(
    what: str, rows: Sequence[ForeignRow], value: Callable[[ForeignRow], float | None], q: float, bar: str
) -> tuple[str, str, str, str]:
    def of(chosen: Sequence[ForeignRow]) -> str:
        known = [v for r in chosen if (v := value(r)) is not None and np.isfinite(v)]
        return f"{np.quantile(known, q):.3g} (n {len(known)})" if known else "none"

    return what, of(rows), of([r for r in rows if r.separable]), bar


def calibration(rows: Sequence[ForeignRow]) -> str:
    """Expected calibration error of the confidences of names, and how many of those of at least 0.9 are right."""
    named = [(c, right) for r in rows if r.kind != "left-out" for _, c, right in r.confidence]
    if not named:
        return "no name carries a confidence"
    confidence, right = np.array([c for c, _ in named]), np.array([r for _, r in named], float)
    error = calibration_error(confidence, right)
    sure = confidence >= 0.9
    return f"expected calibration error {100 * error:.0f} % over {len(named)} names; of {int(sure.sum())} names with 0.9, {int(right[sure].sum())} right"


def misses(rows: Sequence[ForeignRow]) -> list[str]:
    """Every miss in a line."""
    out = []
    for r in rows:
        if r.hit and not r.wrong:
            continue
        made = "+".join(f"{c} {s:.2g}" for c, s in r.causes.items()) or "healthy"
        hidden = "" if r.separable else ", not separable"
        truth = "+".join(r.truth) or "none"
        out.append(
            f"{r.name} {r.kind} {r.scene} {r.robot}: {made} ({truth}{hidden}) -> {', '.join(r.verdict)}: {r.miss or 'wrong: ' + ', '.join(r.wrong)}"
        )
    return out


def summary(rows: Sequence[ForeignRow]) -> str:
    """The table for a terminal."""
    lines = [f"{what:<66}{whole:<32}{part:<32}{bar}" for what, whole, part, bar in figures(rows)]
    head = f"{'what':<66}{'all sessions':<32}{'separable ones':<32}bar"
    return "\n".join([head, *lines, "", calibration(rows), "", *misses(rows)])


def page(rows: Sequence[ForeignRow], command: str) -> str:
    """The table as a section of a page."""
    table = "\n".join(f"| {what} | {whole} | {part} | {bar} |" for what, whole, part, bar in figures(rows))
    missed = "\n".join(f"- {line}" for line in misses(rows)) or "- none"
    return f"""`{command}`: {len(rows)} sessions. Shares carry Wilson's 95 % interval.

| what | all sessions | separable ones | bar |
|---|---|---|---|
{table}

Confidence: {calibration(rows)}.

Every miss:

{missed}
"""
