# SPDX-License-Identifier: Apache-2.0
"""Sign, size and timing of effects, against a formula or an exact geometry that shares no code with them."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.tof_align.made import box, scene_of
from tests.tof_sensor.plane import CAMERA, NORMAL, OFFSET, plane_depth, plane_frame
from tof_core import se3
from tof_scene.builtin.shapes import moved, sphere
from tof_scene.raycast import Raycaster
from tof_scene.render import render
from tof_scene.scene import Material, Part
from tof_sensor.effects.cad_deviation import CadDeviation
from tof_sensor.effects.dropout import Dropout
from tof_sensor.effects.flying_pixels import Edge, FlyingPixels
from tof_sensor.effects.hand_eye import HandEye
from tof_sensor.effects.interference import Interference
from tof_sensor.effects.lens_scatter import LensScatter
from tof_sensor.effects.motion import Motion
from tof_sensor.effects.multipath import Multipath
from tof_sensor.effects.noise import Noise
from tof_sensor.effects.quantization import Quantization
from tof_sensor.effects.specular import Specular
from tof_sensor.effects.time_sync import TimeSync
from tof_sensor.effects.wiggling import Wiggling
from tof_sensor.frame import Context, ideal_frame
from tof_sensor.geometry import image_flow

if TYPE_CHECKING:
    from tof_core.arrays import Float

C = 299_792_458.0
RAYS = CAMERA.rays()
LENGTH = np.linalg.norm(RAYS, axis=-1)
INSIDE = (slice(4, -4), slice(4, -4))


def moved_plane(T: Float) -> tuple[Float, float]:
    """Normal and offset of the plane in the axes of a camera that moved by T (4, 4) in its own."""
    normal = T[:3, :3].T @ NORMAL
    return normal, float(OFFSET - NORMAL @ T[:3, 3])


def depth_from(T: Float) -> Float:
    """z of the plane along the pixels' rays from the moved camera, exact."""
    return plane_depth(RAYS, *moved_plane(T))


@pytest.mark.parametrize("axis", range(6))
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_camera_that_sits_otherwise_sees_the_plane_from_there(axis: int, sign: float) -> None:
    xi = np.zeros(6)
    xi[axis] = sign * 1e-3
    exact = depth_from(se3.exp(xi)) - depth_from(np.eye(4))
    bias = HandEye(**dict(zip(HandEye.LINEAR, xi.tolist(), strict=True))).bias(plane_frame())
    np.testing.assert_allclose(bias, exact, atol=0.01 * np.abs(exact).max())


@pytest.mark.parametrize("delay_s", [0.01, -0.02])
def test_a_late_stamp_sees_the_plane_from_where_the_camera_will_be(delay_s: float) -> None:
    twist = np.array([0.05, -0.08, 0.1, 0.03, -0.05, 0.2])
    exact = depth_from(se3.exp(delay_s * twist)) - depth_from(np.eye(4))
    bias = TimeSync(delay_s=delay_s).bias(plane_frame(Context(twist=twist)))
    np.testing.assert_allclose(bias, exact, atol=0.03 * np.abs(exact).max())


@pytest.mark.parametrize("axis", range(6))
def test_a_part_that_stands_otherwise_is_seen_where_it_stands(axis: int) -> None:
    values, centre = np.zeros(9), np.array([0.05, -0.02, 0.9])
    values[axis] = 1e-3
    R, t = se3.so3_exp(values[3:6]), values[:3]
    normal = R @ NORMAL
    exact = plane_depth(RAYS, normal, normal @ (R @ (NORMAL * OFFSET - centre) + centre + t)) - depth_from(np.eye(4))
    bias = CadDeviation(values=tuple(values.tolist()), part=0, centre=tuple(centre.tolist())).bias(plane_frame())
    np.testing.assert_allclose(bias, exact, atol=0.01 * np.abs(exact).max())


