# SPDX-License-Identifier: Apache-2.0
"""The signature of each effect on the path of the light, on noise-free frames."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tests.tof_virtual.made import bench, biases, looking, quad, session, wall
from tof_core.camera import Camera
from tof_virtual.config import VirtualConfig
from tof_virtual.effect import Effect, Moment
from tof_virtual.effects import make_effects
from tof_virtual.pipeline import expose
from tof_virtual.sight import World, look

if TYPE_CHECKING:
    from tof_virtual.body import Body

CAMERA = Camera(96, 72, 90.0, 90.0, 47.5, 35.5)


def moment(bodies: list[Body], x: float = 0.8, width: float = 1.0) -> Moment:
    """A camera that looks at bodies straight along -x from a distance."""
    world = World.of(bodies)
    sight = look(world, CAMERA.rays(), looking(x), width=width)
    return Moment(0, 0, 0.0, 40.0, world, VirtualConfig(), CAMERA, (sight,))


def effect(name: str, size: float) -> Effect:
    made = make_effects({name: 1.0}, VirtualConfig())[0]
    made.size = size
    return made


def test_flying_pixels_lie_between_the_surfaces_of_a_step() -> None:
    at_edge = moment([wall("near", x=0.15, half=0.1327), wall("far", half=0.8)])
    flying = effect("flying_pixels", 1.0)
    error = expose(at_edge, (flying,)).depth - at_edge.sight.z
    edge = np.zeros(error.size, bool)
    edge[at_edge.sight.edge] = True
    assert np.abs(error[~edge]).max() < 1e-12, "pixels that see one surface are untouched"
    near = at_edge.world.soup.body[at_edge.sight.main.face] == 0
    mixed = edge & (np.abs(error) > 1e-3)
    assert mixed.sum() > 20
    assert (error[mixed & near] > 0).all(), "the foreground is measured too far"
    assert (error[mixed & ~near] < 0).all(), "the background too near"
    assert (expose(at_edge, ()).depth - at_edge.sight.z)[edge].max() < 1e-9, "switched off, no pixel flies"


def test_a_wide_footprint_makes_more_pixels_fly() -> None:
    tilted = [[0.15, -0.1, 0.7], [0.15, 0.07, 0.65], [0.15, 0.1, 0.9], [0.15, -0.07, 0.95]]
    step = [quad("near", tilted), wall("far", half=0.8)]
    counts = []
    for width in (0.4, 1.0, 2.0):
        m = moment(step, width=width)
        counts.append(int((np.abs(expose(m, (effect("flying_pixels", width),)).depth - m.sight.z) > 1e-3).sum()))
    assert counts[0] < counts[1] < counts[2]


def test_multipath_is_nothing_on_a_lone_wall_and_positive_in_a_corner() -> None:
    lone = biases(session({"multipath": 1.0}, [wall(half=1.5)]), "multipath")
    assert np.nanmax(np.abs(lone)) == 0
    made = session({"multipath": 1.0}, camera__width=60, camera__height=44)
    error = biases(made, "multipath")
    assert np.nanpercentile(error, 1) > -1e-4
    parts = np.stack([made.nominal.soup.body[made.moment(i).sight.main.face] for i in range(4)])
    shelf = np.isfinite(error) & (parts == 3)
    assert np.mean(error[shelf]) > 5e-4, "shelf and wall light each other"


def test_lens_scatter_pulls_the_dark_background_toward_the_bright_foreground() -> None:
    bright = [wall("bright", x=0.35, half=0.12, albedo=0.8), wall("dark", x=0.0, half=1.2, albedo=0.06)]
    m = moment(bright)
    error = expose(m, (effect("lens_scatter", 0.02),)).depth - m.sight.z
    near = m.world.soup.body[m.sight.main.face] == 0
    v, u = np.divmod(np.arange(error.size), CAMERA.width)
    off = np.hypot(u - CAMERA.cx, v - CAMERA.cy)
    inner, outer = error[~near & (off < 35)], error[~near & (off > 48)]
    assert np.median(inner) < -2e-3
    assert np.median(outer) < 0
    assert abs(np.median(outer)) < abs(np.median(inner)), "the more, the nearer to the bright thing in the image"
    assert np.abs(error[near]).max() < 2e-3


def test_specular_highlight_sits_where_surface_and_camera_face_each_other() -> None:
    m = moment([wall(half=1.2)])
    shine = effect("specular", 0.004)
    plain, glossy = expose(m, ()), expose(m, (shine,))
    error = glossy.depth - plain.depth
    angle = np.degrees(np.arccos(m.sight.main.cosine))
    assert np.median(error[angle < 3]) < -5e-4, "a highlight is measured too near"
    assert np.abs(error[angle > 30]).max() < 0.2 * np.abs(error[angle < 3]).min()
    assert glossy.amplitude[angle < 3].mean() > 1.3 * plain.amplitude[angle < 3].mean()
    blinding = moment([wall(half=1.2, albedo=0.8)], x=0.45)
    assert expose(blinding, (shine,)).saturated.mean() > expose(blinding, ()).saturated.mean()


def test_subsurface_delays_one_part_alone() -> None:
    made = session({"subsurface": 1.0})
    error = biases(made, "subsurface")
    name = made.effects[0].params()["part"]
    parts = np.stack([made.nominal.soup.body[made.moment(i).sight.main.face] for i in range(4)])
    inside = parts == [b.name for b in bench()].index(name)
    assert np.nanmin(error[inside]) > 1e-3
    assert np.nanmax(np.abs(error[~inside])) == 0
