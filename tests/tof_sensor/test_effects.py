# SPDX-License-Identifier: Apache-2.0
"""Each effect's signature, in values."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.tof_sensor.plane import CAMERA, NORMAL, plane_depth, plane_frame
from tof_core.errors import ConfigError
from tof_sensor.effects.amplitude_bias import AmplitudeBias
from tof_sensor.effects.cad_deviation import CadDeviation
from tof_sensor.effects.depth_scale import DepthScale
from tof_sensor.effects.dropout import Dropout
from tof_sensor.effects.fixed_pattern import FixedPattern, line_cosines, packed
from tof_sensor.effects.flying_pixels import Edge, FlyingPixels
from tof_sensor.effects.interference import Interference
from tof_sensor.effects.intrinsics import Intrinsics
from tof_sensor.effects.lens_scatter import LensScatter
from tof_sensor.effects.motion import Motion
from tof_sensor.effects.noise import Noise
from tof_sensor.effects.phase_wrap import PhaseWrap
from tof_sensor.effects.photon_law import PhotonLaw
from tof_sensor.effects.quantization import Quantization
from tof_sensor.effects.radial_depth import RadialDepth
from tof_sensor.effects.range_offset import RangeOffset
from tof_sensor.effects.specular import Specular
from tof_sensor.effects.subsurface import Subsurface
from tof_sensor.effects.temperature_drift import TemperatureDrift
from tof_sensor.effects.time_sync import TimeSync
from tof_sensor.effects.wiggling import Wiggling
from tof_sensor.frame import Context, ideal_frame
from tof_sensor.geometry import image_flow

if TYPE_CHECKING:
    from tof_sensor.effect import Effect

RNG = np.random.default_rng(5)


def test_wiggling_at_100_mhz_repeats_after_375_mm() -> None:
    assert Wiggling(modulation_mhz=100.0).period_m == pytest.approx(0.37474, abs=1e-5)
    frame = plane_frame()
    bias = Wiggling(sine_m=0.003).bias(frame) * frame.length
    np.testing.assert_allclose(bias, 0.003 * np.sin(2 * np.pi * frame.radial / 0.374741), atol=1e-7)


def test_amplitude_bias_grows_with_each_e_fold() -> None:
    amplitude = np.geomspace(1.0, np.e**2, CAMERA.width)[None] * np.ones((CAMERA.height, 1))
    bias = AmplitudeBias(per_ln_m=0.004).bias(plane_frame(amplitude=amplitude)) * CAMERA.ray_length()
    np.testing.assert_allclose(bias[:, -1] - bias[:, 0], 0.008, atol=1e-9)


def test_where_amplitude_bias_is_zero_does_not_matter() -> None:
    amplitude = np.geomspace(1.0, 50.0, CAMERA.width)[None] * np.ones((CAMERA.height, 1))
    frame, shift = plane_frame(amplitude=amplitude), np.log(7.0)
    a, b = 0.004, 0.0006
    at_seven = AmplitudeBias(per_ln_m=a, per_ln2_m=b, reference=7.0)
    at_one = AmplitudeBias(at_reference_m=-a * shift + b * shift**2, per_ln_m=a - 2 * b * shift, per_ln2_m=b, reference=1.0)
    np.testing.assert_allclose(at_one.bias(frame), at_seven.bias(frame), atol=1e-12)


def test_drift_follows_the_thermometer_and_without_one_the_clock() -> None:
    warm = plane_frame(Context(temperature=35.0))
    np.testing.assert_allclose(TemperatureDrift(drift_m=5e-4).bias(warm) * warm.length, 0.005, rtol=1e-12)
    late = plane_frame(Context(time_s=600.0))
    np.testing.assert_allclose(TemperatureDrift(warmup_m=0.01, tau_s=600.0).bias(late) * late.length, 0.01 / np.e, rtol=1e-12)
    assert not TemperatureDrift(drift_m=0.01).bias(late).any()  # no thermometer


def test_a_warm_up_that_leads_the_thermometer_adds_to_what_it_shows() -> None:
    frame = plane_frame(Context(temperature=35.0, time_s=300.0))
    both = TemperatureDrift(drift_m=5e-4, warmup_m=-0.01, tau_s=300.0)
    np.testing.assert_allclose(both.bias(frame) * frame.length, 0.005 - 0.01 / np.e, rtol=1e-12)


def test_late_charge_goes_with_inverse_amplitude() -> None:
    frame = plane_frame()
    walk = AmplitudeBias(inverse_m=0.004, reference=2.0, form="inverse")
    np.testing.assert_allclose(walk.bias(frame) * frame.length, 0.004 * 2.0 / frame.amplitude, rtol=1e-12)


def test_pile_up_goes_with_amplitude() -> None:
    frame = plane_frame()
    early = AmplitudeBias(direct_m=-0.004, reference=2.0, form="direct")
    np.testing.assert_allclose(early.bias(frame) * frame.length, -0.004 * frame.amplitude / 2.0, rtol=1e-12)
    np.testing.assert_array_equal(AmplitudeBias(direct_m=-0.004, reference=2.0).bias(frame), 0.0)


def test_ambient_light_fills_a_far_pixel_more_than_the_lamp_does() -> None:
    """At 2 m ambient light of 0.25 / m^2 doubles the light of the lamp: late charge is half the share that it is in the dark."""
    frame = plane_frame()
    dark = AmplitudeBias(inverse_m=0.004, reference=2.0, form="inverse").bias(frame)
    lit = AmplitudeBias(inverse_m=0.004, reference=2.0, form="inverse", ambient=0.25).bias(frame)
    np.testing.assert_allclose(lit, dark / (1 + 0.25 * frame.radial**2), rtol=1e-12)
    assert (AmplitudeBias(per_ln_m=0.004, ambient=0.25).bias(frame) > AmplitudeBias(per_ln_m=0.004).bias(frame)).all()


def test_offset_scale_and_radial_are_what_they_say() -> None:
    frame = plane_frame()
    np.testing.assert_allclose(RangeOffset(offset_m=0.005).bias(frame) * frame.length, 0.005)
    np.testing.assert_allclose(DepthScale(scale=0.001).bias(frame), 0.001 * frame.depth)
    np.testing.assert_allclose(frame.depth + RadialDepth(share=1.0).bias(frame), frame.radial)


def test_fixed_pattern_dense_columns_agree_with_its_bias() -> None:
    h, w = CAMERA.shape
    pattern = FixedPattern(values=tuple(RNG.normal(0, 1e-3, h + w + 8)), order=3)
    frame = plane_frame()
    np.testing.assert_allclose(pattern.columns(frame) @ pattern.coefficients, pattern.bias(frame), atol=1e-12)


def test_fixed_pattern_keeps_single_pixels_to_ten_micrometres() -> None:
    image = RNG.normal(0, 2e-3, CAMERA.shape)
    frame = plane_frame()
    bias = FixedPattern(pixels=packed(image)).bias(frame)
    np.testing.assert_allclose(bias * frame.length, image, atol=5.1e-6)


def test_the_cosines_of_lines_begin_where_the_field_ends_and_are_independent_of_it() -> None:
    both = np.concatenate([line_cosines(64, 1, 4), line_cosines(64, 4, 16)], axis=1)
    np.testing.assert_allclose(both.T @ both, 32.0 * np.eye(15), atol=1e-9)
    assert line_cosines(64, 4, 0).shape == (64, 0)


@pytest.mark.parametrize(
    "pattern",
    [
        FixedPattern(pixels=packed(np.zeros((3, 4)))),
        FixedPattern(pixels=packed(np.zeros((4000, 4000)))),
        FixedPattern(pixels="no base64!"),
        FixedPattern(values=(1e-3,) * 12),
    ],
)
def test_a_pattern_of_another_raster_is_refused(pattern: FixedPattern) -> None:
    with pytest.raises(ConfigError, match="40x30"):
        pattern.bias(plane_frame())


def test_time_sync_is_twist_times_delay() -> None:
    frame = plane_frame(Context(twist=np.array([0, 0, 0.1, 0, 0, 0])))
    # Toward the plane at 0.1 m/s: 10 ms late exposure sees it 1 mm nearer along the axis's ray.
    bias = TimeSync(delay_s=0.01).bias(frame)
    np.testing.assert_allclose(bias[15, 19], -0.001, rtol=0.03)
    assert not TimeSync(delay_s=0.01).bias(plane_frame()).any()


def test_motion_is_nothing_while_standing() -> None:
    assert not Motion(axial_s=0.02, edge=1.0, steady=1.0).bias(plane_frame()).any()


def test_taps_of_a_moving_camera_disagree_where_brightness_changes_and_nowhere_else() -> None:
    still = plane_frame()
    albedo = still.rendering.albedo.copy()
    albedo[:, 20:] *= 0.3
    twist = np.array([0.1, 0, 0, 0, 0, 0])
    frame = ideal_frame(replace(still.rendering, albedo=albedo), Context(twist=twist))
    taps = Motion(edge=1.0, steady=1.0, tap_s=0.02)
    reach = 1.5 * taps.tap_s * np.abs(image_flow(frame)[0]).max()
    wrong = np.abs(taps.bias(frame)).max(axis=0)
    far = np.abs(np.arange(CAMERA.width) - 19.5) > reach + 1.0
    assert wrong[~far].max() > 0.01
    assert wrong[far].max() < 0.1 * wrong[~far].max()


def test_a_camera_that_slides_along_a_plane_sees_one_brightness() -> None:
    # The lamp goes with the camera: along the plane nothing in the image changes, however steeply brightness falls over it.
    along = np.cross(NORMAL, [0.0, 1.0, 0.0])
    frame = replace(plane_frame(), context=Context(twist=np.array([*(0.1 * along / np.linalg.norm(along)), 0, 0, 0])))
    turned = replace(frame, context=Context(twist=np.array([0, 0, 0, 0, 0.2, 0])))
    taps = Motion(edge=1.0, steady=1.0, tap_s=0.02)
    inside = (slice(4, -4), slice(4, -4))
    assert np.abs(taps.bias(frame)[inside]).max() < 1e-4
    assert np.abs(taps.bias(turned)[inside]).max() > 1e-3


def test_an_axial_motion_is_late_more_than_its_taps_disagree() -> None:
    frame = replace(plane_frame(), context=Context(twist=np.array([0, 0, 0.1, 0, 0, 0])))
    late = Motion(axial_s=0.02).bias(frame)
    np.testing.assert_allclose(late[15, 20], TimeSync(delay_s=0.02).bias(frame)[15, 20])
    assert np.abs(Motion(edge=1.0, tap_s=0.02).bias(frame)).max() < 0.6 * np.abs(late).max()


@pytest.mark.parametrize("name", Intrinsics.LINEAR)
def test_a_lens_that_is_off_by_little_changes_depth_as_its_column_says(name: str) -> None:
    for lens in ("true_lens", "stated_lens"):
        little = Intrinsics(z_from=lens, **{name: 1e-3})
        exact = plane_depth(little.camera(CAMERA).rays()) * little.published(CAMERA) - plane_depth(CAMERA.rays())
        assert np.abs(exact).max() > 1e-6
        np.testing.assert_allclose(little.bias(plane_frame()), exact, atol=1e-2 * np.abs(exact).max() + 1e-7)


def test_a_camera_that_converts_by_its_stated_lens_publishes_z_by_the_ratio_of_the_rays() -> None:
    lens = Intrinsics(cx_px=2.0, k1=0.02)
    true, stated = (np.linalg.norm(c.rays(), axis=-1) for c in (lens.camera(CAMERA), CAMERA))
    np.testing.assert_allclose(lens.published(CAMERA), true / stated)
    assert (replace(lens, z_from="true_lens").published(CAMERA) == 1.0).all()


def test_a_lens_adds_to_the_one_that_is_stated() -> None:
    rational = replace(CAMERA, distortion_model="rational_polynomial", distortion=(0.5, -0.1, 1e-3, 2e-3, 0.01, 0.4, 0.02, 0.003))
    there = Intrinsics(fx_rel=0.01, cx_px=2.0, k1=0.03).camera(rational)
    assert (there.fx, there.cx) == pytest.approx((1.01 * CAMERA.fx, CAMERA.cx + 2.0))
    assert there.distortion == pytest.approx((0.53, *rational.distortion[1:]))
    assert there.distortion_model == "rational_polynomial"
    assert Intrinsics(k1=0.1).camera(replace(CAMERA, distortion_model="equidistant")).distortion_model == "plumb_bob"


def test_deviation_moves_its_part_alone() -> None:
    push = CadDeviation(values=(0, 0, 0.002, 0, 0, 0, 0, 0, 0), part=0, centre=(0, 0, 0.9))
    frame = plane_frame()
    n = frame.rendering.normal[0, 0].astype(float)
    np.testing.assert_allclose(push.bias(frame), 0.002 * n[2] / (frame.rays @ n), rtol=1e-6)
    assert not push.bias(plane_frame(part=1)).any()


def test_bow_is_zero_at_the_centre_and_full_at_half_size() -> None:
    bow = CadDeviation(values=(0,) * 6 + (0.002, 0.0, 0.0), part=0, centre=(0, 0, 0.9), normal=(0, 0, -1), half_size_m=0.2)
    columns = bow.columns(plane_frame())[..., 6]
    assert np.abs(columns).min() < 1e-3
    assert np.abs(columns).max() > 0.5


def test_a_displaced_part_is_stated_by_its_displacement_turn_and_bow() -> None:
    values = (0.0045, 0.0, 0.0045, 0.0, np.radians(0.5), 0.0, 0.0, -0.0021, 0.0)
    assert CadDeviation(values=values).stated == "displaced by 6.4 mm, turned by 0.5 degrees, bent by 2.1 mm"
    assert CadDeviation(values=(0,) * 6 + (-0.07, 0.001, 0.01), bow_reach=(0.01, 1.0, 0.05)).stated == "bent by 1.0 mm", "a pipe, across"
    assert CadDeviation(values=(0.0003, 0, 0, 0, 0.001, 0, 0, 0, 0)).stated == ""


def test_subsurface_delays_its_part_and_goes_with_incidence() -> None:
    frame = plane_frame()
    bias = Subsurface(delay_m=0.003, aslant_m=-0.001, part=0).bias(frame) * frame.length
    np.testing.assert_allclose(bias, 0.003 - 0.001 * (1 - np.cos(frame.rendering.incidence)), atol=1e-9)
    assert not Subsurface(delay_m=0.003, part=1).bias(frame).any()


def test_over_more_than_half_a_turn_a_mixture_stays_by_the_stronger_return() -> None:
    half = np.array([0.5])
    turn = FlyingPixels(modulation_mhz=100.0)
    for light, near in ((0.1, 0.0), (10.0, 1.2)):
        edge = Edge((np.array([0]), np.array([0])), half, np.array([light]), np.array([1.2]), np.ones(1))
        assert turn.mixture(edge)[0] == pytest.approx(near, abs=0.03)


def test_flying_pixel_of_equal_halves_lies_between() -> None:
    frame = plane_frame()
    mixed, second = np.zeros(CAMERA.shape, np.float32), np.full(CAMERA.shape, np.nan, np.float32)
    mixed[15, 20], second[15, 20] = 0.5, frame.depth[15, 20] + 0.1
    edge = replace(frame, rendering=replace(frame.rendering, mixed=mixed, second=second))
    bias = FlyingPixels(share=1.0).bias(edge)
    assert 0.03 < bias[15, 20] < 0.05  # the nearer half is brighter
    assert np.count_nonzero(bias) == 1


def test_wrapped_pixels_lose_whole_turns() -> None:
    frame = plane_frame()
    wrap = PhaseWrap(modulation_mhz=100.0, start_m=float(np.median(frame.radial)), share=1.0)
    shift = (wrap.apply(frame, RNG).depth - frame.depth) * frame.length
    assert set(np.round(np.unique(shift), 4)) == {-1.499, 0.0}


def test_single_wrapped_pixels_are_outliers_and_no_bias() -> None:
    frame = plane_frame()
    few, most = (PhaseWrap(modulation_mhz=100.0, start_m=0.0 + 1e-6, share=share) for share in (0.1, 0.9))
    assert not few.bias(frame).any(), "taken off the other nine in ten, a mean shift would bias them"
    np.testing.assert_allclose((most.bias(frame) * frame.length)[frame.valid], -1.49896, atol=1e-4)
    wrapped = (few.apply(frame, np.random.default_rng(1)).depth - frame.depth)[frame.valid] < -0.5
    assert wrapped.mean() == pytest.approx(0.1, abs=0.02)


def test_of_several_jumps_each_wrapped_pixel_has_one() -> None:
    frame = plane_frame()
    wrap = PhaseWrap(100.0, start_m=-100.0, share=0.4, others_m=(0.75,), others_share=(0.25,))
    shift = ((wrap.apply(frame, np.random.default_rng(1)).depth - frame.depth) * frame.length)[frame.valid]
    shares = [np.isclose(shift, jump, atol=1e-4).mean() for jump in (0.0, 1.49896, 0.75)]
    assert shares == pytest.approx([0.6, 0.3, 0.1], abs=0.02)
    assert wrap.stated == "off by 1.50 or 0.75 m, 40 % of the pixels at those ranges"


def test_specular_peaks_at_normal_incidence() -> None:
    frame = plane_frame()
    bias = Specular(bias_m=-0.01, lobe_deg=8.0).bias(frame)
    assert np.argmin(bias) == np.argmin(frame.rendering.incidence)


def test_lens_scatter_pulls_dark_pixels_toward_bright_ones() -> None:
    amplitude = np.ones(CAMERA.shape)
    amplitude[:, :20] = 100.0  # the bright half
    frame = plane_frame(amplitude=amplitude)
    bias = LensScatter(middle=0.01).bias(frame)
    veil_depth = frame.depth[:, :20].mean()
    dark = bias[:, 30]
    assert np.all(np.sign(dark) == np.sign(veil_depth - frame.depth[:, 30]))
    assert np.abs(bias[:, 30]).mean() > 20 * np.abs(bias[:, 5]).mean()


def test_photon_law_scatters_as_it_says_and_noise_adds_to_it() -> None:
    frame = plane_frame(amplitude=np.full(CAMERA.shape, 4.0))
    law = PhotonLaw(floor_m=0.0, shot_m=0.002, reference=1.0)
    noisy = law.apply(frame, RNG)
    np.testing.assert_allclose(noisy.sigma * frame.length, 0.001, rtol=1e-12)
    assert np.std((noisy.depth - frame.depth) * frame.length) == pytest.approx(0.001, rel=0.1)
    assert (Noise(extra_m=0.003).apply(noisy, RNG).sigma > 0.003 / frame.length.max()).all()


def test_the_noise_of_a_camera_that_averages_is_shared_by_neighbours_and_as_large_as_stated() -> None:
    frame = plane_frame(amplitude=np.full(CAMERA.shape, 4.0))
    law = PhotonLaw(floor_m=0.0, shot_m=0.002, reference=1.0, window_px=3)
    runs = np.stack([(law.apply(frame, RNG).depth - frame.depth) * frame.length for _ in range(40)])
    assert np.std(runs) == pytest.approx(0.001, rel=0.03)
    shared = [float((runs[..., lag:] * runs[..., : runs.shape[2] - lag]).mean()) / 0.001**2 for lag in (1, 2, 3)]
    np.testing.assert_allclose(shared, [2 / 3, 1 / 3, 0.0], atol=0.05)


def test_quantization_leaves_only_codes() -> None:
    depth = Quantization(step_m=0.005).apply(plane_frame(), RNG).depth
    np.testing.assert_allclose(depth / 0.005, np.round(depth / 0.005), atol=1e-9)


def test_steps_along_the_ray_are_steps_of_range() -> None:
    frame = plane_frame()
    ranges = Quantization(step_m=0.005, along_ray=True).apply(frame, RNG).depth * frame.length
    np.testing.assert_allclose(ranges / 0.005, np.round(ranges / 0.005), atol=1e-6)
    assert np.abs(ranges - frame.depth * frame.length).max() == pytest.approx(0.0025, rel=0.05)


def test_dropout_loses_half_at_its_threshold() -> None:
    frame = plane_frame(amplitude=np.full(CAMERA.shape, 2.0))
    np.testing.assert_allclose(Dropout(threshold=2.0).apply(frame, RNG).missing, 0.5)
    assert not Dropout().apply(frame, RNG).missing.any()


def test_interference_comes_in_bursts() -> None:
    frame = plane_frame()
    hits = sum(Interference(burst_m=0.01, duty=0.3).apply(frame, RNG) is not frame for _ in range(300))
    assert 60 < hits < 120


@pytest.mark.parametrize(
    ("effect", "metres"),
    [
        (Noise(extra_m=0.004), 0.004),
        (Noise(extra_m=0.004, duty=0.25), 0.002),
        (Interference(burst_m=0.003, duty=1.0, reference=200.0), 0.006),
        (Interference(burst_m=0.003, duty=0.25, reference=200.0), 0.003),
        (Quantization(step_m=0.012), 0.012 / np.sqrt(12)),
        (RangeOffset(offset_m=0.01), 0.0),
    ],
)
def test_noise_of_an_effect_is_its_rms_over_captures(effect: Effect, metres: float) -> None:
    """At half of the reference amplitude, interference is twice as large."""
    frame = plane_frame(amplitude=np.full(CAMERA.shape, 100.0))
    np.testing.assert_allclose(effect.noise(frame) * frame.length, metres)


@pytest.mark.parametrize(("start_m", "far"), [(1.0, True), (-1.0, False)])
def test_phase_wraps_beyond_a_range_or_up_to_one(start_m: float, *, far: bool) -> None:
    frame = plane_frame()
    wraps = PhaseWrap(start_m=start_m).beyond(frame)
    np.testing.assert_array_equal(wraps, frame.valid & ((frame.radial > 1.0) == far))
    assert 0.0 < wraps.mean() < 1.0
