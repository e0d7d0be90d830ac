# SPDX-License-Identifier: Apache-2.0
"""The promise of a fitted sensor: the shrink that its model predicts for another session."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, cast

import pytest

from tests.tof_gap.quiet_views import CAMERA
from tof_gap.seen.finding import Finding
from tof_gap.tell.figures.shrink import Errors, Shrink
from tof_gap.tell.report.files import _promise, sensor_model
from tof_sensor.effects.dropout import Dropout
from tof_sensor.effects.phase_wrap import PhaseWrap
from tof_sensor.effects.wiggling import Wiggling
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


def diagnosed(finding: Finding, *, doubted: bool = False) -> Diagnosis:
    """A wiggle of the solution beside a finding."""
    d = SimpleNamespace(
        causes=(SimpleNamespace(named=SimpleNamespace(name="wiggling", effects=(Wiggling(),))),),
        findings=(finding,),
        shares={"wiggling": [], "phase_wrap": []},
        account=SimpleNamespace(figures=Figures()),
        gap=stated(0.9),
        doubted=doubted,
        law=None,
        evidence=(),
        camera=CAMERA,
        solved=SimpleNamespace(caster=SimpleNamespace(scene=SimpleNamespace(digest="3f"))),
    )
    return cast("Diagnosis", d)


@pytest.mark.parametrize(("share", "promised"), [(0.01, 0.5), (0.99, 0.9)])
def test_pixels_that_wrap_here_and_there_are_promised_by_no_model(share: float, promised: float) -> None:
    wrap = Finding(PhaseWrap(share=share), 0.95, corrects=True)
    assert _promise(diagnosed(wrap)) == Promise(promised, promised - 0.1, promised + 0.1)


def test_without_a_gap_nothing_is_promised() -> None:
    d = SimpleNamespace(findings=(), shares={}, gap=stated(None), causes=(), doubted=False)
    assert _promise(cast("Diagnosis", d)) is None


@pytest.mark.parametrize(("doubted", "held"), [(False, ["wiggling", "dropout"]), (True, ["dropout"])])
def test_the_fitted_sensor_holds_what_is_asserted(held: list[str], *, doubted: bool) -> None:
    d = diagnosed(Finding(Dropout(threshold=0.1), 0.6), doubted=doubted)
    model = sensor_model(d)
    assert [e.NAME for e in model.effects] == held
    assert model.scene == "3f"
