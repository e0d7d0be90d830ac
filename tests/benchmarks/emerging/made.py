# SPDX-License-Identifier: Apache-2.0
"""Single views of an emerging camera, without a robot."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.emerging.bounce import indirect
from benchmarks.emerging.camera import Camera, target
from benchmarks.emerging.device import Device
from benchmarks.emerging.light import gather
from benchmarks.emerging.surfaces import surfaces
from tests.tof_virtual.made import looking
from tof_core.camera import Camera as Lens
from tof_core.config import updated
from tof_virtual.sight import Sight, look

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_virtual.body import Body
    from tof_virtual.effect import Frame

LENS = Lens(96, 72, 90.0, 90.0, 47.5, 35.5, "plumb_bob", (0.0,) * 5, "camera")
LINE = Lens(400, 1, 1e5, 1e5, 199.5, 0.0, "plumb_bob", (0.0,) * 5, "camera")
"""A row of pixels that all look the same way: as many targets at once."""
PERFECT = Device()


def device(**knobs: Any) -> Device:
    """The perfect camera with some quantities changed; double underscores for dots."""
    return updated(PERFECT, {name.replace("__", "."): value for name, value in knobs.items()})


def view(bodies: list[Body], x: float, d: Device, lens: Lens = LENS) -> tuple[Sight, Camera, list[Any]]:
    """What a camera at (x, 0, 0.8) that looks along -x sees, the camera, and the light on its pixels."""
    shares = np.full(len(bodies), 0.2)
    real = surfaces(bodies, shares, d)
    sight = look(real.world, lens.rays(), looking(x), subsamples=4)
    camera = Camera(d, PERFECT, lens)
    bounced = indirect(d, real, sight, lens.rays(), camera.response.omega) if d.lamp.flood_share else None
    return sight, camera, [gather(d, real, sight, camera.response.omega, bounced, camera.power(0.0))]


def error_mm(bodies: list[Body], x: float, d: Device = PERFECT, lens: Lens = LENS) -> tuple[Float, Sight, Frame]:
    """Error (H, W) of the mean frame against the surface along each pixel's centre, in millimetres."""
    sight, camera, lights = view(bodies, x, d, lens)
    frame = camera.expose(lights, 0.0)
    return 1e3 * (frame.depth - sight.z).reshape(lens.shape), sight, frame


def on_targets(distance: Float, d: Device, *, built: Device | None = None, electrons: float = 40e3) -> Float:
    """Error (n,) in millimetres on flat targets at distances (n,), seen straight on, equally bright."""
    straight = updated(d, {"lamp.baseline_mm": 0.0, "pixel.clock_ps": 0.0, "firmware.filter": False})
    factory = updated(built or PERFECT, {"lamp.baseline_mm": 0.0, "pixel.clock_ps": 0.0})
    camera = Camera(straight, factory, Lens(distance.size, 1, 1e6, 1e6, 0.0, 0.0, "plumb_bob", (0.0,) * 5, "camera"))
    frame = camera.expose([target(distance, camera.response.omega, electrons, 1e3)], 0.0)
    return np.asarray(1e3 * (frame.depth - distance))
