# SPDX-License-Identifier: Apache-2.0
"""Captures of a simulator, with ideal depth, to captures of the modelled camera."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tof_core.config import param
from tof_core.errors import ConfigError, RefusedError
from tof_core.reasons import Reason
from tof_scene.render import render
from tof_sensor.effects.flying_pixels import FlyingPixels
from tof_sensor.effects.temperature_drift import TemperatureDrift
from tof_sensor.frame import Context, ideal_frame, twist_of
from tof_sensor.ideal import completed, imaged
from tof_sensor.model import SensorModel, load_model
from tof_sensor.origin import check_camera, differences

if TYPE_CHECKING:
    from tof_core.arrays import Float, Image
    from tof_core.camera import Camera
    from tof_core.capture import Capture
    from tof_scene.raycast import Raycaster
    from tof_scene.rendering import Rendering

NOISY_SHARE = 0.25
"""Noise, as a share of depth, above which a pixel has no depth: four sigmas reach the camera, and the phase is unknown."""

OWN_LENS = "give the simulator the resolution and the CameraInfo of the camera, since every pixel of its image is another ray otherwise"


@dataclass(frozen=True, slots=True)
class SimulatorConfig:
    """Which effects are simulated, and the meaning of the images beside the ideal depth."""

    model: str = param("", "sensor.yaml of the camera, written by `toftwin gap`")
    seed: int = param(0, "seed of noise, losses and edges", low=0, high=2**31 - 1)
    light: str = param(
        "albedo",
        "content of the amplitude image beside the ideal depth: the surfaces' albedo, or the amplitude in the camera's unit",
        choices=("albedo", "amplitude"),
    )
    albedo: float = param(0.5, "albedo of surfaces without an albedo in an image or in the scene", low=1e-3, high=10.0)
    albedo_per_count: float = param(1.0, "albedo of one count of the albedo image; 0.0039 for 8 bits", low=1e-9, high=10.0)
    gain: float = param(0.0, "amplitude of albedo 1 seen head-on from 1 m, in the camera's unit; 0: the value in sensor.yaml", low=0.0)


class Simulator:
    """A simulated camera. Equal captures in the same order give equal images: the random numbers depend on seed and stamp only."""

    def __init__(self, config: SimulatorConfig, model: SensorModel, caster: Raycaster | None = None) -> None:
        """Use the effects of `model`; `caster` is the scene, for captures with a pose."""
        self.config, self.model, self.caster = config, model, caster
        self._start: int | None = None
        self._border: Float = np.zeros((2, 0, 0))

    @classmethod
    def load(cls, config: SimulatorConfig, caster: Raycaster | None = None) -> Simulator:
        """The camera of `config.model`.

        Raises:
            ConfigError: no file is named, or it is no sensor model.
        """
        if not config.model:
            raise ConfigError("names no sensor.yaml", where="sensor.model", todo="toftwin gap writes one")
        return cls(config, load_model(Path(config.model)), caster)

    @property
    def without_effect(self) -> tuple[str, ...]:
        """Names of the model's effects that are absent without a scene."""
        return () if self.caster is not None else tuple(sorted({e.NAME for e in self.model.effects if e.needs_scene}))

    def lens_note(self, ideal: Capture) -> list[str]:
        """That the simulator's lens is another calibration than the model's; nothing where it is the same."""
        lens = differences(self.model.camera, ideal.camera)
        return [f"the simulator's CameraInfo is not that of sensor.yaml ({', '.join(lens)}): {OWN_LENS}"] if lens else []

    def notes(self, ideal: Capture) -> list[str]:
        """What a capture of this kind lacks, and what is done instead, in sentences."""
        out, effects = self.lens_note(ideal), self.model.effects
        if ideal.amplitude is None and self.config.light == "albedo":
            out.append(f"no albedo image: all surfaces without an albedo in the scene have {self.config.albedo:g} (--albedo)")
        by_thermometer = any(isinstance(e, TemperatureDrift) and (e.drift_m or e.drift_share) for e in effects)
        if by_thermometer and not np.isfinite(ideal.temperature):
            out.append(
                "no temperature: the drift per kelvin of sensor.yaml is left out, and what warms up with time is not the whole drift: publish the "
                "camera's temperature"
            )
        if not any(isinstance(e, FlyingPixels) for e in effects):
            out.append(
                "edges stay as ideal as they are: sensor.yaml holds no mixed pixels (flying_pixels), and pixels that an edge filter in the camera "
                "removes are not simulated"
            )
        return out

    def reset(self) -> None:
        """Begin a session with the next capture."""
        self._start = None

    def measured(self, ideal: Capture, normal: Image | None = None) -> Capture:
        """The capture that the camera measures of `ideal`.

        Args:
            ideal: capture with the simulator's depth; `config.light` states the content of `amplitude`.
            normal: (H, W, 3) unit normals in the camera frame, if the simulator gives them.

        Raises:
            RefusedError: the camera's unit of amplitude is not known, or the capture is of another camera than the model's.
        """
        check_camera(self.model.camera, ideal.camera, any_lens=True, todo=OWN_LENS)
        rng = np.random.default_rng([self.config.seed, ideal.stamp_ns])
        frame = ideal_frame(self._rendering(ideal, normal), self._context(ideal), *self._light(ideal))
        made = self.model.apply(frame, rng)
        depth, amplitude = made.depth.astype(np.float32), made.amplitude.astype(np.float32)
        depth[made.sigma > NOISY_SHARE * ideal.depth] = np.nan  # simulators' images have black surfaces, which return no light
        lost = ~np.isfinite(depth) & (ideal.reason == Reason.VALID)
        return replace(ideal, depth=depth, amplitude=amplitude, reason=np.where(lost, np.uint8(Reason.NO_RETURN), ideal.reason))

    def _rendering(self, ideal: Capture, normal: Image | None) -> Rendering:
        camera = ideal.camera
        albedo = np.full(camera.shape, self.config.albedo, np.float32)
        if ideal.amplitude is not None and self.config.light == "albedo":
            albedo = self.config.albedo_per_count * ideal.amplitude
        seen = imaged(camera, ideal.depth, self._edges(camera), albedo=albedo, normal=normal)
        if self.caster is None or ideal.robot is None:
            return seen
        return completed(seen, render(self.caster, camera, ideal.robot.T_cell_camera))

    def _edges(self, camera: Camera) -> Float:
        """Random positions of edges, the same for every capture: a camera at rest mixes the same pixels."""
        if self._border.shape[1:] != camera.shape:
            self._border = np.random.default_rng([self.config.seed, 0]).random((2, *camera.shape))
        return self._border

    def _context(self, ideal: Capture) -> Context:
        if self._start is None:
            self._start = ideal.stamp_ns
        return Context(
            temperature=ideal.temperature,
            time_s=(ideal.stamp_ns - self._start) * 1e-9,
            twist=twist_of(ideal.robot),
            caster=self.caster,
        )

    def _light(self, ideal: Capture) -> tuple[Float | None, float]:
        """The simulator's amplitude image, None without one, and the camera's unit of amplitude."""
        if ideal.amplitude is not None and self.config.light == "amplitude":
            return ideal.amplitude.astype(np.float64), 1.0
        gain = self.config.gain or self.model.gain
        if not gain:
            raise RefusedError(
                "the camera's unit of amplitude is not known",
                where="sensor.gain",
                todo="pass --gain: the amplitude of a surface of albedo 1, seen head-on from 1 m",
            )
        return None, gain
