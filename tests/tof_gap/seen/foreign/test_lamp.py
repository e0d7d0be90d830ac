# SPDX-License-Identifier: Apache-2.0
"""Another camera's lamp: its fringes in the views say where it stands."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.tof_gap.quiet_views import SHAPE, VIEWS, views
from tof_core import se3
from tof_gap.limits.foreign import ForeignLampLimits, ForeignLightLimits
from tof_gap.seen.foreign import lamp as room
from tof_gap.seen.foreign.lamp import ForeignLamp, foreign_lamp, reached
from tof_gap.seen.foreign.lamp_cells import beside_common, beside_loudest_part, beside_pose, cells_of
from tof_scene.builtin.shapes import box
from tof_scene.raycast import Raycaster
from tof_scene.scene import Part, Scene
from tof_sensor.effects.interference import Interference
from tof_sensor.frame import LIGHT_M_PER_S
from tof_sensor.geometry import pose_columns

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_gap.seen.evidence.view import ViewEvidence

LIMITS = ForeignLampLimits()
IN_CELL, ON_HAND = np.array([1.0, -0.8, -0.3]), np.array([0.4, -0.4, 0.4])
"""Metres in the cell, and in the camera's frame."""
MHZ = 100.0


def plate_at(place: Float) -> Raycaster:
    """A square plate of 40 cm about a place in the cell, perpendicular to the x axis."""
    corners, faces = box((0.02, 0.4, 0.4))
    return Raycaster(Scene("cell", (Part("plate", corners + place, faces),)))


NOTHING = plate_at(np.array([0.0, 0.0, -50.0]))
"""A scene that casts no shadow on what the views see."""


def poses() -> Float:
    """(V, 4, 4): cameras that look from a metre of places."""
    rng = np.random.default_rng(7)
    return np.stack([se3.exp(np.concatenate([rng.uniform(-0.5, 0.5, 3), rng.uniform(-0.4, 0.4, 3)])) for _ in range(VIEWS)])


def noisy(errors: Float) -> list[ViewEvidence]:
    """Views from `poses`, with errors (V, H, W) metres along the ray and noise of 1 mm."""
    noise = np.random.default_rng(2).normal(0, 1e-3, errors.shape)
    seen = views(np.random.default_rng(1), errors + noise, photons=False)
    return [
        replace(v, frame=replace(v.frame, rendering=replace(v.frame.rendering, T_cell_camera=T)))
        for v, T in zip(seen, poses(), strict=True)
    ]


def lit(strength: Float, *, on_hand: bool = False, at_m: Float = ON_HAND, caster: Raycaster = NOTHING) -> list[ViewEvidence]:
    """Views with light of another lamp, strength (V,) metres where own and foreign way are alike, with a phase of its own in each; `caster` casts shadows."""
    T = poses()
    quiet = noisy(np.zeros((VIEWS, *SHAPE)))
    turns = np.random.default_rng(4).uniform(0, 2 * np.pi, VIEWS)
    errors = []
    for seen, t, size, turn in zip(quiet, T, strength, turns, strict=True):
        lamp = at_m if on_hand else np.linalg.inv(t)[:3] @ [*IN_CELL, 1.0]
        way = lamp - seen.frame.points
        d, r = np.linalg.norm(way, axis=-1), seen.frame.radial
        facing = np.maximum(np.einsum("hwi,hwi->hw", way, seen.frame.rendering.normal) / d, 0)
        ratio = facing * r**2 / (d**2 * np.cos(seen.frame.rendering.incidence))
        points, normals = (a.reshape(-1, 3) @ t[:3, :3].T for a in (seen.frame.points, seen.frame.rendering.normal))
        ratio = ratio * reached(points + t[:3, 3], normals, IN_CELL[None], caster)[0].reshape(SHAPE)
        errors.append(size * ratio * np.cos(2e6 * np.pi * MHZ / LIGHT_M_PER_S * (d - r) + turn))
    return noisy(np.stack(errors))


def found_in(seen: list[ViewEvidence], caster: Raycaster = NOTHING) -> ForeignLamp:
    found = foreign_lamp(seen, caster, LIMITS)
    assert found is not None
    return found


def test_a_lamp_in_the_cell_is_found_where_it_stands() -> None:
    found = found_in(lit(np.full(VIEWS, 0.01)))
    assert not found.on_hand
    assert np.linalg.norm(found.at_m - IN_CELL) < 1.0
    assert "in the cell, within a metre of" in found.stated
    assert found.mhz == MHZ
    assert found.share > 0.6


def test_parts_of_the_scene_cast_shadows_in_its_light() -> None:
    plate = plate_at(IN_CELL + 0.8 * (np.array([0.0, 0.0, 0.9]) - IN_CELL))
    seen = lit(np.full(VIEWS, 0.01), caster=plate)
    dark = [v.residual for v in lit(np.full(VIEWS, 0.01))]
    assert 0.1 < np.mean([np.abs(v.residual - d) > 1e-4 for v, d in zip(seen, dark, strict=True)]) < 0.9, (
        "the plate shades a part of the views"
    )
    found, without = found_in(seen, plate), foreign_lamp(seen, NOTHING, LIMITS)
    assert np.linalg.norm(found.at_m - IN_CELL) < 1.0
    assert found.share > 0.6
    assert without is None or without.share < found.share - 0.1


