# SPDX-License-Identifier: Apache-2.0
"""An effect is contradicted where its map, on the pixels on which it acts, leaves most of what neighbours share."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.tof_gap.quiet_views import SHAPE, VIEWS, views
from tof_core import se3
from tof_core.calibration import Calibration, HandEyeLimits
from tof_gap.config import GapConfig
from tof_gap.limits.report import UnexplainedLimits
from tof_gap.tell import contradicted as room
from tof_gap.tell.contradicted import TakenOut, contradicted, shares_left, taken_out
from tof_sensor.effects.interference import Interference

NOISE_M = 0.002
HELD = (1, 4, 7, 10)
LIMIT = UnexplainedLimits()


def ramp(size_m: float, axis: int) -> np.ndarray:
    """(H, W) metres from -`size_m` to `size_m` down (0) or across (1) the left half of the image, 0 on the right one."""
    row, column = (np.linspace(-1.0, 1.0, n) for n in SHAPE)
    whole = np.broadcast_to(row[:, None] if axis == 0 else column[None, :], SHAPE) * size_m
    return np.where(np.arange(SHAPE[1])[None, :] < SHAPE[1] // 2, whole, 0.0)


def account(left: np.ndarray, alike_m: float = 0.0, **maps: np.ndarray) -> Any:
    """What is read of an account whose effects leave `left` (H, W) metres beside white noise of 2 mm in every view.

    alike_m: metres of named error that neighbours share.
    """
    rng, seen = np.random.default_rng(3), views(np.random.default_rng(1))
    errors = [left + rng.normal(0, NOISE_M, SHAPE) for _ in range(VIEWS)]
    figures = SimpleNamespace(
        maps={name: [m] * VIEWS for name, m in maps.items()},
        left=lambda held: [errors[v] for v in held],
        floors=[np.full(SHAPE, NOISE_M**2)] * VIEWS,
        edge=[v.edge for v in seen],
        unsure2=np.zeros(SHAPE),
        alike_m=alike_m,
    )
    named = [SimpleNamespace(name=name, suspected=False, confidence=1.0) for name in maps]
    arms_sd = np.full((VIEWS, 6), 1e-6)
    solved = SimpleNamespace(
        evidence=seen,
        bare=seen,
        maps=figures.maps,
        named=named,
        names=lambda name: name in maps,
        hand_eye=np.eye(4),
        split=SimpleNamespace(held_out=HELD),
        arms_sd=arms_sd,
    )
    return SimpleNamespace(solved=solved, figures=figures, findings=(), causes=(), follows=False, sags=False, astray=False)


def test_a_map_that_takes_all_of_the_error_leaves_no_share() -> None:
    assert shares_left(account(np.zeros(SHAPE), wiggling=ramp(0.004, 0)), LIMIT)["wiggling"] < 0.01


@pytest.mark.parametrize(("left_m", "share"), [(0.002, 0.2), (0.004, 0.5)])
def test_the_share_is_that_of_the_squares_that_are_left_where_the_map_acts(left_m: float, share: float) -> None:
    """A map of 4 mm on the left, and stripes that it leaves: their squares add. On the right, where the map is 0, nothing counts."""
    column = np.arange(SHAPE[1])
    acts = column < 48  # three pairs of stripes, each as wide as a block
    stripes = np.where(acts, np.where(column // 8 % 2, left_m, -left_m), 0.05)
    found = account(np.broadcast_to(stripes, SHAPE), wiggling=np.broadcast_to(np.where(acts, 0.004, 0.0), SHAPE))
    assert shares_left(found, LIMIT)["wiggling"] == pytest.approx(share, abs=0.03)


def test_a_small_thing_fills_no_large_block_and_leaves_its_share_of_finer_ones() -> None:
    """Stripes of 4 pixels are half of the error where the map acts: blocks of 8 pixels take their mean, which is 0."""
    column = np.arange(SHAPE[1])
    acts = column < 48
    stripes = np.where(acts, np.where(column // 4 % 2, 0.004, -0.004), 0.0)
    found = account(np.broadcast_to(stripes, SHAPE), wiggling=np.broadcast_to(np.where(acts, 0.004, 0.0), SHAPE))
    assert shares_left(found, LIMIT)["wiggling"] == pytest.approx(0.5, abs=0.05)
    assert shares_left(found, replace(LIMIT, contradicted_px=16))["wiggling"] < 0.01


def test_the_effect_that_leaves_most_is_contradicted() -> None:
    half = ramp(0.006, 0)
    assert contradicted(account(half, lens_scatter=0.5 * half, wiggling=np.zeros(SHAPE)), LIMIT) == "lens_scatter"
    assert contradicted(account(0.1 * half, lens_scatter=0.9 * half), LIMIT) is None


def test_what_is_left_beside_a_larger_effect_may_be_the_error_of_its_map() -> None:
    """Half of the scattering is left, a tenth of the gap's squares, since a wave ten times as large stands beside it."""
    half = ramp(0.006, 0)
    assert contradicted(account(half, lens_scatter=0.5 * half, wiggling=3.0 * half), LIMIT) is None


