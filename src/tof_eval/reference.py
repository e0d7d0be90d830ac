# SPDX-License-Identifier: Apache-2.0
"""The reference depth: the truth file of a virtual session, or labels at the estimated poses of a session."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tof_core.errors import DatasetError
from tof_core.npz import read_npz
from tof_scene.render import render

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from pathlib import Path

    from tof_core.arrays import Image
    from tof_core.capture import Capture, Posed, View
    from tof_scene.raycast import Raycaster
    from tof_scene.render import Rendering
    from tof_sim_label.config import LabelConfig


@dataclass(frozen=True, slots=True, eq=False)
class Judged:
    """One view of a bag: captures, reference depth (H, W) in metres, NaN where unknown, and the CAD rendered at its pose."""

    captures: tuple[Capture, ...]
    reference: Image
    rendering: Rendering
    station: int


def by_truth(views: Iterable[tuple[View, tuple[Capture, ...]]], caster: Raycaster, path: Path) -> Iterator[Judged]:
    """Views with the true depth of the virtual session that recorded them; views without true depth are left out.

    Raises:
        DatasetError: the file is not the truth of a virtual session.
    """
    try:
        names = ("stamp_ns", "depth", "T_cell_camera")
        arrays = read_npz(path if path.suffix == ".npz" else path.with_name(path.name + ".npz"), names)
        stamps, depth, poses = (arrays[name] for name in names)
    except (OSError, KeyError, ValueError, DatasetError) as error:
        raise DatasetError(f"is no truth file ({error})", where=path, todo="pass the .npz that lies beside a virtual session") from None
    number = {int(s): k for k, s in enumerate(stamps)}
    for view, captures in views:
        k = number.get(view.stamp_ns)
        if k is not None and depth[k].shape == view.depth.shape:
            yield Judged(captures, depth[k], render(caster, view.camera, poses[k]), view.station)


def by_label(
    views: Iterable[tuple[View, tuple[Capture, ...]]], posed: Iterable[Posed], caster: Raycaster, config: LabelConfig
) -> Iterator[Judged]:
    """Views with their labels as reference; views without an accepted pose are left out."""
    from tof_sim_label.label import label_view

    for (view, captures), pose in zip(views, posed, strict=True):
        if not pose.accepted:
            continue
        label = label_view(view, pose, caster, config)
        reference = np.where(label.mask > 0, label.depth, np.float32(np.nan))
        yield Judged(captures, reference, render(caster, pose.seen_by(view.camera), pose.T_cell_camera), view.station)
