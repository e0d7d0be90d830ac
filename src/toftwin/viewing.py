# SPDX-License-Identifier: Apache-2.0
"""Bags, datasets and gap reports as a rerun recording: the scene, clouds, the camera and its path, images, all on the stamps' time line.

Entities: `cell/parts/NAME`, `cell/path`, `cell/camera`, `cell/measured`, `cell/labelled`, `images/...`; everything in the cell's frame, metres.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np

from tof_core import se3
from tof_core.errors import DatasetError, UsageError
from tof_core.npz import read_npz

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from numpy.typing import NDArray

    from tof_core.arrays import Bytes, Float, Image
    from tof_core.bag import BagReader
    from tof_core.camera import Camera
    from tof_scene.scene import Scene
    from tof_sim_label.dataset import Dataset

TIME = "stamp"
RESIDUAL_SPAN_M = 0.01
"""Measured minus label at which the colours blue (too near) and red (too far) saturate, metres."""
MEASURED_RGB, LABELLED_RGB, PATH_RGB = (232, 89, 12), (11, 114, 133), (112, 72, 232)


def rerun() -> Any:
    """The module rerun; if it is missing, a UsageError with the line that installs it."""
    try:
        import rerun as rr
    except ImportError:
        from toftwin.extras import install_line

        raise UsageError("rerun is not installed", where="toftwin view", todo=install_line("view")) from None
    return rr


class Scribe:
    """Writes scene, clouds, poses and images into a rerun recording."""

    def __init__(self, path: Path) -> None:
        self._rr = rerun()
        self._log = self._rr.RecordingStream("toftwin", recording_id=path.stem)
        self._log.save(str(path))
        self._path: list[Float] = []
        self._log.log("cell", self._rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)

    def close(self) -> None:
        """Draw the camera's path and finish the file."""
        if self._path:
            self._log.log("cell/path", self._rr.LineStrips3D([np.array(self._path)], colors=[PATH_RGB], radii=[0.001]), static=True)
        self._log.flush()
        self._log.disconnect()

    def scene(self, scene: Scene, gap_m: Mapping[str, float] | None = None) -> None:
        """The parts: grey as their albedo, or from green over yellow to red as their gap grows to the largest of them."""
        largest = max([g for g in (gap_m or {}).values() if np.isfinite(g)], default=0.0)
        for part in scene.parts:
            gap = (gap_m or {}).get(part.name, np.nan)
            grey = int(255 * part.material.albedo)
            colour = heat(np.array([gap / largest]))[0] if largest and np.isfinite(gap) else np.array([grey, grey, grey])
            mesh = self._rr.Mesh3D(vertex_positions=part.vertices, triangle_indices=part.faces, albedo_factor=colour)
            self._log.log(["cell", "parts", part.name], mesh, static=True)
            if np.isfinite(gap):
                self._log.log(["gap", "parts", part.name], self._rr.TextDocument(f"{1e3 * gap:.2f} mm RMS"), static=True)

    def at(self, stamp_ns: int) -> None:
        """Set the time of the following entries."""
        self._log.set_time(TIME, timestamp=np.datetime64(stamp_ns, "ns"))

    def camera(self, camera: Camera, T_cell_camera: Float) -> None:
        """The camera at its pose."""
        self._path.append(T_cell_camera[:3, 3])
        self._log.log("cell/camera", self._rr.Transform3D(translation=T_cell_camera[:3, 3], mat3x3=T_cell_camera[:3, :3]))
        pinhole = self._rr.Pinhole(
            image_from_camera=camera.K,
            width=camera.width,
            height=camera.height,
            image_plane_distance=0.1,
            camera_xyz=self._rr.ViewCoordinates.RDF,
        )
        self._log.log("cell/camera/pinhole", pinhole)

    def cloud(self, name: str, camera: Camera, depth: Image, T_cell_camera: Float, colours: NDArray[Any]) -> None:
        """A depth image (H, W) as points of the cell; colours (3,) or (H, W, 3)."""
        valid = np.isfinite(depth)
        points = se3.apply(T_cell_camera, camera.points(depth)[valid])
        chosen = colours[valid] if colours.ndim == 3 else colours
        self._log.log(f"cell/{name}", self._rr.Points3D(points.astype(np.float32), colors=chosen, radii=0.001))

    def depth(self, name: str, depth: Image) -> None:
        """A depth image (H, W) in metres."""
        self._log.log(f"images/{name}", self._rr.DepthImage(np.nan_to_num(depth, nan=0.0), meter=1.0))

    def picture(self, name: str, image: Bytes) -> None:
        """An image (H, W) or (H, W, 3) of bytes."""
        self._log.log(f"images/{name}", self._rr.Image(image))

    def text(self, name: str, text: str) -> None:
        """A text for all times."""
        self._log.log(name, self._rr.TextDocument(text), static=True)

    def number(self, name: str, value: float) -> None:
        """A value over time."""
        self._log.log(f"plots/{name}", self._rr.Scalars(value))


