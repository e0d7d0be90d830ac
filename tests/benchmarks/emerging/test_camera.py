# SPDX-License-Identifier: Apache-2.0
"""The perfect camera measures truly; each cause has the sign and the dependence that physics gives it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from benchmarks.bench_emerging import corner_bias
from benchmarks.emerging.camera import Camera, target
from benchmarks.emerging.firmware import denoised, edges
from tests.benchmarks.emerging.made import LENS, PERFECT, device, error_mm, on_targets, view
from tests.tof_virtual.made import quad, wall
from tof_core.camera import Camera as Lens
from tof_virtual.taps import SPEED_OF_LIGHT

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_virtual.body import Body

RANGE = np.linspace(0.35, 2.4, 400)
ONE_TURN = np.linspace(0.05, 1.45, 400)
"""Distances that one frequency of 100 MHz can tell."""


def corner() -> list[Body]:
    """Two walls that meet at a right angle at x = 0, open towards +x."""
    left = quad("left", [[0, 0, 0.3], [0.6, -0.6, 0.3], [0.6, -0.6, 1.3], [0, 0, 1.3]], albedo=0.6)
    right = quad("right", [[0, 0, 0.3], [0, 0, 1.3], [0.6, 0.6, 1.3], [0.6, 0.6, 0.3]], albedo=0.6)
    return [left, right]


def wave(error: Float, harmonic: int, span: float, distance: Float = RANGE) -> float:
    """Amplitude of the error's part that repeats `harmonic` times over `span` metres."""
    basis = np.stack([np.ones_like(distance), distance, *(g(2 * np.pi * harmonic * distance / span) for g in (np.cos, np.sin))], axis=1)
    return float(np.hypot(*np.linalg.lstsq(basis, error, rcond=None)[0][2:]))


# the perfect camera --------------------------------------------------------------------------------
def test_the_perfect_camera_measures_a_wall_to_a_hundredth_of_a_millimetre() -> None:
    for x in (0.4, 0.83, 1.7):
        error, _, frame = error_mm([wall(half=3.0)], x)
        assert np.isfinite(frame.depth).all()
        assert np.abs(error).max() < 0.01


def test_the_perfect_camera_measures_a_corner_of_direct_light() -> None:
    error, sight, _ = error_mm(corner(), 1.4)
    inside = np.ones(error.size, bool)
    inside[sight.edge] = False
    assert np.isfinite(error.ravel()[inside]).sum() > 1500
    assert np.nanmax(np.abs(error.ravel()[inside])) < 0.02


def test_with_noise_the_perfect_camera_errs_by_noise_alone() -> None:
    _, camera, lights = view([wall(half=3.0)], 0.9, PERFECT)
    mean = camera.expose(lights, 0.0).depth
    rng = np.random.default_rng(3)
    draws = np.stack([camera.expose(lights, 0.0, rng).depth for _ in range(40)])
    z = (draws.mean(axis=0) - mean) / (draws.std(axis=0, ddof=1) / np.sqrt(40))
    assert abs(np.mean(z)) < 5 / np.sqrt(z.size)
    assert np.std(z) == pytest.approx(1.0, abs=0.06)


@pytest.mark.parametrize("electrons", [10e3, 40e3])
def test_photon_noise_is_what_theory_says(electrons: float) -> None:
    """Of four differential steps at one frequency: sigma = c / (4 pi f) sqrt(2 N) / (sum of squared in-phase signals)^(1/2)."""
    d = device(
        pixel__read_e=0.0, pixel__pedestal_e=0.0, pixel__mismatch=0.0, firmware__filter=False, firmware__step_mm=0.01, pixel__dark_e=0.0
    )
    n = 4000
    lens = Lens(n, 1, 1e7, 1e7, 0.0, 0.0, "plumb_bob", (0.0,) * 5, "camera")
    camera = Camera(d, PERFECT, lens)
    light = target(np.full(n, 0.9), camera.response.omega, electrons, 5e3)
    depth = camera.expose([light], 0.0, np.random.default_rng(1)).depth
    N = electrons + 5e3
    variance, total = 0.0, 0.0
    for f, omega in enumerate(camera.response.omega):
        # amplitude of I and Q: both taps of two steps add up; their variance: two sub-frames of N electrons
        signal = 4 * abs(camera.response.orders[f, 0, 0, 0]) * electrons
        sigma = SPEED_OF_LIGHT / (2 * omega) * np.sqrt(2 * N) / signal
        weight = omega**2
        variance += (weight * sigma) ** 2
        total += weight
    assert np.nanstd(depth) == pytest.approx(np.sqrt(variance) / total, rel=0.12)


