# SPDX-License-Identifier: Apache-2.0
"""The page of a proposal: its words, its target, and what it predicts."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from arm_correction.corrector import Corrector
from arm_correction.frames import Frames
from arm_correction.report import known, seen_from, sentence, sigma, todo, write
from tests.arm_correction.made import CAMERA, CONFIG, FIRST, reference, seen
from tests.tof_align.made import section
from tof_core import se3

if TYPE_CHECKING:
    from pathlib import Path

    from arm_correction.correction import Correction
    from tof_core.capture import View

MOTION = se3.exp([0.02, -0.01, 0.015, 0.01, 0.02, -0.01])


def proposed() -> tuple[dict[str, Correction], View]:
    made = section()
    view = seen(made, FIRST @ MOTION, believed=FIRST)
    return Corrector(CONFIG, reference=reference(made)).propose([view]), view


def test_points_seen_from_the_reference_are_where_the_reference_sees_them() -> None:
    made = section()
    view = seen(made, FIRST @ MOTION, noise_mm=0.0)
    wanted = seen(made, FIRST, noise_mm=0.0).depth
    predicted = seen_from(view, CAMERA, MOTION)
    both = np.isfinite(predicted) & np.isfinite(wanted)
    assert both.mean() > 0.5
    assert np.median(np.abs(predicted - wanted)[both]) < 2e-3
    assert np.nanmedian(np.abs(view.depth - wanted)[both]) > 8e-3


def test_the_page_names_the_move_and_the_target(tmp_path: Path) -> None:
    made, view = proposed()
    page = write(made, view, Frames(), tmp_path, "today", reference=reference(section()))
    text, content = page.read_text(), json.loads((tmp_path / "correction.json").read_text())
    mm, deg = made["reference"].step
    assert f"Move the hand by {mm:.1f} mm and {deg:.2f}°" in text
    assert f"{content['reference']['target']['xyz'][0]:.4f}" in text
    assert "after the proposed move" in text
    assert abs(mm - 1e3 * np.linalg.norm(MOTION[:3, 3])) < 1.0, made["reference"].reason


def test_a_refusal_says_why_and_moves_nothing(tmp_path: Path) -> None:
    made, view = proposed()
    refused = replace(made["reference"], accepted=False, delta=np.eye(4), reason="step limit: 900 mm and 0.1 deg")
    assert sentence(refused) == "No move is proposed. Step limit: 900 mm and 0.1 deg."
    assert todo(refused)[0] == "Leave the hand where it is."
    text = write({"reference": refused}, view, Frames(), tmp_path, "today", reference=reference(section())).read_text()
    assert "Command the hand" not in text


def test_an_undetermined_direction_is_named() -> None:
    made, _ = proposed()
    partial = replace(made["reference"], unknown=("along the pipe",))
    assert "1 direction that the surfaces do not determine" in sentence(partial)
    assert any("along the pipe" in line for line in todo(partial))


def test_sigma_is_the_length_of_the_axes() -> None:
    made, _ = proposed()
    c = replace(made["reference"], cov=np.diag([1e-6, 4e-6, 4e-6, 0, 0, np.radians(0.5) ** 2]))
    np.testing.assert_allclose(sigma(c), (3.0, 0.5))


def test_what_is_not_determined_is_called_unknown_and_a_refusal_has_no_move(tmp_path: Path) -> None:
    made, view = proposed()
    mm, deg = known(made["reference"])
    assert (mm, deg) == (f"± {sigma(made['reference'])[0]:.1f} mm", f"± {sigma(made['reference'])[1]:.2f}°")
    open_ = replace(made["reference"], cov=made["reference"].cov + np.diag([1.0, 0, 0, 0, 0, 0]))
    assert known(open_) == ("partly unknown", deg)
    refused = replace(made["reference"], accepted=False, delta=np.eye(4), reason="step limit: 900 mm and 0.1 deg")
    text = write({"reference": refused}, view, Frames(), tmp_path, "today", reference=reference(section())).read_text()
    assert "no move" in text
    assert "proposed translation" not in text
    assert "last picture" not in text
