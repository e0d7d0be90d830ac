# SPDX-License-Identifier: Apache-2.0
"""The promise of a fitted sensor: the shrink that its model predicts for another session."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, cast

import pytest

from tof_gap.seen.finding import Finding
from tof_gap.tell.report import _promise
from tof_gap.tell.shrink import Errors, Shrink
from tof_sensor.effects.phase_wrap import PhaseWrap
from tof_sensor.origin import Promise

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_gap.tell.diagnosis import Diagnosis

NOTHING = Errors(0.0, 0.0, 0.0)


def stated(shrink: float | None) -> Shrink:
    return Shrink(NOTHING, NOTHING, 1.0, shrink, None if shrink is None else (shrink - 0.1, shrink + 0.1))


class Figures:
    """Figures that state half for `wiggling` alone."""

    def shrink(self, names: Sequence[str]) -> Shrink:
        assert list(names) == ["wiggling"]
        return stated(0.5)


@pytest.mark.parametrize(("share", "promised"), [(0.01, 0.5), (0.99, 0.9)])
def test_pixels_that_wrap_here_and_there_are_promised_by_no_model(share: float, promised: float) -> None:
    wrap = Finding(PhaseWrap(share=share), 0.95, corrects=True)
    d = SimpleNamespace(
        findings=(wrap,), shares={"wiggling": [], "phase_wrap": []}, account=SimpleNamespace(figures=Figures()), gap=stated(0.9)
    )
    assert _promise(cast("Diagnosis", d)) == Promise(promised, promised - 0.1, promised + 0.1)


def test_without_a_gap_nothing_is_promised() -> None:
    d = SimpleNamespace(findings=(), shares={}, gap=stated(None))
    assert _promise(cast("Diagnosis", d)) is None