def test_pixels_that_still_jump_by_half_a_metre_contradict_no_bias() -> None:
    """`phase_wrap` gives one length; where the camera errs by another one, half a metre is left, beside which a wave is nothing."""
    jumps = np.zeros(SHAPE)
    jumps[::4, ::4] = 0.5
    found = account(jumps, wiggling=ramp(0.004, 0))
    assert contradicted(found, LIMIT) == "wiggling"
    found.solved.evidence = [replace(v, gross=jumps > 0) for v in found.solved.evidence]
    assert contradicted(found, LIMIT) is None


def test_what_noise_may_leave_contradicts_nothing() -> None:
    """0.15 mm of an effect, of which nothing is taken: block means of 64 pixels with 2 mm of noise are known to 0.25 mm."""
    assert contradicted(account(ramp(0.00015, 0), wiggling=ramp(0.00015, 0)), LIMIT) is None


def test_what_named_noise_of_rows_may_leave_in_blocks_contradicts_nothing() -> None:
    """Two thirds of the scattering are left, 3.5 mm RMS: they contradict the map, but not where noise of rows makes errors of 4 mm."""
    half = ramp(0.006, 0)
    assert contradicted(account(half, lens_scatter=0.5 * half), LIMIT) == "lens_scatter"
    assert contradicted(account(half, alike_m=0.004, lens_scatter=0.5 * half), LIMIT) is None


def test_motion_is_not_judged_where_it_hardly_acts() -> None:
    """It errs at edges, which are left out here."""
    assert contradicted(account(ramp(0.006, 0), motion=ramp(0.003, 0)), LIMIT) is None


def test_an_unfounded_cause_is_taken_out_before_a_contradicted_one(monkeypatch: pytest.MonkeyPatch) -> None:
    found = account(ramp(0.006, 0), lens_scatter=ramp(0.003, 0))
    monkeypatch.setattr(room, "unfounded", lambda *_: "temperature_drift")
    assert taken_out(found, GapConfig()) == TakenOut("temperature_drift", contradicted=False)
    monkeypatch.setattr(room, "unfounded", lambda *_: None)
    assert taken_out(found, GapConfig()) == TakenOut("lens_scatter", contradicted=True)
    assert taken_out(account(np.zeros(SHAPE), lens_scatter=ramp(0.003, 0)), GapConfig()) is None


def test_an_uneven_cause_is_contradicted_unless_foreign_light_is_there(monkeypatch: pytest.MonkeyPatch) -> None:
    found = account(np.zeros(SHAPE), lens_scatter=ramp(0.003, 0))
    monkeypatch.setattr(room, "unfounded", lambda *_: None)
    monkeypatch.setattr(room, "contradicted", lambda *_: None)
    monkeypatch.setattr(room, "uneven", lambda *_: "lens_scatter")
    assert taken_out(found, GapConfig()) == TakenOut("lens_scatter", contradicted=True)
    found.findings = (SimpleNamespace(effect=Interference(burst_m=0.002)),)
    assert taken_out(found, GapConfig()) == TakenOut("lens_scatter", contradicted=False)


def test_a_cause_whose_means_over_the_views_the_steps_follow_is_contradicted(monkeypatch: pytest.MonkeyPatch) -> None:
    """A scale that grows from view to view, and steps of the camera that grow with it: between views it has another size than within."""
    found = account(np.zeros(SHAPE), depth_scale=ramp(0.003, 0), wiggling=ramp(0.003, 1))
    found.solved.maps = {"depth_scale": [np.full(SHAPE, 1e-3 * k) for k in range(VIEWS)], "wiggling": found.solved.maps["wiggling"]}
    found.solved.arms_sd, found.solved.chain = np.ones((VIEWS, 6)), SimpleNamespace(station=np.zeros(VIEWS, int))
    found.solved.arms = np.random.default_rng(4).normal(0, 0.1, (VIEWS, 6)) + np.arange(VIEWS)[:, None]
    for test in ("unfounded", "contradicted", "uneven"):
        monkeypatch.setattr(room, test, lambda *_: None)
    assert taken_out(found, GapConfig()) is None, "the steps do not follow what the views contain"
    found.follows = True
    assert taken_out(found, GapConfig()) == TakenOut("depth_scale", contradicted=True)
    found.findings = (SimpleNamespace(effect=Interference(burst_m=0.002)),)
    assert taken_out(found, GapConfig()) is None, "beside another camera's light, steps are its own"


