# SPDX-License-Identifier: Apache-2.0
"""A planned session with its truth: worlds, poses, what each capture sees and measures."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import zip_longest
from typing import TYPE_CHECKING

import numpy as np

from tof_core.camera import Camera
from tof_virtual.effect import Moment
from tof_virtual.effects import adapt, make_effects
from tof_virtual.pipeline import expose
from tof_virtual.plan import plan
from tof_virtual.robot import HAND_OF_CAMERA, Robot
from tof_virtual.sight import World, look
from tof_virtual.timeline import schedule

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from tof_core.arrays import Float
    from tof_virtual.body import Body
    from tof_virtual.config import CameraConfig, VirtualConfig
    from tof_virtual.effect import Effect
    from tof_virtual.optics import Light
    from tof_virtual.sight import Sight
    from tof_virtual.timeline import Shutter

SIGHTS_KEPT = 12
"""Size of the cache of rendered views, for the captures of a dwell and for the shares of the effects; as many as the sizes of effects are
found on (`calibrate.MOST_CAPTURES`), which are recorded next."""


@dataclass(frozen=True, slots=True, eq=False)
class Errors:
    """The robot's errors at one stop: base, arm."""

    B: Float
    A: Float


def stated_camera(config: CameraConfig, frame_id: str) -> Camera:
    """The published calibration: square pixels, principal point near the middle."""
    f = 0.5 * config.width / np.tan(np.radians(config.fov_deg) / 2)
    return Camera(
        config.width,
        config.height,
        float(f),
        float(f),
        0.5 * (config.width - 1) + 0.8,
        0.5 * (config.height - 1) - 0.6,
        "plumb_bob",
        (0.0,) * 5,
        frame_id,
    )


