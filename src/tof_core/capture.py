# SPDX-License-Identifier: Apache-2.0
"""Captures, views and sessions: the data that flow from room to room."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from tof_core import se3
from tof_core.camera import radial_to_z

if TYPE_CHECKING:
    from tof_core.arrays import Bytes, Float, Image, Ints, Mask
    from tof_core.camera import Camera


@dataclass(frozen=True, slots=True)
class RobotPose:
    """The robot's own estimate of its camera pose, from TF at the image's stamp.

    `T_cell_body` is the identity where the chain has no body frame (one station), and then
    `T_body_camera` is the whole chain from the cell to the camera.
    """

    T_cell_body: Float
    T_body_camera: Float
    twist: Float | None = None
    """(6,) velocity of the camera in its own axes (m/s, rad/s) at the stamp, from TF; None unknown."""
    cov: Float | None = None
    """(6, 6) covariance of a right perturbation of this camera pose (m, rad); None: the configured deviations of arm poses hold."""
    uneven: bool = False
    """Whether the velocity changes within the window of `twist`: the camera starts or stops, or TF errs."""

    @property
    def T_cell_camera(self) -> Float:
        """The robot's own pose of the camera in the cell, before any correction."""
        return np.asarray(self.T_cell_body @ self.T_body_camera)


@dataclass(frozen=True, slots=True, eq=False)
class Colour:
    """A colour image (H, W, 3) uint8 RGB with its own camera; `T_camera_colour` from TF."""

    image: Bytes
    camera: Camera | None = None
    T_camera_colour: Float | None = None
    stamp_ns: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class Capture:
    """One frame as the camera gave it, in metres along z.

    depth (H, W) float32, NaN invalid; reason (H, W) uint8, why a pixel is invalid; amplitude (H, W) float32 in
    the camera's own unit or None; temperature in degrees Celsius, NaN where the bag has none.
    `robot` is None where TF has no answer at this stamp.
    """

    stamp_ns: int
    camera: Camera
    depth: Image
    reason: Bytes
    robot: RobotPose | None = None
    amplitude: Image | None = None
    colour: Colour | None = None
    temperature: float = float("nan")


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """The accumulated captures of a dwell; a capture without a dwell is a view of one.

    depth (H, W) metres; sigma (H, W) standard error of `depth` in metres, estimated from the captures
    (NaN where there are fewer than two); count (H, W) uint16 captures used; reason (H, W).
    `stamp_ns` is the last capture's stamp, `dwell_ns` the first one's: it names the dwell.
    """

    stamp_ns: int
    dwell_ns: int
    camera: Camera
    depth: Image
    sigma: Image
    count: Ints
    reason: Bytes
    robot: RobotPose | None
    station: int = 0
    captures: int = 1
    amplitude: Image | None = None
    colour: Colour | None = None
    temperature: float = float("nan")
    noise: Image | None = None
    """(H, W) standard deviation of one capture in metres over the dwell, where known."""
    code_m: float | None = None
    """Metres between the codes of the depth that the camera wrote; 0: no codes; None: not looked for, or not stated before a conversion."""
    written_m: float = 0.0
    """Metres between the depths that a message of the camera can hold; 0: not known, or continuous. Means of n captures lie on n-th parts."""
    ray_shift: Image | None = None
    """(H, W, 2) pixels along x and y from a pixel's ray to that of its depth, where a driver rectified by the nearest pixel; None: no shift."""

    @property
    def valid(self) -> Mask:
        """(H, W) pixels that have a depth."""
        return np.isfinite(self.depth)

    @property
    def returned(self) -> Float:
        """(H, W) share of the captures in which a pixel has a depth."""
        return np.where(self.valid, self.count / max(self.captures, 1), 0.0)

    def as_z(self) -> View:
        """The view whose images hold distances along the ray, in z: depth, its standard error and the deviation of one capture."""
        noise = None if self.noise is None else radial_to_z(self.camera, self.noise)
        return replace(self, depth=radial_to_z(self.camera, self.depth), sigma=radial_to_z(self.camera, self.sigma), noise=noise)

    @classmethod
    def of_capture(cls, capture: Capture, station: int = 0) -> View:
        """A view of one capture: nothing accumulated, nothing filtered."""
        valid = np.isfinite(capture.depth)
        return cls(
            stamp_ns=capture.stamp_ns,
            dwell_ns=capture.stamp_ns,
            camera=capture.camera,
            depth=capture.depth,
            sigma=np.full(capture.depth.shape, np.nan, np.float32),
            count=valid.astype(np.uint16),
            reason=capture.reason,
            robot=capture.robot,
            station=station,
            amplitude=capture.amplitude,
            colour=capture.colour,
            temperature=capture.temperature,
        )


@dataclass(frozen=True, slots=True, eq=False)
class Posed:
    """A camera pose with its uncertainty.

    `cov` (6, 6) is of (x, y, z, rotX, rotY, rotZ) with fixed axes of the cell, as
    `PoseWithCovariance` has it; `null` (k, 6) are unit directions (same axes, 1 m against 1 rad
    scaled by `lever_m`) that the data do not determine and in which the robot's pose was kept.
    """

    T_cell_camera: Float
    cov: Float
    null: Float = field(default_factory=lambda: np.zeros((0, 6)))
    accepted: bool = True
    verdict: str = "ok"
    parts: Float = field(default_factory=lambda: np.zeros(0))
    """(P,) metres along the surface's normal by which each part of the scene deviates from its CAD, RMS; empty: no part does."""
    camera: Camera | None = None
    """The camera with the lens estimated from the session, where that is not the stated lens."""
    apart: Float = field(default_factory=lambda: np.zeros(0))
    """(P,) metres by which each part that `verdict` names is off its CAD, 0 for the others; empty: no part is."""
    short: str = "ok"
    """The verdict in a few words without numbers or names of parts, by which verdicts are counted."""

    def seen_by(self, stated: Camera) -> Camera:
        """The camera with the estimated lens; `stated`, CameraInfo's, where no lens was estimated."""
        return stated if self.camera is None else self.camera

    @property
    def cov_right(self) -> Float:
        """The covariance for `T_cell_camera @ exp(xi)`."""
        return se3.cov_right(self.T_cell_camera, self.cov)