def test_a_lamp_that_rides_on_the_hand_is_told_from_one_in_the_cell() -> None:
    found = found_in(lit(np.full(VIEWS, 0.01), on_hand=True))
    assert found.on_hand
    np.testing.assert_allclose(found.at_m, ON_HAND, atol=0.21)
    assert "on the camera's hand" in found.stated


def test_a_lamp_that_would_be_seen_in_every_image_is_none() -> None:
    assert foreign_lamp(lit(np.full(VIEWS, 0.01), on_hand=True, at_m=np.array([0.0, 0.0, 0.2])), NOTHING, LIMITS) is None


def test_views_that_its_light_does_not_reach_are_not_hit() -> None:
    strength = np.where(np.arange(VIEWS) % 2 == 0, 0.01, 0.0)
    found = found_in(lit(strength, on_hand=True))
    assert found.hit.tolist() == (strength > 0).tolist()
    assert not found.fields[1::2].any()


def test_its_light_is_interference_by_its_size_in_the_views_it_reaches() -> None:
    seen = lit(np.full(VIEWS, 0.01))
    lamp = found_in(seen)
    finding = lamp.finding(seen, ForeignLightLimits())
    added = np.stack([v.residual for v in seen]) - np.stack([v.residual for v in lit(np.zeros(VIEWS))])
    smooth = np.stack([v.smooth for v in seen])
    assert finding.effect.burst_m == pytest.approx(np.std(added[smooth]), rel=0.25)  # type: ignore[attr-defined]
    assert finding.effect.duty == lamp.hit.mean()  # type: ignore[attr-defined]
    assert finding.common is not None
    left = (added - finding.common)[smooth]
    assert np.sqrt(np.mean(left**2)) < 0.4 * np.std(added[smooth]), "a place half a metre off leaves a sixth of the energy at most"


def test_its_size_is_that_of_one_capture_and_with_what_poses_absorbed() -> None:
    seen = lit(np.full(VIEWS, 0.01))
    lamp, limits = found_in(seen), ForeignLightLimits()
    one = lamp.finding(seen, limits).effect
    of_four = [replace(v, view=replace(v.view, captures=4)) for v in seen]
    assert isinstance(one, Interference)
    absorbed, each = lamp.finding(seen, limits, posed_m=0.02), lamp.finding(of_four, limits).effect
    assert isinstance(absorbed.effect, Interference)
    assert isinstance(each, Interference)
    assert each.burst_m == pytest.approx(2.0 * one.burst_m)
    assert absorbed.effect.burst_m == pytest.approx(np.hypot(one.burst_m, 0.02))
    assert absorbed.posed_m == 0.02


def patches() -> Float:
    """(V, H, W) metres along the ray: bumps at places of their own in every view, a sixth of the image wide."""
    rng = np.random.default_rng(5)
    row, column = np.mgrid[: SHAPE[0], : SHAPE[1]]
    out = np.zeros((VIEWS, *SHAPE))
    for v in range(VIEWS):
        for _ in range(6):
            y, x = rng.uniform(0, SHAPE[0]), rng.uniform(0, SHAPE[1])
            out[v] += 0.01 * rng.choice([-1, 1]) * np.exp(-((row - y) ** 2 + (column - x) ** 2) / (2 * 9.0**2))
    return out


def own_light(*, albedo: bool = False, across: float = 0.0) -> Float:
    """(V, H, W) metres along the ray: lamp light that the camera's own cover glass throws onto the sensor, the same in every view.

    `albedo`: relative to the light of surfaces of different albedo; `across`: change of its strength from the middle column to the last.
    """
    frames = [v.frame for v in noisy(np.zeros((VIEWS, *SHAPE)))]
    wave = 4e6 * np.pi * MHZ / LIGHT_M_PER_S
    weak = [2000.0 / f.amplitude if albedo else f.radial**2 / np.cos(f.rendering.incidence) for f in frames]
    slope = 1.0 + across * np.linspace(-1.0, 1.0, SHAPE[1])
    return np.stack([0.01 * slope * w * np.sin(wave * f.radial) for w, f in zip(weak, frames, strict=True)])


def ghost() -> Float:
    """(V, H, W) metres along the ray: light of the surface opposite the middle of the image, reflected twice in the lens."""
    frames = [v.frame for v in noisy(np.zeros((VIEWS, *SHAPE)))]
    wave = 4e6 * np.pi * MHZ / LIGHT_M_PER_S
    opposite = np.s_[::-1, ::-1]
    return np.stack([0.02 * f.amplitude[opposite] / f.amplitude * np.sin(wave * (f.radial[opposite] - f.radial)) for f in frames])