def test_a_bow_grows_with_the_square_of_the_distance_along_the_normal() -> None:
    frame = plane_frame()
    centre, half = np.array([0.0, 0.0, OFFSET / NORMAL[2]]), 0.2
    for k in range(3):
        values = np.zeros(9)
        values[6 + k] = 1e-3
        bow = CadDeviation(
            values=tuple(values.tolist()), part=0, centre=tuple(centre.tolist()), normal=tuple(NORMAL.tolist()), half_size_m=half
        )
        along = np.cross(NORMAL, np.eye(3)[1])  # the axis that is farthest from the normal is y here
        along /= np.linalg.norm(along)
        arm = frame.points - centre
        u, v = arm @ along / half, arm @ np.cross(NORMAL, along) / half
        np.testing.assert_allclose(bow.bias(frame), 1e-3 * (u * u, v * v, u * v)[k] / (RAYS @ NORMAL), atol=2e-5)


def test_the_image_flows_as_points_move_over_it() -> None:
    twist = np.array([0.05, -0.08, 0.1, 0.03, -0.05, 0.2])
    frame, dt = plane_frame(Context(twist=twist)), 1e-5
    points = frame.points @ se3.inverse(se3.exp(dt * twist))[:3, :3].T + se3.inverse(se3.exp(dt * twist))[:3, 3]
    u = CAMERA.fx * points[..., 0] / points[..., 2] + CAMERA.cx
    v = CAMERA.fy * points[..., 1] / points[..., 2] + CAMERA.cy
    row, column = np.mgrid[: CAMERA.height, : CAMERA.width]
    along_u, along_v = image_flow(frame)
    assert np.abs(along_u).max() > 3.0
    np.testing.assert_allclose(along_u, (u - column) / dt, atol=0.02)
    np.testing.assert_allclose(along_v, (v - row) / dt, atol=0.02)


def four_taps(twist: Float, tap_s: float, mhz: float, order: tuple[int, int, int, int], steady: float, beyond: float = 0.0) -> Float:
    """Metres along the ray that four exposures of an even plane err by, each rendered from where the camera then is.

    The taps' phase is that of the distance and `beyond` radians.
    """
    wave = 4 * np.pi * mhz * 1e6 / C
    taps = np.zeros((4, *CAMERA.shape))
    for place, quarter in enumerate(order):
        T = se3.exp((place - 1.5) * tap_s * twist)
        normal, _ = moved_plane(T)
        radial = depth_from(T) * LENGTH
        light = -(RAYS @ normal) / LENGTH / radial**2
        taps[quarter] = light * (steady + np.cos(wave * radial + beyond - quarter * np.pi / 2))
    phase = np.arctan2(taps[1] - taps[3], taps[0] - taps[2])
    own = wave * depth_from(np.eye(4)) * LENGTH + beyond
    return np.asarray(np.angle(np.exp(1j * (phase - own))) / wave)


@pytest.mark.parametrize("opposite_first", [False, True])
@pytest.mark.parametrize(("tap_s", "mhz"), [(0.01, 60.0), (0.02, 60.0), (0.01, 20.0)])
@pytest.mark.parametrize("twist", [(0, 0, 0.1, 0, 0, 0), (0.06, 0.04, -0.1, 0, 0, 0)])
def test_taps_err_as_four_exposures_one_after_another_do(twist: tuple[float, ...], tap_s: float, mhz: float, opposite_first: bool) -> None:  # noqa: FBT001
    order = (0, 2, 1, 3) if opposite_first else (0, 1, 2, 3)
    frame = plane_frame(Context(twist=np.array(twist)))
    for steady in (0.0, 2.0):
        exact = four_taps(np.array(twist), tap_s, mhz, order, steady)
        taps = Motion(edge=1.0, steady=steady, tap_s=tap_s, modulation_mhz=mhz, opposite_first=opposite_first)
        assert np.abs(exact[INSIDE]).max() > 2e-6
        np.testing.assert_allclose((taps.bias(frame) * LENGTH)[INSIDE], exact[INSIDE], atol=0.06 * np.abs(exact[INSIDE]).max())


