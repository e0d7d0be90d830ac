# SPDX-License-Identifier: Apache-2.0
"""The virtual robot: how fast it records, how true its camera is without effects, its multipath against path tracing."""

from __future__ import annotations

import shutil
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.figure import Figure, at_least, at_most
from tof_core.camera import Camera
from tof_core.config import from_mapping
from tof_scene.builtin import make_builtin
from tof_virtual.body import Body
from tof_virtual.config import VirtualConfig
from tof_virtual.effects import EFFECTS
from tof_virtual.indirect import irradiance
from tof_virtual.pipeline import expose
from tof_virtual.record import record
from tof_virtual.session import Session
from tof_virtual.sight import World, look
from toftwin.commands.simulate import bodies_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from tof_core.arrays import Float

PUBLISHED_MM = {0.3: (14.7, 17.3, 13.8), 0.6: (31.5, 35.9, 28.6), 0.9: (50.2, 56.2, 44.7)}
"""Path-traced 90 degree V at 100 MHz, 0.5 m walls, apex 1.2 m: medians 30..100, 100..200, 200..350 mm from the apex, by albedo."""


def run() -> list[Figure]:
    """Speed of each effect, truth of the null, multipath."""
    bodies = bodies_of(make_builtin("body_section"))
    record_case(bodies, {})  # compiles
    null = record_case(bodies, {})
    cases = {name: record_case(bodies, {name: 1.0}) for name in EFFECTS}
    slowest = max(cases, key=lambda name: cases[name])
    each = ", ".join(f"{name} {seconds:.1f}" for name, seconds in sorted(cases.items(), key=lambda c: -c[1]))
    bias, noise_m = null_camera(bodies)
    rays, peer = ray_rate(bodies)
    return [
        at_most("virtual: record 12 views 224x171, no effect, CPU of one core", null, 10, "s"),
        at_most("virtual: record 12 views 224x171, slowest effect, CPU of one core", cases[slowest], 10, "s", remark=each),
        at_most("virtual: record 20 views x 10 captures 400x300 with colour, CPU of one core", demo(bodies), 60, "s"),
        at_most(
            "virtual: mean error without effects, 200 frames",
            1e3 * abs(bias),
            0.05,
            "mm",
            remark=f"noise of one frame {1e3 * noise_m:.2f} mm (median)",
        ),
        at_most("virtual: multipath in a V corner against path tracing, worst bin", 100 * corner_error(), 15, "%"),
        at_least(
            "virtual: primary rays against embree's, one core, same run",
            rays / peer,
            0.5,
            "",
            remark=f"{rays / 1e6:.1f} million rays a second",
        ),
    ]


def record_case(bodies: list[Body], effects: dict[str, float], **settings: object) -> float:
    """CPU seconds to record one session, truth and writing included."""
    folder = Path(tempfile.mkdtemp(prefix="toftwin-virtual-"))
    try:
        started = time.process_time()
        record(bodies, folder / "bag", from_mapping(VirtualConfig, settings), effects=effects)
        return time.process_time() - started
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def demo(bodies: list[Body]) -> float:
    """The demonstration's session."""
    size = {"camera.width": 400, "camera.height": 300, "plan.views": 20, "plan.captures": 10, "output.colour": True}
    return record_case(bodies, {}, **size)


def null_camera(bodies: list[Body]) -> tuple[float, float]:
    """Mean error over frames and pixels, and the median noise of one frame, in metres."""
    session = Session(bodies, VirtualConfig(), {})
    photons = np.random.default_rng(0)
    moment = session.moment(1)
    error = np.stack([expose(moment, (), photons).depth for _ in range(200)]) - moment.sight.z
    always = np.isfinite(error).all(axis=0)
    return float(error[:, always].mean()), float(np.median(error[:, always].std(axis=0)))


def corner_error() -> float:
    """Largest relative deviation from the published medians."""
    worst = 0.0
    for albedo, published in PUBLISHED_MM.items():
        x, error = corner_bias(albedo)
        bins = [np.nanmedian(error[(x >= low) & (x < high)]) for low, high in ((0.03, 0.1), (0.1, 0.2), (0.2, 0.35))]
        worst = max(worst, float(np.abs(np.array(bins) / published - 1).max()))
    return worst


def corner_bias(albedo: float) -> tuple[Float, Float]:
    """Distance from the apex line and bias in mm of the pixels that see the V."""
    camera = Camera(224, 172, 210.6, 210.6, 111.5, 85.5)
    walls = [
        Body(
            f"wall{s}",
            np.array([[0, -0.5, 1.2], [s * 0.5, -0.5, 0.7], [s * 0.5, 0.5, 0.7], [0, 0.5, 1.2]]),
            np.array([[0, 1, 2], [0, 2, 3]], np.int32),
            albedo,
        )
        for s in (-1, 1)
    ]
    world = World.of(walls)
    sight = look(world, camera.rays(), np.eye(4))
    metres = 299_792_458.0 / (4e8 * np.pi)
    light = irradiance(world, sight, camera.rays(), 1 / metres, wider=3.0, cones=(42, 54))
    with np.errstate(invalid="ignore"):
        error = 1e3 * metres * np.angle(1 + light / (sight.main.cosine / sight.main.distance**2))
    return np.abs(sight.main.points[:, 0]), error


def ray_rate(bodies: list[Body]) -> tuple[float, float]:
    """Rays a second of the virtual camera's caster and of embree's, alternating, the best of five."""
    import trimesh
    from trimesh.ray.ray_pyembree import RayMeshIntersector

    session = Session(bodies, VirtualConfig(), {})
    T = session.true_pose(session.shutters[0])
    rays = session.camera.rays().reshape(-1, 3) @ T[:3, :3].T
    origins = np.broadcast_to(T[:3, 3], rays.shape)
    corners = session.nominal.soup.corners
    mesh = trimesh.Trimesh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3), process=False)
    peer = RayMeshIntersector(mesh)
    best = [0.0, 0.0]
    calls: list[Callable[[], object]] = [lambda: session.nominal.tree.cast(T[:3, 3], rays), lambda: peer.intersects_first(origins, rays)]
    for _ in range(5):
        for k, call in enumerate(calls):
            started = time.process_time()
            call()
            best[k] = max(best[k], len(rays) / (time.process_time() - started))
    return best[0], best[1]
