# SPDX-License-Identifier: Apache-2.0
"""Recorded views as a perfect sensor would measure them, and their bias by a sensor model."""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce
from typing import TYPE_CHECKING

import numpy as np

from tof_core.cores import in_threads
from tof_scene.albedo import albedo_by_amplitude
from tof_sensor.frame import Context, Frame, amplitude_gain, ideal_frame, lambert_amplitude, twist_of
from tof_sensor.origin import check_camera

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from tof_core.arrays import Float, Image
    from tof_core.camera import Camera
    from tof_core.capture import View
    from tof_scene.raycast import Raycaster
    from tof_scene.render import Rendering
    from tof_sensor.model import SensorModel

STEP = 3
"""Step of rows and columns of the pixels used for albedo."""
STEEPEST = 0.25
"""Least cosine of the incidence of pixels used for albedo."""


@dataclass(frozen=True, slots=True)
class KnownBias:
    """The bias of a sensor model in the views of a session, which `tof_align.known` removes."""

    model: SensorModel

    def __call__(
        self, views: Sequence[View], renderings: Sequence[Rendering], caster: Raycaster, start_ns: int | None = None
    ) -> list[Float]:
        """(H, W) metres of z per view; `start_ns`: stamp of the session's first view, if it is not among `views`.

        Raises:
            RefusedError: the model was fitted to another camera.
        """
        for camera in {v.camera for v in views}:
            check_camera(self.model.camera, camera)
        model = self.model.holding_in(caster.scene.digest)
        scene = caster if any(e.needs_scene for e in model.effects) else None  # Only these use the scene and its albedo.
        return in_threads(model.bias, ideal_frames(views, renderings, scene, start_ns))

    def camera(self, stated: Camera) -> Camera:
        """The true camera, if CameraInfo states `stated`."""
        return reduce(lambda camera, effect: effect.camera(camera), self.model.effects, stated)


def scene_note(model: SensorModel, scene: str) -> str:
    """The effects of a model that are not removed in the scene of this digest, in a sentence; empty without any."""
    apart = sorted(set(model.names) - set(model.holding_in(scene).names))
    return f"sensor.yaml is of another scene: effects of its parts are not removed here ({', '.join(apart)})" if apart else ""


def known_bias(path: Path | str | None) -> KnownBias | None:
    """The bias of a `sensor.yaml`; None for no file ("" or None)."""
    if not path:
        return None
    from pathlib import Path

    from tof_sensor.model import load_model  # loads all effects: only where they are needed

    return KnownBias(load_model(Path(path)))


def as_ideal(
    views: Sequence[View], renderings: Sequence[Rendering], caster: Raycaster | None, start_ns: int | None = None
) -> Callable[[View, Rendering], Frame]:
    """A function of view and rendering that gives the frame of a perfect sensor, with the measured amplitude.

    `start_ns`: stamp of the session's first view, if it is not among `views`.
    """
    start, gain = min(v.stamp_ns for v in views) if start_ns is None else start_ns, _gain(views, renderings)
    albedo = None if caster is None else seen_albedo([v.amplitude for v in views], renderings, caster.albedo.astype(float))

    def one(view: View, rendering: Rendering) -> Frame:
        context = Context(
            temperature=view.temperature,
            time_s=(view.stamp_ns - start) * 1e-9,
            twist=twist_of(view.robot),
            caster=caster,
            albedo=albedo,
        )
        amplitude = None if view.amplitude is None else view.amplitude.astype(np.float64)
        return ideal_frame(rendering, context, amplitude, gain)

    return one


def ideal_frames(
    views: Sequence[View], renderings: Sequence[Rendering], caster: Raycaster | None, start_ns: int | None = None
) -> list[Frame]:
    """The frames of all views of a session, as of `as_ideal`."""
    return in_threads(as_ideal(views, renderings, caster, start_ns), views, renderings)


def seen_albedo(amplitudes: Sequence[Image | None], renderings: Sequence[Rendering], stated: Float) -> Float:
    """(P,) albedo of the scene's parts estimated from measured amplitude (H, W); `stated` (P,) without amplitude."""
    parts, returned, off_axis = [], [], []
    for amplitude, rendering in zip(amplitudes, renderings, strict=True):
        if amplitude is None:
            continue
        at = np.s_[::STEP, ::STEP]
        cosine = np.cos(rendering.incidence[at].astype(np.float64))
        with np.errstate(divide="ignore", invalid="ignore"):
            law = cosine / (rendering.depth[at] * rendering.camera.ray_length()[at]) ** 2
            light = np.log(amplitude[at] / law)
        seen = np.isfinite(light) & (cosine > STEEPEST) & ~(rendering.mixed[at] > 0)
        radius = np.linalg.norm(rendering.camera.rays()[..., :2], axis=2)  # NaN where the lens model folds over
        parts.append(rendering.part[at][seen])
        returned.append(light[seen])
        off_axis.append((radius[at] / np.nanmax(radius))[seen])
    if not parts:
        return stated
    return albedo_by_amplitude(stated, np.concatenate(parts).astype(np.int64), np.concatenate(returned), np.concatenate(off_axis))


def _gain(views: Sequence[View], renderings: Sequence[Rendering]) -> float:
    """Camera's unit of amplitude per 1/m^2, for views without an amplitude image in a session with others; otherwise 1."""
    lit = [v.amplitude is not None and bool(np.isfinite(v.amplitude).any()) for v in views]
    if all(lit) or not any(lit):
        return 1.0
    seen = [(v.amplitude, r) for v, r, has in zip(views, renderings, lit, strict=True) if has]
    gains = [amplitude_gain(a.astype(np.float64), lambert_amplitude(r)) for a, r in seen if a is not None]
    return float(np.median([g for g in gains if g is not None] or [1.0]))