@pytest.mark.parametrize("beyond", [0.4, 1.2, 2.9])
def test_taps_err_by_twice_their_phase_whatever_constant_the_factory_took_off(beyond: float) -> None:
    twist = np.array([0.06, 0.04, -0.1, 0.0, 0.0, 0.0])
    exact = four_taps(twist, 0.01, 60.0, (0, 1, 2, 3), 0.0, beyond)
    taps = Motion(edge=np.cos(2 * beyond), turned=np.sin(2 * beyond), tap_s=0.01, modulation_mhz=60.0)
    bias = taps.bias(plane_frame(Context(twist=twist))) * LENGTH
    np.testing.assert_allclose(bias[INSIDE], exact[INSIDE], atol=0.06 * np.abs(exact[INSIDE]).max())


def test_an_edge_that_passes_errs_to_the_side_that_the_taps_saw() -> None:
    """One pixel beside a step of albedo, the image shifted by whole pixels between taps: each tap is known by hand."""
    still = plane_frame()
    albedo = still.rendering.albedo.copy()
    albedo[:, 20:] *= 0.3
    frame = ideal_frame(replace(still.rendering, albedo=albedo), Context(twist=np.array([0, 0, 0, 0, 0.2, 0])))
    along_u, _ = image_flow(frame)
    assert along_u[15, 20] < 0, "the camera turns to the right of its picture, which moves to the left"
    tap_s = 2.0 / abs(along_u[15, 20])  # the taps see columns -3, -1, 1, 3 from here
    bias = Motion(edge=1.0, steady=1.0, tap_s=tap_s).bias(frame)[15, 18:22] * LENGTH[15, 18:22]
    wave = 4 * np.pi * 60e6 / C
    for column, error in zip(range(18, 22), bias, strict=True):
        light = [still.amplitude[15, column + d] * (0.3 if column + d >= 20 else 1.0) for d in (-3, -1, 1, 3)]
        phase = wave * still.radial[15, column]
        taps = [a * (1 + np.cos(phase - k * np.pi / 2)) for k, a in enumerate(light)]
        exact = np.angle(np.exp(1j * (np.arctan2(taps[1] - taps[3], taps[0] - taps[2]) - phase))) / wave
        assert error == pytest.approx(exact, abs=0.15 * 0.3)


def corner() -> tuple[Raycaster, Float]:
    """Two plates of albedo 0.5 that meet in a right angle along x, and a camera that looks at the floor of it."""
    floor, wall = box("floor", (1.0, 1.0, 0.02), np.eye(4)), np.eye(4)
    wall[:3, 3] = 0.0, 0.51, 0.5
    looks = np.eye(4)
    looks[:3, :3] = np.column_stack([[1, 0, 0], [0, -0.6, -0.8], [0, 0.8, -0.6]])
    looks[:3, 3] = 0.0, -0.55, 0.75
    return Raycaster(scene_of(floor, box("wall", (1.0, 0.02, 1.0), wall))), looks


@pytest.mark.parametrize("mhz", [20.0, 60.0])
def test_multipath_in_a_corner_is_the_sum_over_the_other_plate(mhz: float) -> None:
    """One bounce by the rendering equation, summed over a fine raster of the wall for pixels of the floor; later ones vanish at albedo 0.02."""
    caster, T = corner()
    albedo = 0.02
    frame = ideal_frame(render(caster, CAMERA, T), Context(caster=caster, albedo=np.full(2, albedo)))
    bias = Multipath(strength=1.0, modulation_mhz=mhz).bias(frame) * LENGTH
    points = frame.points @ T[:3, :3].T + T[:3, 3]
    n = 200
    x, z = np.meshgrid((np.arange(n) + 0.5) / n - 0.5, (np.arange(n) + 0.5) / n, indexing="ij")
    wall = np.stack([x.ravel(), np.full(n * n, 0.5), z.ravel()], axis=-1)
    seen = (wall - T[:3, 3]) @ T[:3, :3]
    lit_field = 1.3 * 0.5 * np.array([CAMERA.width / CAMERA.fx, CAMERA.height / CAMERA.fy])  # the lamp lights a little more than the image
    wall = wall[(wall[:, 2] > 0.01) & (np.abs(seen[:, :2] / seen[:, 2:]) < lit_field).all(axis=1)]
    to_lamp = T[:3, 3] - wall
    r_wall = np.linalg.norm(to_lamp, axis=1)
    lit = (to_lamp @ [0, -1, 0]) / r_wall**3
    checked = []
    for row, column in np.argwhere(np.abs(points[..., 2] - 0.01) < 1e-4):
        p = points[row, column]
        if not (abs(p[0]) < 0.3 and 0.1 < 0.5 - p[1] < 0.5):
            continue
        way = wall - p
        d = np.linalg.norm(way, axis=1)
        spread = albedo / np.pi * lit * np.maximum(way[:, 2], 0) * np.maximum(way[:, 1], 0) / d**4 / n**2
        r = frame.radial[row, column]
        direct = (T[2, 3] - p[2]) / r**3
        phase = 2 * np.pi * mhz * 1e6 / C * (r_wall + d - r)
        exact = C / (4 * np.pi * mhz * 1e6) * np.angle(1 + (spread * np.exp(1j * phase)).sum() / direct)
        checked.append((bias[row, column], exact))
    ours, exact = np.array(checked).T
    assert len(ours) > 20
    assert exact.min() > 4e-5, "light that bounces arrives late"
    assert np.median(ours / exact) == pytest.approx(1.0, abs=0.1)
    np.testing.assert_allclose(ours, exact, rtol=0.35)


