# SPDX-License-Identifier: Apache-2.0
"""Continues an interrupted labelling: stored frames, poses and labels are not computed again."""

from __future__ import annotations

import json
import shutil
from dataclasses import asdict
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from tof_core.capture import Posed
from tof_core.errors import RefusedError
from tof_core.hashing import digest_arrays
from tof_sim_label.schema import camera_of, from_json
from toftwin.cameras import Cameras

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path
    from types import TracebackType
    from typing import Self

    from tof_core.camera import Camera
    from tof_core.capture import Capture, View
    from tof_sim_label.dataset import Dataset, DatasetWriter
    from tof_sim_label.label import Label
    from tof_sim_label.schema import Attributes

SAME_POSE = 1e-9
"""Tolerance of stored poses in metres and radians: sums over arrays of another memory alignment differ in the last bit."""


class OtherBagError(Exception):
    """The stored data were computed from other frames or other poses."""


class Unfinished:
    """An unfinished dataset, `dataset.zarr.part`, and, once they are solved, the poses beside it.

    The part that is written can be read. Data of an interrupted run stay if they equal those that this run would write;
    data of another scene, configuration or camera are removed. A new dataset is created when its first frame arrives.
    """

    def __init__(self, folder: Path, camera: Camera, attributes: Attributes) -> None:
        self.path, self._poses = folder / "dataset.zarr.part", folder / "poses.json.kept"
        if not self._continues(camera, attributes):
            self._remove()
        self._of = camera, attributes
        self._captures = self._views = 0

    @property
    def note(self) -> str:
        """A note if an earlier run is continued, else empty."""
        if not self.path.exists():
            return ""
        captures, views = self._before.captures, self._before.views
        return f"continued an interrupted run that had {captures} captures and {views} labels" if captures else ""

    def append_capture(self, capture: Capture, view: int) -> None:
        """Store one frame that belongs to a view (-1: to none).

        Raises:
            OtherBagError: another frame is stored in its place.
        """
        at, self._captures = self._captures, self._captures + 1
        if at >= self._before.captures:
            self._writer.append_capture(capture, view)
        elif not np.array_equal(self._before.frame("captures/raw", at), capture.depth.astype(np.float32), equal_nan=True):
            raise OtherBagError

    def append_view(self, view: View, posed: Posed, make: Callable[[], Label]) -> None:
        """Store one view with the label that `make` returns; `make` is not called if the label is stored already.

        Raises:
            OtherBagError: another view, or a label at another pose, is stored in its place.
        """
        at, self._views = self._views, self._views + 1
        if at >= self._before.views:
            self._writer.append_view(view, make())
        elif self._before.frame("views/stamp_ns", at) != view.stamp_ns or not np.allclose(
            self._before.frame("views/T_cell_camera", at), posed.T_cell_camera, rtol=0.0, atol=SAME_POSE
        ):
            raise OtherBagError

    def solved(self, views: Sequence[View], name: str, solve: Callable[[], Cameras]) -> Cameras:
        """The stored cameras of these views under `name`; if there are none, those of `solve`, which are stored then."""
        key, kept = _key(views), self._kept_poses()
        if kept.get("of") != key:
            kept = {"of": key}
        if name not in kept:
            cameras = solve()
            kept[name] = {"posed": [_to_json(p) for p in cameras.posed], "displaced": [d.to_dict() for d in cameras.displaced]}
            save_json(self._poses, kept)
        return _cameras(kept[name])

    def finish(self, whole: Path) -> None:
        """Rename the closed dataset to its final name; an earlier dataset stays until then."""
        old = whole.with_name(f"{whole.name}.old")
        shutil.rmtree(old, ignore_errors=True)
        if whole.exists():
            whole.replace(old)
        self.path.replace(whole)
        shutil.rmtree(old, ignore_errors=True)
        self._poses.unlink(missing_ok=True)

    def __enter__(self) -> Self:
        """The dataset itself."""
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        """Close the writer; the data of a refused bag, or of another bag, are removed."""
        if "_writer" in self.__dict__:
            self._writer.close()
        if isinstance(error, (RefusedError, OtherBagError)):
            self._remove()

    @cached_property
    def _writer(self) -> DatasetWriter:
        from tof_sim_label.dataset import DatasetWriter

        return DatasetWriter(self.path, *self._of, resume=True)

    @cached_property
    def _before(self) -> Dataset:
        """The dataset as it was before this run."""
        from tof_sim_label.dataset import Dataset

        self._writer  # noqa: B018  (locks the dataset, or makes it)
        return Dataset(self.path)

    def _remove(self) -> None:
        shutil.rmtree(self.path, ignore_errors=True)
        self._poses.unlink(missing_ok=True)

    def _continues(self, camera: Camera, attributes: Attributes) -> bool:
        if not self.path.exists():
            return False
        from tof_sim_label.store import read_meta

        there, made = from_json(read_meta(self.path)["attributes"], self.path)
        return there == camera and made == attributes

    def _kept_poses(self) -> dict[str, Any]:
        return dict(json.loads(self._poses.read_text(encoding="utf-8"))) if self._poses.exists() else {}


def save_json(path: Path, value: Any) -> None:
    """Write a file completely or not at all."""
    part = path.with_name(f"{path.name}.part")
    part.write_text(json.dumps(value, indent=1) + "\n", encoding="utf-8")
    part.replace(path)


def _key(views: Sequence[View]) -> str:
    """Digest of everything that a solution depends on, except scene and configuration."""
    robots = [a for v in views if v.robot is not None for a in (v.robot.T_cell_body, v.robot.T_body_camera)]
    images = [a for v in views for a in (v.depth, v.sigma, v.count, v.amplitude) if a is not None]
    return digest_arrays(*images, *robots)


def _cameras(values: dict[str, Any]) -> Cameras:
    posed = [_from_json(p) for p in values["posed"]]
    if not values["displaced"]:
        return Cameras(posed)
    from toftwin.displaced import Displaced

    return Cameras(posed, tuple(Displaced.from_dict(d) for d in values["displaced"]))


def _to_json(posed: Posed) -> dict[str, Any]:
    return {
        "T_cell_camera": posed.T_cell_camera.tolist(),
        "cov": posed.cov.tolist(),
        "null": posed.null.tolist(),
        "accepted": bool(posed.accepted),
        "verdict": posed.verdict,
        "parts": posed.parts.tolist(),
        "camera": None if posed.camera is None else asdict(posed.camera),
        "apart": posed.apart.tolist(),
        "short": posed.short,
    }


def _from_json(values: dict[str, Any]) -> Posed:
    return Posed(
        np.array(values["T_cell_camera"]),
        np.array(values["cov"]),
        np.array(values["null"]).reshape(-1, 6),
        values["accepted"],
        values["verdict"],
        np.array(values["parts"]),
        None if values.get("camera") is None else camera_of(values["camera"]),
        np.array(values.get("apart", []), float),
        values.get("short", values["verdict"]),
    )
