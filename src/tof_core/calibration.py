# SPDX-License-Identifier: Apache-2.0
"""Accuracy of a camera's calibration: the largest errors that the maker or the plant states."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tof_core.config import from_mapping, param, section, to_mapping
from tof_core.yamlio import load_yaml, save_yaml

if TYPE_CHECKING:
    from pathlib import Path

    from tof_core.arrays import Float
    from tof_core.camera import Camera

FILE = "calibration.yaml"
"""Name of the file beside scene.yaml."""


@dataclass(frozen=True, slots=True)
class HandEyeLimits:
    """Largest errors of the hand-eye calibration."""

    translation_mm: float = param(
        0.0,
        "largest error of the camera's place in the hand: length over all three axes, not per axis; 3 times a standard deviation per axis",
        unit="mm",
        low=0.0,
        high=100.0,
        why="as the calibration's report states",
    )
    rotation_deg: float = param(
        0.0,
        "largest error of its direction: angle about any axis, not per axis; 3 times a standard deviation per axis",
        unit="deg",
        low=0.0,
        high=10.0,
        why="as the calibration's report states",
    )


@dataclass(frozen=True, slots=True)
class LensLimits:
    """Largest errors of the lens calibration."""

    principal_point_px: float = param(
        0.0,
        "largest error of the principal point: distance in the image, not per axis; 2.4 times a standard deviation per axis",
        unit="px",
        low=0.0,
        high=100.0,
        why="as the calibration's report states",
    )
    focal_pct: float = param(
        0.0,
        "largest error of the focal length, the same for fx and fy; 1.7 times a standard deviation",
        unit="%",
        low=0.0,
        high=10.0,
        why="as the calibration's report states",
    )


@dataclass(frozen=True, slots=True)
class AlbedoLimits:
    """Largest errors of the scene's albedos."""

    relative: float = param(
        0.0, "largest relative error of a part's infrared albedo", low=0.0, high=10.0, why="as the calibration's report states"
    )


@dataclass(frozen=True, slots=True)
class BoardLimits:
    """Largest errors of a calibration board."""

    print_scale_pct: float = param(
        0.0, "largest error of the board's print scale", unit="%", low=0.0, high=10.0, why="as measured with a ruler over ten squares"
    )


@dataclass(frozen=True, slots=True)
class Modulation:
    """Modulation frequencies of the camera's light, as its data sheet states them."""

    first_mhz: float = param(
        0.0,
        "first modulation frequency; 0: none is stated, or the camera has none",
        unit="MHz",
        low=0.0,
        high=400.0,
        why="as the data sheet states",
    )
    second_mhz: float = param(
        0.0, "second modulation frequency, of a camera that merges several", unit="MHz", low=0.0, high=400.0, why="as the data sheet states"
    )
    third_mhz: float = param(
        0.0, "third modulation frequency, of a camera that merges three", unit="MHz", low=0.0, high=400.0, why="as the data sheet states"
    )

    @property
    def stated(self) -> tuple[float, ...]:
        """The stated frequencies, MHz."""
        return tuple(mhz for mhz in (self.first_mhz, self.second_mhz, self.third_mhz) if mhz > 0.0)


@dataclass(frozen=True, slots=True)
class Calibration:
    """Largest errors of a calibration, and the modulation of the light, as stated; 0: none is stated.

    An error is taken as evenly distributed from 0 to the largest, in any direction: each of n components has the standard
    deviation `largest / sqrt(3 n)`.
    """

    hand_eye: HandEyeLimits = section(HandEyeLimits, "hand-eye")
    lens: LensLimits = section(LensLimits, "lens")
    albedo: AlbedoLimits = section(AlbedoLimits, "albedo")
    board: BoardLimits = section(BoardLimits, "board")
    modulation: Modulation = section(Modulation, "modulation of the camera's light")

    @property
    def hand_eye_most(self) -> tuple[float, float]:
        """Largest error of hand-eye: metres, radians."""
        return 1e-3 * self.hand_eye.translation_mm, float(np.radians(self.hand_eye.rotation_deg))

    def lens_most_px(self, radius_px: float) -> float:
        """Largest shift in pixels of a point `radius_px` from the principal point."""
        return self.lens.principal_point_px + 1e-2 * self.lens.focal_pct * radius_px

    @property
    def hand_eye_sd(self) -> Float:
        """(6,) prior deviations of hand-eye: metres, radians."""
        return np.repeat(self.hand_eye_most, 3) / 3.0

    @property
    def lens_sd(self) -> Float:
        """(4,) prior deviations of fx and fy (relative) and of cx and cy (pixels)."""
        focal, centre = 1e-2 * self.lens.focal_pct / np.sqrt(3.0), self.lens.principal_point_px / np.sqrt(6.0)
        return np.array([focal, focal, centre, centre])


def lens_limits(camera: Camera, sd: Float) -> LensLimits:
    """The limits whose prior has the standard deviations (fx, fy, cx, cy, ...) in pixels of a lens calibration."""
    focal = float(np.sqrt(np.mean((sd[:2] / [camera.fx, camera.fy]) ** 2)))
    centre = float(np.sqrt(np.mean(sd[2:4] ** 2)))
    return LensLimits(principal_point_px=float(np.sqrt(6.0) * centre), focal_pct=float(1e2 * np.sqrt(3.0) * focal))


def save_calibration(calibration: Calibration, path: Path) -> None:
    """Write `calibration.yaml`."""
    save_yaml(path, to_mapping(calibration))


def load_calibration(path: Path) -> Calibration:
    """Read `calibration.yaml`; unknown keys and values out of bounds are refused."""
    return from_mapping(Calibration, load_yaml(path), where=str(path))


def calibration_beside(folder: Path) -> Calibration:
    """The calibration in the folder of a scene; none is stated without the file."""
    path = folder / FILE
    return load_calibration(path) if path.exists() else Calibration()
