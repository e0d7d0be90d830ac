# SPDX-License-Identifier: Apache-2.0
"""A rendered view on its way through the sensor model, which each effect reads and changes."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import wraps
from typing import TYPE_CHECKING, TypeVar
from weakref import WeakKeyDictionary

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import Any

    from numpy.typing import NDArray

    from tof_core.arrays import Float, Ints, Mask
    from tof_core.camera import Camera
    from tof_core.capture import RobotPose
    from tof_scene.raycast import Raycaster
    from tof_scene.render import Rendering

T = TypeVar("T")
LIGHT_M_PER_S = 299_792_458.0
MOVING_M_S = 5e-3
"""Speed in m/s from which a view counts as taken in motion: 0.1 mm within an exposure of 20 ms."""
ROUNDING = 1e-4
"""Velocity (m/s, rad/s) that rounding of TF gives to a camera at rest."""
GRAZING = 0.1
"""Least cosine of incidence in formulas; fits do not use flatter surfaces."""
MOVING_RAD_S = float(np.radians(0.5))
"""Turn rate in rad/s from which a view counts as taken in motion."""


@dataclass(frozen=True, slots=True, eq=False)
class Context:
    """Conditions of a view besides its geometry.

    temperature in degrees Celsius, NaN where unknown; time_s since the session's first capture;
    twist (6,) is the camera's velocity (m/s, rad/s) in its own axes; caster: ray caster of the scene, for effects beyond the
    image (interreflection), None where only the raster is known; albedo (P,): of the scene's parts at the camera's wavelength, None for the
    scene's values.
    """

    temperature: float = float("nan")
    time_s: float = 0.0
    twist: Float = field(default_factory=lambda: np.zeros(6))
    caster: Raycaster | None = None
    albedo: Float | None = None

    @property
    def moving(self) -> bool:
        """Whether the camera was faster than `MOVING_M_S` or `MOVING_RAD_S`; TF of an arm at rest is noisy, too."""
        return in_motion(self.twist)


def twist_of(robot: RobotPose | None) -> Float:
    """(6,) velocity of the camera (m/s, rad/s); zero for a camera at rest, or if TF does not state it."""
    twist = None if robot is None else robot.twist
    return np.zeros(6) if twist is None or np.abs(twist).max() < ROUNDING else twist


def in_motion(twist: Float) -> bool:
    """Whether a camera with this velocity (6,), m/s and rad/s, counts as moving."""
    return bool(np.linalg.norm(twist[:3]) > MOVING_M_S or np.linalg.norm(twist[3:]) > MOVING_RAD_S)


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class Frame:
    """One view: its geometry, and depth, amplitude, noise and loss at this stage of the sensor model.

    rays (H, W, 3) with z = 1 through the pixels; depth (H, W) metres along z, NaN off the CAD; amplitude (H, W) in the camera's unit;
    sigma (H, W) metres, noise of one capture; missing (H, W) probability of no return.
    """

    rendering: Rendering
    rays: Float
    depth: Float
    amplitude: Float
    sigma: Float
    missing: Float
    context: Context = field(default_factory=Context)

    @property
    def length(self) -> Float:
        """(H, W) radial distance per metre of z."""
        return self.camera.ray_length() if self.whole else _ray_length(self)

    @property
    def whole(self) -> bool:
        """Whether it has the camera's pixels, and not chosen ones (`take`)."""
        return self.rays is self.camera.rays()

    def take(self, pixels: Ints) -> Frame:
        """The same view on chosen pixels (flat indices (n,)), as a raster of one row (1, n).

        For effects that depend on single pixels (`Effect.LOCAL`).
        """

        def at(a: NDArray[Any]) -> NDArray[Any]:
            return a.reshape(-1, *a.shape[2:])[pixels][None]

        r = self.rendering
        rendering = replace(
            r,
            depth=at(r.depth),
            part=at(r.part),
            face=at(r.face),
            normal=at(r.normal),
            incidence=at(r.incidence),
            albedo=at(r.albedo),
            mixed=at(r.mixed),
            second=at(r.second),
        )
        return Frame(rendering, at(self.rays), at(self.depth), at(self.amplitude), at(self.sigma), at(self.missing), self.context)

    @property
    def camera(self) -> Camera:
        """The camera of the rendering."""
        return self.rendering.camera

    @property
    def valid(self) -> Mask:
        """(H, W) pixels on the CAD."""
        return np.isfinite(self.depth)

    @property
    def radial(self) -> Float:
        """(H, W) metres along the pixel's ray."""
        return self.depth * self.length

    @property
    def surroundings_m2(self) -> Float:
        """(H, W) m^2: range squared over the cosine of incidence; 0 off the CAD.

        Light of the lamp off a surface decreases with both; ambient light from all sides does not. At one amplitude of the lamp's light,
        ambient light is proportional to this quantity.
        """
        return np.nan_to_num(self.radial**2 / np.maximum(np.cos(self.rendering.incidence.astype(np.float64)), GRAZING))

    @property
    def points(self) -> Float:
        """(H, W, 3) surface points in the camera frame, metres."""
        return self.rays * self.depth[..., None]


