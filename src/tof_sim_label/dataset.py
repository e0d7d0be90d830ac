# SPDX-License-Identifier: Apache-2.0
"""The labelled dataset: a Zarr v3 group for one camera, appended to crash-safely and read lazily."""

from __future__ import annotations

from dataclasses import asdict
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tof_core.errors import DatasetError
from tof_sim_label import schema, store
from tof_sim_label.schema import COLUMNS, Attributes

if TYPE_CHECKING:
    import os
    from types import TracebackType
    from typing import Self

    import zarr
    from numpy.typing import NDArray

    from tof_core.camera import Camera
    from tof_core.capture import Capture, View
    from tof_sim_label.label import Label


class DatasetWriter:
    """Appends captures and labelled views; each is on disk when its call returns.

    A path that holds a dataset of the same camera, CAD and configuration is continued as a new
    session: its stations get new numbers, so that a split by station stays valid. View and station
    numbers given to the methods count from 0 in this session. With `resume` an interrupted session
    is continued, and numbers count from the dataset's beginning.

    Raises:
        DatasetError: another schema, camera, CAD or configuration; something else at `path`; a
            full disk (what was appended before stays, and the append may be tried again).
    """

    def __init__(self, path: str | os.PathLike[str], camera: Camera, attributes: Attributes, *, resume: bool = False) -> None:
        self.path = Path(path)
        if not self.path.exists():
            store.create(self.path, camera, schema.to_json(camera, attributes))
        there, made = schema.from_json(store.read_meta(self.path)["attributes"], self.path)
        if there != camera:
            msg = f"is for camera {_camera_words(there)}, not {_camera_words(camera)}"
            raise DatasetError(msg, where=self.path, todo="one dataset holds one camera: write to another")
        attributes.must_equal(made, self.path)
        self._store = store.FrameStore(self.path)
        self._first_view, self._first_station = (0, 0) if resume else (self.views, self._continue())

    @property
    def captures(self) -> int:
        """Captures in the dataset, earlier sessions included."""
        return self._store.count("captures")

    @property
    def views(self) -> int:
        """Views in the dataset, earlier sessions included."""
        return self._store.count("views")

    def append_capture(self, capture: Capture, view: int = -1) -> int:
        """Append one frame; `view` is the session's view that contains it, -1 for none. Returns its number."""
        none = np.full(capture.depth.shape, np.nan, np.float32)
        return self._store.append(
            "captures",
            {
                "raw": capture.depth,
                "amplitude": none if capture.amplitude is None else capture.amplitude,
                "stamp_ns": capture.stamp_ns,
                "temperature": capture.temperature,
                "view": view + self._first_view if view >= 0 else -1,
            },
        )

    def append_view(self, view: View, label: Label) -> int:
        """Append a view with its label. Returns its number in the dataset."""
        before, camera = self._store.attributes, label.posed.camera
        verdicts = [*before["verdicts"], label.posed.verdict]
        lenses = [*before.get("lenses", [None] * self.views), None if camera is None else asdict(camera)]
        return self._store.append(
            "views",
            {
                "depth": view.depth,
                "sigma": view.sigma,
                "count": np.minimum(view.count, 65535),
                "label": label.depth,
                "label_sigma": label.sigma,
                "mask": label.mask,
                "reason": label.reason,
                "part": label.part,
                "mixed": label.mixed,
                "incidence": label.incidence,
                "T_cell_camera": label.posed.T_cell_camera,
                "pose_cov": label.posed.cov,
                "station": view.station + self._first_station,
                "stamp_ns": view.stamp_ns,
            },
            verdicts=verdicts,
            lenses=lenses,
        )

    def close(self) -> None:
        """Release the lock, so that another process may write."""
        self._store.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def _continue(self) -> int:
        """The first free station. Captures whose view was never written are set to view -1."""
        before = Dataset(self.path)
        for index in np.flatnonzero(before.column("captures/view") >= before.views):
            self._store.replace("captures", "view", int(index), -1)
        return int(before.column("views/station").max(initial=-1)) + 1


