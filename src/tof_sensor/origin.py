# SPDX-License-Identifier: Apache-2.0
"""Origin of a sensor model: the camera that it was fitted to, and the shrink of the gap stated by the fit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from tof_core.camera import Camera
from tof_core.config import LARGEST
from tof_core.errors import ConfigError, RefusedError

if TYPE_CHECKING:
    from pathlib import Path

SAME_PX = 0.01
"""Difference of focal length or principal point, in pixels, above which two cameras differ: files keep six digits."""
SIZES, LENS = ("width", "height"), ("fx", "fy", "cx", "cy")
LENS_FAULT = 0.05
"""Share of the image's width by which focal length or principal point may be wrong in CameraInfo: units of one type differ by up to 3 %."""
CAMERA_KEYS = {*SIZES, *LENS, "distortion_model", "distortion"}


@dataclass(frozen=True, slots=True)
class Promise:
    """Shrink of the gap on held-out views of the session that the model was fitted to, and its 95 % interval; 1: the whole gap."""

    shrink: float
    low: float
    high: float


USE_OWN = "diagnose a session of this camera with `toftwin gap` and use its sensor.yaml"


def check_camera(fitted: Camera | None, here: Camera, *, any_lens: bool = False, todo: str = USE_OWN) -> None:
    """Refuse a model of another camera, or of another calibration of its lens; a model without a camera is valid for all.

    any_lens: whether the calibrations may differ as far as those of two units of one type (`LENS_FAULT`); todo: what is to be done otherwise.

    Raises:
        RefusedError: the cameras differ.
    """
    differs = differences(fitted, here)
    if fitted is not None and any_lens and fitted.shape == here.shape:
        differs = _differ(fitted, here, LENS, LENS_FAULT * here.width)
    if differs:
        msg = f"was fitted to another camera ({', '.join(differs)})"
        raise RefusedError(msg, where="sensor.yaml", todo=todo)


def differences(fitted: Camera | None, here: Camera) -> list[str]:
    """In words, how the camera that a model was fitted to differs from the one here; empty without one."""
    if fitted is None:
        return []
    other = [] if _coefficients(fitted) == _coefficients(here) else ["distortion"]
    return [*_differ(fitted, here, SIZES, 0.0), *_differ(fitted, here, LENS, SAME_PX), *other]


def _differ(fitted: Camera, here: Camera, names: tuple[str, ...], most: float) -> list[str]:
    """Both values of each attribute that differs by more than `most` pixels."""
    values = [(name, getattr(fitted, name), getattr(here, name)) for name in names]
    return [f"{name} {a:g} against {b:g}" for name, a, b in values if abs(a - b) > most]


def _coefficients(camera: Camera) -> tuple[float, ...]:
    """Distortion without trailing zeros, rounded as in files."""
    values = [round(c, 6) for c in camera.distortion]
    while values and values[-1] == 0.0:
        values.pop()
    return tuple(values)


def to_blocks(camera: Camera | None, promise: Promise | None) -> dict[str, Any]:
    """The known ones of the keys `camera` and `promise` of `sensor.yaml`."""
    out: dict[str, Any] = {}
    if camera is not None:
        lens = {k: float(getattr(camera, k)) for k in LENS}
        out["camera"] = {k: int(getattr(camera, k)) for k in SIZES} | lens
        out["camera"] |= {"distortion_model": camera.distortion_model, "distortion": [float(c) for c in camera.distortion]}
    if promise is not None:
        out["promise"] = {"shrink": float(promise.shrink), "ci95": [float(promise.low), float(promise.high)]}
    return out


def camera_from(block: Any, path: Path) -> Camera | None:
    """The camera of a `camera` block, None without one.

    Raises:
        ConfigError: the block is no camera.
    """
    if block is None:
        return None
    if not isinstance(block, dict) or set(block) != CAMERA_KEYS:
        msg = f"camera must hold {', '.join(sorted(CAMERA_KEYS))}"
        raise ConfigError(msg, where=path)
    numbers = [block[k] for k in (*SIZES, *LENS)]
    distortion, model = block["distortion"], block["distortion_model"]
    if not (isinstance(model, str) and isinstance(distortion, list) and _finite([*numbers, *distortion])):
        msg = "camera must hold numbers, a distortion_model and a list of distortion coefficients"
        raise ConfigError(msg, where=path)
    width, height = (int(block[k]) for k in SIZES)
    fx, fy, cx, cy = (float(block[k]) for k in LENS)
    return Camera(width, height, fx, fy, cx, cy, model, tuple(float(c) for c in distortion))


def promise_from(block: Any, path: Path) -> Promise | None:
    """The promise of a `promise` block, None without one.

    Raises:
        ConfigError: the block is no promise.
    """
    if block is None:
        return None
    values = [block.get("shrink"), *(block.get("ci95") or [])] if isinstance(block, dict) and isinstance(block.get("ci95"), list) else []
    if len(values) != 3 or set(block) != {"shrink", "ci95"} or not _finite(values):
        msg = "promise must hold shrink and ci95 (two numbers)"
        raise ConfigError(msg, where=path)
    return Promise(*(float(v) for v in values))


def _finite(values: list[Any]) -> bool:
    return all(isinstance(v, int | float) and not isinstance(v, bool) and -LARGEST < v < LARGEST for v in values)
