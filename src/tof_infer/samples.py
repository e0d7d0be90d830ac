# SPDX-License-Identifier: Apache-2.0
"""Labelled captures of one camera from several datasets: checked, split by station, returned as arrays."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

import numpy as np

from tof_core.errors import DatasetError, RefusedError
from tof_core.hashing import digest_config
from tof_sim_label.dataset import open_dataset
from tof_sim_label.split import Split, split_stations

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path
    from typing import Any

    from tof_core.arrays import Image, Ints, Mask
    from tof_core.camera import Camera
    from tof_sim_label.dataset import Dataset

MIN_STATIONS = 3
"""Fewest stations: training and validation share none, and of two, each would have a single base pose."""
CACHE_BYTES = 2_000_000_000
COMMON = 0.05
"""Quantile of the standard deviations of a view's labels that counts as their common part; the smallest may be an outlier."""


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """One capture with its label: images (H, W) float32, NaN where invalid; `mask` marks where the label may be used.

    label_sigma: standard deviation of the label in metres without the part common to all labels of the view, see `own_sigma`.
    """

    depth: Image
    amplitude: Image
    temperature: float
    label: Image
    label_sigma: Image
    mask: Mask
    incidence: Image
    material: Image

    @property
    def nbytes(self) -> int:
        """Memory in bytes."""
        return sum(a.nbytes for a in (self.depth, self.amplitude, self.label, self.label_sigma, self.mask, self.incidence, self.material))


@dataclass(frozen=True, slots=True)
class Place:
    """Address of a capture: numbers of the dataset, of capture and view in that dataset, and of the view among all datasets."""

    dataset: int
    capture: int
    view: int
    pooled: int


class Pool:
    """Several datasets as one: views are numbered consecutively; stations of different datasets are different stations.

    Raises:
        DatasetError: a dataset is damaged, or made by another camera.
        RefusedError: fewer than `least` stations in all.
    """

    path = "the datasets"

    def __init__(self, paths: Sequence[Path], least: int = MIN_STATIONS) -> None:
        self.datasets: list[Dataset] = [open_dataset(p) for p in paths]
        self.camera: Camera = self.datasets[0].camera
        for d in self.datasets[1:]:
            _same_camera(self.camera, d, self.datasets[0])
        self.first = np.cumsum([0, *(d.views for d in self.datasets)])
        self._station, self._stamps = self._columns()
        if self.stations < least:
            msg = f"{self.stations} station(s) in {len(paths)} dataset(s) are too few to train and to check on others"
            raise RefusedError(msg, where=self.datasets[0].path, todo=f"record at least {least}: move the base between views")

    @property
    def stations(self) -> int:
        """Stations in all datasets."""
        return len(np.unique(self._station))

    @property
    def views(self) -> int:
        """Views in all datasets."""
        return int(self.first[-1])

    def column(self, name: str) -> Ints:
        """The stations of all views, numbered consecutively, for `split_stations`."""
        assert name == "views/station"
        return self._station

    def split(self, val: float, test: float, seed: int) -> Split:
        """Views for training, validation and test that share no station."""
        return split_stations(cast("Dataset", self), (1 - val - test, val, test), seed)

    def places(self, views: Ints) -> list[Place]:
        """The captures of some views, in order."""
        wanted = {int(v) for v in views}
        return [
            Place(i, c, int(v), int(v + self.first[i]))
            for i, d in enumerate(self.datasets)
            for c, v in enumerate(d.column("captures/view"))
            if v >= 0 and int(v + self.first[i]) in wanted
        ]

    def facts(self) -> list[dict[str, Any]]:
        """Description of the datasets for the card: hashes, sizes, source of the poses."""
        return [
            {
                "name": d.path.parent.name if d.path.name == "dataset.zarr" else d.path.name,
                "digest": digest_config(self._stamps[i]),
                "cad": d.attributes.cad_hash,
                "config": d.attributes.config_hash,
                "pose_source": d.attributes.pose_source,
                "views": d.views,
                "captures": d.captures,
                "stations": len(np.unique(d.column("views/station"))),
            }
            for i, d in enumerate(self.datasets)
        ]

    def _columns(self) -> tuple[Ints, list[list[int]]]:
        out, first = [], 0
        for d in self.datasets:
            names, station = np.unique(d.column("views/station"), return_inverse=True)
            out.append(station + first)
            first += len(names)
        return np.concatenate(out), [[int(s) for s in d.column("captures/stamp_ns")] for d in self.datasets]