def test_white_plates_add_later_bounces() -> None:
    """Ten times the albedo gives ten times the first bounce and a hundred times the second."""
    caster, T = corner()

    def bias(albedo: float) -> Float:
        frame = ideal_frame(render(caster, CAMERA, T), Context(caster=caster, albedo=np.full(2, albedo)))
        return Multipath(strength=1.0).bias(frame)[frame.valid]

    more = np.median(bias(0.8)) / np.median(bias(0.08))
    assert 11.0 < more < 25.0


def test_a_round_part_is_lit_by_what_it_stands_on() -> None:
    """Depth averaged over a pixel's footprint lies under the surface of a sphere: its own shadow there must not count."""
    ball = Part("ball", *moved(sphere(0.1), (0.0, 0.0, 0.11)), Material(0.5))
    caster, T = Raycaster(scene_of(box("floor", (1.0, 1.0, 0.02), np.eye(4)), ball)), corner()[1]
    frame = ideal_frame(render(caster, CAMERA, T), Context(caster=caster))
    bias = Multipath(strength=1.0).bias(frame)
    flank = (frame.rendering.part == 1) & (np.abs((frame.rendering.normal @ T[:3, :3].T)[..., 2]) < 0.3)
    assert flank.sum() > 5
    assert np.median(bias[flank]) > 1e-3


def test_a_mixture_is_the_phase_of_the_sum_of_both_returns() -> None:
    wave = 4 * np.pi * 100e6 / C
    for share, light, step in ((0.3, 1.0, 0.1), (0.3, 0.25, 0.1), (0.6, 0.5, -0.15), (0.5, 2.0, 0.3)):
        edge = Edge((np.array([0]), np.array([0])), np.array([share]), np.array([light]), np.array([step]), np.array([1.25]))
        exact = np.angle((1 - share) + share * light * np.exp(1j * wave * step)) / wave
        assert FlyingPixels(modulation_mhz=100.0).mixture(edge)[0] == pytest.approx(exact / 1.25, rel=1e-6)


def test_scattered_light_pulls_by_its_share_and_phase() -> None:
    """A veil over the whole image from a bright half: to first order s (A' / A) sin(w (r' - r)) / w."""
    amplitude = np.ones(CAMERA.shape)
    frame = plane_frame(amplitude=amplitude)
    wave = 4 * np.pi * 60e6 / C
    veil = LensScatter(veil=0.02, modulation_mhz=60.0)
    sigma = 0.8 * CAMERA.width
    row, column = np.mgrid[: CAMERA.height, : CAMERA.width]
    exact = np.zeros(CAMERA.shape)
    for v, u in ((15, 5), (15, 35), (3, 20), (26, 20)):
        weight = np.exp(-((row - v) ** 2 + (column - u) ** 2) / (2 * sigma**2)) / (2 * np.pi * sigma**2)
        light = (weight * np.exp(1j * wave * (frame.radial - frame.radial[v, u]))).sum()
        exact[v, u] = 0.02 * light.imag / wave
        assert veil.bias(frame)[v, u] * LENGTH[v, u] == pytest.approx(exact[v, u], abs=0.15 * 2e-5 + 0.15 * abs(exact[v, u]))