class Session:
    """Stops, times, errors and effects of one session, all drawn from the seed."""

    def __init__(
        self, bodies: Sequence[Body], config: VirtualConfig, effects: Mapping[str, float], standing: Sequence[Body] | None = None
    ) -> None:
        """Plan the session on the nominal bodies, as a robot's programmer would; `standing`: the bodies as they are (default: the same)."""
        config = adapt(config, effects)
        self.config = config
        self.bodies = bodies if standing is None else standing
        self.effects: tuple[Effect, ...] = make_effects(effects, config)
        self.camera = stated_camera(config.camera, frame(config, "hand_depth_sensor"))
        self.nominal = World.of(bodies)
        """The bodies as the CAD has them."""
        self._worlds: dict[frozenset[str], World] = {frozenset(): self.nominal if standing is None else World.of(standing)}
        self._sights: dict[tuple[object, ...], Sight] = {}
        self._lights: tuple[tuple[Sight, ...], dict[object, list[Light]]] | None = None
        plan_rng, time_rng, robot_rng = (np.random.default_rng([config.seed, k, day]) for k, day in enumerate((0, 0, config.day)))
        raster = self.camera.rays()[:: max(self.camera.height // 12, 1), :: max(self.camera.width // 16, 1)].reshape(-1, 3)
        self.stops = plan(self.nominal, config.plan, raster, plan_rng)
        self.segments, self.shutters = schedule(self.stops, config.plan, time_rng)
        self.errors = self._errors(Robot(config.robot, robot_rng))
        for e in self.effects:
            e.prepare(self)

    def _errors(self, robot: Robot) -> list[Errors]:
        out = []
        for stop in self.stops:
            if stop.T_cell_body is not robot.T_cell_body:
                robot.drive(stop.T_cell_body)
            robot.goto(stop.T_body_hand)
            out.append(Errors(robot.B, robot.A))
        return out

    # what is true -------------------------------------------------------------------------------
    def stamp_s(self, shutter: Shutter) -> float:
        """The stamp that the capture gets, in seconds from the start."""
        return shutter.time_s + sum(e.stamp_error_s() for e in self.effects)

    def temperature(self, time_s: float) -> float:
        """Of the camera, in degrees Celsius."""
        w = self.config.warmup
        return float(w.end_c + (w.start_c - w.end_c) * np.exp(-time_s / w.tau_s))

    def hand_eye(self, effects: Sequence[Effect] | None = None) -> Float:
        """X with these effects (all of the session's if None)."""
        X = np.eye(4)
        for e in self.effects if effects is None else effects:
            X = X @ e.hand_eye()
        return X

    def robot_pose(self, shutter: Shutter) -> Float:
        """`T_cell_camera` as TF has it at the capture's stamp."""
        body, hand = shutter.segment.poses(self.stamp_s(shutter))
        return np.asarray(body @ hand @ HAND_OF_CAMERA)

    def true_pose(self, shutter: Shutter, effects: Sequence[Effect] | None = None, shift_s: float = 0.0) -> Float:
        """`T_cell_camera` where the camera is `shift_s` after the middle of the exposure, with these effects."""
        effects = self.effects if effects is None else effects
        time_s = self.stamp_s(shutter) - sum(e.stamp_error_s() for e in effects)
        body, hand = shutter.segment.poses(time_s + shift_s)
        errors = self.errors[shutter.stop]
        return np.asarray(errors.B @ body @ hand @ HAND_OF_CAMERA @ errors.A @ self.hand_eye(effects))

    def world(self, effects: Sequence[Effect]) -> World:
        """The bodies as they are with these effects."""
        bending = [e for e in effects if e.deforms]
        key = frozenset(e.name for e in bending)
        if key not in self._worlds:
            bodies = self.bodies
            for e in bending:
                bodies = e.deform(bodies)
            self._worlds[key] = World.of(bodies)
        return self._worlds[key]

    def shares(self) -> Float:
        """Share of all pixels of the session that each nominal body fills (bodies,), by a coarse raster.

        Zero for bodies that are not subjects, unless hardly any subject is seen.
        """
        soup = self.nominal.soup
        raster = self.camera.rays()[::6, ::6].reshape(-1, 3)
        count = np.zeros(len(soup.names))
        for stop in self.stops:
            T = stop.T_cell_body @ stop.T_body_hand @ HAND_OF_CAMERA
            _, face = self.nominal.tree.cast(T[:3, 3], raster @ T[:3, :3].T)
            count += np.bincount(soup.body[face[face >= 0]], minlength=count.size)
        subjects = np.where(soup.subject, count, 0)
        return np.asarray((subjects if subjects.max() > 0.01 * count.sum() else count) / (len(self.stops) * len(raster)))

    # what is seen and measured --------------------------------------------------------------------
    def sight(self, shutter: Shutter, effects: Sequence[Effect], shift_s: float = 0.0, *, subsamples: int = 0) -> Sight:
        """What the camera sees with these effects."""
        subsamples = subsamples or self.config.camera.subsamples
        when = (shutter.time_s, shift_s) if self.config.plan.capture_moving else ()
        key = (shutter.stop, *when, subsamples, frozenset(e.name for e in effects if e.geometric or e.footprint()))
        if key not in self._sights:
            camera = self.camera
            for e in effects:
                camera = e.true_camera(camera)
            width = max((e.footprint() for e in effects), default=0.0) or 1.0
            while len(self._sights) >= SIGHTS_KEPT:
                self._sights.pop(next(iter(self._sights)))
            self._sights[key] = look(
                self.world(effects), camera.rays(), self.true_pose(shutter, effects, shift_s), subsamples=subsamples, width=width
            )
        return self._sights[key]

    def moment(self, index: int, effects: Sequence[Effect] | None = None, *, subsamples: int = 0) -> Moment:
        """Capture number `index` with these effects (all of the session's if None)."""
        effects = self.effects if effects is None else effects
        shutter = self.shutters[index]
        interval = sum(e.tap_interval_s() for e in effects)
        shifts = [(k - 1.5) * interval for k in range(4)] if interval else []
        sights = tuple(self.sight(shutter, effects, s, subsamples=subsamples) for s in [*shifts, 0.0])
        if not self._lights or any(a is not b for a, b in zip_longest(self._lights[0], sights)):
            self._lights = (sights, {})
        return Moment(
            index=index,
            view=shutter.stop,
            time_s=shutter.time_s,
            temperature=self.temperature(shutter.time_s),
            world=self.world(effects),
            config=self.config,
            camera=self.camera,
            sights=sights,
            lights=self._lights[1],
        )

    def bias(self, index: int, effect: Effect) -> Float:
        """Bias of one effect in the noise-free depth (P,) of a capture, with the others on; NaN where not seen.

        For an effect that is not a bias: its noise in metres, or its loss as a share.
        """
        level = effect.level(self.moment(index)) if effect.kind != "bias" else None
        if level is not None:
            return level
        others = [e for e in self.effects if e is not effect]
        if effect.geometric:
            shutter = self.shutters[index]
            return self.sight(shutter, self.effects).z - self.sight(shutter, others).z
        return expose(self.moment(index), self.effects).depth - expose(self.moment(index, others), others).depth

    def forget(self) -> None:
        """Clear the caches that depend on the size of an effect."""
        self._sights.clear()
        self._worlds = {frozenset(): self.nominal}


def frame(config: VirtualConfig, name: str) -> str:
    """A TF frame's name with the robot's prefix."""
    return f"{config.output.namespace}/{name}" if config.output.namespace else name


def topic(config: VirtualConfig, name: str) -> str:
    """A topic's name with the robot's namespace."""
    return f"/{config.output.namespace}/{name}" if config.output.namespace else f"/{name}"
