# SPDX-License-Identifier: Apache-2.0
"""A planned session of the emerging camera: what each capture sees and measures, with all causes or with some left out."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from typing_extensions import override

from benchmarks.emerging.bounce import indirect
from benchmarks.emerging.camera import Camera
from benchmarks.emerging.causes import CAUSES, applied
from benchmarks.emerging.light import gather
from benchmarks.emerging.person import arm, reaches
from benchmarks.emerging.surfaces import Surfaces, surfaces
from benchmarks.emerging.waveform import STEPS, response
from tof_core import se3
from tof_core.camera import Camera as Lens
from tof_virtual.robot import HAND_OF_CAMERA
from tof_virtual.session import Session
from tof_virtual.sight import look

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from benchmarks.emerging.device import Device
    from benchmarks.emerging.light import Light
    from tof_core.arrays import Float
    from tof_virtual.body import Body
    from tof_virtual.config import VirtualConfig
    from tof_virtual.effect import Frame
    from tof_virtual.sight import Sight
    from tof_virtual.timeline import Shutter

KEPT = 16
"""Sights and lights kept, for the captures of a view and for re-rendering without a cause."""
ViewKey: TypeAlias = tuple[bytes, float, int, tuple[float, ...], tuple[float | bool, ...]]
"""What decides what the pixels look at: pose, time in the exposure, rays of an edge pixel, lens, parts."""
SUBSAMPLES = 4
"""Rays along each side of a pixel that sees an edge."""
SUBSAMPLES_MOVING = 2


class EmergingSession(Session):
    """Stops and times of the virtual robot, seen by a device with causes of error.

    Attributes:
        healthy: the device without any cause.
        sizes: size of each cause, in its own unit.
    """

    def __init__(
        self, bodies: Sequence[Body], config: VirtualConfig, healthy: Device, sizes: Mapping[str, float], seen: Float | None = None
    ) -> None:
        """Plan the session on the nominal bodies; see `strength.calibrate` for sizes from strengths.

        `seen` (bodies,): shares of the pixels by which parts are chosen that stand off, bend or shine; those of this session without it.
        """
        super().__init__(bodies, config, {})
        self.healthy = healthy
        self.sizes = dict(sizes)
        self._seen_shares = self.shares() if seen is None else seen
        self._surfaces: dict[object, Surfaces] = {}
        self._cameras: dict[Device, Camera] = {}
        self._looks: dict[ViewKey, Sight] = {}
        self._indirect: dict[object, NDArray[np.complex128]] = {}
        self._gathered: dict[object, Light] = {}

    def device(self, without: frozenset[str] = frozenset()) -> Device:
        """The device with all causes but some."""
        return applied(self.healthy, {name: size for name, size in self.sizes.items() if name not in without})

    # what a device is and sees ------------------------------------------------------------------
    def camera_of(self, device: Device) -> Camera:
        """The camera with its factory calibration; the factory saw it without any cause."""
        if device not in self._cameras:
            _make_room(self._cameras)
            self._cameras[device] = Camera(device, self.healthy, self.camera)
        return self._cameras[device]

    def real(self, device: Device, shutter: Shutter | None = None) -> Surfaces:
        """The world as it really is; with a person's arm where one reaches into the view of `shutter`."""
        reached = shutter is not None and reaches(shutter.stop, device.world.arm_share, device.serial)
        key = (device.world, device.serial, *((shutter.stop,) if shutter is not None and reached else ()))
        if key not in self._surfaces:
            _make_room(self._surfaces)
            beside = self._arm(shutter, device) if shutter is not None and reached else None
            self._surfaces[key] = surfaces(self.bodies, self._seen_shares, device, beside)
        return self._surfaces[key]

    def _arm(self, shutter: Shutter, device: Device) -> Body | None:
        half = 0.5 * self.camera.width / self.camera.fx
        return arm(self.real(device).world, self.camera_pose(shutter, device), half, shutter.stop, device.serial)

    def true_lens(self, device: Device) -> Lens:
        """The lens behind the published calibration."""
        c, o = self.camera, device.optics
        zoom = 1 + 0.01 * o.focal_pct
        return Lens(
            c.width,
            c.height,
            c.fx * zoom,
            c.fy * zoom,
            c.cx + o.centre_x_px,
            c.cy + o.centre_y_px,
            "plumb_bob",
            (o.k1, 0.0, 0.0, 0.0, 0.0),
            c.frame_id,
        )

    def mounted(self, device: Device) -> Float:
        """The true hand-eye error X, in a direction that the serial number decides."""
        rng = np.random.default_rng([device.serial, 5])
        way, turn = rng.normal(0, 1, 3), rng.normal(0, 1, 3)
        m = device.mount
        twist = [1e-3 * m.hand_eye_mm * way / np.linalg.norm(way), np.radians(m.hand_eye_deg) * turn / np.linalg.norm(turn)]
        return se3.exp(np.concatenate(twist))

    def camera_pose(self, shutter: Shutter, device: Device, shift_s: float = 0.0) -> Float:
        """True `T_cell_camera`, `shift_s` after the middle of the exposure."""
        body, hand = shutter.segment.poses(shutter.time_s + shift_s)
        errors = self.errors[shutter.stop]
        return np.asarray(errors.B @ body @ hand @ HAND_OF_CAMERA @ errors.A @ self.mounted(device))

    def view(self, shutter: Shutter, device: Device, shift_s: float = 0.0, subsamples: int = SUBSAMPLES) -> Sight:
        """What the pixels look at."""
        return self._seen(self._view_key(shutter, device, shift_s, subsamples), shutter, device)

    def _view_key(self, shutter: Shutter, device: Device, shift_s: float, subsamples: int) -> ViewKey:
        """Whatever decides what the pixels look at."""
        o, w = device.optics, device.world
        lens = (o.focal_pct, o.centre_x_px, o.centre_y_px, o.k1, o.defocus_px)
        parts = (w.moved_mm, w.bent_mm, w.foreign_m, w.missing, w.arm_share, w.moved_parts)
        return self.camera_pose(shutter, device, shift_s).tobytes(), shift_s, subsamples, lens, parts

    def _seen(self, key: ViewKey, shutter: Shutter, device: Device) -> Sight:
        if key not in self._looks:
            _make_room(self._looks)
            _, shift_s, subsamples, _, _ = key
            self._looks[key] = look(
                self.real(device, shutter).world,
                self.true_lens(device).rays(),
                self.camera_pose(shutter, device, shift_s),
                subsamples=subsamples,
                width=1 + device.optics.defocus_px,
            )
        return self._looks[key]

    # what is measured ---------------------------------------------------------------------------
    def lights(self, index: int, device: Device) -> list[Light]:
        """Light on the pixels: one for the whole capture, or one for each sub-frame where the hand moves between them."""
        shutter = self.shutters[index]
        step = 1e-3 * device.clock.subframe_ms
        if not (step > 0 and self.config.plan.capture_moving):
            return [self._light(index, shutter, device, 0.0, SUBSAMPLES)]
        n = STEPS * len(device.frequencies)
        return [self._light(index, shutter, device, (k - 0.5 * (n - 1)) * step, SUBSAMPLES_MOVING) for k in range(n)]

    def _light(self, index: int, shutter: Shutter, device: Device, shift_s: float, subsamples: int) -> Light:
        view_key = self._view_key(shutter, device, shift_s, subsamples)
        power = self.camera_of(device).power(shutter.time_s)
        key = (view_key, device.lamp, device.optics, device.world, device.clock, power)
        if key not in self._gathered:
            _make_room(self._gathered)
            sight, omega = self._seen(view_key, shutter, device), response(device).omega
            bounced = self._bounced(view_key, shutter, sight, device, omega) if device.lamp.flood_share > 0 else None
            self._gathered[key] = gather(device, self.real(device, shutter), sight, omega, bounced, power)
        light = self._gathered[key]
        light.phase = float(np.random.default_rng([self.config.seed, 41, index]).uniform(0, 2 * np.pi))
        return light

    def _bounced(self, view_key: ViewKey, shutter: Shutter, sight: Sight, device: Device, omega: Float) -> NDArray[np.complex128]:
        lamp = device.lamp
        key = (view_key, lamp.offset_x_mm, lamp.offset_y_mm, lamp.baseline_mm, device.world, device.clock)
        if key not in self._indirect:
            _make_room(self._indirect)
            self._indirect[key] = indirect(device, self.real(device, shutter), sight, self.true_lens(device).rays(), omega)
        return self._indirect[key]

    def exposed(self, index: int, device: Device, *, noise: bool = False) -> Frame:
        """Capture `index` with a device: with its noise, or the mean frame. The same index has the same noise."""
        rng = np.random.default_rng([self.config.seed, 77, index]) if noise else None
        return self.camera_of(device).expose(self.lights(index, device), self.shutters[index].time_s, rng)

    # what the recorder asks ---------------------------------------------------------------------
    @override
    def stamp_s(self, shutter: Shutter) -> float:
        return shutter.time_s + 1e-3 * self.device().firmware.latency_ms

    @override
    def temperature(self, time_s: float) -> float:
        return self.camera_of(self.device()).thermometer(time_s)

    def without_each(self) -> dict[str, frozenset[str]]:
        """Effects of the vocabulary to the causes that make them."""
        effects = {CAUSES[name].effect for name in self.sizes}
        return {effect: frozenset(n for n in self.sizes if CAUSES[n].effect == effect) for effect in sorted(effects)}


def _make_room(kept: dict[Any, Any]) -> None:
    """Forget what was kept first."""
    while len(kept) >= KEPT:
        kept.pop(next(iter(kept)))