def test_equal_seeds_give_equal_frames_and_other_seeds_do_not() -> None:
    _, camera, lights = view([wall(half=3.0)], 0.9, PERFECT)
    a, b, c = (camera.expose(lights, 0.0, np.random.default_rng(s)).depth for s in (1, 1, 2))
    np.testing.assert_array_equal(a, b)
    assert (a != c).mean() > 0.5


# waveform ------------------------------------------------------------------------------------------
def test_a_slower_driver_errs_in_waves_of_a_quarter_of_each_period_and_more_the_slower() -> None:
    one = device(clock__f2_mhz=100.0)
    spans = SPEED_OF_LIGHT / 2 / 100e6
    small, large = (on_targets(ONE_TURN, device(clock__f2_mhz=100.0, lamp__rise_ns=r), built=one) for r in (1.0, 2.0))
    size = [wave(large, k, spans, ONE_TURN) for k in (4, 2, 3, 5)]
    assert size[0] > 1.5 * wave(small, 4, spans, ONE_TURN) > 1.0
    assert size[0] > 5 * max(size[1:])


def test_the_wave_does_not_depend_on_brightness() -> None:
    slow = device(lamp__rise_ns=2.0)
    np.testing.assert_allclose(on_targets(RANGE, slow, electrons=5e3), on_targets(RANGE, slow, electrons=60e3), atol=0.05)


def test_two_frequencies_give_two_waves() -> None:
    slow = device(lamp__rise_ns=2.0)
    error = on_targets(RANGE, slow)
    for f in (100e6, 80e6):
        assert wave(error, 4, SPEED_OF_LIGHT / 2 / f) > 0.5


def test_a_coarse_factory_table_leaves_waves_and_a_fine_one_none() -> None:
    coarse, fine = (on_targets(RANGE, device(factory__nodes=n), built=device(factory__nodes=n)) for n in (40, 1440))
    assert np.std(coarse) > 0.3
    assert np.abs(fine).max() < 0.01


# charge --------------------------------------------------------------------------------------------
def test_trapped_charge_makes_dark_pixels_measure_late_as_one_over_their_charge() -> None:
    trap = device(pixel__trap_ke=0.5)
    mean = {e: float(np.mean(on_targets(RANGE, trap, electrons=e))) for e in (8e3, 16e3, 32e3)}
    assert mean[8e3] > 0
    assert (mean[8e3] + 0.0) * 9e3 == pytest.approx(mean[32e3] * 33e3, rel=0.1)
    assert mean[8e3] > 1.7 * mean[16e3] > 2.9 * mean[32e3]


def test_a_leaky_gate_takes_contrast_and_so_adds_noise_but_no_bias_by_itself() -> None:
    leaky = device(pixel__leak=0.3)
    assert np.abs(on_targets(RANGE, leaky, built=leaky)).max() < 0.02
    _, tight_camera, lights = view([wall(half=3.0)], 0.9, PERFECT)
    _, leaky_camera, _ = view([wall(half=3.0)], 0.9, leaky)
    rng = np.random.default_rng(0)
    sd = [np.nanstd(c.expose(lights, 0.0, rng).depth - c.expose(lights, 0.0).depth) for c in (tight_camera, leaky_camera)]
    assert sd[1] / sd[0] == pytest.approx((1 - 2 * 0.06) / (1 - 2 * 0.3), rel=0.1)


def test_in_a_leaky_gate_trapped_charge_errs_with_amplitude_too() -> None:
    both = device(pixel__leak=0.3, pixel__trap_ke=0.5)
    dark, bright = (float(np.mean(on_targets(RANGE, both, built=device(pixel__leak=0.3), electrons=e))) for e in (8e3, 32e3))
    assert dark > 3 * bright > 0


def test_a_full_well_saturates_and_is_invalid() -> None:
    _, _, frame = error_mm([wall(half=3.0, albedo=0.9)], 0.3, device(pixel__full_well_ke=60.0))
    assert frame.saturated.mean() > 0.5
    assert np.isnan(frame.depth[frame.saturated]).all()