def pose_errors() -> Float:
    """(V, H, W) metres along the ray that poses off by 5 mm and 0.3 degrees along each axis make, in each view their own."""
    rng = np.random.default_rng(8)
    frames = [v.frame for v in noisy(np.zeros((VIEWS, *SHAPE)))]
    return np.stack([f.length * (pose_columns(f) @ rng.normal(0, [5e-3] * 3 + [5e-3] * 3)) for f in frames])


@pytest.mark.parametrize(
    "errors",
    [
        np.zeros((VIEWS, *SHAPE)),
        patches(),
        own_light(),
        own_light(albedo=True),
        own_light(albedo=True, across=0.5) + pose_errors(),
        ghost(),
    ],
    ids=["none", "patches", "own light", "own light, albedo", "own light that follows the column, and poses that follow it", "ghost image"],
)
def test_errors_that_no_lamp_makes_show_none(errors: Float) -> None:
    assert foreign_lamp(noisy(errors), NOTHING, LIMITS) is None


@pytest.mark.parametrize(
    ("at_m", "kept"), [(IN_CELL, True), (IN_CELL + np.array([-0.5, 2.0, 1.5]), False)], ids=["the same place", "another place"]
)
def test_a_lamp_must_stand_at_the_same_place_beside_what_all_views_share(
    monkeypatch: pytest.MonkeyPatch, at_m: Float, *, kept: bool
) -> None:
    """The first search finds a place of its own; the second one, beside what views share, finds the lamp."""
    first = iter([replace(room._search([cells_of(v, LIMITS) for v in lit(np.full(VIEWS, 0.01))], at_m[None], NOTHING), median=0.0)])
    usual = room._standing_out
    monkeypatch.setattr(room, "_standing_out", lambda *a: next(first, None) or usual(*a))
    assert (foreign_lamp(lit(np.full(VIEWS, 0.01)), NOTHING, LIMITS) is not None) == kept


def test_two_views_alone_may_be_another_kind_of_scene() -> None:
    assert foreign_lamp(lit(np.where(np.arange(VIEWS) < LIMITS.views - 1, 0.01, 0.0)), NOTHING, LIMITS) is None


@pytest.mark.parametrize(
    ("seen", "left"),
    [
        (noisy(own_light()), 0.0),
        (noisy(own_light(albedo=True)), 0.0),
        (noisy(own_light(albedo=True, across=0.5)), 0.0),
        (noisy(ghost()), 0.0),
        (lit(np.full(VIEWS, 0.01)), 1.0),
    ],
    ids=["own light", "own light, albedo", "own light that follows the column", "ghost image", "another lamp"],
)
def test_what_all_views_have_in_common_is_the_camera_s_own(seen: list[ViewEvidence], left: float) -> None:
    before = [beside_pose(c) for c in (cells_of(v, LIMITS) for v in seen) if c is not None]
    after = beside_common(before)
    chi2 = [sum(float(c.error @ c.error) for c in cells if c is not None) for cells in (before, after)]
    assert chi2[1] / chi2[0] == pytest.approx(left, abs=0.1)


def test_errors_of_pose_are_no_light() -> None:
    before = [cells_of(v, LIMITS) for v in noisy(pose_errors())]
    chi2 = [
        sum(float(c.error @ c.error) / len(c.error) for c in cells)
        for cells in ([c for c in before if c], [beside_pose(c) for c in before if c])
    ]
    assert chi2[1] < min(1.1 * VIEWS, chi2[0])


def test_waves_on_the_part_with_most_chi_square_may_be_its_shape() -> None:
    right = np.broadcast_to(np.arange(SHAPE[1]) > 0.7 * SHAPE[1], SHAPE)
    halves = [
        replace(v, frame=replace(v.frame, rendering=replace(v.rendering, part=right.astype(np.int16)))) for v in noisy(patches() * right)
    ]
    cells = [cells_of(v, LIMITS) for v in halves]
    others = beside_loudest_part(cells)
    for before, after in zip(cells, others, strict=True):
        assert before is not None
        assert after is not None
        assert not after.part.any()
        assert len(after.error) == np.count_nonzero(before.part == 0)
        np.testing.assert_allclose(after.smooth.T @ after.error, 0.0, atol=1e-9)
        assert after.error @ after.error < before.error @ before.error


def test_a_scene_of_one_part_is_judged_by_that_part() -> None:
    cells = [cells_of(v, LIMITS) for v in noisy(patches())]
    assert all(a is b for a, b in zip(beside_loudest_part(cells), cells, strict=True))


def test_a_second_part_that_no_view_shows_enough_of_is_no_other_part() -> None:
    corner = np.zeros(SHAPE, np.int16)
    corner[:6, :6] = 1
    seen = [replace(v, frame=replace(v.frame, rendering=replace(v.rendering, part=corner))) for v in noisy(patches())]
    cells = [cells_of(v, LIMITS) for v in seen]
    assert all(0 < np.count_nonzero(c.part) <= c.smooth.shape[1] for c in cells if c is not None)
    assert all(a is b for a, b in zip(beside_loudest_part(cells), cells, strict=True))
