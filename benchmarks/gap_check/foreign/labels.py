# SPDX-License-Identifier: Apache-2.0
"""Labels of foreign sessions, without any sensor model and with the effects that a diagnosis finds: error against the true depth, and how honest their deviation is."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.gap_check.separable import Truth
from benchmarks.strong_sessions import score
from tof_core.errors import RefusedError
from tof_scene.raycast import Raycaster
from tof_sim_label.labeller import label_session, labels_at
from toftwin.inputs import opened
from toftwin.joint import joint_poses
from toftwin.pipeline import PipelineConfig, ViewStream

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path


@dataclass(frozen=True, slots=True)
class LabelRow:
    """One session: label MAE in mm of all usable pixels, less the common range offset.

    believed_mm, mae_mm: with the lens of CameraInfo believed, and with a lens that is estimated; joint_mm: as `label --joint` solves it, with
    the effects that a diagnosis finds; within, joint_within: per cent of usable pixels whose label is within twice its deviation, the range
    offset aside in both, of the last two; refused: why there are no labels.
    """

    name: str
    effects: tuple[str, ...]
    believed_mm: float = np.nan
    mae_mm: float = np.nan
    within: float = np.nan
    joint_mm: float = np.nan
    joint_within: float = np.nan
    refused: str = ""


def label_rows(folder: Path) -> Iterator[LabelRow]:
    """The rows of all sessions of a folder, one at a time."""
    for bag in sorted((folder / "bags").iterdir()):
        truth = Truth(folder / "sealed" / bag.name, bag)
        effects = tuple(sorted(truth.meta["causes"]))
        try:
            yield _row(bag.name, effects, truth)
        except RefusedError as error:
            yield LabelRow(bag.name, effects, refused=str(error).splitlines()[0])


def _row(name: str, effects: tuple[str, ...], truth: Truth) -> LabelRow:
    config = PipelineConfig()
    with opened(truth.bag / "bag", truth.bag / "scene" / "scene.yaml", config) as (reader, scene):
        assert scene is not None
        views = [replace(v, colour=None) for v in ViewStream(reader, config)]
        caster = Raycaster(scene)
        joint = joint_poses(reader, views, caster, config)
    stated = replace(config.align, discrepancy=replace(config.align.discrepancy, lens=False))
    believed = score(truth.sealed, label_session(views, caster, replace(config.labeller, align=stated))[1])
    estimated = score(truth.sealed, label_session(views, caster, config.labeller)[1])
    together = score(truth.sealed, labels_at(views, joint.posed, joint.caster(caster), config.labeller))
    offset = 1e-3 * config.labeller.label.unseen_offset_mm
    within, joint_within = (s.shape_within(2, offset) for s in (estimated, together))
    return LabelRow(name, effects, believed.mae_mm, estimated.mae_mm, within, together.mae_mm, joint_within)


HEAD = f"{'session':10} {'stated lens, mm':>16} {'lens estimated, mm':>19} {'within 2 sigma':>15} {'--joint, mm':>12} {'within 2 sigma':>15}  causes"


def line(r: LabelRow) -> str:
    """A session under `HEAD`."""
    figures = r.refused or f"{r.believed_mm:16.2f} {r.mae_mm:19.2f} {r.within:13.1f} % {r.joint_mm:12.2f} {r.joint_within:13.1f} %"
    return f"{r.name:10} {figures}  {', '.join(r.effects) or 'healthy'}"


def summary(rows: Sequence[LabelRow]) -> str:
    """Median and 90 % quantile over the sessions that are not refused."""
    known, lines = [r for r in rows if not r.refused], []
    for what, q in (("median", 0.5), ("90 % quantile", 0.9)):
        believed, mae, joint = (float(np.nanquantile([getattr(r, f) for r in known], q)) for f in ("believed_mm", "mae_mm", "joint_mm"))
        lines.append(f"{what:14} {believed:12.2f} {mae:19.2f} {joint:28.2f}")
    inside, together = (float(np.nanmean([getattr(r, f) for r in known])) for f in ("within", "joint_within"))
    return "\n".join([*lines, f"mean within 2 sigma {inside:.1f} %, with --joint {together:.1f} %, of {len(known)} sessions"])