def test_wiggling_has_sine_and_cosine_of_range() -> None:
    frame = plane_frame()
    phase = 2 * np.pi * frame.radial / (C / (8 * 100e6))
    for wiggle, wave in ((Wiggling(sine_m=0.003), np.sin), (Wiggling(cosine_m=0.003), np.cos)):
        np.testing.assert_allclose(wiggle.bias(frame) * frame.length, 0.003 * wave(phase), atol=1e-7)


def test_a_wiggle_runs_ahead_over_the_columns_and_rows() -> None:
    frame, period = plane_frame(), C / (8 * 100e6)
    u = (np.arange(CAMERA.width) - CAMERA.cx) / CAMERA.width
    v = (np.arange(CAMERA.height) - CAMERA.cy) / CAMERA.height
    skewed = Wiggling(sine_m=0.003, across_m=0.04, down_m=-0.02).bias(frame) * frame.length
    ahead = 0.04 * u[None, :] - 0.02 * v[:, None]
    np.testing.assert_allclose(skewed, 0.003 * np.sin(2 * np.pi * (frame.radial + ahead) / period), atol=1e-7)


def test_gloss_shares_the_pixel_with_matt_light() -> None:
    """Peak as bright as an albedo of 0.5 before a matt 0.5: half of the bias straight on, 0.5 / e of 0.5 / e + 0.5 cos 8 degrees at the lobe."""
    frame = plane_frame()
    bias = Specular(bias_m=-0.01, lobe_deg=8.0).bias(frame) * frame.length
    angle = np.degrees(frame.rendering.incidence)
    for at, size in ((0.0, -0.005), (8.0, -0.00271), (30.0, 0.0)):
        assert bias.ravel()[np.abs(angle - at).argmin()] == pytest.approx(size, abs=2e-4)


def test_codes_are_the_nearest_ones() -> None:
    frame = plane_frame()
    coded = Quantization(step_m=0.005).apply(frame, np.random.default_rng(0)).depth
    np.testing.assert_allclose(coded, 0.005 * np.round(frame.depth / 0.005), atol=1e-9)


@pytest.mark.parametrize(
    ("light", "random", "lost"), [(2.0, 0.0, 0.5), (4.0, 0.0, 1 / 65), (1.0, 0.0, 64 / 65), (4.0, 0.2, 0.2 + 0.8 / 65)]
)
def test_dropout_follows_its_law(light: float, random: float, lost: float) -> None:
    frame = plane_frame(amplitude=np.full(CAMERA.shape, light))
    out = Dropout(threshold=2.0, steepness=6.0, random=random).apply(frame, np.random.default_rng(0))
    np.testing.assert_allclose(out.missing, lost, rtol=1e-9)
    n = out.depth.size
    assert abs(np.isnan(out.depth).sum() - n * lost) < 4 * np.sqrt(n * lost * (1 - lost)) + 1


def test_noise_adds_in_squares() -> None:
    frame = replace(plane_frame(), sigma=np.full(CAMERA.shape, 0.004))
    noisy = Noise(extra_m=0.003).apply(frame, np.random.default_rng(0))
    np.testing.assert_allclose(noisy.sigma, 0.005, rtol=1e-9)
    drawn = noisy.depth - frame.depth
    assert drawn.std() == pytest.approx(0.003, rel=0.08)
    assert abs(drawn.mean()) < 4 * 0.003 / np.sqrt(drawn.size)


def test_interference_is_as_large_as_it_says_and_larger_where_light_is_weak() -> None:
    rng = np.random.default_rng(1)
    for light, size in ((1.0, 0.01), (2.0, 0.005)):
        frame = plane_frame(amplitude=np.full(CAMERA.shape, light))
        burst = Interference(burst_m=0.01, duty=1.0, reference=1.0)
        spread = [((burst.apply(frame, rng).depth - frame.depth) * LENGTH).std() for _ in range(40)]
        assert np.median(spread) == pytest.approx(size, rel=0.1)
