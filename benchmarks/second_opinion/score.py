# SPDX-License-Identifier: Apache-2.0
"""Opening the answers: both judges against the truth, where they differ, and how well each means its probabilities."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from benchmarks.calibration import brier, calibration_error

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from benchmarks.second_opinion.opinion import Opinion

LIKELY = 0.5
"""Probability above which the second judge names."""
NO_EFFECT = frozenset({"none", "unknown"})


@dataclass(frozen=True, slots=True)
class Session:
    """One session before both judges.

    truth: its effects, whether the evidence can hold them or not; asked: names that both could choose; first, second: by name the
    diagnosis' confidence and the second judge's probability; first_names, second_names: what each says.
    """

    name: str
    kind: str
    truth: tuple[str, ...]
    asked: tuple[str, ...]
    first: Mapping[str, float]
    second: Mapping[str, float]
    first_names: tuple[str, ...]
    second_names: tuple[str, ...]

    @classmethod
    def of(cls, case: Mapping[str, Any], report: Mapping[str, Any], opinion: Opinion) -> Session:
        """From the sealed answer, the diagnosis' gap.json and the second opinion; an effect left out is no truth to either."""
        truth = tuple(sorted(set(case["effects"]) - {case["left_out"]})) or ((f"({'+'.join(case['causes'])})",) if case["causes"] else ())
        asked = tuple(n for n in opinion.asked if n not in NO_EFFECT)
        confidence = {c["effect"]: float(c["confidence"]) for c in report["causes"]}
        second = {n: opinion.probability(n) for n in asked}
        named = tuple(n for n in opinion.inclusion if opinion.probability(n) > LIKELY)
        return cls(case["name"], case["kind"], truth, asked, confidence, second, tuple(report["verdict"]), named)

    @property
    def holds(self) -> bool:
        """Whether the evidence before both judges can hold every effect of the truth: noise, loss and bursts are no columns."""
        return set(self.truth) <= set(self.asked)

    @property
    def only_first(self) -> tuple[str, ...]:
        """Effects that the diagnosis alone names, of those that both were asked for."""
        mine = {n for v in self.first_names for n in v.split("|")}
        return tuple(sorted(n for n in mine & set(self.asked) if n not in self.second_names))

    @property
    def only_second(self) -> tuple[str, ...]:
        """Effects that the second judge alone names."""
        mine = {n for v in self.first_names for n in v.split("|")}
        return tuple(sorted(n for n in set(self.second_names) & set(self.asked) if n not in mine))


def line(s: Session) -> str:
    """A session in a line: truth, both verdicts, and every name on which they differ, with an R where it is right."""
    stated = ", ".join(f"{v} {s.first[v.split('|')[0]]:.2f}" if v.split("|")[0] in s.first else v for v in s.first_names)
    second = ", ".join(f"{n} {s.second.get(n, float('nan')):.2f}" for n in s.second_names) or "none"
    alone = [*(f"1: {n}{_right(s, n)}" for n in s.only_first), *(f"2: {n}{_right(s, n)}" for n in s.only_second)]
    held = "" if s.holds else " [beyond the evidence]"
    return f"{s.name} {s.kind:<9}{'+'.join(s.truth) or 'healthy'}{held} | {stated} | {second} | {'; '.join(alone) or '-'}"


def _right(s: Session, name: str) -> str:
    return " R" if name in s.truth else ""


def figures(sessions: Sequence[Session]) -> list[tuple[str, str, str]]:
    """(what, the diagnosis, the second judge) over all sessions given."""
    judges: tuple[Callable[[Session], Mapping[str, float]], ...] = (lambda s: s.first, lambda s: s.second)
    every = [[(p(s).get(n, 0.0), n in s.truth) for s in sessions for n in s.asked] for p in judges]
    named = [
        [
            (s.first.get(n, 0.0), n in s.truth)
            for s in sessions
            for n in s.asked
            if n in {x for v in s.first_names for x in v.split("|")[:1]}
        ],
        [(s.second[n], n in s.truth) for s in sessions for n in s.asked if n in s.second_names],
    ]
    both = (0, 1)
    return [
        ("names stated, of them right", *_pair([f"{len(x)}, {sum(r for _, r in x)}" for x in named])),
        ("true names that the evidence holds, of them stated", *_pair([_found(sessions, x) for x in both])),
        ("expected calibration error of stated names", *_pair([_percent(calibration_error, x) for x in named])),
        ("expected calibration error of all names asked", *_pair([_percent(calibration_error, x) for x in every])),
        ("Brier score of all names asked", *_pair([f"{brier([p for p, _ in x], [r for _, r in x]):.4f}" for x in every])),
        ("names that it alone states, of them right", *_pair([_alone(sessions, x) for x in ("only_first", "only_second")])),
    ]


def _pair(values: Sequence[str]) -> tuple[str, str]:
    first, second = values
    return first, second


def _found(sessions: Sequence[Session], judge: int) -> str:
    true = [(s, n) for s in sessions for n in s.truth if n in s.asked]
    said = [n in ({x for v in s.first_names for x in v.split("|")} if judge == 0 else s.second_names) for s, n in true]
    return f"{len(true)}, {sum(said)}"


def _percent(error: Callable[[Sequence[float], Sequence[bool]], float], stated: Sequence[tuple[float, bool]]) -> str:
    return f"{100 * error([p for p, _ in stated], [r for _, r in stated]):.1f} %" if stated else "none stated"


def _alone(sessions: Sequence[Session], which: str) -> str:
    names = [(s, n) for s in sessions for n in getattr(s, which)]
    return f"{len(names)}, {sum(n in s.truth for s, n in names)}"


def table(sessions: Sequence[Session]) -> str:
    """Every session in a line, then the figures over all and over those whose truth the evidence can hold."""
    out = ["session kind truth | diagnosis, confidence | second judge, probability | named by one alone (R: right)", *map(line, sessions)]
    for what, some in (("all sessions", sessions), ("truth within the evidence", [s for s in sessions if s.holds])):
        if some:
            out += ["", f"{what} ({len(some)})".ljust(56) + f"{'diagnosis':<16}second judge"]
            out += [f"{name:<56}{one:<16}{two}" for name, one, two in figures(some)]
    return "\n".join(out)
