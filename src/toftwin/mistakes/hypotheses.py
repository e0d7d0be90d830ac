# SPDX-License-Identifier: Apache-2.0
"""The usual mistakes: for each, the view with the mistake corrected, and the line to change."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from tof_core import se3
from tof_core.capture import RobotPose, View

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from tof_core.arrays import Float
    from tof_core.camera import Camera
    from tof_core.options import BagOptions

UNITS = {
    10.0: "centimetres are written where millimetres are expected",
    0.1: "tenths of a millimetre are written where millimetres are expected",
    1000.0: "metres are read as millimetres",
    1e-3: "millimetres are read as metres",
    25.4: "inches are read as millimetres",
    1 / 39.3700787: "inches are read as metres",
    4.0: "quarters of the stated unit",
    0.25: "a unit of 0.25 mm (Kinect, RealSense) is read as 1 mm",
}
"""Factors by which depth must be multiplied, and their meaning; only factors of real cameras are tried."""
FOCAL = (0.5, 0.6, 0.68, 0.76, 0.84, 0.91, 1.1, 1.2, 1.32, 1.47, 1.65, 2.0)
"""Focal lengths over the stated one."""
CELL_SCALES = {
    1e-3: "the scene is in millimetres",
    1e3: "the scene is a thousand times too small: a scale of 0.001 for meshes in metres",
    0.0254: "the scene is in inches",
    1 / 0.0254: "the scene is 39.37 times too small: the scale of inches for meshes in metres",
    0.1: "the scene is ten times too large: in tenths of metres",
    10.0: "the scene is ten times too small: its scale is that of another unit",
}
"""Factors by which the whole scene (meshes and poses) must be multiplied."""


@dataclass(frozen=True, slots=True, eq=False)
class Mistake:
    """One possible mistake.

    what: the mistake in words; todo: the line to change; undone: the view as it would be without it; metres: length of a metre of
    the CAD after that (1 but for a scene of another unit).
    """

    what: str
    todo: str
    undone: Callable[[View], View]
    metres: float = 1.0


def none() -> Mistake:
    """No mistake."""
    return Mistake("", "", lambda view: view)


def usual(camera: Camera, options: BagOptions) -> Iterator[Mistake]:
    """All usual mistakes of a bag with this camera, read with these options."""
    yield from _units(options)
    yield from _images()
    if options.depth == "z":
        todo = "pass --depth radial (node: input.depth:=radial)"
        yield Mistake("depth is the distance along the ray, not z", todo, View.as_z)
    yield from _lenses(camera)
    yield from _transforms()
    yield from _scenes()


def _units(options: BagOptions) -> Iterator[Mistake]:
    for factor, what in UNITS.items():
        scale = options.depth_scale * factor
        todo = f"pass --depth-scale {scale:.4g} (node: input.depth_scale); a 32FC1 image must be published in metres (REP 118)"
        yield Mistake(f"depth is {1 / factor:.4g} times too large: {what}", todo, _times(factor))


def _times(factor: float) -> Callable[[View], View]:
    return lambda v: replace(v, depth=(v.depth * factor).astype(np.float32), sigma=(v.sigma * factor).astype(np.float32))


def _images() -> Iterator[Mistake]:
    turned: dict[str, tuple[Callable[[Any], Any], tuple[bool, bool]]] = {
        "mirrored left to right": (np.fliplr, (True, False)),
        "upside down, mirrored top to bottom": (np.flipud, (False, True)),
        "turned by 180 degrees (or the camera's frame is)": (lambda a: a[::-1, ::-1], (True, True)),
    }
    for what, (turn, (across, down)) in turned.items():
        todo = "let the driver publish the image as the lens sees it (image_flip, rotate), or turn the frame in the robot's TF"
        yield Mistake(f"the image is {what}", todo, _turned(turn, across=across, down=down))


def _turned(turn: Callable[[Any], Any], *, across: bool, down: bool) -> Callable[[View], View]:
    """The view with its image and principal point turned."""

    def undone(view: View) -> View:
        c = view.camera
        camera = replace(c, cx=c.width - 1 - c.cx if across else c.cx, cy=c.height - 1 - c.cy if down else c.cy)
        amplitude = None if view.amplitude is None else np.ascontiguousarray(turn(view.amplitude))
        images: dict[str, Any] = {name: np.ascontiguousarray(turn(getattr(view, name))) for name in ("depth", "sigma", "count", "reason")}
        return replace(view, camera=camera, amplitude=amplitude, **images)

    return undone


def _lenses(camera: Camera) -> Iterator[Mistake]:
    for ratio in FOCAL:
        fx = camera.fx * ratio
        todo = f"publish the camera_info of this camera and image size: fx should be about {fx:.0f}, not {camera.fx:.0f} (--info-topic names another one)"
        yield Mistake("CameraInfo is of another camera or image size", todo, _through(ratio, centred=False))
    off = np.hypot(camera.cx - (camera.width - 1) / 2, camera.cy - (camera.height - 1) / 2)
    if off > 0.05 * camera.width:
        todo = "publish the camera_info of this image size: cx, cy should be about the image's centre"
        yield Mistake("the principal point is of another image size or crop", todo, _through(1.0, centred=True))
        for ratio in FOCAL:
            todo = (
                f"publish the camera_info of this image size: fx should be about {camera.fx * ratio:.0f}, cx, cy about the image's centre"
            )
            yield Mistake("CameraInfo is of another camera or image size", todo, _through(ratio, centred=True))


def _through(ratio: float, *, centred: bool) -> Callable[[View], View]:
    def undone(view: View) -> View:
        c = view.camera
        cx, cy = ((c.width - 1) / 2, (c.height - 1) / 2) if centred else (c.cx, c.cy)
        return replace(view, camera=replace(c, fx=c.fx * ratio, fy=c.fy * ratio, cx=cx, cy=cy))

    return undone


OPTICAL = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
"""From the axes of an optical frame (z ahead, x right) to those of a body (x ahead, z up), REP 103."""


def _transforms() -> Iterator[Mistake]:
    ahead = "let TF end in the optical frame (z ahead, REP 103): the images' frame_id names one whose x is ahead"
    yield Mistake("the camera's frame has x ahead, not z", ahead, _posed(lambda T: T @ OPTICAL))
    yield Mistake(
        "the camera's frame is turned twice into an optical one",
        "take one optical rotation out of the robot's TF",
        _posed(lambda T: T @ OPTICAL.T),
    )
    yield Mistake(
        "the transform to the camera is inverted", "swap parent and child of the cell's transform, or invert it", _posed(se3.inverse)
    )
    for turn in (90, 180, 270):
        todo = f"turn the cell by {turn} degrees about its z axis: --initial-pose, placed_in of scene.yaml, or the cell's transform"
        T_turn = se3.exp([0, 0, 0, 0, 0, np.radians(turn)])
        yield Mistake(f"the cell is turned by {turn} degrees about z", todo, _posed(_left(T_turn)))
    for axis, twist in (("x", [0, 0, 0, np.pi, 0, 0]), ("y", [0, 0, 0, 0, np.pi, 0])):
        todo = f"turn the parts of scene.yaml, or the cell, by 180 degrees about {axis}"
        yield Mistake(f"the scene is upside down: turned by 180 degrees about {axis}", todo, _posed(_left(se3.exp(twist))))


def _left(T_turn: Float) -> Callable[[Float], Float]:
    return lambda T: np.asarray(T_turn @ T)


def _scenes() -> Iterator[Mistake]:
    for factor, what in CELL_SCALES.items():
        todo = f"multiply scale and the positions of all parts in scene.yaml by {factor:g}"
        yield Mistake(what, todo, _in_cell_of(factor), 1 / factor)


def _in_cell_of(factor: float) -> Callable[[View], View]:
    """The view with its lengths in the CAD's unit: a scene that is too large is tested by a camera and an arm that are larger."""
    placed = _posed(lambda T: _at(T, T[:3, 3] / factor))
    return lambda view: placed(_times(1 / factor)(view))


def _posed(change: Callable[[Float], Float]) -> Callable[[View], View]:
    """The view with another camera pose in the cell; the base stays at the camera, so that it can still be registered."""

    def undone(view: View) -> View:
        assert view.robot is not None
        return replace(view, robot=RobotPose(np.eye(4), np.asarray(change(view.robot.T_cell_camera))))

    return undone


def _at(T: Float, place: Float) -> Float:
    """The view with the pose of another view."""
    out = np.array(T)
    out[:3, 3] = place
    return out
