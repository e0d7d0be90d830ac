# SPDX-License-Identifier: Apache-2.0
"""The score as a table, with Wilson intervals and every kind of miss."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from benchmarks.gap_check.score import Row


def wilson(hits: int, n: int, z: float = 1.96) -> tuple[float, float]:
    """95 % interval of a share (Wilson 1927)."""
    if n == 0:
        return 0.0, 1.0
    p = hits / n
    middle, half = p + z * z / (2 * n), z * np.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    return float((middle - half) / (1 + z * z / n)), float((middle + half) / (1 + z * z / n))


RIVALS = {
    "single-usual": "one effect, usual strength",
    "single-small": "one effect, small strength",
    "single-large": "one effect, large strength",
    "pair": "pairs",
    "null": "nulls",
    "left-out": "effect not in the list",
}


def figures(rows: Sequence[Row]) -> list[tuple[str, str, str]]:
    """(what, value, bar) rows of the table in docs/gap_check.md."""
    out = [
        _share("one effect, usual strength: named", [r.hit for r in rows if r.kind == "single-usual"], "95 %"),
        _share("one effect, small strength: named", [r.hit for r in rows if r.kind == "single-small"], ""),
        _share("one effect, large strength: named", [r.hit for r in rows if r.kind == "single-large"], ""),
        _share("pairs: both named", [r.hit for r in rows if r.kind == "pair"], "85 %"),
        _share("nulls: none", [r.hit for r in rows if r.kind == "null"], "97 %"),
        _share("effect not in the list, separable: unknown", [r.hit for r in rows if r.kind == "left-out" and r.separable], "85 %"),
        _share(
            "  and the part that carries it named", [r.place == 1.0 for r in rows if r.kind == "left-out" and r.separable and r.hit], ""
        ),
        _share("false unknown elsewhere", ["unknown" in r.verdict for r in rows if r.kind != "left-out"], "at most 5 %"),
        _median("place of localised effects, AUROC", [r.place for r in rows if r.kind != "left-out"], "0.9"),
        _median("place of effects everywhere, correlation", [r.likeness for r in rows], "0.9"),
    ]
    both = [(r.shrink, r.true_shrink) for r in rows if r.hit and r.shrink is not None and r.true_shrink is not None]
    out.append(_median("stated shrink against the true effect's, points", [100 * abs(a - b) for a, b in both], "at most 5"))
    out.append(
        _share("its 95 % interval holds the true shrink", [bool(r.covered) for r in rows if r.hit and r.covered is not None], "90 to 99 %")
    )
    out.append(_median("label error at the diagnosis's poses, mm (range offset aside)", [r.label_mm for r in rows], "at most 0.3"))
    out.append(_median("gap left over the floor after what was named", [r.left_over_floor for r in rows], "at most 1.2"))
    out.append(_median("seconds of processor a case", [r.cpu_s for r in rows], ""))
    out.append(_median("seconds a case", [r.seconds for r in rows], "at most 10"))
    for name in ("least squares", "boosting"):
        for kind, what in RIVALS.items():
            hits = [r.baselines[name] for r in rows if r.kind == kind and name in r.baselines]
            if hits:
                out.append(_share(f"beside it, {name}: {what}", hits, ""))
    return out


def _share(what: str, hits: Sequence[bool], bar: str) -> tuple[str, str, str]:
    n, k = len(hits), sum(hits)
    low, high = wilson(k, n)
    return what, f"{100 * k / max(n, 1):.1f} % ({k} of {n}; {100 * low:.0f} to {100 * high:.0f})", bar


def _median(what: str, values: Sequence[float | None], bar: str) -> tuple[str, str, str]:
    known = np.array([v for v in values if v is not None and np.isfinite(v)])
    if len(known) == 0:
        return what, "no case", bar
    return what, f"{np.median(known):.3g} (10 %: {np.quantile(known, 0.1):.3g}, 90 %: {np.quantile(known, 0.9):.3g}, n {len(known)})", bar


def misses(rows: Sequence[Row]) -> list[str]:
    """Every miss in a line: kind, truth, verdict, why."""
    return [f"{r.name} {r.kind} {r.scene}: {'+'.join(r.truth) or 'null'} -> {', '.join(r.verdict)}: {r.miss}" for r in rows if not r.hit]


def summary(rows: Sequence[Row]) -> str:
    """The table for a terminal."""
    lines = [f"{what:<64}{value:<48}{bar}" for what, value, bar in figures(rows)]
    return "\n".join([*lines, "", *misses(rows)])


def page(rows: Sequence[Row], command: str) -> str:
    """`docs/gap_check.md`."""
    kinds = Counter(r.kind for r in rows)
    table = "\n".join(f"| {what} | {value} | {bar} |" for what, value, bar in figures(rows))
    missed = "\n".join(f"- {line}" for line in misses(rows)) or "- none"
    drawn = ", ".join(f"{n} {kind}" for kind, n in sorted(kinds.items()))
    return f"""# The gap diagnosis on sessions whose effect is withheld
Terms are in the [glossary](glossary.md).

`{command}` draws the cases, seals the answers, diagnoses the bags alone and scores: {drawn}.
Shares carry Wilson's 95 % interval.

| what | figure | bar |
|---|---|---|
{table}

## Every miss
{missed}
"""