def once_per_frame(compute: Callable[[Frame], T], *, whole: bool = False) -> Callable[[Frame], T]:
    """`compute` with its value kept as long as the frame lives: for what hundreds of hypotheses ask of the same frame.

    Only of frames on chosen pixels, unless `whole` is set: images of all views would take too much memory.
    """
    kept: WeakKeyDictionary[Frame, T] = WeakKeyDictionary()

    @wraps(compute)
    def known(frame: Frame) -> T:
        if frame not in kept:
            value = compute(frame)
            if frame.whole and not whole:
                return value
            kept[frame] = value
        return kept[frame]

    return known


@once_per_frame
def _ray_length(frame: Frame) -> Float:
    """(H, W) radial distance per metre of z."""
    length = np.sqrt(np.einsum("...i,...i->...", frame.rays, frame.rays))
    length.setflags(write=False)
    return np.asarray(length)


def ideal_frame(rendering: Rendering, context: Context | None = None, amplitude: Float | None = None, gain: float = 1.0) -> Frame:
    """The view that a perfect sensor would measure.

    Without a measured `amplitude` (H, W) the Lambertian one is used: albedo cos(incidence) / r^2, times the camera's `gain`.
    """
    depth = rendering.depth.astype(np.float64)
    lambert = lambert_amplitude(rendering)
    if amplitude is None:
        amplitude = gain * lambert
    else:
        own = amplitude_gain(amplitude, lambert)
        amplitude = np.where(np.isfinite(amplitude) & (amplitude > 0), amplitude, lambert * (gain if own is None else own))
    return Frame(rendering, rendering.camera.rays(), depth, amplitude, np.zeros_like(depth), np.zeros_like(depth), context or Context())


MODULATION = "modulation frequency; 5 for a pulsed camera, where light of several paths adds by its amount only"
"""Meaning of `modulation_mhz` for effects in which light of several paths adds up (docs/effects.md)."""


def waves_per_m(modulation_mhz: float) -> float:
    """Radians of phase per metre of path, lamp to lens."""
    return 2e6 * np.pi * modulation_mhz / LIGHT_M_PER_S


def indirect_bias(indirect: NDArray[np.complex128], waves: float) -> Float:
    """Range error in metres by light of longer paths: `indirect` is its phasor divided by the direct light's."""
    return np.asarray(np.angle(1 + indirect) / (2 * waves))


def lambert_amplitude(rendering: Rendering) -> Float:
    """(H, W) albedo cos(incidence) / r^2 in 1/m^2; 0 off the CAD."""
    radial = rendering.depth.astype(np.float64) * rendering.camera.ray_length()
    amplitude = rendering.albedo * np.cos(rendering.incidence) / (radial * radial)
    return np.where(np.isfinite(amplitude), amplitude, 0.0)


def amplitude_gain(measured: Float, lambert: Float) -> float | None:
    """Camera's unit per 1/m^2 of the Lambertian amplitude, None where no pixel was measured."""
    both = np.isfinite(measured) & (measured > 0) & (lambert > 0)
    return float(np.median(measured[both] / lambert[both])) if both.any() else None


def with_noise(frame: Frame, sigma: Float, rng: np.random.Generator, window_px: int = 1) -> Frame:
    """The frame with normal noise of `sigma` (H, W) metres of z added to depth and sigma.

    window_px: neighbours share noise as if it had been averaged over a window of this width; 1 for independent pixels.
    """
    unit = rng.standard_normal(frame.depth.shape)
    if window_px > 1:
        from scipy.ndimage import uniform_filter  # loads slowly, and most cameras need none

        # The mean of n pixels has 1 / sqrt(n) of the deviation; a wrapped window has n at the border, too.
        unit = window_px * uniform_filter(unit, window_px, mode="wrap")
    return replace(frame, depth=frame.depth + sigma * unit, sigma=np.hypot(frame.sigma, sigma))
