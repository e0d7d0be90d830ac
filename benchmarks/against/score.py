# SPDX-License-Identifier: Apache-2.0
"""Third process: open what differs in each pair, and score the command's answers."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from benchmarks.against.compare import CODE
from benchmarks.against.pairs import MISSING, SUPERFLUOUS, TWICE
from benchmarks.against.record import REAL, SIMULATED
from benchmarks.gap_check.examine import REPORTS
from benchmarks.gap_check.record import BAGS, opened, sealed_names
from benchmarks.gap_check.separable import Truth, inseparable

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

MANNERS = {MISSING: "lacks", TWICE: "exaggerates", SUPERFLUOUS: "reality has not"}
"""What against.json must say that the simulator does."""
LEAST_REACHED = 0.5
"""Share of the asked strength that a cause must reach on both sides: where physics allows less, the pair does not count."""
ANSWER = "against.json"


@dataclass(frozen=True, slots=True)
class PairRow:
    """How the comparison of one pair went.

    found: effects named (`a|b`: a tie), and what the simulator does with each; hit: the changed effect in the right manner, and nothing else;
    seen: the changed effect, in whatever manner and beside whatever else; counts: whether the cause reached its size on both sides.
    """

    name: str
    kind: str
    scene: str
    causes: dict[str, float]
    effect: str
    found: dict[str, str]
    hit: bool
    seen: bool
    counts: bool

    @property
    def line(self) -> str:
        """The pair and the answer in words."""
        answer = ", ".join(f"{name} ({manner})" for name, manner in self.found.items()) or "none"
        return f"{self.name} {self.kind} {self.effect}".rstrip() + f": {answer}"


def score_pairs(folder: Path) -> list[PairRow]:
    """A row for every pair whose seal holds.

    Raises:
        DatasetError: an answer was changed after it was sealed.
    """
    out = []
    for name in sealed_names(folder):
        sealed, report = opened(folder, name), folder / REPORTS / name
        if (report / CODE).exists():
            pair = json.loads((sealed / "pair.json").read_text())
            out.append(scored(pair, answer(report / ANSWER), partial(_one_to_any_observer, pair, sealed, folder / BAGS / name)))
    return out


def scored(pair: dict[str, Any], found: dict[str, str] | None, alike: Callable[[str], bool] = lambda _: False) -> PairRow:
    """The row of a pair.

    A tie is right by the rule of the diagnosis' own check (`gap_check.separable.inseparable`): it holds the effect, and nothing that the
    session with more of the effect can distinguish from it.

    Args:
        pair: what differs.
        found: effects named, `a|b` for a tie, and what the simulator does with each; None where the command refused.
        alike: whether another effect cannot be distinguished from the one that differs.
    """
    effect, answer = pair["effect"], {"refused": ""} if found is None else found
    mine = {entry: manner for entry, manner in answer.items() if effect in entry.split("|")}
    causes = pair["camera"] | pair["simulator"]
    if effect:
        others = [other for entry in mine for other in entry.split("|") if other != effect]
        hit = len(answer) == 1 and list(mine.values()) == [MANNERS[pair["kind"]]] and all(map(alike, others))
    else:
        hit = not answer
    return PairRow(pair["name"], pair["kind"], pair["scene"], causes, effect, answer, hit, bool(mine), _counts(pair))


def _one_to_any_observer(pair: dict[str, Any], sealed: Path, bag: Path, other: str) -> bool:
    """Whether pose and another effect make the map of the effect that differs, in the session with more of it."""
    session = REAL if pair["kind"] == MISSING else SIMULATED
    return inseparable(Truth(sealed, bag, session, session), pair["effect"], other)


def _counts(pair: dict[str, Any]) -> bool:
    """Whether the changed cause reached its size; a cause that is measured by its size alone (NaN) always does."""
    sides = zip((pair["camera"], pair["simulator"]), pair["reached"], strict=True)
    return all(_shares(pair["changed"], asked, reached) for asked, reached in sides)


def _shares(changed: str, asked: dict[str, float], reached: dict[str, float]) -> bool:
    from benchmarks.emerging.causes import CAUSES
    from benchmarks.emerging.strength import GOALS

    if changed not in asked or CAUSES[changed].metric == "size":
        return True
    return reached[changed] >= LEAST_REACHED * asked[changed] * GOALS[CAUSES[changed].metric]


def answer(path: Path) -> dict[str, str] | None:
    """Effects named in an against.json, and what the simulator does with each; `unknown` alone where nothing is certain, None without a file."""
    if not path.exists():
        return None
    content = json.loads(path.read_text())
    rows = content["differences"]
    if content["verdict"] == ["unknown"]:
        return {"unknown": ""}
    return {"|".join(sorted({row["effect"], *row.get("tied_with", [])})): row["simulator"] for row in rows}
