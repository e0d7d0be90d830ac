# SPDX-License-Identifier: Apache-2.0
"""Labels in a world that is not its CAD: absent, foreign and displaced things and a person's arm, before the emerging camera."""

from __future__ import annotations

import shutil
import sys
import tempfile
from dataclasses import asdict
from pathlib import Path

from benchmarks.figure import Figure, at_least, at_most
from benchmarks.kept import kept
from benchmarks.surprises.cases import draw, record_case
from benchmarks.surprises.score import Row, score

LONG = True
COUNT, SEED, SIZE, VIEWS = 40, 9, (128, 98), 8
"""Sessions of the bench; the limits were found on seed 1, what is named was corrected on seeds 2, 3, 6 and 8; this seed was never looked at."""
DISPLACED_OF = 48
"""Of so many sessions those with a displaced part are in the bench, too: one session shows few wrong pixels."""
PERCENT = 2.0


def run() -> list[Figure]:
    """Shares over all sessions of each kind."""
    rows = [Row(**row) for row in kept(f"surprises-{SEED}-{COUNT}-{DISPLACED_OF}", lambda: [asdict(r) for r in measured()])]
    kinds = {
        "a foreign object": ["foreign"],
        "a missing part": ["missing"],
        "a displaced part": ["displaced"],
        "a person's arm in half of the views": ["arm", "arm and foreign"],
        "all surprises": ["foreign", "missing", "displaced", "arm", "arm and foreign"],
        "nothing surprising": ["none"],
    }
    figures = [figure for words, names in kinds.items() for figure in _figures(words, [r for r in rows if r.kind in names])]
    return [*figures, *_names([r for r in rows if not r.refused])]


def measured() -> list[Row]:
    """Record, label and count each session."""
    folder = Path(tempfile.mkdtemp(prefix="toftwin-surprises-"))
    rows = []
    try:
        for case in (c for k, c in enumerate(draw(DISPLACED_OF, SEED, VIEWS)) if k < COUNT or c.kind == "displaced"):
            record_case(case, folder / case.name, SIZE)
            rows.append(score(folder / case.name))
            shutil.rmtree(folder / case.name)
            print(rows[-1], file=sys.stderr, flush=True)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    return rows


def _names(rows: list[Row]) -> list[Figure]:
    """Of sessions: what is named of what is there, and what is named that is not."""
    things, named = sum(r.things for r in rows), sum(r.named for r in rows)
    false = [f"{r.name} ({r.kind})" for r in rows if r.false]
    return [
        at_least(
            "surprises: foreign objects and missing parts that are named", 100 * named / max(things, 1), 90, "%", remark=f"of {things}"
        ),
        at_most(
            "surprises: sessions in which one is named that is not there",
            100 * len(false) / max(len(rows), 1),
            PERCENT,
            "%",
            remark=f"of {len(rows)}; {', '.join(false) or 'none'}",
        ),
    ]


def _figures(words: str, rows: list[Row]) -> list[Figure]:
    total = {name: sum(getattr(r, name) for r in rows) for name, value in asdict(Row("", "")).items() if isinstance(value, int)}
    refused = sum(bool(r.refused) for r in rows)
    sessions = f"{len(rows)} sessions" + (f", {refused} refused" if refused else "")

    def percent(part: str, whole: str) -> float:
        return float(100 * total[part] / max(total[whole], 1))

    lost = at_most(
        f"surprises: {words}, right labels that are lost",
        percent("lost", "good"),
        PERCENT,
        "%",
        remark=f"of {total['good']} in {sessions}; beside, {total['pose']} labels more than 15 mm off by pose and lens, at edges; each view by itself, as live: {percent('alone_lost', 'good'):.2f} %",
    )
    if words.startswith("nothing"):
        return [lost]
    remark = (
        f"of {total['wrong']} measured pixels in {sum(r.wrong > 0 for r in rows)} of {sessions}; of {total['wrong_unmeasured']} without a return {percent('kept_unmeasured', 'wrong_unmeasured'):.0f} %; "
        f"each view by itself, as live: {percent('alone_kept', 'wrong'):.2f} %"
    )
    return [
        at_most(f"surprises: {words}, labels more than 15 mm off that are kept", percent("kept", "wrong"), PERCENT, "%", remark=remark),
        lost,
    ]
