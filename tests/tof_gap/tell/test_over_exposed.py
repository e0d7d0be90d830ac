# SPDX-License-Identifier: Apache-2.0
"""Pixels without depth since too much light returns to them."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.tof_gap.quiet_views import SHAPE, views
from tof_core.reasons import Reason
from tof_gap.limits.missing import MissingLimits
from tof_gap.tell.over_exposed import over_exposed, saturated

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_gap.seen.evidence.view import ViewEvidence

ROWS = SHAPE[0] // 4
"""Rows at the upper edge of the image without depth: a quarter of all."""


def without_depth(amplitude: float, reason: Reason = Reason.NO_RETURN) -> list[ViewEvidence]:
    """Views whose upper rows have no depth; amplitude: that of these rows, where the largest measured one is 1."""
    seen = []
    for v in views(np.random.default_rng(3)):
        assert v.view.amplitude is not None
        bright: Float = v.view.amplitude / v.view.amplitude.max()
        code, valid = v.view.reason.copy(), v.view.valid.copy()
        bright[:ROWS], code[:ROWS], valid[:ROWS] = amplitude, reason, False
        depth = np.where(valid, v.view.depth, np.float32(np.nan))
        view = replace(v.view, amplitude=bright.astype(np.float32), reason=code, depth=depth)
        seen.append(replace(v, view=view, frame=replace(v.frame, amplitude=bright)))
    return seen


def advice(seen: list[ViewEvidence], least: float = 0.05) -> str:
    return over_exposed(seen, ["panel"], MissingLimits(), least)


def test_over_exposed_pixels_ask_for_less_light_and_name_their_part() -> None:
    line = advice(without_depth(1.0))
    assert line.startswith("the same with a shorter exposure or from farther away, since 24 % of the pixels")
    assert line.endswith("most of them on panel")


@pytest.mark.parametrize(("amplitude", "reason", "stated"), [(0.1, Reason.NO_RETURN, False), (0.1, Reason.SATURATED, True)])
def test_dark_pixels_without_depth_are_over_exposed_only_by_the_camera_s_code(amplitude: float, reason: Reason, *, stated: bool) -> None:
    assert bool(advice(without_depth(amplitude, reason))) is stated


def test_few_over_exposed_pixels_need_no_other_captures() -> None:
    assert advice(without_depth(1.0), least=0.3) == ""


def test_without_an_amplitude_image_the_code_decides() -> None:
    (view, *_) = without_depth(1.0, Reason.SATURATED)
    blind = replace(view, view=replace(view.view, amplitude=None))
    assert saturated(blind, np.inf).sum() == ROWS * SHAPE[1]
