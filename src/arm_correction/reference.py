# SPDX-License-Identifier: Apache-2.0
"""The stored reference view: depth, sigma, pose, colour, intrinsics, and the region of interest."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tof_align.pixels import view_sigma
from tof_core import se3
from tof_core.camera import Camera
from tof_core.capture import Colour
from tof_core.errors import DatasetError, RefusedError, ToftwinError, UsageError
from tof_core.npz import read_npz

if TYPE_CHECKING:
    from tof_align.config import WeightConfig
    from tof_core.arrays import Float, Image, Mask
    from tof_core.capture import View

SCHEMA = "toftwin.reference/1"


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """The reference view.

    depth, sigma (H, W) metres, region (H, W) the pixels of interest; T_cell_body, T_body_camera (4, 4) by TF at that
    time; T_cell_camera (4, 4) by the CAD, or None; colour: the image with its camera, or None; scene: digest of the CAD, "" for none.
    """

    camera: Camera
    depth: Image
    sigma: Image
    region: Mask
    T_cell_body: Float
    T_body_camera: Float
    stamp_ns: int
    scene: str = ""
    T_cell_camera: Float | None = None
    colour: Colour | None = None

    def check(self, view: View, scene: str = "") -> None:
        """Refuse a view of another camera or size, or one of another scene."""
        mine, its = self.camera, view.camera
        if mine.shape != its.shape:
            raise RefusedError(
                f"the reference is {mine.width}x{mine.height}, the view {its.width}x{its.height}",
                where="reference",
                todo="capture the reference again with this camera mode",
            )
        if not np.allclose([mine.fx, mine.fy, mine.cx, mine.cy], [its.fx, its.fy, its.cx, its.cy], rtol=1e-3, atol=0.2) or not np.allclose(
            _padded(mine.distortion), _padded(its.distortion), atol=1e-4
        ):
            raise RefusedError(
                "the reference was taken with another camera (intrinsics differ)", where="reference", todo="capture it again with this one"
            )
        self.check_scene(scene)

    def check_scene(self, scene: str) -> None:
        """Refuse another scene's CAD, by its digest; "" fits any scene."""
        if scene and self.scene and scene != self.scene:
            raise RefusedError(
                "the reference belongs to another scene (its CAD differs)", where="reference", todo="pass that scene, or capture it again"
            )


def _padded(distortion: tuple[float, ...]) -> Float:
    return np.array([*distortion, *(0.0,) * (8 - len(distortion))])


def capture_reference(
    view: View, weights: WeightConfig, *, region: Mask | None = None, scene: str = "", T_cell_camera: Float | None = None
) -> Reference:
    """Store a view as the reference; `region` (H, W) marks the pixels of interest (default: all)."""
    if view.robot is None:
        raise RefusedError("the view has no robot pose", where="reference", todo="record TF with the images")
    mask = np.ones(view.depth.shape, bool) if region is None else region
    if mask.shape != view.depth.shape:
        raise UsageError(
            f"the region is {mask.shape[1]}x{mask.shape[0]}, the view {view.camera.width}x{view.camera.height}", where="reference"
        )
    if int((mask & view.valid).sum()) < 400:
        raise RefusedError(
            f"only {int((mask & view.valid).sum())} pixels of the region have a depth (at least 400)",
            where="reference",
            todo="look at the part from 0.3 to 2 m",
        )
    sigma = view_sigma(view, weights, np.ix_(*map(np.arange, view.depth.shape)))
    return Reference(
        view.camera,
        view.depth,
        sigma.astype(np.float32),
        mask,
        view.robot.T_cell_body,
        view.robot.T_body_camera,
        view.stamp_ns,
        scene,
        T_cell_camera,
        view.colour,
    )


def save_reference(reference: Reference, path: Path | str) -> Path:
    """Write `<path>.npz` (arrays) and `<path>.json` (description); returns the path of the JSON file."""
    path = Path(path).with_suffix("")
    path.parent.mkdir(parents=True, exist_ok=True)
    r = reference
    arrays: dict[str, Any] = {
        "depth": r.depth,
        "sigma": r.sigma,
        "region": r.region,
        "T_cell_body": r.T_cell_body,
        "T_body_camera": r.T_body_camera,
    }
    colour = r.colour or Colour(np.zeros((0, 0, 3), np.uint8))
    optional = {"T_cell_camera": r.T_cell_camera, "colour": r.colour and colour.image, "T_camera_colour": colour.T_camera_colour}
    arrays |= {name: value for name, value in optional.items() if value is not None}
    np.savez_compressed(path.with_suffix(".npz"), **arrays)
    facts = {"schema": SCHEMA, "stamp_ns": r.stamp_ns, "scene": r.scene, "camera": asdict(r.camera)}
    if colour.camera is not None:
        facts["colour_camera"] = asdict(colour.camera)
    path.with_suffix(".json").write_text(json.dumps(facts, indent=1), encoding="utf-8")
    return path.with_suffix(".json")


def load_reference(path: Path | str) -> Reference:
    """Read a reference written by `save_reference`; damaged files and other schemas are refused."""
    path = Path(path).with_suffix("")
    try:
        out = _read(path)
    except FileNotFoundError as error:
        raise UsageError("there is no such reference (a .json and a .npz)", where=path, todo="capture one with --save") from error
    except ToftwinError:
        raise
    except Exception as error:  # whatever a damaged zip or JSON raises
        raise RefusedError(f"cannot be read ({type(error).__name__})", where=path, todo="capture the reference again") from error
    if not out.depth.shape == out.sigma.shape == out.region.shape == out.camera.shape:
        raise RefusedError("its images do not have the camera's size", where=path, todo="capture the reference again")
    return out


def _read(path: Path) -> Reference:
    facts = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))
    if facts.get("schema") != SCHEMA:
        raise RefusedError(f"schema '{facts.get('schema')}' is not {SCHEMA}", where=path, todo="capture the reference again")
    try:
        arrays = read_npz(path.with_suffix(".npz"))
    except DatasetError as error:
        raise RefusedError(f"cannot be read: it {error.what}", where=error.where, todo="capture the reference again") from None
    camera = _camera(facts["camera"])
    poses = {name: se3.as_se3(name, arrays[name]) for name in ("T_cell_body", "T_body_camera")}
    by_cad = se3.as_se3("T_cell_camera", arrays["T_cell_camera"]) if "T_cell_camera" in arrays else None
    return Reference(camera, arrays["depth"], arrays["sigma"], arrays["region"].astype(bool), **poses, stamp_ns=int(facts["stamp_ns"]),
                     scene=str(facts["scene"]), T_cell_camera=by_cad, colour=_colour(arrays, facts))  # fmt: skip


def _camera(facts: dict[str, Any]) -> Camera:
    return Camera(**{**facts, "distortion": tuple(facts["distortion"])})


def _colour(arrays: dict[str, Any], facts: dict[str, Any]) -> Colour | None:
    if "colour" not in arrays:
        return None
    camera = _camera(facts["colour_camera"]) if "colour_camera" in facts else None
    T = se3.as_se3("T_camera_colour", arrays["T_camera_colour"]) if "T_camera_colour" in arrays else None
    return Colour(arrays["colour"], camera, T, int(facts["stamp_ns"]))
