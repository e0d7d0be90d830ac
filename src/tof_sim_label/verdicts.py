# SPDX-License-Identifier: Apache-2.0
"""The verdicts of the views in words: how many of which kind, and a warning while views are refused."""

from __future__ import annotations

from collections import Counter, deque

RECENT = 10
"""Labels whose refusals are a warning: a robot that looks past the cell once is forgotten after as many good views, some dwells later."""
SKIPPED = "skipped"
"""Verdict of a dwell without a label because `live.share` was used up."""
TF = "TF"
"""Who says where the cell is, where TF has it."""
WITHHELD = "label/pose and CAMERA_aligned are not published for them, and their masks are empty"


class Verdicts:
    """Counts since the node began, by a short name each; a warning from the session's latest views.

    `why` is the session's newest refusal in full, empty where there is none.
    """

    def __init__(self) -> None:
        """No view yet."""
        self.counts: Counter[str] = Counter()
        self.begin()

    def begin(self) -> None:
        """A session begins: what views of the one before fitted says nothing about this one."""
        self._refused: deque[str] = deque(maxlen=RECENT)
        self._of_session: Counter[str] = Counter()
        self._accepted, self.why = 0, ""

    def skip(self) -> str:
        """A dwell gets no label; how many have none, in words."""
        self.counts[SKIPPED] += 1
        return f"{self.counts[SKIPPED]} of {self.counts.total()} dwells"

    def accept(self, short: str) -> None:
        """A view whose pose is accepted."""
        self.counts[short] += 1
        self._accepted += 1
        self._refused.append("")

    def refuse(self, short: str, why: str) -> None:
        """A view whose pose is refused; `why` in full."""
        self.counts[short] += 1
        self._of_session[short] += 1
        self._refused.append(short)
        self.why = why

    def warning(self, placed_by: str) -> str:
        """What is wrong while views are refused, and what to do; empty otherwise. `placed_by`: who says where the cell is."""
        recent = Counter(filter(None, self._refused))
        if not recent:
            return ""
        if self._accepted:
            return f"views are refused: {recent.total()} of the last {len(self._refused)} ({_listed(recent)}); {WITHHELD}. The newest: {self.why}"
        remedy = "correct the transform to the cell" if placed_by == TF else "correct it, or draw the pose in RViz (2D Pose Estimate)"
        return (
            f"no view fits the CAD: all {self._of_session.total()} of this session are refused ({_listed(self._of_session)}); {WITHHELD}. "
            f"If the camera sees the cell, the cell is not where {placed_by} places it: {remedy}; or the scene is of another cell. "
            f"The newest: {self.why}"
        )


def _listed(counts: Counter[str]) -> str:
    return ", ".join(f"{name} {count}" for name, count in counts.most_common())
