# SPDX-License-Identifier: Apache-2.0
"""Intrinsics: the lens differs from CameraInfo."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from tof_core.config import param
from tof_core.lens import LENS, ray_shift, with_lens
from tof_sensor.action import ASIDE, FARTHER, NEARER
from tof_sensor.effect import Effect, Form
from tof_sensor.geometry import ray_columns

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tof_core.arrays import Float
    from tof_core.camera import Camera
    from tof_sensor.frame import Frame
    from tof_sensor.session import Session


CONVERSIONS = STATED_LENS, TRUE_LENS = "stated_lens", "true_lens"
"""Lenses with which a camera may convert distance to z."""


@dataclass(frozen=True, slots=True)
class Intrinsics(Effect):
    """True minus stated intrinsics: pixels have other rays (docs/effects.md).

    A time-of-flight camera measures distance along the ray and converts it to z with the lens in CameraInfo (`z_from` "stated_lens"):
    with another true lens, z is also wrong by the ratio of the rays' lengths. A camera that measures z, or converts with its true lens,
    has `z_from` "true_lens".
    """

    NAME: ClassVar[str] = "intrinsics"
    ORDER: ClassVar[int] = 30
    MEANING: ClassVar[str] = "the lens is not what camera_info says"
    REMEDY: ClassVar[str] = "calibrate the lens (`toftwin gap --board ... --calibrate`) and publish the new camera_info"
    SEPARATED_BY: ClassVar[str] = "a calibration of the lens"
    ACTIONS: ClassVar = (ASIDE, NEARER, FARTHER)
    LINEAR: ClassVar[tuple[str, ...]] = LENS

    fx_rel: float = param(0.0, "relative focal length in x", low=-0.1, high=0.1)
    fy_rel: float = param(0.0, "relative focal length in y", low=-0.1, high=0.1)
    cx_px: float = param(0.0, "principal point in x", unit="px", low=-30.0, high=30.0)
    cy_px: float = param(0.0, "principal point in y", unit="px", low=-30.0, high=30.0)
    k1: float = param(0.0, "radial distortion", low=-0.5, high=0.5)
    k2: float = param(0.0, "radial distortion, 4th order", low=-0.5, high=0.5)
    p1: float = param(0.0, "tangential distortion", low=-0.05, high=0.05)
    p2: float = param(0.0, "tangential distortion", low=-0.05, high=0.05)

    z_from: str = param(STATED_LENS, "lens with which distance was converted to z", choices=CONVERSIONS)

    @property
    def stated(self) -> str:
        """Focal length and principal point."""
        focal, centre = 50.0 * (self.fx_rel + self.fy_rel), np.hypot(self.cx_px, self.cy_px)
        return f"focal length {focal:+.2f} %, principal point off by {centre:.1f} px"

    def published(self, stated: Camera) -> Float:
        """(H, W) ratio of published to true z."""
        if self.z_from == TRUE_LENS:
            return np.ones((stated.height, stated.width))
        true, assumed = (np.linalg.norm(camera.rays(), axis=-1) for camera in (self.camera(stated), stated))
        return np.asarray(true / assumed)

    def camera(self, stated: Camera) -> Camera:
        """The true camera, if CameraInfo states `stated`."""
        return with_lens(stated, self.coefficients)

    def columns(self, frame: Frame) -> Float:
        """Change of z per unit of each parameter, by the direction of the ray and by its length."""
        return self._answer(frame, self._shift(frame))

    def bias(self, frame: Frame) -> Float:
        """Bias of the current parameters, computed without a column for each."""
        return np.asarray(self._answer(frame, self._shift(frame) @ self.coefficients[:, None])[..., 0])

    def _answer(self, frame: Frame, shift: Float) -> Float:
        """(H, W, k) change of z in metres by `shift` (H, W, 2, k) of the rays."""
        turned = ray_columns(frame, shift)
        if self.z_from == TRUE_LENS:
            return turned
        longer = np.einsum("...i,...ik->...k", frame.rays[..., :2], shift) / frame.length[..., None] ** 2
        return np.asarray(turned + np.nan_to_num(frame.depth)[..., None] * np.nan_to_num(longer))

    def _shift(self, frame: Frame) -> Float:
        """(H, W, 2, 8) true minus stated ray, normalised x and y, by each parameter."""
        return _ray_shift(frame.camera) if frame.rays is frame.camera.rays() else ray_shift(frame.rays, frame.camera)

    def prior_sd(self, scale: Float) -> Float:
        """(k,) prior standard deviations, `USUAL_SD` times `scale`: without them, hand-eye, principal point and tangential terms correlate."""
        return np.array(USUAL_SD) * scale

    @classmethod
    def hypotheses(cls, session: Session) -> Iterator[Form]:
        """Two forms: conversion to z with the stated and with the true lens."""
        del session
        for lens in CONVERSIONS:
            yield Form(cls(z_from=lens), f"z from the {lens.replace('_', ' ')}")


USUAL_SD = (0.02, 0.02, 10.0, 10.0, 0.1, 0.1, 1e-3, 1e-3)
"""Prior standard deviations of a lens from its CameraInfo, in the order of `LINEAR`.

Calibrations of one lens differ by less than 2 % and ten pixels, or by all of its radial distortion; decentring of molded lenses is
within 1e-3. A rotation of the camera equals a shift of the principal point with tangential terms.
"""


@lru_cache(maxsize=8)
def _ray_shift(camera: Camera) -> Float:
    return ray_shift(camera.rays(), camera)
