# SPDX-License-Identifier: Apache-2.0
"""The steps of a diagnosis, as it names them, and their usual shares of its time."""

from __future__ import annotations

FIRST = "first poses: depth or distance along the ray"
TOGETHER = "poses and effects together"
HELD_OUT = "noise, loss and edges; the gap on held-out views"
UNEXPLAINED = "what no named effect explains"
REPORT = "advice and report"

PERCENT = {FIRST: (0, 10), TOGETHER: (10, 85), HELD_OUT: (85, 97), UNEXPLAINED: (97, 99), REPORT: (99, 100)}
"""When a step begins and ends, in percent of the time that all take: of 20 views of 224x171, 82 s."""


def with_share(step: str) -> str:
    """A step with its usual share of the time; what is only a note comes back as it is."""
    begins, ends = PERCENT.get(step, (0, 0))
    return f"{step} ({begins} to {ends} % of the usual time)" if ends else step
