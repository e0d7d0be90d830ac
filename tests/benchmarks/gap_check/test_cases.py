# SPDX-License-Identifier: Apache-2.0
"""Sessions of the gap check's short form, whose effect is withheld: the exact verdicts. The bars over all forty are those of `make gap-check`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from benchmarks.gap_check.__main__ import FORMS
from benchmarks.gap_check.cases import draw, with_small_nulls
from benchmarks.gap_check.examine import examine_all
from benchmarks.gap_check.record import record_all
from benchmarks.gap_check.score import score_all
from tof_scene.builtin import builtin_names

if TYPE_CHECKING:
    from pathlib import Path

    from benchmarks.gap_check.score import Row

pytestmark = pytest.mark.slow

SEED = 40
COUNT, SIZE = FORMS["short"]

VERDICTS = {
    5: ("single-small", ("flying_pixels",)),
    10: ("left-out", ("unknown",)),
    17: ("pair", ("dropout", "noise")),
    23: ("single-usual", ("specular",)),
    24: ("single-usual", ("hand_eye",)),
    31: ("pair", ("phase_wrap", "fixed_pattern")),
}
"""Kind and verdict of a case, by its number in the draw: each kind but sessions without an effect, which `tests/tof_gap/test_diagnose.py` and the
emerging camera's tests have, each scene, and effects in depth, noise, loss and poses."""


def scored(number: int, folder: Path) -> Row:
    """One case of the draw, recorded, diagnosed and scored."""
    case = with_small_nulls(draw(COUNT, tuple(builtin_names()), SEED))[number]
    width, height = (int(x) for x in SIZE.split("x"))
    record_all([case], folder, (width, height))
    examine_all(folder)
    (row,) = score_all(folder)
    return row


@pytest.mark.parametrize("number", VERDICTS)
def test_a_case_is_recorded_sealed_diagnosed_and_right(number: int, tmp_path: Path) -> None:
    row = scored(number, tmp_path)
    assert row.name == f"case{number:04d}"
    assert (row.kind, row.verdict) == VERDICTS[number]
    assert row.hit
    if row.kind != "left-out" and row.likeness is not None:
        assert row.likeness > 0.9, "the map of an effect everywhere is that of the true one"
    if row.kind.startswith("single") and row.place is not None:
        assert row.place > 0.9, "the pixels of a localised effect are found"
    if row.left_over_floor is not None:
        assert row.left_over_floor < 1.25, "what was named leaves the floor"
