# SPDX-License-Identifier: Apache-2.0
"""A bag and its CAD to a labelled dataset: captures to views, views to poses, poses to labels."""

from __future__ import annotations

import json
import shutil
from collections import Counter
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from tof_core.config import to_mapping
from tof_core.errors import RefusedError, UsageError
from tof_core.hashing import digest_config
from tof_core.progress import progress
from tof_core.yamlio import save_yaml
from toftwin.pipeline import PipelineConfig, ViewStream
from toftwin.scores import PooledError

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from tof_core.arrays import Bytes, Float, Image, Mask
    from tof_core.bag import BagReader
    from tof_core.capture import View
    from tof_core.metrics import DepthError
    from tof_scene.raycast import Raycaster
    from tof_sim_label.dataset import DatasetWriter
    from tof_sim_label.label import Label

MODES = {"final": "session", "causal": "session", "per_view": "per_view", "robot": "robot"}
"""Modes of labelling and the alignment mode of each."""
CERTAIN_M = 0.01
"""Labels less certain than this (one standard deviation) take no part in the figures."""
POSE_SOURCES = {"final": "session, final", "causal": "session, causal", "per_view": "per view", "robot": "robot"}


@dataclass(slots=True)
class LabelResult:
    """What came of a bag: counts, depth errors against the label, each view's verdict.

    `others` holds each view's `T_cell_camera` by the other ways of posing that were asked for.
    """

    dataset: Path
    captures: int = 0
    views: int = 0
    skipped: Counter[str] = field(default_factory=Counter)
    verdicts: Counter[str] = field(default_factory=Counter)
    raw: PooledError = field(default_factory=PooledError)
    filtered: PooledError = field(default_factory=PooledError)
    others: dict[str, list[Float]] = field(default_factory=dict)
    note: str = ""

    @property
    def rows(self) -> list[tuple[str, DepthError]]:
        """The table."""
        return [("raw against label", self.raw.error), ("filtered against label", self.filtered.error)]

    def to_dict(self) -> dict[str, Any]:
        """Plain values for `metrics.json`."""
        return {
            "captures": self.captures,
            "views": self.views,
            "skipped": dict(self.skipped),
            "verdicts": dict(self.verdicts),
            "raw": self.raw.error.to_dict(),
            "filtered": self.filtered.error.to_dict(),
            "note": self.note,
        }


def label_bag(
    reader: BagReader,
    caster: Raycaster,
    config: PipelineConfig,
    out: Path,
    *,
    mode: str = "final",
    also: Sequence[str] = (),
) -> LabelResult:
    """Label a bag into `out`: dataset.zarr, config.yaml, poses.json, metrics.json.

    The dataset appears under its name once it is whole; what was there before is kept until then.
    `also` names other modes whose poses are wanted beside (`LabelResult.others`), with mode final.

    Raises:
        RefusedError: the bag has no usable frame, or the session fits the CAD nowhere.
    """
    from tof_sim_label.dataset import DatasetWriter
    from tof_sim_label.schema import Attributes

    if mode not in MODES:
        raise UsageError(f"'{mode}' is not one of {', '.join(MODES)}", where="--mode")
    config = replace(config, align=replace(config.align, mode=MODES[mode]))
    out.mkdir(parents=True, exist_ok=True)
    part, whole = out / "dataset.zarr.part", out / "dataset.zarr"
    shutil.rmtree(part, ignore_errors=True)
    attributes = Attributes(caster.scene.digest, digest_config(config), POSE_SOURCES[mode], caster.scene.names)
    result = LabelResult(whole, note=reader.note)
    with DatasetWriter(part, reader.camera, attributes) as dataset:
        result.others = {name: [] for name in also}
        labelled = _final if mode != "causal" else _causal
        poses = [_appended(dataset, view, label, result) for view, label in labelled(reader, caster, config, dataset, result)]
    _score_raw(part, result)
    _swap(part, whole)
    save_yaml(out / "config.yaml", to_mapping(config))
    _save_json(out / "poses.json", poses)
    _save_json(out / "metrics.json", result.to_dict())
    return result


def views_of(reader: BagReader, config: PipelineConfig, dataset: DatasetWriter | None, result: LabelResult) -> Iterator[View]:
    """Views of the bag; their captures go to the dataset on the way."""
    stream = ViewStream(reader, config)
    frames = progress(range(reader.frame_count), "captures", reader.frame_count)
    for number, view in enumerate(stream):
        for capture in stream.members:
            next(frames, None)
            result.captures += 1
            if dataset is not None:
                dataset.append_capture(capture, view=number)
        result.views += 1
        yield replace(view, colour=None)
    result.skipped = Counter(reader.skipped)
    if not result.views:
        raise RefusedError(_why_nothing(reader), where="label", todo="toftwin doctor tells what the bag lacks")


