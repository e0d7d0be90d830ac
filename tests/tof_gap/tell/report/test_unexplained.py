# SPDX-License-Identifier: Apache-2.0
"""Words on the gap that no named effect explains, and on what to do about it."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import pytest

from tof_gap.tell.image_place import SPOTS_WORDS
from tof_gap.tell.report.unexplained import unexplained_words, where_to_look
from tof_gap.tell.report.words import sentence
from tof_gap.tell.unexplained import Unexplained

if TYPE_CHECKING:
    from collections.abc import Sequence

LEFT = "neighbouring pixels still share an error of 0.32 mm RMS (means of blocks of pixels away from edges, all views)"


def gap_left(*where: str, by: Sequence[str] = (), **more: Any) -> dict[str, Any]:
    """The unexplained gap as gap.json has it."""
    return {"where": list(where), "depends_on": list(by), **more}


@pytest.mark.parametrize(
    ("where", "depends_on", "words"),
    [
        ((), (), f"With the named effects simulated, {LEFT}."),
        (("door", "sill"), (), f"With the named effects simulated, {LEFT}. It shows most on door and sill."),
        (
            ("door",),
            ("range_m", "edge_px"),
            f"With the named effects simulated, {LEFT}. It varies with range and distance to an edge; it shows most on door.",
        ),
    ],
)
def test_what_is_left_is_stated_as_far_as_it_is_known(where: tuple[str, ...], depends_on: tuple[str, ...], words: str) -> None:
    assert unexplained_words(Unexplained(0.324, structured=True, depends_on=depends_on, where=where)) == words


def test_what_is_left_in_one_part_of_the_image_is_placed_there() -> None:
    gap = Unexplained(0.324, structured=True, depends_on=(), where=("door",), in_image="the lower half of the image")
    assert unexplained_words(gap).endswith("It shows most on door; it lies in the lower half of the image.")


def test_what_is_left_beside_suspected_effects_is_stated_as_such() -> None:
    gap = Unexplained(0.324, structured=True, depends_on=(), where=("door",))
    assert unexplained_words(gap, "suspected") == f"With the suspected effects simulated, {LEFT}. It shows most on door."


def test_where_no_effect_is_simulated_what_is_left_is_the_error_itself() -> None:
    gap = Unexplained(0.324, structured=True, depends_on=(), where=("door",))
    assert unexplained_words(gap, "") == f"N{LEFT[1:].replace('still ', '')}. It shows most on door."


def test_an_error_that_block_means_do_not_show_is_not_stated_as_zero() -> None:
    words = unexplained_words(Unexplained(0.004, structured=True, depends_on=("viewed",), where=()))
    assert words.startswith("With the named effects simulated, neighbouring pixels share no error above the noise")
    assert words.endswith("other signs show one. It varies with distance and brightness of the view.")


def test_pixels_that_no_bias_explains_are_stated_by_their_share() -> None:
    """Blocks of pixels leave them out, so that an error of some tenths of a millimetre would explain nothing."""
    gross = "1.3 % of the pixels away from edges are off by centimetres: that is no bias, but another surface, a mirror or a wrapped phase."
    gap = Unexplained(0.324, structured=True, depends_on=(), where=("door",), gross=0.013)
    assert unexplained_words(gap).endswith(f"{LEFT}. It shows most on door. {gross}")
    report = {
        "verdict": ["unknown"],
        "causes": [],
        "gap": {"shrink": None},
        "unexplained": {"depends_on": [], "where": ["door"], "gross": 0.013},
    }
    assert (
        sentence(report)
        == f"Camera and simulation differ, and no effect known here explains the difference. It shows most on door. {gross}"
    )


def test_an_effect_that_is_contradicted_is_stated_with_what_contradicts_it() -> None:
    like = (
        "Lens scatter was fitted and rejected: simulated, it would leave much of the error on the pixels that it changes, or it would need "
        "another size in each view. Another cause acts there, or this one in a form that no formula here describes."
    )
    assert unexplained_words(Unexplained(0.324, structured=True, depends_on=(), where=(), resembles=("lens_scatter",))).endswith(f" {like}")
    shown = {"depends_on": [], "where": ["door"], "resembles": ["lens_scatter"]}
    report = {"verdict": ["unknown"], "causes": [], "gap": {"shrink": None}, "unexplained": shown}
    assert (
        sentence(report) == f"Camera and simulation differ, and no effect known here explains the difference. It shows most on door. {like}"
    )


def test_what_keeps_its_place_in_the_image_is_looked_for_on_window_and_lens() -> None:
    drops = Unexplained(0.5, structured=True, depends_on=(), where=("floor",), in_image=SPOTS_WORDS)
    assert "It shows most on floor; it lies at the same places of the image in all views, a fifth of it." in unexplained_words(drops)
    first, then = where_to_look(asdict(drops)).split(". ", 1)
    assert first.startswith("Check the camera's window and lens for drops")
    assert then.startswith("If there are none, look at floor")


def test_what_is_left_is_looked_for_on_its_parts() -> None:
    assert where_to_look(gap_left("door", "sill")) == (
        "Look at door and sill, where most of the error lies: check whether they are as drawn and in place, and whether they are glossy, wet or "
        "transparent. If nothing is to be seen there, the cause is the camera's or the light's."
    )
    assert where_to_look(gap_left("rear"), ("multipath",)).endswith("the cause is the camera's or the light's (suspected: multipath).")
    assert where_to_look(gap_left()).startswith("Look at the maps of the report: ")
    assert where_to_look(gap_left("door", by=("attitude",))).startswith("Check the camera's mount")


def test_what_varies_as_the_camera_s_own_errors_do_is_looked_for_in_the_camera_first() -> None:
    first, then = where_to_look(gap_left("floor", by=("stray_light",))).split(". ", 1)
    assert first.startswith("Check the camera's window and the air before it")
    assert then.startswith("If it is in order, look at floor")
    assert where_to_look(gap_left("door", by=("region",))).startswith(
        "Check for glass, film or liquid before the parts: light into one region of the cell is late by one amount. If there is none, look at door,"
    )
    assert where_to_look(gap_left(by=("viewed", "arm"))).index("supply and driver") < where_to_look(gap_left(by=("viewed", "arm"))).index(
        "the arm's encoders"
    )


def test_poses_may_follow_the_camera_where_they_err_from_view_to_view() -> None:
    line = where_to_look(gap_left("table", by=["arm"]), ["lens scatter"])
    assert line.startswith("Check the arm's encoders, the base and TF")
    assert line.endswith("followed an error of the camera or of the light that differs from view to view (suspected: lens scatter).")


@pytest.mark.parametrize(("depends_on", "words"), [(("hand",), "It shows most on door. Camera poses"), (("hand", "range_m"), "It varies with range; it shows most on door. Camera poses")])  # fmt: skip
def test_poses_that_follow_an_error_are_stated_beside_what_it_varies_with(depends_on: tuple[str, ...], words: str) -> None:
    gap = Unexplained(0.324, structured=True, depends_on=depends_on, where=("door",))
    clue = unexplained_words(gap).split("all views). ", 1)[1]
    assert clue.startswith(f"{words} differ from the robot's along the view, or alike in all views")
    assert clue.endswith("or the camera sits otherwise on the hand than stated.")
