# SPDX-License-Identifier: Apache-2.0
"""Export to the BOP format (Hodan et al., "BOP: Benchmark for 6D Object Pose Estimation", scene-wise layout).

One BOP scene per station, one object per part. BOP's units are millimetres, its models are
centred on their bounding box, its cameras are pinholes: a lens with distortion is undone by
taking, for each pinhole pixel, the nearest pixel of the raster (depths are never mixed).
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tof_core import se3
from tof_core.errors import DatasetError
from tof_sim_label.bop_models import Model, write_models
from tof_sim_label.silhouette import Silhouettes

if TYPE_CHECKING:
    import os
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from tof_core.arrays import Float, Image, Ints, Mask
    from tof_core.camera import Camera
    from tof_scene.scene import Scene
    from tof_sim_label.dataset import Dataset

DEPTH_SCALE = 0.1
"""Millimetres per unit of the depth images: 16 bits reach 6.5 m."""


def export_bop(
    dataset: Dataset, scene: Scene, folder: str | os.PathLike[str], *, split: str = "train", views: Iterable[int] | None = None
) -> Path:
    """Write the views of a dataset as `folder/{models,SPLIT,camera.json}`; gives the folder.

    Per view: `depth` (measured), `depth_label` (the CAD's), `gray` (amplitude), `mask`,
    `mask_visib`, and the poses of all parts with their visibility. BOP has no place for the sigma of
    a label, so it is not exported.

    Raises:
        DatasetError: the scene is not the one the dataset was labelled with.
    """
    if scene.names != dataset.attributes.parts or scene.digest != dataset.attributes.cad_hash:
        msg = "was labelled with another scene"
        raise DatasetError(msg, where=dataset.path, todo="give the scene.yaml the dataset was made with")
    root = Path(folder)
    camera = pinhole_of(dataset.camera)
    models = write_models(scene, root / "models")
    _write_json(root / "camera.json", _camera_file(camera))
    stations = dataset.column("views/station")
    first_capture = _first_captures(dataset)
    chosen = np.arange(dataset.views) if views is None else np.asarray(list(views), int)
    silhouettes = Silhouettes(scene, camera)
    for station in np.unique(stations[chosen]):
        scene_folder = root / split / f"{station:06d}"
        writer = _SceneWriter(dataset, camera, models, silhouettes, scene_folder)
        for view in chosen[stations[chosen] == station]:
            writer.add(int(view), first_capture.get(int(view)))
        writer.finish()
    return root


@dataclass(frozen=True, slots=True, eq=False)
class Raster:
    """The pinhole raster of the export, and the pixel of the camera's own raster for each of its pixels."""

    camera: Camera
    source: Ints | None
    """(H, W) flat index into the camera's raster, -1 outside it; None where both are one."""

    @classmethod
    @lru_cache(maxsize=4)
    def of(cls, pinhole: Camera, camera: Camera) -> Raster:
        """Pixels of `camera`, whose lens may be another than the stated one, for those of the pinhole."""
        if pinhole == pinhole_of(camera) and not camera.distorted:
            return cls(pinhole, None)
        uv = np.rint(camera.project(pinhole.rays()))
        inside = ((uv >= 0) & (uv < [camera.width, camera.height])).all(axis=-1)
        index = np.where(inside, uv[..., 1] * camera.width + uv[..., 0], -1)
        return cls(pinhole, index.astype(np.int64))

    def take(self, image: NDArray[Any], outside: float) -> NDArray[Any]:
        """A camera image, resampled to the pinhole raster."""
        if self.source is None:
            return image
        return np.where(self.source >= 0, image.ravel()[self.source], np.asarray(outside, image.dtype))


def pinhole_of(camera: Camera) -> Camera:
    """The pinhole with the same size and matrix."""
    return replace(camera, distortion_model="", distortion=())


class _SceneWriter:
    """Collects one station's images and its three annotation files."""

    def __init__(self, dataset: Dataset, camera: Camera, models: list[Model], silhouettes: Silhouettes, folder: Path) -> None:
        self._dataset, self._camera, self._models = dataset, camera, models
        self._silhouettes, self._folder = silhouettes, folder
        self._files: dict[str, dict[str, Any]] = {"scene_camera": {}, "scene_gt": {}, "scene_gt_info": {}}
        for name in ("depth", "depth_label", "gray", "mask", "mask_visib"):
            (folder / name).mkdir(parents=True, exist_ok=True)

    def add(self, view: int, capture: int | None) -> None:
        """One image: its number in the scene is the view's number in the dataset."""
        T_camera_cell = se3.inverse(self._dataset.frame("views/T_cell_camera", view))
        raster = Raster.of(self._camera, self._dataset.lens(view))
        depth = raster.take(self._dataset.frame("views/depth", view), np.nan)
        part = raster.take(self._dataset.frame("views/part", view), -1)
        image = f"{view:06d}.png"
        _write_png(self._folder / "depth" / image, _to_units(depth))
        _write_png(self._folder / "depth_label" / image, _to_units(raster.take(self._dataset.frame("views/label", view), np.nan)))
        if capture is not None:
            amplitude = raster.take(self._dataset.frame("captures/amplitude", capture), np.nan)
            _write_png(self._folder / "gray" / image, _to_grey(amplitude))
        self._files["scene_camera"][str(view)] = _image_camera(self._camera, T_camera_cell)
        poses: list[dict[str, Any]] = []
        infos: list[dict[str, Any]] = []
        for model in self._models:
            silhouette = self._silhouettes.of(model.part, T_camera_cell)
            if silhouette.pixels == 0:
                continue
            visible = part == model.part
            name = f"{view:06d}_{len(poses):06d}.png"
            _write_png(self._folder / "mask" / name, silhouette.inside.astype(np.uint8) * 255)
            _write_png(self._folder / "mask_visib" / name, visible.astype(np.uint8) * 255)
            poses.append(model.pose(T_camera_cell))
            infos.append(
                {
                    "bbox_obj": silhouette.box,
                    "bbox_visib": box(visible),
                    "px_count_all": silhouette.pixels,
                    "px_count_valid": int((silhouette.inside & np.isfinite(depth)).sum()),
                    "px_count_visib": int(visible.sum()),
                    "visib_fract": min(1.0, float(visible.sum()) / silhouette.pixels),
                }
            )
        self._files["scene_gt"][str(view)], self._files["scene_gt_info"][str(view)] = poses, infos

    def finish(self) -> None:
        """Write the annotations, after the images that they name."""
        for name, content in self._files.items():
            _write_json(self._folder / f"{name}.json", content)


def box(mask: Mask) -> list[int]:
    """Bounding box (x, y, width, height) of a mask, -1 four times where it is empty."""
    v, u = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not len(v):
        return [-1, -1, -1, -1]
    return [int(u[0]), int(v[0]), int(u[-1] - u[0] + 1), int(v[-1] - v[0] + 1)]


def _first_captures(dataset: Dataset) -> dict[int, int]:
    views, index = np.unique(dataset.column("captures/view"), return_index=True)
    return {int(v): int(i) for v, i in zip(views, index, strict=True)}


def _camera_file(camera: Camera) -> dict[str, float]:
    return {
        "cx": camera.cx,
        "cy": camera.cy,
        "depth_scale": DEPTH_SCALE,
        "fx": camera.fx,
        "fy": camera.fy,
        "height": camera.height,
        "width": camera.width,
    }


def _image_camera(camera: Camera, T_camera_cell: Float) -> dict[str, Any]:
    return {
        "cam_K": camera.K.ravel().tolist(),
        "depth_scale": DEPTH_SCALE,
        "cam_R_w2c": T_camera_cell[:3, :3].ravel().tolist(),
        "cam_t_w2c": (1e3 * T_camera_cell[:3, 3]).tolist(),
    }


def _to_units(depth: Image) -> NDArray[np.uint16]:
    """16-bit units of DEPTH_SCALE, 0 where invalid or beyond the range."""
    units = np.rint(np.nan_to_num(depth.astype(float), nan=0.0) * 1e3 / DEPTH_SCALE)
    return np.where((units > 0) & (units < 65536), units, 0).astype(np.uint16)


def _to_grey(amplitude: Image) -> NDArray[np.uint8]:
    """8 bits, square root of amplitude, white at the 99.5 % quantile."""
    if not np.isfinite(amplitude).any():
        return np.zeros(amplitude.shape, np.uint8)
    white = max(float(np.nanquantile(amplitude, 0.995)), 1e-12)
    scaled = np.sqrt(np.clip(np.nan_to_num(amplitude, nan=0.0) / white, 0.0, 1.0))
    return np.asarray(np.rint(255 * scaled), np.uint8)


def _write_png(path: Path, image: NDArray[Any]) -> None:
    from PIL import Image as Pillow

    Pillow.fromarray(image).save(path, compress_level=1)


def _write_json(path: Path, content: object) -> None:
    path.write_text(json.dumps(content, indent=1))