def test_aged_clock_columns_shift_whole_columns_by_half_their_delay_at_any_distance() -> None:
    aged = device(pixel__column_ps=20.0, firmware__filter=False)
    near, far = (error_mm([wall(half=4.0)], x, aged)[0] for x in (0.7, 1.6))
    columns = near.mean(axis=0)
    assert np.std(columns) == pytest.approx(0.5e3 * SPEED_OF_LIGHT * 20e-12, rel=0.3)
    assert (near - columns).std() < 0.15 * columns.std()
    assert np.corrcoef(columns, far.mean(axis=0))[0, 1] > 0.97


def test_the_factory_removes_the_clock_tree_that_the_camera_was_built_with() -> None:
    error, _, _ = error_mm([wall(half=3.0)], 0.9, device(pixel__clock_ps=PERFECT.pixel.clock_ps))
    assert np.abs(error).max() < 0.01
    other, _, _ = error_mm([wall(half=3.0)], 0.9, device(pixel__clock_ps=0.0))
    columns = other.mean(axis=0)
    slope = (columns[60] - columns[35]) / 25  # near the axis, where z and the distance along the ray are one
    assert abs(slope) * 95 == pytest.approx(0.5e3 * SPEED_OF_LIGHT * PERFECT.pixel.clock_ps * 1e-12, rel=0.05)


# heat ----------------------------------------------------------------------------------------------
def test_a_cold_start_drifts_in_common_with_the_lamp_and_not_with_the_thermometer() -> None:
    _, camera, lights = view([wall(half=3.0)], 0.9, device(thermal__warmup_ahead=1.0, lamp__power_tempco=0.0))
    times = np.arange(0, 900.0, 30)
    frames = np.stack([1e3 * camera.expose(lights, t).depth for t in times])
    drift = np.nanmedian(frames, axis=1)
    steady = 1e3 * view([wall(half=3.0)], 0.9, PERFECT)[1].expose(lights, 0.0).depth
    assert np.nanstd(frames[0] - steady) < 0.1 * abs(np.nanmean(frames[0] - steady))
    assert drift[0] < np.nanmedian(steady) - 4
    lamp = np.array([camera._network.at(t).lamp for t in times])
    thermometer = np.array([camera.thermometer(t) for t in times])
    early = times < 240
    assert np.corrcoef(drift[early], lamp[early])[0, 1] > np.corrcoef(drift[early], thermometer[early])[0, 1]
    assert np.corrcoef(drift[early], lamp[early])[0, 1] > 0.99


# light ---------------------------------------------------------------------------------------------
def test_a_lamp_that_is_aside_errs_to_one_side_and_less_from_afar() -> None:
    aside = device(lamp__offset_x_mm=30.0)
    near, far = (error_mm([wall(half=4.0)], x, aside)[0] for x in (0.5, 1.5))
    columns = near.mean(axis=0)
    assert columns[5] > 1.0 > -1.0 > columns[-5]
    # half of (lamp - lens) . direction does not fall with distance; what falls is the quadratic rest
    middle_near, middle_far = (float(e[36, 45:51].mean()) for e in (near, far))
    assert middle_near > 2.5 * middle_far > 0


def test_the_lamp_casts_shadows_beside_near_things_where_the_lens_still_sees() -> None:
    bodies = [wall(half=4.0), wall("near", x=0.4, half=0.1)]
    narrow, wide = (error_mm(bodies, 1.0, device(lamp__baseline_mm=b))[2] for b in (0.0, 120.0))
    assert np.isnan(wide.depth).sum() > np.isnan(narrow.depth).sum() + 20


def test_flood_light_makes_a_corner_too_far_and_a_free_wall_not() -> None:
    flood = device(lamp__flood_share=1.0)
    error, sight, _ = error_mm(corner(), 1.4, flood)
    inside = np.ones(error.size, bool)
    inside[sight.edge] = False
    assert np.nanpercentile(error.ravel()[inside], 1) > 0
    assert 5 < np.nanmedian(error.ravel()[inside]) < 60
    free, _, _ = error_mm([wall(half=3.0)], 0.9, flood)
    assert np.abs(free).max() < 0.01
    half = error_mm(corner(), 1.4, device(lamp__flood_share=0.5))[0]
    assert 0.5 < np.nanmedian(half) / np.nanmedian(error) < 0.65


def test_stray_light_pulls_a_dark_far_wall_towards_a_bright_near_one() -> None:
    bodies = [wall(half=4.0, albedo=0.1), wall("near", x=0.6, half=0.12, albedo=0.9)]
    error, sight, _ = error_mm(bodies, 1.1, device(optics__stray_share=0.03))
    part = sight.main.face.reshape(error.shape)
    away = part < 2
    away[:, 30:66] = False
    assert np.nanmedian(error[away]) < -1.0
    assert abs(np.nanmedian(error[36, 44:52])) < 1.0


