# SPDX-License-Identifier: Apache-2.0
"""What an inspector takes from a session: its poses, its colours, and where parts stand in a reference session."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.tof_inspect.made import SURE, plate, seen
from tof_core.errors import RefusedError
from tof_inspect import judge as room
from tof_inspect.config import InspectConfig
from tof_inspect.evidence import Evidence
from tof_inspect.judge import Inspector
from tof_inspect.reference import Standing
from tof_scene.raycast import Raycaster

VIEW = seen(plate())


def inspector(*, first: tuple[Any, ...] = (), colour: bool = True) -> Inspector:
    config = InspectConfig()
    return Inspector(Raycaster(plate()), replace(config, colour=replace(config.colour, enabled=colour)), first=first)


@pytest.mark.parametrize(
    ("colour", "first", "now", "pairs", "note"),
    [
        (False, 1, 2, 5, "depth alone: colour is switched off"),
        (True, 0, 2, 5, "depth alone: no reference image in colour is given"),
        (True, 1, 0, 5, "depth alone: no view has a colour image with its calibration and TF"),
        (True, 1, 2, 0, "depth alone: reference images and current images overlap too little"),
        (True, 1, 2, 5, "depth and colour (pairs of a current image with a reference image: 5)"),
    ],
)
def test_colour_is_used_where_there_is_some(
    monkeypatch: pytest.MonkeyPatch, *, colour: bool, first: int, now: int, pairs: int, note: str
) -> None:
    pictures = iter(["picture"] * now + [None] * (3 - now))
    monkeypatch.setattr(room, "Picture", SimpleNamespace(of=lambda *_: next(pictures)))
    monkeypatch.setattr(room, "Colours", lambda _caster, _first, given, _config: SimpleNamespace(pairs=pairs, given=given))
    views: Any = [SimpleNamespace(view=VIEW, posed=SURE)] * 3
    made, told = inspector(first=("first",) * first, colour=colour)._colours(views)
    assert told == note
    assert (made is not None) is note.startswith("depth and colour")
    if made is not None:
        assert made.given == ["picture", "picture"]  # type: ignore[attr-defined]


class Lens:
    """Stands for a lens that a session shows: views through it are marked."""

    def over(self, view: Any) -> str:
        return f"{view} through the lens"


@pytest.mark.parametrize("lens", [None, Lens()])
@pytest.mark.parametrize("bias", [None, "bias"])
def test_poses_are_solved_from_views_less_what_is_known_and_seen_through_their_lens(
    monkeypatch: pytest.MonkeyPatch, lens: Any, bias: Any
) -> None:
    solved: list[Any] = []

    def solve(views: Any, *_: object) -> Any:
        solved.extend(views)
        return SimpleNamespace(lens=lens)

    monkeypatch.setattr(room, "known_removed", lambda views, *_: [f"{v} less the bias" for v in views])
    monkeypatch.setattr(room, "solve_session", solve)
    views: Any = ["a", "b"]
    clean, _ = Inspector(Raycaster(plate()), bias=bias)._solved(views, lambda _: None)
    expected = ["a less the bias", "b less the bias"] if bias else ["a", "b"]
    assert solved == expected
    seen_through: Any = list(clean)
    assert seen_through == ([f"{v} through the lens" for v in expected] if lens else expected)


def test_without_views_nothing_is_judged() -> None:
    with pytest.raises(RefusedError, match="no view to judge"):
        inspector().judge([])


def evidence(pixels: int) -> Evidence:
    none = np.zeros(0)
    return Evidence(pixels, 50, 1.0, none.astype(int), none, none, none, none)


def test_a_reference_session_knows_the_parts_that_it_sees_well_and_from_where(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pixels in two views: 30 in all are enough; a view with ten of them is useful; where none is, all views are fitted."""
    own = inspector()
    pixels = {"clip": (0, 30), "block": (10, 20), "shim": (9, 20), "speck": (10, 19), "behind": (0, 0), "buried": (100, 100)}
    other = replace(SURE, cov=SURE.cov)
    poses = [SURE, other]
    views: Any = [SimpleNamespace(number=k, posed=posed) for k, posed in enumerate(poses)]
    monkeypatch.setattr(own, "_solved", lambda *_: ([VIEW, VIEW], SimpleNamespace(posed=poses)))
    monkeypatch.setattr(own, "_seen", lambda *_: views)
    monkeypatch.setattr(room, "Left", SimpleNamespace(of=lambda _: "left"))
    monkeypatch.setattr(room, "SessionErrors", SimpleNamespace(of=lambda *args: args))
    monkeypatch.setattr(room, "weigh", lambda s, _without, part, *_: evidence(pixels[own.scene.parts[part].name][s.number]))
    monkeypatch.setattr(room, "fit_part", lambda part, given, *_: (part.name, [s.number for s in given]))
    parts = own.learn([VIEW, VIEW]).parts
    fits: Any = {name: standing.fit for name, standing in parts.items()}
    assert fits == {"clip": ("clip", [1]), "block": ("block", [0, 1]), "buried": ("buried", [0, 1])}
    assert all(isinstance(standing, Standing) for standing in parts.values())
    np.testing.assert_array_equal(parts["block"].cameras, [SURE.T_cell_camera[:3, 3]] * 2)


@pytest.mark.parametrize(("standing", "relative"), [(None, False), ("reference", True)])
def test_displacements_are_relative_to_a_reference_session_where_there_is_one(
    monkeypatch: pytest.MonkeyPatch, standing: Any, *, relative: bool
) -> None:
    """The fit is passed on to the decision as it is, or as the reference session makes it; too few pixels come to no fit."""
    own = inspector()
    if standing:
        own.standing = SimpleNamespace(relative=lambda name, fit, cameras, _: (name, fit, len(cameras)))  # type: ignore[assignment]
    monkeypatch.setattr(room, "weigh", lambda s, *_: evidence(s.pixels))
    monkeypatch.setattr(room, "fit_part", lambda *_: "fit")
    monkeypatch.setattr(room, "place_of", lambda _part, fit, *_: fit)
    monkeypatch.setattr(room, "decide", lambda _part, _evidence, ratio, colour, fit, *_: (ratio, colour, fit))
    views: Any = [SimpleNamespace(pixels=p, posed=SURE) for p in (9, 21)]
    part = own.scene.part("block")
    found: Any = own._part(part, views, None, None)  # type: ignore[arg-type]
    assert found == (2.0, 0.0, ("block", "fit", 1) if relative else "fit")
    colours: Any = SimpleNamespace(log_ratio=lambda *_: 7.0)
    assert own._part(part, views, colours, None)[1] == 7.0  # type: ignore[arg-type, index]
    few = own._part(part, views[1:], None, None)  # type: ignore[arg-type]
    assert few.state == "not_observable"
    assert few.why == "only 21 of its 50 pixels are valid and distinctive (at least 30)"
    assert (few.judged, few.todo) == (False, "add a view that shows it, closer or from another side")
