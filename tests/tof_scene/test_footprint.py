# SPDX-License-Identifier: Apache-2.0
"""Footprints: shares and means over each pixel, against closed forms and against rays cast at 64 x 64 points a pixel."""

from __future__ import annotations

import numpy as np
import pytest

from tests.tof_scene.solids import ball, block, camera, looking, scene, wall
from tof_scene.builtin import make_builtin
from tof_scene.builtin.shapes import join, sheet
from tof_scene.raycast import Raycaster
from tof_scene.render import render

FRONT = looking((1.0, 0.0, 0.0), (0.0, 0.0, 0.0))


def edge_scene(y: float) -> Raycaster:
    """A thin plate at x = 0 that ends at y, before a wall at x = -0.5."""
    return Raycaster(scene(wall=wall(-0.5), plate=block(-5e-4, y - 1.0, 0, (1e-3, 2.0, 1.0))))


@pytest.mark.parametrize("share", [0.03, 0.25, 0.49, 0.7, 0.98])
def test_a_straight_edge_divides_its_pixels_in_the_exact_proportion(share: float) -> None:
    cam = camera(40, 30)
    column = 23
    y = (column - 0.5 + share - cam.cx) / cam.fx  # image right is +y seen from +x
    view = render(edge_scene(y), cam, FRONT)
    inside = view.mixed[12:18, column]
    assert inside == pytest.approx(min(share, 1 - share), abs=0.004)
    first, second = (1.0, 1.5) if share > 0.5 else (1.5, 1.0)
    assert np.allclose(view.depth[12:18, column], first, atol=1e-5)
    assert np.allclose(view.second[12:18, column], second, atol=1e-5)
    assert (view.part[12:18, column] == (1 if share > 0.5 else 0)).all()
    assert (view.mixed[12:18, [column - 1, column + 1]] == 0).all()


def test_a_slanted_edge_matches_the_area_it_cuts_off() -> None:
    cam, slope = camera(40, 30), 0.37
    corners = np.array([[0, -3, -3.0], [0, -3 * slope, -3], [0, 3 * slope, 3], [0, -3, 3]])
    view = render(Raycaster(scene(wall=wall(-0.5), plate=(corners, np.array([[0, 1, 2], [0, 2, 3]])))), cam, FRONT)
    fine = np.asarray(cam.scaled(64).rays()[..., 0] + slope * cam.scaled(64).rays()[..., 1] < 0)
    cover = fine.reshape(30, 64, 40, 64).mean(axis=(1, 3))
    error = view.mixed - np.minimum(cover, 1 - cover)
    assert (np.minimum(cover, 1 - cover) > 0.01).sum() > 30
    assert np.sqrt(np.mean(error[cover % 1 > 0] ** 2)) < 0.005


def test_a_wire_thinner_than_a_pixel_is_not_lost() -> None:
    """0.2 pixels wide, between the pixels' centres for its whole length."""
    cam = camera(40, 30)
    y = (20.4 - cam.cx) / cam.fx
    wire = block(0.0, y, 0.0, (1e-4, 0.2 / cam.fx, 1.0))
    view = render(Raycaster(scene(wall=wall(-0.5), wire=wire)), cam, FRONT)
    centre = render(Raycaster(scene(wall=wall(-0.5), wire=wire)), cam, FRONT, footprints=False)
    assert (centre.part == 0).all()
    assert view.mixed[10:20, 20] == pytest.approx(0.2, abs=0.01)
    assert view.second[10:20, 20] == pytest.approx(1.0, abs=1e-3)


def test_a_hole_smaller_than_a_pixel_is_not_lost() -> None:
    cam = camera(40, 30)
    radius = 0.35 / cam.fx
    at = np.array([(20.45 - cam.cx) / cam.fx, (14.55 - cam.cy) / cam.fy])
    plate = sheet(
        (0.4, 0.4),
        (21, 21),
        1e-4,
        lambda uv: np.stack([np.zeros(len(uv)), uv[:, 0] - 0.2, uv[:, 1] - 0.2], 1),
        [(0.2 + at[0], 0.2 - at[1], radius)],
    )
    view = render(Raycaster(scene(wall=wall(-0.5), plate=plate)), cam, FRONT)
    around = view.mixed[13:17, 19:23]
    assert around.sum() == pytest.approx(np.pi * 0.35**2, abs=0.03)