def draw_bag(scribe: Scribe, reader: BagReader, every: int = 1) -> None:
    """Captures as recorded, at the camera poses of TF."""
    for number, capture in enumerate(reader.captures(need_tf=False)):
        if number % every:
            continue
        scribe.at(capture.stamp_ns)
        scribe.depth("measured", capture.depth)
        if capture.amplitude is not None:
            scribe.picture("amplitude", grey(capture.amplitude))
        if capture.colour is not None:
            scribe.picture("colour", capture.colour.image)
        if np.isfinite(capture.temperature):
            scribe.number("temperature", capture.temperature)
        if capture.robot is not None:
            pose = capture.robot.T_cell_camera
            scribe.camera(capture.camera, pose)
            scribe.cloud("measured", capture.camera, capture.depth, pose, np.array(MEASURED_RGB))


def draw_dataset(scribe: Scribe, data: Dataset, every: int = 1) -> dict[str, float]:
    """Views with their labels at the solved poses; returns the RMS of measured minus label of each part in metres, over the mask."""
    stamps, poses = data.column("views/stamp_ns"), data.column("views/T_cell_camera")
    squares, counts = np.zeros(len(data.attributes.parts)), np.zeros(len(data.attributes.parts))
    for view in range(data.views):
        depth, label, part = (data.frame(f"views/{name}", view) for name in ("depth", "label", "part"))
        gap = np.where(data.frame("views/mask", view) > 0, depth - label, np.nan)
        seen = np.isfinite(gap) & (part >= 0)
        np.add.at(squares, part[seen], gap[seen].astype(float) ** 2)
        np.add.at(counts, part[seen], 1)
        if view % every:
            continue
        scribe.at(int(stamps[view]))
        camera = data.lens(view)
        scribe.camera(camera, poses[view])
        scribe.cloud("measured", camera, depth, poses[view], np.array(MEASURED_RGB))
        scribe.cloud("labelled", camera, label, poses[view], np.array(LABELLED_RGB))
        scribe.depth("measured", depth)
        scribe.depth("label", label)
        scribe.picture("residual", signed(gap))
        scribe.number("rms_mm", 1e3 * float(np.sqrt(np.nanmean(gap**2))) if seen.any() else np.nan)
    with np.errstate(invalid="ignore"):
        return dict(zip(data.attributes.parts, np.sqrt(squares / counts).tolist(), strict=True))


def draw_gap(scribe: Scribe, folder: Path, scene: Scene | None) -> dict[str, float]:
    """Residuals and the share of each effect, view by view; returns the RMS of each part in metres if the scene is given."""
    try:
        verdict = json.loads((folder / "gap.json").read_text(encoding="utf-8"))["verdict"]
        maps = read_npz(folder / "gap_maps.npz")
        stamps, residual, region = maps.pop("view_stamp_ns"), maps.pop("residual_m"), maps.pop("region")
    except (OSError, ValueError, KeyError, TypeError, DatasetError) as error:
        raise DatasetError(
            f"is no gap report ({error})", where=folder, todo="make one with: toftwin gap BAG --scene SCENE --out DIR"
        ) from None
    maps.pop("station", None)
    for view, stamp in enumerate(stamps):
        scribe.at(int(stamp))
        scribe.picture("gap/residual", signed(residual[view]))
        for name, share in maps.items():
            scribe.picture(f"gap/{name}", signed(share[view]))
        scribe.number("gap_rms_mm", 1e3 * float(np.sqrt(np.nanmean(residual[view] ** 2))))
    scribe.text("gap/verdict", ", ".join(map(str, verdict)))
    return {} if scene is None else part_gaps(scene, residual, region)


def part_gaps(scene: Scene, residual: Image, region: NDArray[np.int32]) -> dict[str, float]:
    """RMS residual of each part in metres; `region` (V, H, W) indexes the scene's surface regions."""
    _, _, part_of_face = scene.triangles()
    of_face = scene.surface_regions()
    part_of_region = np.full(int(of_face.max(initial=-1)) + 1, -1)
    part_of_region[of_face] = part_of_face
    seen = np.isfinite(residual) & (region >= 0) & (region < len(part_of_region))
    part = part_of_region[region[seen]]
    counts = np.bincount(part, minlength=len(scene.parts))
    squares = np.bincount(part, weights=residual[seen].astype(float) ** 2, minlength=len(scene.parts))
    with np.errstate(invalid="ignore"):
        return dict(zip(scene.names, np.sqrt(squares / counts).tolist(), strict=True))


def grey(image: Image) -> Bytes:
    """(H, W) uint8 of an amplitude image, its 99th percentile white."""
    top = np.nanpercentile(image, 99) if np.isfinite(image).any() else 1.0
    return np.asarray(np.clip(np.nan_to_num(image) * (255 / max(top, 1e-9)), 0, 255), np.uint8)


def signed(metres: Image) -> Bytes:
    """(H, W, 3) uint8: white is zero, red measured too far, blue too near, black no value."""
    share = np.clip(metres / RESIDUAL_SPAN_M, -1, 1)
    fade = 255 * (1 - np.abs(share))
    rgb = np.stack([np.where(share > 0, 255, fade), fade, np.where(share < 0, 255, fade)], axis=-1)
    return np.asarray(np.where(np.isfinite(share)[..., None], rgb, 0), np.uint8)


def heat(share: Float) -> Bytes:
    """(N, 3) uint8 from green (0) over yellow to red (1)."""
    s = np.clip(share, 0, 1)[:, None]
    low, middle, high = (np.array(c, float) for c in ((64, 160, 90), (240, 200, 60), (200, 40, 40)))
    return np.asarray(np.where(s < 0.5, low + 2 * s * (middle - low), middle + (2 * s - 1) * (high - middle)), np.uint8)