def test_the_cover_glass_pulls_dark_pixels_to_the_lens_the_more_the_darker() -> None:
    dark, bright = (np.median(error_mm([wall(half=4.0, albedo=a)], 0.9, device(optics__cover_share=0.005))[0]) for a in (0.1, 0.8))
    assert abs(dark) > 5 * abs(bright) > 0.05


def test_a_ghost_mirrors_a_near_object_through_the_centre() -> None:
    near = quad("near", [[0.5, -0.3, 0.72], [0.5, -0.1, 0.72], [0.5, -0.1, 0.88], [0.5, -0.3, 0.88]], albedo=0.8)
    bodies = [wall(half=4.0, albedo=0.3), near]
    error, sight, _ = error_mm(bodies, 1.1, device(optics__ghost_share=0.01))
    face = sight.main.face.reshape(error.shape)
    plain = error_mm(bodies, 1.1)[0]
    change = error - plain
    ghost = (face[::-1, ::-1] >= 2) & (face < 2)
    assert np.nanmedian(np.abs(change[ghost])) > 3 * np.nanmedian(np.abs(change[(~ghost) & (face < 2)]))


def test_a_translucent_part_measures_too_far_by_about_half_its_way() -> None:
    error, _, _ = error_mm([wall(half=4.0)], 0.9, device(world__translucent_mm=8.0))
    assert 3.0 < np.median(error) < 4.5


def test_a_pane_of_glass_adds_its_optical_way() -> None:
    d = device(world__pane_mm=10.0)
    error, _, _ = error_mm([wall(half=0.5)], 0.9, d)
    through = error[np.abs(error) > 1]
    assert through.size > 100
    assert np.median(through) == pytest.approx(10 * 0.52, rel=0.1)


def test_gloss_brightens_the_mirror_direction_and_mirrors_what_stands_before_it() -> None:
    plain, shiny = (error_mm([wall(half=4.0)], 0.9, device(world__gloss=g, world__gloss_rough=0.2))[2] for g in (0.0, 0.1))
    gain = (shiny.amplitude / plain.amplitude).reshape(LENS.shape)
    assert gain[33:39, 44:52].mean() > 1.5 * gain[:4, :4].mean()
    # a floor of gloss before a wall shows the wall's image, farther away than itself
    floor = quad("floor", [[0, -0.5, 0.5], [0.7, -0.5, 0.5], [0.7, 0.5, 0.5], [0, 0.5, 0.5]], albedo=0.1)
    back = wall(half=0.6, albedo=0.8)
    d = device(world__gloss=0.1)
    errors = []
    for serial in range(8):
        error, sight, _ = error_mm(
            [back, floor], 1.1, d.__class__(**{f: getattr(d, f) for f in d.__slots__ if f != "serial"}, serial=serial)
        )
        on_floor = sight.main.face.reshape(error.shape) >= 2
        errors.append(float(np.nanmedian(error[on_floor])))
    assert max(errors) > 5.0
    assert min(errors) > -1.0


def test_another_cameras_lamp_errs_by_its_phase_and_changes_from_capture_to_capture() -> None:
    _, camera, lights = view([wall(half=4.0)], 0.9, device(world__neighbour=0.2))
    depths = []
    for phase in np.arange(8) * np.pi / 4:
        lights[0].phase = phase
        depths.append(np.nanmedian(camera.expose(lights, 0.0).depth))
    assert 1e3 * np.ptp(depths) > 2


# firmware ------------------------------------------------------------------------------------------
def test_two_frequencies_err_at_their_lobes_when_the_second_is_hardly_exposed() -> None:
    d = device(clock__weight2=0.01, firmware__filter=False, world__signal_ke=20.0)
    _, camera, lights = view([wall(half=4.0)], 1.9, d)
    depth = camera.expose(lights, 0.0, np.random.default_rng(0)).depth
    error = depth * np.linalg.norm(LENS.rays().reshape(-1, 3), axis=1) - camera.expose(lights, 0.0).depth * np.linalg.norm(
        LENS.rays().reshape(-1, 3), axis=1
    )
    wrong = np.abs(error) > 0.2
    assert 0.005 < wrong.mean() < 0.6
    turns = np.abs(error[wrong]) / (SPEED_OF_LIGHT / 2 / 100e6)
    assert np.median(np.abs(turns - np.round(turns))) < 0.1


