# SPDX-License-Identifier: Apache-2.0
"""Twenty usual mistakes, made in the views of a recorded session or in its scene.yaml, and the words that must name each."""

from __future__ import annotations

import shutil
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import yaml

from benchmarks.radial import z_to_radial
from tof_core import se3
from tof_core.capture import RobotPose

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from tof_core.arrays import Float
    from tof_core.capture import View

AHEAD = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
"""From optical axes to those of REP 103."""


@dataclass(frozen=True, slots=True)
class Made:
    """A mistake: its name, what it does to a view or to the content of scene.yaml, and words of the advice that must name it."""

    name: str
    words: str
    view: Callable[[View], View] = lambda view: view
    scene: Callable[[dict[str, Any], str], None] | None = None


def _depth(factor: float) -> Callable[[View], View]:
    return lambda v: replace(v, depth=(v.depth * factor).astype(np.float32))


def _image(turn: Callable[[Any], Any]) -> Callable[[View], View]:
    def turned(v: View) -> View:
        images: dict[str, Any] = {n: np.ascontiguousarray(turn(getattr(v, n))) for n in ("depth", "sigma", "count", "reason")}
        return replace(v, amplitude=None if v.amplitude is None else np.ascontiguousarray(turn(v.amplitude)), **images)

    return turned


def _focal(factor: float) -> Callable[[View], View]:
    return lambda v: replace(v, camera=replace(v.camera, fx=v.camera.fx * factor, fy=v.camera.fy * factor))


def _pose(change: Callable[[Float], Float]) -> Callable[[View], View]:
    def moved(v: View) -> View:
        assert v.robot is not None
        return replace(v, robot=RobotPose(np.eye(4), np.asarray(change(v.robot.T_cell_camera))))

    return moved


def _turn(axis: int, degrees: float) -> Float:
    twist = np.zeros(6)
    twist[3 + axis] = np.radians(degrees)
    return se3.exp(twist)


def _scaled(factor: float) -> Callable[[dict[str, Any], str], None]:
    def change(content: dict[str, Any], part: str) -> None:
        entry = next(p for p in content["parts"] if p["name"] == part)
        entry["scale"] = factor

    return change


def _misplaced(content: dict[str, Any], part: str) -> None:
    """A part's pose in millimetres: its mesh is in the cell's axes, so that a metre becomes a thousand."""
    next(p for p in content["parts"] if p["name"] == part)["pose"] = [400.0, 100.0, 800.0, 0, 0, 0, 1]


def _all_scaled(content: dict[str, Any], _part: str) -> None:
    for entry in content["parts"]:
        entry["scale"] = 0.0254


TWENTY = (
    Made("centimetres as millimetres", "centimetres are written", _depth(0.1)),
    Made("metres as millimetres", "metres are read as millimetres", _depth(1e-3)),
    Made("millimetres as metres", "millimetres are read as metres", _depth(1e3)),
    Made("inches as metres", "inches are read as metres", _depth(39.3700787)),
    Made("quarter millimetres as millimetres", "0.25 mm", _depth(4.0)),
    Made("mirrored left to right", "left to right", _image(np.fliplr)),
    Made("mirrored top to bottom", "top to bottom", _image(np.flipud)),
    Made("turned by 180 degrees", "turned by 180 degrees", _image(lambda a: a[::-1, ::-1])),
    Made("radial distance", "along the ray", lambda v: replace(v, depth=z_to_radial(v.camera, v.depth))),
    Made("K of half the image size", "CameraInfo", _focal(0.5)),
    Made("K of a wider camera", "CameraInfo", _focal(0.8)),
    Made("K of a narrower camera", "CameraInfo", _focal(1.25)),
    Made("x ahead in the camera's frame", "x ahead", _pose(lambda T: T @ np.linalg.inv(AHEAD))),
    Made("inverted transform", "inverted", _pose(se3.inverse)),
    Made("cell turned by 180 degrees", "turned by 180 degrees about z", _pose(lambda T: _turn(2, 180) @ T)),
    Made("scene upside down", "upside down", _pose(lambda T: _turn(0, 180) @ T)),
    Made("another scene", "another scene", scene=lambda content, _part: content.clear()),
    Made("part with a scale of 0.001", "too small to be seen", scene=_scaled(1e-3)),
    Made("part with a pose in millimetres", "from the others", scene=_misplaced),
    Made("scene in inches", "inches", scene=_all_scaled),
)


def edited(folder: Path, out: Path, made: Made, part: str, other: Path) -> Path:
    """A copy of a scene's folder with the mistake in its scene.yaml; `other` is the folder of another scene. Returns the file."""
    assert made.scene is not None
    content: dict[str, Any] = yaml.safe_load((folder / "scene.yaml").read_text(encoding="utf-8"))
    made.scene(content, part)
    shutil.rmtree(out, ignore_errors=True)
    shutil.copytree(folder if content else other, out)
    if content:
        (out / "scene.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
    return out / "scene.yaml"
