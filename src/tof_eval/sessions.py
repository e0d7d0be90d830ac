# SPDX-License-Identifier: Apache-2.0
"""Errors of a labelled session against its truth: depth, label and poses."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from tof_core import se3
from tof_core.errors import DatasetError
from tof_eval.pooled import PooledError
from tof_sim_label.dataset import open_dataset

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from tof_core.arrays import Float
    from tof_core.metrics import DepthError


@dataclass(frozen=True, slots=True, eq=False)
class PoseErrors:
    """Errors of one estimate of the poses, per view that has one: millimetres and degrees."""

    name: str
    millimetres: Float
    degrees: Float


@dataclass(frozen=True, slots=True, eq=False)
class SessionErrors:
    """Errors of depth and poses against label and truth.

    rows: name and error of each comparison; poses: one entry per pose estimate; honest: share of the labelled pixels whose label is
    within two of its sigmas of the truth.
    """

    rows: list[tuple[str, DepthError]]
    poses: list[PoseErrors] = field(default_factory=list)
    honest: float = float("nan")


def session_errors(dataset_path: Path, truth: Mapping[str, Any], poses: Mapping[str, Sequence[Float]]) -> SessionErrors:
    """Compare a dataset with its session's truth, view by view.

    Args:
        dataset_path: dataset written by `label`.
        truth: arrays by name, as `tof_virtual.truth` writes them: stamp_ns, depth, T_robot, T_cell_camera.
        poses: further estimates of the views' poses by name, (V, 4, 4) each.

    Raises:
        DatasetError: dataset and truth belong to different sessions.
    """
    dataset = open_dataset(dataset_path)
    if not np.array_equal(dataset.column("views/stamp_ns"), truth["stamp_ns"]):
        raise DatasetError("its views are not those of the truth", where=dataset_path, todo="label the bag beside the truth")
    names = ("raw against label", "filtered against label", "raw against truth", "filtered against truth", "label against truth")
    pooled = {name: PooledError() for name in names}
    members = dataset.column("captures/view")
    within = compared = 0
    for v in range(dataset.views):
        depth, label, sigma, mask = (dataset.frame(f"views/{n}", v) for n in ("depth", "label", "label_sigma", "mask"))
        true, where = truth["depth"][v], mask > 0
        for capture in np.flatnonzero(members == v):
            raw = dataset.frame("captures/raw", int(capture))
            pooled["raw against label"].add(raw, label, where)
            pooled["raw against truth"].add(raw, true, where)
        pooled["filtered against label"].add(depth, label, where)
        pooled["filtered against truth"].add(depth, true, where)
        pooled["label against truth"].add(label, true, where)
        both = where & np.isfinite(label) & np.isfinite(true)
        within += int((np.abs(label - true)[both] <= 2.0 * sigma[both]).sum())
        compared += int(both.sum())
    ways = {"robot": truth["T_robot"], **poses, "session solution": dataset.column("views/T_cell_camera")}
    errors = [pose_errors(name, T, truth["T_cell_camera"]) for name, T in ways.items()]
    return SessionErrors([(n, p.error) for n, p in pooled.items()], errors, within / max(compared, 1))


def pose_errors(name: str, found: Sequence[Float], true: Sequence[Float]) -> PoseErrors:
    """Distances of poses (V, 4, 4) from the true ones; a view without a pose (NaN) is left out."""
    distances = np.array([se3.distance(a, b) for a, b in zip(found, true, strict=True) if np.isfinite(a).all()]).reshape(-1, 2)
    return PoseErrors(name, distances[:, 0] * 1e3, distances[:, 1])