def test_the_filter_drops_mixed_pixels_and_without_it_they_lie_between_the_surfaces() -> None:
    bodies = [wall(half=4.0), wall("near", x=0.3, half=0.1295)]
    on, _, _ = error_mm(bodies, 1.1)
    off, sight, frame = error_mm(bodies, 1.1, device(firmware__filter=False))
    edge = np.zeros(on.size, bool)
    edge[sight.edge] = True
    assert np.nanmax(np.abs(on)) < 0.5
    assert np.isnan(on.ravel()[edge]).all()
    mixed = np.abs(off.ravel()) > 5
    assert mixed.sum() > 20
    assert edge[mixed].all()
    assert ((frame.depth[mixed] > 0.75) & (frame.depth[mixed] < 1.15)).all()


def test_the_filter_drops_a_step_of_centimetres_where_the_noise_allows_and_keeps_slopes_and_creases() -> None:
    H, W = 40, 60
    _v, u = np.mgrid[0:H, 0:W]
    noise = np.full(H * W, 1e-3)
    low_step = 0.8 + 0.04 * (u >= 30)
    found = edges(low_step.ravel(), noise, (H, W), 1 / 90).reshape(H, W)
    assert found[5:-5, 29:31].all()
    assert not found[:, :27].any()
    assert not edges(low_step.ravel(), 8 * noise, (H, W), 1 / 90).any()
    assert not edges((0.8 + 0.015 * (u >= 30)).ravel(), noise, (H, W), 1 / 90).any()  # a fixed pattern leaves as much
    slope, crease = 0.8 + 0.02 * u, 0.8 + 0.02 * np.abs(u - 30)
    for surface in (slope, crease):
        assert not edges(surface.ravel(), noise, (H, W), 1 / 90).any()


def test_a_denoising_filter_averages_noise_and_keeps_slopes_steps_and_holes() -> None:
    shape = H, W = 60, 80
    _v, u = np.mgrid[0:H, 0:W]
    noise = np.random.default_rng(4).normal(0, 2e-3, shape)
    flat = denoised((1.0 + noise).ravel(), shape, 3).reshape(shape)
    assert np.std(flat[2:-2, 2:-2]) == pytest.approx(2e-3 / 3, rel=0.05)
    slope_and_step = 0.8 + 0.01 * u + 0.2 * (u >= 40)
    slope_and_step[30, 20] = np.nan
    out = denoised(slope_and_step.ravel(), shape, 5).reshape(shape)
    np.testing.assert_allclose(out, slope_and_step, atol=1e-12)


def test_radial_output_is_the_distance_along_the_ray() -> None:
    _, sight, frame = error_mm([wall(half=4.0)], 0.9, device(firmware__radial=True))
    np.testing.assert_allclose(frame.depth, sight.z * sight.length, atol=1e-5)


def test_a_wrong_pll_scales_and_a_late_pulse_shifts() -> None:
    error = on_targets(RANGE, device(clock__pll_ppm=4000.0))
    assert np.polyfit(RANGE, error, 1)[0] == pytest.approx(4.0, rel=0.05)
    late = on_targets(RANGE, device(lamp__delay_ps=20.0))
    assert np.mean(late) == pytest.approx(0.5e3 * SPEED_OF_LIGHT * 20e-12, rel=0.02)
    assert np.std(late) < 0.05


def test_a_strict_threshold_loses_the_dark_pixels() -> None:
    bodies = [wall(half=4.0, albedo=0.5), wall("dark", x=0.05, half=0.2, albedo=0.05)]
    _, sight, frame = error_mm(bodies, 0.9, device(firmware__min_amplitude_e=2500.0))
    dark = sight.main.face >= 2
    assert np.isnan(frame.depth[dark]).all()
    assert np.isfinite(frame.depth[~dark]).mean() > 0.7


def test_bounced_light_in_a_corner_is_what_a_path_tracer_says() -> None:
    """Medians by mitransient of a 90 degree V, albedo 0.6, 100 MHz: 30 to 100, 100 to 200, 200 to 350 mm from the apex."""
    x, error = corner_bias(0.6)
    medians = [np.nanmedian(error[(x >= low) & (x < high)]) for low, high in ((0.03, 0.1), (0.1, 0.2), (0.2, 0.35))]
    assert medians == pytest.approx([31.5, 35.9, 28.6], rel=0.16)