def test_hand_eye_is_no_constant_where_the_mount_gives_way(monkeypatch: pytest.MonkeyPatch) -> None:
    found = account(np.zeros(SHAPE), wiggling=ramp(0.003, 0))
    monkeypatch.setattr(room, "unfounded", lambda *_: None)
    found.sags = True
    found.solved.names = lambda _: False
    assert taken_out(found, GapConfig()) is None
    found.solved.names = lambda name: name == "hand_eye"
    assert taken_out(found, GapConfig()) == TakenOut("hand_eye", contradicted=True)


STATED = Calibration(hand_eye=HandEyeLimits(translation_mm=2.0, rotation_deg=0.25))


@pytest.mark.parametrize(
    ("off", "stated", "also", "taken"),
    [
        ([0, 0, 0, 0, 0, 1.1], STATED, (), True),
        ([0, 5.0, 0, 0, 0, 0], STATED, (), True),
        ([0, 0, 0, 0, 0.4, 0], STATED, (), False),  # within what the estimates of healthy mounts reach
        ([0, 0, 0, 0, 0, 1.1], STATED, ("hand_eye",), False),  # the mount is named itself
        ([0, 0, 0, 0, 0, 1.1], Calibration(), (), False),  # nothing is stated that could be exceeded
    ],
)
def test_a_lens_that_needs_the_camera_elsewhere_in_the_hand_is_not_believed(
    monkeypatch: pytest.MonkeyPatch, off: list[float], stated: Calibration, also: tuple[str, ...], *, taken: bool
) -> None:
    """Millimetres and degrees of hand-eye; the calibration states 2 mm and 0.25 degrees."""
    found = account(np.zeros(SHAPE), intrinsics=ramp(0.003, 0))
    found.solved.names = lambda name: name == "intrinsics" or name in also
    monkeypatch.setattr(room, "unfounded", lambda *_: None)
    found.solved.hand_eye = se3.exp(np.concatenate([1e-3 * np.array(off[:3]), np.radians(off[3:])]))
    config = replace(GapConfig(), calibration=stated)
    assert taken_out(found, config) == (TakenOut("intrinsics", contradicted=True) if taken else None)


def test_a_cause_that_few_resampled_sets_of_views_choose_is_taken_out(monkeypatch: pytest.MonkeyPatch) -> None:
    found = account(np.zeros(SHAPE), lens_scatter=ramp(0.003, 0), wiggling=ramp(0.003, 1))
    monkeypatch.setattr(room, "unfounded", lambda *_: None)
    assert taken_out(found, GapConfig()) is None
    for cause, share in zip(found.solved.named, (0.02, 0.3), strict=True):
        cause.confidence = share
    assert taken_out(found, GapConfig()) == TakenOut("lens_scatter", contradicted=True)
    found.solved.named[0].suspected = True
    assert taken_out(found, GapConfig()) is None


@pytest.mark.parametrize(
    ("shrinks", "taken"),
    [
        ((-2.6, -8.3), "wiggling"),  # both are larger than the gap, and leave little together
        ((0.5, -8.3), None),  # one may hide a part of another
        ((-0.9, -8.3), None),
        ((None, -8.3), None),  # noise shrinks no bias
    ],
)
def test_two_causes_that_cancel_each_other_are_a_coincidence(
    monkeypatch: pytest.MonkeyPatch, shrinks: tuple[float | None, float], taken: str | None
) -> None:
    found = account(np.zeros(SHAPE), lens_scatter=ramp(0.003, 0), wiggling=ramp(0.003, 1))
    monkeypatch.setattr(room, "unfounded", lambda *_: None)
    found.causes = tuple(
        SimpleNamespace(named=n, alone=SimpleNamespace(shrink=s)) for n, s in zip(found.solved.named, shrinks, strict=True)
    )
    assert taken_out(found, GapConfig()) == (None if taken is None else TakenOut(taken, contradicted=True))


@pytest.mark.parametrize("test", ["contradicted", "uneven"])
def test_a_cause_that_was_only_suspected_leaves_no_mechanism_without_a_name(monkeypatch: pytest.MonkeyPatch, test: str) -> None:
    found = account(np.zeros(SHAPE), wiggling=ramp(0.003, 0))
    monkeypatch.setattr(room, "unfounded", lambda *_: None)
    monkeypatch.setattr(room, "contradicted", lambda *_: "wiggling" if test == "contradicted" else None)
    monkeypatch.setattr(room, "uneven", lambda *_: "wiggling")
    assert taken_out(found, GapConfig()) == TakenOut("wiggling", contradicted=True)
    found.solved.named[0].suspected = True
    assert taken_out(found, GapConfig()) == TakenOut("wiggling", contradicted=False)