class Dataset:
    """A dataset as far as it is committed; frames are read when asked for, columns at once.

    Raises:
        DatasetError: no dataset, another schema, or a committed chunk that is missing or damaged.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        attributes = store.read_meta(self.path)["attributes"]
        self.camera, self.attributes = schema.from_json(attributes, self.path)
        self.captures = int(attributes["committed"]["captures"])
        self.views = int(attributes["committed"]["views"])
        self.verdicts: tuple[str, ...] = tuple(attributes["verdicts"])
        self._lenses = attributes.get("lenses", [])
        self._arrays: dict[str, Any] = {}
        self._usual: dict[str, bool] = {}

    def lens(self, view: int) -> Camera:
        """The camera with which a view's label was rendered: `camera`, or that with the lens estimated from its session."""
        values = self._lenses[view] if view < len(self._lenses) else None
        return self.camera if values is None else schema.camera_of(values)

    def frame(self, name: str, index: int) -> NDArray[Any]:
        """One frame of an array named as in the schema, such as "views/label"."""
        group, column = self._find(name)
        if not 0 <= index < self._count(group):
            msg = f"has no {name}[{index}]"
            raise DatasetError(msg, where=self.path, todo=f"it holds {self._count(group)}")
        self._must_exist(group, column, index)
        return np.asarray(self._read(name, index))

    def column(self, name: str) -> NDArray[Any]:
        """All frames of a small array (stamps, poses, stations); images go through `frame`."""
        group, column = self._find(name)
        for index in range(self._count(group)):
            self._must_exist(group, column, index)
        return np.asarray(self._read(name, slice(0, self._count(group))))

    @cached_property
    def _group(self) -> zarr.Group:
        import zarr

        return zarr.open_group(self.path, mode="r", zarr_format=3)

    def _read(self, name: str, index: int | slice) -> Any:
        try:
            if self._is_usual(name):
                return self._read_chunks(name, index)
            if name not in self._arrays:
                self._arrays[name] = self._group[name]
            return self._arrays[name][index]
        except Exception as error:  # foreign bytes: Zarr and its codecs may raise any exception
            msg = f"{name} is damaged ({error})"
            raise DatasetError(msg, where=self.path) from error

    def _is_usual(self, name: str) -> bool:
        """Whether an array is stored as `store` writes it; zarr, which takes long to load, reads all others."""
        if name not in self._usual:
            group, column = self._find(name)
            meta = store.read_json(self.path / group / column / store.META)
            self._usual[name] = meta | {"shape": []} == store.array_meta(COLUMNS[group][column], self.camera) | {"shape": []}
        return self._usual[name]

    def _read_chunks(self, name: str, index: int | slice) -> NDArray[Any]:
        group, name = self._find(name)
        column = COLUMNS[group][name]
        frame = column.frame_shape(self.camera)
        if not isinstance(index, slice):
            return store.read_frame(store.chunk_path(self.path, group, name, index), column, frame)
        places = range(self._count(group))[index]
        out = np.empty((len(places), *frame), column.dtype)
        for i, place in enumerate(places):
            out[i] = store.read_frame(store.chunk_path(self.path, group, name, place), column, frame)
        return out

    def _find(self, name: str) -> tuple[str, str]:
        group, _, column = name.partition("/")
        if column not in COLUMNS.get(group, {}):
            msg = f"has no array '{name}'"
            raise DatasetError(msg, where=self.path)
        return group, column

    def _count(self, group: str) -> int:
        return self.captures if group == "captures" else self.views

    def _must_exist(self, group: str, column: str, index: int) -> None:
        # Zarr reads a missing chunk as its fill value; here that is damage.
        path = store.chunk_path(self.path, group, column, index)
        if not path.is_file():
            msg = "committed chunk is missing"
            raise DatasetError(msg, where=path)


def open_dataset(path: str | os.PathLike[str]) -> Dataset:
    """Open a dataset for reading, also while it is being written."""
    return Dataset(path)


def _camera_words(camera: Camera) -> str:
    return f"{camera.width}x{camera.height} fx {camera.fx:.2f} '{camera.frame_id}'"