def test_steps_within_one_part_are_two_surfaces_and_creases_are_one() -> None:
    cam = camera(40, 30)
    y = (20.2 - cam.cx) / cam.fx
    stair = Raycaster(scene(stair=join(block(-0.05, y - 1.0, 0, (0.1, 2.0, 1.0)), block(-0.1, y + 1.0, 0, (0.1, 2.0, 1.0)))))
    view = render(stair, cam, FRONT)
    assert view.mixed[15, 20] == pytest.approx(0.3, abs=0.02)
    assert view.second[15, 20] - view.depth[15, 20] == pytest.approx(0.05, abs=1e-4)
    roof = Raycaster(
        scene(
            roof=(
                np.array([[0, 0, -1.0], [0, 0, 1], [-0.5, 1, 1], [-0.5, 1, -1], [-0.5, -1, 1], [-0.5, -1, -1]]),
                np.array([[0, 2, 1], [0, 3, 2], [0, 1, 4], [0, 4, 5]]),
            )
        )
    )
    assert (render(roof, cam, FRONT).mixed == 0).all()


def test_the_larger_surface_gives_the_depth_and_void_is_no_second_surface() -> None:
    cam = camera(40, 30)
    for share in (0.3, 0.8):
        y = (20 - 0.5 + share - cam.cx) / cam.fx
        view = render(Raycaster(scene(plate=block(-5e-4, y - 1.0, 0, (1e-3, 2.0, 1.0)))), cam, FRONT)
        assert np.isnan(view.depth[15, 20]) == (share < 0.5)
        assert view.part[15, 20] == (0 if share > 0.5 else -1)
        assert view.mixed[15, 20] == 0
        assert np.isnan(view.second[15, 20])


def test_every_field_belongs_to_the_surface_that_fills_most() -> None:
    cam = camera(40, 30)
    y = (20.3 - cam.cx) / cam.fx  # the plate covers the centre's side: 80 % of column 20
    view = render(edge_scene(y), cam, FRONT)
    assert view.part[15, 20] == 1
    assert view.albedo[15, 20] == pytest.approx(0.2)
    y = (20.1 - 0.5 - cam.cx) / cam.fx
    view = render(edge_scene(y), cam, FRONT)
    assert (view.part[15, 20], view.mixed[15, 20] > 0.05) == (0, True)
    assert view.albedo[15, 20] == pytest.approx(0.1)


@pytest.mark.parametrize("name", ["body_section", "pipework"])
def test_a_whole_scene_agrees_with_rays_through_sixteen_by_sixteen_points(name: str) -> None:
    caster, cam, T = Raycaster(make_builtin(name)), camera(100, 75), looking((0.9, -0.2, 1.0), (0, 0, 0.8))
    view = render(caster, cam, T)
    fine = render(caster, cam.scaled(16), T, footprints=False)
    depth, part = (a.reshape(75, 16, 100, 16).transpose(0, 2, 1, 3).reshape(75, 100, 256) for a in (fine.depth, fine.part))
    gap = np.diff(np.sort(depth, axis=-1), axis=-1).max(axis=-1)
    interior = (part == part[..., :1]).all(-1) & (part[..., 0] >= 0) & (gap < 1e-3)
    error = np.abs(view.depth - depth.mean(-1))[interior]
    assert interior.mean() > 0.6
    assert np.quantile(error, 0.999) < 1e-4  # pixels are four times as large here as in the bench, creases bend four times as far
    assert np.sqrt(np.mean(error**2)) < 2e-5
    lost = (view.mixed == 0) & (np.sort(part, axis=-1)[..., 8] != np.sort(part, axis=-1)[..., -9])
    assert lost.mean() < 2e-3


def test_a_dense_mesh_far_away_is_counted_right() -> None:
    """Hundreds of triangles a pixel."""
    cam = camera(24, 18, 20)
    view = render(Raycaster(scene(wall=wall(-0.5), ball=ball(0.08, 400))), cam, looking((6.0, 0.0, 0.0), (0, 0, 0)))
    area = (view.part == 1) * (1 - view.mixed) + (view.part != 1) * (np.abs(view.second - 5.95) < 0.2) * view.mixed
    seen = np.pi * np.tan(np.arcsin(0.08 / 6)) ** 2 * cam.fx**2
    assert np.nansum(area) == pytest.approx(seen, rel=0.03)
