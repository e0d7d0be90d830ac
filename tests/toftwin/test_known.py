# SPDX-License-Identifier: Apache-2.0
"""What is known of the sensor comes off: what is left is what a camera without it would have measured, from the same poses."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
import pytest

from arm_correction.corrector import Corrector
from tests.tof_align.made import CONFIG, ROBOT, one_view, panel, pose_error, section, session, wiggling
from tof_align import known as room
from tof_align.causal import SessionAligner
from tof_align.known import known_removed, known_removed_alone
from tof_align.session import solve_session
from tof_core import se3
from tof_core.errors import RefusedError
from tof_inspect.judge import Inspector
from tof_scene.raycast import Raycaster
from tof_scene.render import render
from tof_sensor.effects.depth_scale import DepthScale
from tof_sensor.effects.multipath import Multipath
from tof_sensor.effects.range_offset import RangeOffset
from tof_sensor.effects.wiggling import Wiggling
from tof_sensor.frame import LIGHT_M_PER_S
from tof_sensor.known import KnownBias, ideal_frames
from tof_sensor.model import SensorModel, save_model
from tof_sim_label.labeller import LabellerConfig, label_session
from toftwin.known import bias_in

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from tests.tof_align.made import Seen, Truth
    from tof_core.arrays import Float
    from tof_core.capture import View

AMPLITUDE = 3e-3 * np.sqrt(2.0)
WIGGLING = Wiggling(
    sine_m=float(AMPLITUDE * np.cos(0.7)), cosine_m=float(AMPLITUDE * np.sin(0.7)), modulation_mhz=LIGHT_M_PER_S / (8e6 * 0.375)
)
"""What `wiggling` adds along the ray."""


def wiggle(seen: Seen) -> Float:
    return wiggling(seen) * seen.depth / seen.range_m


def offset(seen: Seen) -> Float:
    return 0.05 * seen.depth / seen.range_m


def stretch(seen: Seen) -> Float:
    return 0.05 * seen.depth


KNOWN: dict[str, tuple[SensorModel, Callable[[Seen], Float]]] = {
    "wiggling": (SensorModel((WIGGLING,)), wiggle),
    "offset of 50 mm": (SensorModel((RangeOffset(offset_m=0.05),)), offset),
    "scale of 5 %": (SensorModel((DepthScale(scale=0.05),)), stretch),
    "offset and wiggling": (SensorModel((RangeOffset(offset_m=0.05), WIGGLING)), lambda seen: offset(seen) + wiggle(seen)),
}


def left_mm(less: Sequence[View], clean: Sequence[View]) -> Float:
    """(n,) mm by which views differ, where both have depth."""
    off = 1e3 * np.concatenate([(a.depth - b.depth).ravel() for a, b in zip(less, clean, strict=True)])
    return np.asarray(off[np.isfinite(off)])


@lru_cache(maxsize=1)
def clean() -> tuple[list[View], Float]:
    """The session of a camera without any bias, and what its poses err by."""
    views, truth = session(section(), views=4)
    return views, camera_errors(views, truth)


def camera_errors(views: Sequence[View], truth: Sequence[Truth]) -> Float:
    """(V, 2) mm and degrees of the poses that the views are solved to."""
    posed = solve_session(views, section(), CONFIG).posed
    return np.array([pose_error(p.T_cell_camera, t) for p, t in zip(posed, truth, strict=True)])


@pytest.mark.parametrize("name", KNOWN)
def test_removing_an_effect_gives_the_depth_of_a_camera_without_it(name: str) -> None:
    model, effect = KNOWN[name]
    views, truth = session(section(), views=4, effect=effect)
    less = known_removed(views, section(), KnownBias(model), CONFIG)
    without, errors = clean()
    off = left_mm(less, without)
    assert np.quantile(np.abs(off), 0.98) < 0.2  # edges apart, where the neighbouring pixel's range may have been bent instead
    assert abs(np.median(off)) < 0.01
    np.testing.assert_allclose(camera_errors(less, truth), errors, atol=0.05)


def test_a_known_bias_that_poses_could_absorb_comes_off_whole() -> None:
    """Two views of a panel from about one distance: a stretch is seen there as a base that stands off."""
    views, _ = session(panel(), views=2, stations=1, effect=stretch)
    without, _ = session(panel(), views=2, stations=1)
    less = known_removed(views, panel(), KnownBias(SensorModel((DepthScale(scale=0.05),))), CONFIG)
    assert np.abs(left_mm(less, without)).max() < 0.1


def test_from_one_view_it_comes_off_at_the_pose_without_it() -> None:
    model, effect = KNOWN["offset and wiggling"]
    (view, _), (without, truth) = (one_view(section(), np.zeros(6), effect=e) for e in (effect, None))
    cov = np.diag(ROBOT**2)
    less = known_removed_alone(view, section(), KnownBias(model), truth.T_cell_camera, cov, CONFIG)
    off = left_mm([less], [without])
    assert np.quantile(np.abs(off), 0.95) < 0.3
    assert abs(np.median(off)) < 0.05


def test_views_as_they_come_are_posed_without_it() -> None:
    model, effect = KNOWN["offset of 50 mm"]
    views, truth = session(section(), views=6, effect=effect)
    told, plain = SessionAligner(section(), CONFIG, bias=KnownBias(model)), SessionAligner(section(), CONFIG)
    errors = np.array([[pose_error(a.push(v).T_cell_camera, t)[0] for a in (told, plain)] for v, t in zip(views, truth, strict=True)])
    assert np.median(errors[:, 0]) < 1.0
    assert np.median(errors[:, 1]) > 10.0
    assert max(pose_error(p.T_cell_camera, t)[0] for p, t in zip(told.finish().posed, truth, strict=True)) < 0.8


def test_time_counts_from_the_sessions_first_view() -> None:
    views, truth = session(section(), views=2)
    caster, seen = section(), [render(section(), v.camera, t.T_cell_camera) for v, t in zip(views, truth, strict=True)]
    together = [f.context.time_s for f in ideal_frames(views, seen, caster)]
    assert together == [0.0, 1.0]
    assert ideal_frames(views[1:], seen[1:], caster, views[0].stamp_ns)[0].context.time_s == 1.0


def test_labels_parts_and_corrections_take_it() -> None:
    model, effect = KNOWN["offset of 50 mm"]
    views, truth = session(section(), views=4, effect=effect)
    bias = KnownBias(model)
    solution, labels = label_session(views, section(), LabellerConfig(CONFIG), bias)
    assert max(pose_error(p.T_cell_camera, t)[0] for p, t in zip(solution.posed, truth, strict=True)) < 1.0
    for (_, label), true in zip(labels, truth, strict=True):
        assert np.nanmedian(np.abs(label.depth - true.depth)) < 1e-3
    inspected = Raycaster(replace(section().scene, parts=tuple(replace(p, inspect=True) for p in section().scene.parts)))
    verdicts = Inspector(inspected, align=CONFIG, bias=bias).judge(views).verdicts
    assert {v.name: v.state for v in verdicts}["block"] == "present"
    assert views[0].robot is not None
    wanted = se3.inverse(truth[0].T_cell_camera) @ views[0].robot.T_cell_camera
    told, plain = (Corrector(align=CONFIG, caster=section(), bias=b).propose([views[0]])["cad"] for b in (bias, None))
    assert told.accepted
    assert 1e3 * se3.distance(told.delta, wanted)[0] < 2.0
    assert 1e3 * se3.distance(plain.delta, wanted)[0] > 10.0


def test_an_empty_model_changes_nothing() -> None:
    views, _ = session(section(), views=2)
    assert not left_mm(known_removed(views, section(), KnownBias(SensorModel()), CONFIG), views).any()


def test_a_model_of_another_scene_states_what_is_not_removed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene = section().scene
    path = tmp_path / "sensor.yaml"
    save_model(SensorModel((Multipath(strength=0.6), RangeOffset(offset_m=0.01)), scene="another"), path)
    assert bias_in(scene, path) is not None
    assert capsys.readouterr().err == "sensor.yaml is of another scene: effects of its parts are not removed here (multipath)\n"
    save_model(SensorModel((Multipath(strength=0.6),), scene=scene.digest), path)
    assert bias_in(scene, path) is not None
    assert capsys.readouterr().err == ""


def test_effects_of_the_parts_of_another_scene_are_not_removed() -> None:
    """The light between parts is removed in its own scene, and in no other."""
    views, _ = session(section(), views=2)
    here, elsewhere = (KnownBias(SensorModel((Multipath(strength=0.6),), scene=s)) for s in (section().scene.digest, "another"))
    assert np.abs(left_mm(known_removed(views, section(), here, CONFIG), views)).max() > 1.0
    assert not left_mm(known_removed(views, section(), elsewhere, CONFIG), views).any()


def test_where_the_session_fits_nowhere_the_first_poses_serve(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever solves the session next refuses it, or takes what stands before the parts apart."""

    def refuse(*_: object) -> None:
        raise RefusedError("a pole stands before it", where="alignment", todo="look")

    monkeypatch.setattr(room, "solve_session", refuse)
    model, effect = KNOWN["offset of 50 mm"]
    views, _ = session(section(), views=4, effect=effect)
    off = left_mm(known_removed(views, section(), KnownBias(model), CONFIG), clean()[0])
    assert np.quantile(np.abs(off), 0.9) < 0.5
    assert abs(np.median(off)) < 0.1
