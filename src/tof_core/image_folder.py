# SPDX-License-Identifier: Apache-2.0
"""A folder of PNG pairs as captures: `depth_*.png`, `ir_*.png` of the same name, and `camera.yaml`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from tof_core.camera import Camera
from tof_core.capture import Capture
from tof_core.decode import check_size, depth_of_counts
from tof_core.errors import CameraError, ConfigError, DecodeError
from tof_core.png import decode_png
from tof_core.yamlio import load_yaml, save_yaml

if TYPE_CHECKING:
    from pathlib import Path

    from tof_core.arrays import Float

CAMERA, DEPTH, AMPLITUDE = "camera.yaml", "depth_", "ir_"
DEVIATIONS = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
"""Lens parameters that `--calibrate` fits."""
LARGEST_FILE = 64 * 2**20
"""Largest PNG file in bytes: an image of sixteen million 16-bit pixels has half of that."""
SPACING_NS = 1_000_000_000
"""Nanoseconds between the stamps given to files, which have none."""


def is_image_folder(path: Path) -> bool:
    """Whether a folder holds PNG pairs rather than a bag."""
    return (path / CAMERA).is_file() and any(path.glob(f"{DEPTH}*.png"))


def read_image_folder(folder: Path, *, depth_scale: float = 0.001) -> list[Capture]:
    """Captures in the order of the files' names.

    Args:
        folder: `depth_NAME.png` (16 bit, `depth_scale` metres a count, 0 invalid), `ir_NAME.png` (8 or 16 bit, optional), `camera.yaml` as
            ROS's camera_calibration writes it (image_width, image_height, camera_matrix, distortion_model, distortion_coefficients).
        depth_scale: metres a count.

    Raises:
        DecodeError: a file is no PNG of the camera's size.
        ConfigError, CameraError: `camera.yaml` is not complete.
    """
    camera = read_camera(folder / CAMERA)
    captures = []
    for number, path in enumerate(sorted(folder.glob(f"{DEPTH}*.png"))):
        depth, reason = depth_of_counts(_raster(path, camera, "uint16"), depth_scale)
        amplitude = path.with_name(AMPLITUDE + path.name.removeprefix(DEPTH))
        light = _raster(amplitude, camera).astype(np.float32) if amplitude.is_file() else None
        captures.append(Capture(number * SPACING_NS, camera, depth, reason, amplitude=light))
    if not captures:
        raise DecodeError("holds no depth images", where=folder, todo=f"name them {DEPTH}0001.png, {DEPTH}0002.png ...")
    return captures


def _raster(path: Path, camera: Camera, kind: str = "") -> Any:
    if path.stat().st_size > LARGEST_FILE:
        raise DecodeError("is no image of a depth camera", where=path, todo=f"PNG files of up to {LARGEST_FILE >> 20} MB are read")
    raster = decode_png(path.read_bytes(), path)
    if raster.ndim != 2 or (kind and raster.dtype != kind):
        raise DecodeError("is no single-channel image" if raster.ndim != 2 else f"holds {raster.dtype} and not {kind}", where=path)
    check_size(raster.shape, camera, str(path))
    return raster


def write_camera(camera: Camera, path: Path, sd: Float | None = None) -> None:
    """Write a `camera.yaml` as `read_camera` reads it; `sd` (9,) are standard deviations of fx, fy, cx, cy (pixels), k1, k2, p1, p2, k3."""
    values = {
        "image_width": camera.width,
        "image_height": camera.height,
        "camera_name": camera.frame_id or "camera",
        "camera_matrix": {"rows": 3, "cols": 3, "data": [float(x) for x in camera.K.ravel()]},
        "distortion_model": camera.distortion_model,
        "distortion_coefficients": {"rows": 1, "cols": len(camera.distortion), "data": list(camera.distortion)},
    }
    deviations = {} if sd is None else {"standard_deviations": dict(zip(DEVIATIONS, (float(x) for x in sd), strict=True))}
    save_yaml(path, values | deviations)


def read_camera(path: Path) -> Camera:
    """The camera of a `camera.yaml`."""
    values = load_yaml(path)
    try:
        K = np.asarray(values["camera_matrix"]["data"], float).reshape(3, 3)
        lens = values.get("distortion_coefficients", {}).get("data", ())
        return Camera(
            width=int(values["image_width"]),
            height=int(values["image_height"]),
            fx=float(K[0, 0]),
            fy=float(K[1, 1]),
            cx=float(K[0, 2]),
            cy=float(K[1, 2]),
            distortion_model=str(values.get("distortion_model", "plumb_bob")),
            distortion=tuple(float(x) for x in lens),
            frame_id=str(values.get("camera_name", "camera")),
        )
    except CameraError as error:
        raise CameraError(error.what, where=path, todo=error.todo) from None
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        what = f"lacks or garbles {error}" if isinstance(error, KeyError) else "is no camera calibration"
        raise ConfigError(
            what, where=path, todo="write image_width, image_height, camera_matrix.data (9) and distortion_coefficients.data"
        ) from None
