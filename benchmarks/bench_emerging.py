# SPDX-License-Identifier: Apache-2.0
"""The emerging camera: what its sessions cost, how true the perfect camera is, its bounced light against path tracing."""

from __future__ import annotations

import shutil
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.bench_virtual import PUBLISHED_MM
from benchmarks.emerging.bounce import indirect
from benchmarks.emerging.device import Device
from benchmarks.emerging.light import gather
from benchmarks.emerging.record import record
from benchmarks.emerging.session import EmergingSession
from benchmarks.emerging.surfaces import surfaces
from benchmarks.emerging.waveform import response
from benchmarks.figure import Figure, at_most
from tof_core.camera import Camera as Lens
from tof_core.config import from_mapping, updated
from tof_scene.builtin import make_builtin
from tof_virtual.body import Body
from tof_virtual.config import VirtualConfig
from tof_virtual.sight import look
from tof_virtual.taps import SPEED_OF_LIGHT
from toftwin.commands.simulate import bodies_of

if TYPE_CHECKING:
    from tof_core.arrays import Float


def run() -> list[Figure]:
    """Cost with and without bounced light, truth, corner."""
    bodies = bodies_of(make_builtin("body_section"))
    perfect, flood = Device(), updated(Device(), {"lamp.flood_share": 0.02})
    for device in (perfect, flood):
        recorded(bodies, device, views=2)  # compiles
    bias, noise = truth(bodies)
    return [
        at_most("emerging: record 20 views 224x171 without bounced light, CPU of one core", recorded(bodies, perfect), 15, "s"),
        at_most("emerging: record 20 views 224x171 with bounced light, CPU of one core", recorded(bodies, flood), 40, "s"),
        at_most(
            "emerging: error of the perfect camera inside surfaces, 99.9 % quantile",
            bias,
            0.05,
            "mm",
            remark=f"noise {noise:.2f} mm (median)",
        ),
        at_most("emerging: bounced light in a V corner against path tracing, worst bin", 100 * corner_error(), 20, "%"),
    ]


def recorded(bodies: list[Body], device: Device, views: int = 20) -> float:
    """CPU seconds to plan and record one session, truth and writing included."""
    folder = Path(tempfile.mkdtemp(prefix="toftwin-emerging-"))
    try:
        started = time.process_time()
        session = EmergingSession(bodies, from_mapping(VirtualConfig, {"plan.views": views}), device, {})
        record(session, folder / "bag", folder / "truth", {}, {})
        return time.process_time() - started
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def truth(bodies: list[Body]) -> tuple[float, float]:
    """Error of mean frames away from edges, and the noise of one frame, in millimetres."""
    session = EmergingSession(bodies, VirtualConfig(), Device(), {})
    errors, noise = [], []
    for index in range(4):
        sight, frame = session.view(session.shutters[index], Device()), session.exposed(index, Device())
        inside = np.ones(sight.z.size, bool)
        inside[sight.edge] = False
        errors.append(np.abs(frame.depth - sight.z)[inside])
        noise.append(np.abs(session.exposed(index, Device(), noise=True).depth - frame.depth)[inside])
    return 1e3 * float(np.nanquantile(np.concatenate(errors), 0.999)), 1e3 * float(np.nanmedian(np.concatenate(noise)))


def corner_error() -> float:
    """Largest relative deviation from the published medians."""
    worst = 0.0
    for albedo, published in PUBLISHED_MM.items():
        x, error = corner_bias(albedo)
        bins = [np.nanmedian(error[(x >= low) & (x < high)]) for low, high in ((0.03, 0.1), (0.1, 0.2), (0.2, 0.35))]
        worst = max(worst, float(np.abs(np.array(bins) / published - 1).max()))
    return worst


def corner_bias(albedo: float) -> tuple[Float, Float]:
    """Distance from the apex line in metres, and the error in mm of a sinusoidal camera of 100 MHz, per pixel of the V."""
    lens = Lens(224, 172, 210.6, 210.6, 111.5, 85.5)
    walls = [
        Body(
            f"wall{s}",
            np.array([[0, -0.5, 1.2], [s * 0.5, -0.5, 0.7], [s * 0.5, 0.5, 0.7], [0, 0.5, 1.2]]),
            np.array([[0, 1, 2], [0, 2, 3]], np.int32),
            albedo,
        )
        for s in (-1, 1)
    ]
    device = updated(Device(), {"lamp.baseline_mm": 0.0, "lamp.flood_share": 1.0})
    real = surfaces(walls, np.full(2, 0.2), device)
    sight = look(real.world, lens.rays(), np.eye(4), subsamples=2)
    omega = response(device).omega
    bounced = indirect(device, real, sight, lens.rays(), omega, wider=3.0, cones=(42, 54))
    with_it, without = (gather(device, real, sight, omega, b, 1.0).orders[0, 0] for b in (bounced, None))
    with np.errstate(invalid="ignore"):
        late = -np.angle(with_it / without) / omega[0]
    return np.abs(sight.main.points[:, 0]), 0.5e3 * SPEED_OF_LIGHT * late


if __name__ == "__main__":
    for figure in run():
        print(figure)