class Samples:
    """Usable captures of some views. `skipped` counts the unusable ones by reason; samples are kept in memory up to `CACHE_BYTES`."""

    def __init__(self, pool: Pool, views: Ints) -> None:
        self.pool = pool
        self.skipped: Counter[str] = Counter()
        self._kept: dict[Place, Sample] = {}
        self._bytes = 0
        self._temperature = [d.column("captures/temperature") for d in pool.datasets]
        self.places = [p for p in pool.places(views) if self._usable(p)]

    def __len__(self) -> int:
        return len(self.places)

    def __getitem__(self, number: int) -> Sample:
        place = self.places[number]
        kept = self._kept.get(place)
        return kept if kept is not None else self._read(place)

    def _usable(self, place: Place) -> bool:
        sample = self._read(place)
        reason = _fault(sample)
        if reason:
            self.skipped[reason] += 1
        return not reason

    def _read(self, place: Place) -> Sample:
        d = self.pool.datasets[place.dataset]
        label, sigma = d.frame("views/label", place.view), d.frame("views/label_sigma", place.view)
        mask = (d.frame("views/mask", place.view) > 0) & np.isfinite(label) & (label > 0)
        sample = Sample(
            depth=d.frame("captures/raw", place.capture),
            amplitude=d.frame("captures/amplitude", place.capture),
            temperature=float(self._temperature[place.dataset][place.capture]),
            label=label,
            label_sigma=own_sigma(sigma, mask),
            mask=mask,
            incidence=d.frame("views/incidence", place.view),
            material=_material(d, place.view),
        )
        if self._bytes + sample.nbytes < CACHE_BYTES:
            self._kept[place] = sample
            self._bytes += sample.nbytes
        return sample


def _fault(sample: Sample) -> str:
    """Why a capture cannot be used for training; empty if it can."""
    if not np.isfinite(sample.label).any():
        return "no label"
    if not sample.mask.any():
        return "label masked"
    if not (np.isfinite(sample.depth) & sample.mask).any():
        return "no depth where the label is"
    return ""


def own_sigma(sigma: Image, mask: Mask) -> Image:
    """Standard deviation of each pixel's label (H, W) without the part common to all labels of the view; 0 where there is no label.

    A range offset that no session can measure (2 mm by default) is common to all labels. With it, the scale would not show any
    smaller error of the network.
    """
    known = np.isfinite(sigma)
    used = sigma[known & mask]
    common = float(np.quantile(used, COMMON)) if used.size else 0.0
    return np.sqrt(np.clip(np.where(known, sigma, 0.0) ** 2 - common**2, 0.0, None)).astype(np.float32)


def _material(dataset: Dataset, view: int) -> Image:
    """Albedo of the CAD's material by pixel; NaN where the dataset's notes have none."""
    albedo = dataset.attributes.notes.get("albedo")
    part = dataset.frame("views/part", view)
    if not albedo:
        return np.full(part.shape, np.nan, np.float32)
    return np.asarray(np.append(np.asarray(albedo, np.float32), np.float32(np.nan))[part])


def _same_camera(camera: Camera, dataset: Dataset, first: Dataset) -> None:
    if dataset.camera != camera:
        a, b = camera, dataset.camera
        msg = f"is of another camera ({b.width}x{b.height}, f {b.fx:.1f}) than {first.path.name} ({a.width}x{a.height}, f {a.fx:.1f})"
        raise DatasetError(msg, where=dataset.path, todo="train one model per camera")
