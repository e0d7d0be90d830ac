# SPDX-License-Identifier: Apache-2.0
"""Where: discoveries keep their rate; the page escapes what comes from outside."""

from __future__ import annotations

import numpy as np

from tof_gap.tell.page import sentence
from tof_gap.tell.where import _discoveries


def test_false_discoveries_stay_below_their_rate() -> None:
    rng = np.random.default_rng(0)
    found = [bool(_discoveries(rng.uniform(size=200), 0.05).any()) for _ in range(400)]
    assert np.mean(found) < 0.09


def test_small_p_values_are_found_among_many() -> None:
    p = np.concatenate([np.full(5, 1e-8), np.random.default_rng(1).uniform(size=200)])
    assert _discoveries(p, 0.05)[:5].all()


def test_the_verdict_reads_as_a_sentence() -> None:
    gap = {"shrink": 0.97}
    assert sentence({"verdict": ["none"], "gap": gap}).startswith("Camera and simulation agree")
    one = sentence({"verdict": ["multipath"], "gap": gap})
    assert one == "Camera and simulation differ by multipath, which explains 97% of the gap."
    two = sentence({"verdict": ["amplitude_bias|wiggling", "multipath"], "gap": gap})
    assert two == "Camera and simulation differ by amplitude bias or wiggling and multipath, which together explain 97% of the gap."
    clue = {"depends_on": ["amplitude", "x_m", "z_m"], "where": ["floor", "wall"]}
    assert sentence({"verdict": ["unknown"], "gap": gap, "unexplained": clue}) == (
        "Camera and simulation differ, and no effect known here explains how. "
        "It goes with amplitude and place in the cell; it shows most on floor and wall."
    )
    nowhere: dict[str, list[str]] = {"depends_on": [], "where": []}
    assert sentence({"verdict": ["multipath", "unknown"], "gap": gap, "unexplained": nowhere}).endswith("no effect known here explains.")