def _why_nothing(reader: BagReader) -> str:
    skipped = ", ".join(f"{reason} {count}" for reason, count in reader.skipped.items())
    return f"no frame of {reader.frame_count} can be used ({skipped or 'there are none'}): {reader.last_error}"


def _final(
    reader: BagReader,
    caster: Raycaster,
    config: PipelineConfig,
    dataset: DatasetWriter,
    result: LabelResult,
) -> Iterator[tuple[View, Label]]:
    """Poses from one solution of the whole session."""
    from tof_align.session import solve_session
    from tof_sim_label.labeller import label_session

    views = list(views_of(reader, config, dataset, result))
    _, labels = label_session(views, caster, config.labeller)
    for name, found in result.others.items():
        other = solve_session(views, caster, replace(config.align, mode=MODES[name]))
        found.extend(p.T_cell_camera for p in other.posed)
    yield from progress(labels, "labels", len(views))


def _causal(
    reader: BagReader,
    caster: Raycaster,
    config: PipelineConfig,
    dataset: DatasetWriter,
    result: LabelResult,
) -> Iterator[tuple[View, Label]]:
    """What the nodes give live: each view posed by those before it."""
    yield from causal_labels(views_of(reader, config, dataset, result), caster, config, result)


def causal_labels(views: Iterator[View], caster: Raycaster, config: PipelineConfig, result: LabelResult) -> Iterator[tuple[View, Label]]:
    """Labels by the code that the node `sim_label` runs."""
    from tof_sim_label.stream import LabelStream

    stream = LabelStream(caster, config.labeller)
    for view in views:
        stream.push(view)
        labelled = stream.flush()
        if labelled is not None and labelled.label is not None:
            yield labelled.view, labelled.label
        elif labelled is not None:
            result.verdicts["refused"] += 1


def _appended(dataset: DatasetWriter, view: View, label: Label, result: LabelResult) -> dict[str, Any]:
    dataset.append_view(view, label)
    result.verdicts[label.posed.verdict] += 1
    result.filtered.add(view.depth, label.depth, certain(label.mask, label.sigma))
    assert view.robot is not None
    return {
        "stamp_ns": view.stamp_ns,
        "station": view.station,
        "captures": view.captures,
        "verdict": label.posed.verdict,
        "accepted": bool(label.posed.accepted),
        "T_cell_camera": label.posed.T_cell_camera.tolist(),
        "T_robot": view.robot.T_cell_camera.tolist(),
        "sigma": np.sqrt(np.diag(label.posed.cov)).tolist(),
    }


def certain(mask: Bytes, sigma: Image) -> Mask:
    """Pixels (H, W) over which depth is compared with its label: trainable, and the label known to a centimetre.

    What is left out are silhouettes, where a pose error of a tenth of a millimetre jumps to the next surface.
    """
    return np.asarray((mask > 0) & (sigma <= CERTAIN_M))


def _score_raw(path: Path, result: LabelResult) -> None:
    """Every single capture against the label of its view."""
    from tof_sim_label.dataset import open_dataset

    dataset = open_dataset(path)
    number, last = dataset.column("captures/view"), -1
    label, mask = np.zeros((0, 0), np.float32), np.zeros((0, 0), bool)
    for capture in range(dataset.captures):
        if not 0 <= number[capture] < dataset.views:
            continue
        if number[capture] != last:
            last = int(number[capture])
            label = dataset.frame("views/label", last)
            mask = certain(dataset.frame("views/mask", last), dataset.frame("views/label_sigma", last))
        result.raw.add(dataset.frame("captures/raw", capture), label, mask)


def _swap(part: Path, whole: Path) -> None:
    """Put the new dataset in the old one's place."""
    old = whole.with_name(whole.name + ".old")
    shutil.rmtree(old, ignore_errors=True)
    if whole.exists():
        whole.replace(old)
    part.replace(whole)
    shutil.rmtree(old, ignore_errors=True)


def _save_json(path: Path, value: Any) -> None:
    part = path.with_name(path.name + ".part")
    part.write_text(json.dumps(value, indent=1) + "\n", encoding="utf-8")
    part.replace(path)
