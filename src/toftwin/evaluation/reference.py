# SPDX-License-Identifier: Apache-2.0
"""What depth is compared with: the truth file of a virtual session where one is given, else the label of the solved session."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tof_core.errors import DatasetError, RefusedError
from toftwin.pipeline import ViewStream

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from tof_core.arrays import Image
    from tof_core.bag import BagReader
    from tof_core.capture import Capture, View
    from tof_scene.raycast import Raycaster
    from tof_scene.render import Rendering
    from toftwin.pipeline import PipelineConfig


@dataclass(frozen=True, slots=True, eq=False)
class Judged:
    """One view of the bag: its captures, its true depth (H, W) with NaN where there is none, and the CAD rendered there."""

    captures: tuple[Capture, ...]
    reference: Image
    rendering: Rendering
    station: int


def judged_views(
    reader: BagReader,
    caster: Raycaster,
    config: PipelineConfig,
    truth: Path | None,
    keep: int,
) -> Iterator[Judged]:
    """Views with their reference; of each at most `keep` captures, the last ones.

    Raises:
        RefusedError: no view has a reference (all refused by the alignment, or another session's truth).
    """
    stream = ViewStream(reader, config)
    members: list[tuple[View, tuple[Capture, ...]]] = [(view, tuple(stream.members[-keep:])) for view in stream]
    if not members:
        raise RefusedError(
            f"no frame of {reader.frame_count} can be used: {reader.last_error}",
            where="evaluate",
            todo="toftwin doctor tells what the bag lacks",
        )
    judged = _by_truth(members, caster, truth) if truth is not None else _by_label(members, caster, config)
    empty = True
    for one in judged:
        empty = False
        yield one
    if empty:
        raise RefusedError(
            "no view has a reference", where=truth or "evaluate", todo="give the truth of this bag, or align it first: toftwin label"
        )


def _by_truth(members: list[tuple[View, tuple[Capture, ...]]], caster: Raycaster, path: Path) -> Iterator[Judged]:
    from tof_scene.render import render

    try:
        with np.load(path if path.suffix == ".npz" else path.with_name(path.name + ".npz")) as file:
            stamps, depth, poses = file["stamp_ns"], file["depth"], file["T_cell_camera"]
    except (OSError, KeyError, ValueError) as error:
        raise DatasetError(f"is no truth ({error})", where=path, todo="give the .npz that lies beside a virtual session") from None
    number = {int(s): k for k, s in enumerate(stamps)}
    for view, captures in members:
        k = number.get(view.stamp_ns)
        if k is not None and depth[k].shape == view.depth.shape:
            yield Judged(captures, depth[k], render(caster, view.camera, poses[k]), view.station)


def _by_label(members: list[tuple[View, tuple[Capture, ...]]], caster: Raycaster, config: PipelineConfig) -> Iterator[Judged]:
    from tof_align.session import solve_session
    from tof_scene.render import render
    from tof_sim_label.label import label_view

    solution = solve_session([view for view, _ in members], caster, config.align)
    for (view, captures), posed in zip(members, solution.posed, strict=True):
        if not posed.accepted:
            continue
        label = label_view(view, posed, caster, config.label)
        reference = np.where(label.mask > 0, label.depth, np.float32(np.nan))
        yield Judged(captures, reference, render(caster, view.camera, posed.T_cell_camera), view.station)
