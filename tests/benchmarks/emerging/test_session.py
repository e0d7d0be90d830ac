# SPDX-License-Identifier: Apache-2.0
"""Sessions of the emerging camera: causes, strengths, determinism, the recorded bag and its truth."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from benchmarks.emerging.causes import CAUSES, OUTSIDE, applied
from benchmarks.emerging.healthy import HAND_EYE_DEG, HAND_EYE_MM, LENS_PX, draw
from benchmarks.emerging.record import record
from benchmarks.emerging.session import EmergingSession
from benchmarks.emerging.strength import absent, calibrate
from tests.benchmarks.emerging.made import PERFECT, device
from tests.tof_virtual.made import bench, config
from tests.vocabulary import EFFECT_NAMES
from tof_core.bag import open_bag
from tof_core.config import flatten
from tof_core.errors import ConfigError
from tof_virtual.truth import load_truth

if TYPE_CHECKING:
    from pathlib import Path

    from benchmarks.emerging.device import Device


def session(sizes: dict[str, float], healthy: Device = PERFECT, **extra: object) -> EmergingSession:
    return EmergingSession(bench(), config(**{"plan__pause_s": 20.0, **extra}), healthy, sizes)


def rms_mm(made: EmergingSession, index: int = 0) -> float:
    change = made.exposed(index, made.device()).depth - made.exposed(index, made.healthy).depth
    return 1e3 * float(np.sqrt(np.nanmean(np.where(np.abs(change) > 0.1, np.nan, change) ** 2)))


@pytest.mark.parametrize("name", sorted(CAUSES))
def test_each_cause_changes_its_own_quantities_and_no_other(name: str) -> None:
    cause = CAUSES[name]
    before, after = flatten(PERFECT), flatten(applied(PERFECT, {name: cause.start}))
    changed = {k for k in before if before[k] != after[k]}
    assert changed <= {cause.knob, *cause.beside, *cause.settings}
    assert changed or name == "radial_output"


def test_an_unknown_cause_is_refused() -> None:
    with pytest.raises(ConfigError, match="no cause 'magic'"):
        applied(PERFECT, {"magic": 1.0})


@pytest.mark.parametrize("name", ["slow_driver", "charge_traps", "hazy_lens", "late_pulse", "lamp_aside", "sunlight"])
def test_strength_one_is_three_millimetres_and_half_of_it_half(name: str) -> None:
    made = session({})
    reached = [calibrate(made, {name: s})[name] for s in (1.0, 0.5)]
    assert reached == pytest.approx([3e-3, 1.5e-3], rel=0.12)


def test_a_strength_that_physics_does_not_allow_ends_at_the_limit_and_reports_what_was_reached() -> None:
    made = session({})
    reached = calibrate(made, {"slow_driver": 3.0})["slow_driver"]
    assert made.sizes["slow_driver"] == CAUSES["slow_driver"].limit
    assert 2e-3 < reached < 9e-3
    assert rms_mm(made) == pytest.approx(1e3 * reached, rel=0.3)


def test_a_cause_that_makes_less_than_half_of_what_is_asked_for_is_absent() -> None:
    strengths = {"bent_part": 1.0, "slow_driver": 2.0, "wrong_lens": 0.5}
    assert absent(strengths, {"bent_part": 0.0, "slow_driver": 3.1e-3, "wrong_lens": float("nan")}) == ("bent_part",)
    assert absent(strengths, {"bent_part": 2.9e-3, "slow_driver": 2.9e-3, "wrong_lens": float("nan")}) == ("slow_driver",)
    assert absent({}, {}) == ()


def test_a_bent_part_makes_the_error_that_is_asked_for_although_a_box_has_corners_alone() -> None:
    made = session({})
    assert all(len(b.vertices) <= 8 for b in made.bodies)
    reached = calibrate(made, {"bent_part": 1.0})["bent_part"]
    assert reached == pytest.approx(3e-3, rel=0.12)
    assert 3.0 < made.sizes["bent_part"] < 20.0


def test_a_session_without_causes_is_its_healthy_device() -> None:
    made = session({})
    assert made.device() == PERFECT
    assert rms_mm(made) == 0.0


def test_causes_act_together_and_each_can_be_left_out() -> None:
    made = session({"late_pulse": 20.0, "wrong_pll": 4000.0})
    assert made.device(frozenset({"late_pulse"})) == applied(PERFECT, {"wrong_pll": 4000.0})
    assert made.without_each() == {"depth_scale": frozenset({"wrong_pll"}), "range_offset": frozenset({"late_pulse"})}


def test_equal_sessions_are_equal_bit_for_bit_and_another_seed_is_another() -> None:
    one, two = (session({"clock_columns": 15.0}).exposed(1, applied(PERFECT, {"clock_columns": 15.0}), noise=True) for _ in range(2))
    np.testing.assert_array_equal(one.depth, two.depth)
    other = session({}, seed=1)
    assert (other.exposed(1, PERFECT, noise=True).depth != one.depth).mean() > 0.5


def test_a_slow_readout_shows_while_the_hand_moves_and_not_when_it_stands() -> None:
    still = session({"slow_readout": 10.0})
    moving = session({"slow_readout": 10.0}, plan__capture_moving=True)
    assert rms_mm(still) == 0.0
    assert rms_mm(moving) > 0.3


def test_driver_latency_makes_stamps_late_and_leaves_the_image_alone() -> None:
    made = session({"driver_latency": 30.0}, plan__capture_moving=True)
    assert made.stamp_s(made.shutters[0]) - made.shutters[0].time_s == pytest.approx(0.03)
    assert rms_mm(made) == 0.0


def test_moved_and_missing_parts_and_foreign_objects_are_geometry() -> None:
    made = session({})
    plain = made.real(PERFECT).world.soup
    assert made.real(device(world__missing=True)).world.soup.names != plain.names
    assert "foreign" in made.real(device(world__foreign_m=0.1)).world.soup.names
    moved = made.real(device(world__moved_mm=5.0)).world.soup.corners
    assert 0.004 < np.abs(moved - plain.corners).max() < 0.02


def test_the_true_albedo_stays_within_what_is_stated() -> None:
    made = session({})
    real = made.real(device(world__albedo_off=0.4, serial=3))
    assert 0.1 < np.abs(real.factor - 1).max() <= 0.4


def test_healthy_cameras_stay_within_the_stated_prior() -> None:
    for seed in range(20):
        d = draw(np.random.default_rng(seed), seed)
        assert d.mount.hand_eye_mm <= HAND_EYE_MM
        assert d.mount.hand_eye_deg <= HAND_EYE_DEG
        assert np.hypot(d.optics.centre_x_px, d.optics.centre_y_px) <= LENS_PX


def test_a_recorded_session_holds_what_was_measured_and_its_truth_what_the_cause_did(tmp_path: Path) -> None:
    healthy = draw(np.random.default_rng(2), 2)
    made = session({}, healthy)
    reached = calibrate(made, {"slow_driver": 1.0, "strict_threshold": 1.0})
    record(made, tmp_path / "bag", tmp_path / "truth", {"slow_driver": 1.0, "strict_threshold": 1.0}, reached)
    arrays, meta = load_truth(tmp_path / "truth")
    with open_bag(tmp_path / "bag") as reader:
        captures = list(reader.captures())
    assert len(captures) == 4
    for v, capture in enumerate(captures):
        true, depth = arrays["depth"][v], capture.depth
        error = 1e3 * (depth - true)
        assert np.nanmedian(np.abs(error)) < 25
        seen = np.isfinite(depth) & np.isfinite(arrays["noise"][v])
        mean = depth - arrays["noise"][v]
        without = mean - arrays["bias_all"][v]
        assert np.nanstd((mean - true)[seen]) >= 0.0
        assert np.nanmedian(np.abs((without - true)[seen])) < 3e-3
    assert meta["causes"]["slow_driver"]["effect"] == "wiggling"
    assert {"bias_wiggling", "loss_dropout", "normal", "T_cell_camera", "X"} <= set(arrays)
    lost = arrays["loss_dropout"]
    assert np.nanmean(lost) == pytest.approx(0.1, abs=0.06)


def test_names_of_effects_are_the_vocabularys_or_outside() -> None:
    known = EFFECT_NAMES | {"emitter_offset", "ambient"}
    assert {c.effect for c in CAUSES.values() if not c.effect.startswith(OUTSIDE)} <= known


def test_what_is_kept_of_other_captures_never_stands_in_for_this_one() -> None:
    one = session({"late_pulse": 20.0}, plan__views=24, plan__captures=1)
    fresh = session({"late_pulse": 20.0}, plan__views=24, plan__captures=1)
    for index in range(24):
        one.exposed(index, one.device())
        one.exposed(index, one.healthy)
    for index in (23, 12, 0):
        np.testing.assert_array_equal(one.exposed(index, one.device()).depth, fresh.exposed(index, fresh.device()).depth)


def test_the_page_lists_every_cause_with_its_effect_and_quantity(repository: Path) -> None:
    page = (repository / "docs" / "emerging_camera.md").read_text(encoding="utf-8")
    for name, cause in CAUSES.items():
        assert f"| `{name}`: {cause.text} | {cause.effect} | `{cause.knob}` |" in page
