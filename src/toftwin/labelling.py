# SPDX-License-Identifier: Apache-2.0
"""A bag and its CAD to a labelled dataset: captures to views, views to poses, poses to labels."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from tof_core.capture import View
from tof_core.config import to_mapping
from tof_core.errors import RefusedError, UsageError
from tof_core.lens import apart_px, apart_rms_px
from tof_core.progress import progress
from tof_core.yamlio import save_yaml
from tof_eval.pooled import PooledError
from tof_scene.world.words import described
from toftwin.cameras import Cameras
from toftwin.known import MODES, Known
from toftwin.pipeline import PipelineConfig, ViewStream
from toftwin.resume import OtherBagError, Unfinished, save_json

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from tof_core.arrays import Float
    from tof_core.bag import BagReader
    from tof_core.camera import Camera
    from tof_core.capture import Capture, Posed
    from tof_core.metrics import DepthError
    from tof_scene.raycast import Raycaster
    from tof_scene.scene import Scene
    from tof_sim_label.label import Label
    from tof_sim_label.schema import Attributes
    from toftwin.boarded import BoardSource

    Labelled: TypeAlias = tuple[View, Posed, Callable[[], Label]]


@dataclass(slots=True)
class LabelResult:
    """Result of a bag: counts, depth errors against the label, the verdict of each view.

    `label_sigma_mm` is the standard deviation of one label: the median over the usable pixels of a view, and over the views.
    `reasons` counts the pixels of all views by why they may not be trained on (`tof_sim_label.reasons`); `world` lists missing parts
    and foreign objects, with mode final. `others` holds the `T_cell_camera` of each view by the further modes that were requested.
    """

    dataset: Path
    captures: int = 0
    views: int = 0
    skipped: Counter[str] = field(default_factory=Counter)
    verdicts: Counter[str] = field(default_factory=Counter)
    reasons: Counter[str] = field(default_factory=Counter)
    world: dict[str, Any] = field(default_factory=lambda: {"missing": [], "foreign": []})
    raw: PooledError = field(default_factory=PooledError)
    filtered: PooledError = field(default_factory=PooledError)
    label_sigma_mm: float | None = None
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
            "reasons": dict(self.reasons),
            "world": self.world,
            "raw": self.raw.error.to_dict(),
            "filtered": self.filtered.error.to_dict(),
            "label_sigma_mm": self.label_sigma_mm,
            "note": self.note,
        }


def label_bag(
    reader: BagReader | BoardSource,
    scene: Scene,
    config: PipelineConfig,
    out: Path,
    *,
    known: Known | None = None,
    mode: str = "final",
    also: Sequence[str] = (),
) -> LabelResult:
    """Label a bag into `out`: dataset.zarr, config.yaml, poses.json, metrics.json.

    The dataset gets its name when it is complete; an earlier one stays until then. An interrupted run leaves
    `dataset.zarr.part`, and the same call continues where it stopped.
    `known`: prior knowledge of the camera. `also`: further modes whose poses are computed (`LabelResult.others`), with mode final.

    Raises:
        RefusedError: the bag has no usable frame, or the session fits the CAD nowhere.
    """
    from tof_sim_label.schema import Attributes

    if mode not in MODES:
        raise UsageError(f"'{mode}' is not one of {', '.join(MODES)}", where="--mode")
    config = replace(config, align=replace(config.align, mode=MODES[mode]))
    known = known or Known()
    known.check(mode)
    new = not out.exists()
    out.mkdir(parents=True, exist_ok=True)
    attributes = Attributes(scene.digest, known.digest(config), known.source(mode), scene.names)
    job = _Job(reader, scene, config, known, tuple(also), causal=mode == "causal")
    try:
        result, poses = job.run(out, attributes)
    except OtherBagError:  # the data of an earlier run belong to another bag, and are removed now
        result, poses = job.run(out, attributes)
    except RefusedError:
        if new and not any(out.iterdir()):
            out.rmdir()
        raise
    save_yaml(out / "config.yaml", to_mapping(config))
    save_json(out / "poses.json", poses)
    save_json(out / "metrics.json", result.to_dict())
    return result


@dataclass(frozen=True, eq=False)
class _Job:
    """Bag, scene and settings of one labelling."""

    reader: BagReader | BoardSource
    scene: Scene
    config: PipelineConfig
    known: Known
    also: tuple[str, ...]
    causal: bool

    @cached_property
    def caster(self) -> Raycaster:
        """Built at its first use: reading a bag does not need it."""
        from tof_scene.raycast import Raycaster

        return Raycaster(self.scene)

    def run(self, out: Path, attributes: Attributes) -> tuple[LabelResult, list[dict[str, Any]]]:
        """Write or finish the dataset; returns the result and the entry of each view in `poses.json`."""
        poses = list[dict[str, Any]]()
        with Unfinished(out, self.reader.camera, attributes) as dataset:
            result = LabelResult(out / "dataset.zarr", note="; ".join(filter(None, [self.reader.note, dataset.note])))
            for view, posed, make in (self._causal if self.causal else self._final)(dataset, result):
                dataset.append_view(view, posed, make)
                result.verdicts[posed.verdict] += 1
                poses.append(_entry(view, posed))
        _score(dataset.path, result)
        dataset.finish(result.dataset)
        return result, poses

    def _final(self, dataset: Unfinished, result: LabelResult) -> Iterator[Labelled]:
        """Poses from one solution of the whole session."""
        views = list[View]()
        for view, members in self._views(result):
            for capture in members:
                dataset.append_capture(capture, len(views))
            views.append(view)

        from tof_align.session import solve_session
        from tof_sim_label.label import label_view
        from tof_sim_label.world import missing_named, session_surprises

        try:
            cameras = dataset.solved(views, "labels", partial(self._cameras, views))
        except RefusedError as error:
            from toftwin.mistakes.find import explained

            raise explained(error, views, self.caster, self.config.input, self.config.align) from error
        posed, caster = cameras.posed, cameras.caster(self.caster)
        lens = _lens_note(views[0].camera, posed, self.config.label.lens_px)
        notes = [result.note, lens, cameras.note(self.scene), self.known.scene_note(self.scene.digest)]
        result.note = "; ".join(filter(None, notes))
        for name in self.also:
            other = replace(self.config.align, mode=MODES[name])
            found = dataset.solved(views, name, lambda align=other: Cameras(solve_session(views, self.caster, align).posed))  # type: ignore[misc]
            result.others[name] = [p.T_cell_camera for p in found.posed]
        world = session_surprises(views, posed, caster, self.config.label)
        result.world = described(world, self.caster.scene)
        posed = missing_named(posed, world, self.scene.names)
        for view, pose, codes in progress(zip(views, posed, world.pixels, strict=True), "labels", len(views)):
            yield view, pose, partial(label_view, view, pose, caster, self.config.label, codes)

    def _cameras(self, views: Sequence[View]) -> Cameras:
        """The cameras of all views, corrected for known effects and, on request, for those that a diagnosis finds."""
        from tof_sim_label.labeller import label_session

        if self.known.joint:
            from toftwin.joint import joint_poses

            return joint_poses(self.reader, views, self.caster, self.config, self.known.model)
        return Cameras(label_session(views, self.caster, self.config.labeller, self.known.bias)[0].posed)

    def _causal(self, dataset: Unfinished, result: LabelResult) -> Iterator[Labelled]:
        """Poses as of the node `sim_label`, by its code: each view's follows from the views before it."""
        from tof_sim_label.stream import LabelStream

        stream, number = LabelStream(self.caster, self.config.labeller, self.known.bias), 0
        for view, members in self._views(result):
            stream.push(view)
            labelled = stream.flush()
            label = None if labelled is None else labelled.label
            for capture in members:
                dataset.append_capture(capture, -1 if label is None else number)
            if label is None:
                result.verdicts["refused"] += 1
                continue
            number += 1
            yield view, label.posed, partial(_itself, label)

    def _views(self, result: LabelResult) -> Iterator[tuple[View, list[Capture]]]:
        """Views of the bag with their captures."""
        reader, stream = self.reader, ViewStream(self.reader, self.config)
        for view in stream:
            result.captures += len(stream.members)
            result.views += 1
            yield replace(view, colour=None), stream.members
        result.skipped = Counter(reader.skipped)
        if not result.views:
            raise RefusedError(_why_nothing(reader), where="label", todo="toftwin doctor lists what the bag lacks")


def _lens_note(stated: Camera, posed: Sequence[Posed], least_px: float) -> str:
    """A note where the session's lens differs from CameraInfo's by `least_px` and more."""
    lens = next((p.camera for p in posed if p.camera is not None), None)
    most = 0.0 if lens is None else apart_px(stated, lens)
    if lens is None or most < least_px:
        return ""
    off = f"{apart_rms_px(stated, lens):.1f} px RMS off camera_info, {most:.1f} px at the pixel that is off most"
    return f"the session shows a lens {off}: labels are rendered through the lens found"


def _itself(label: Label) -> Label:
    return label


def _why_nothing(reader: BagReader | BoardSource) -> str:
    skipped = ", ".join(f"{reason} {count}" for reason, count in reader.skipped.items())
    return f"no frame of {reader.frame_count} can be used ({skipped or 'there are none'}): {reader.last_error}"


def _entry(view: View, posed: Posed) -> dict[str, Any]:
    """The entry of a view in `poses.json`."""
    assert view.robot is not None
    return {
        "stamp_ns": view.stamp_ns,
        "station": view.station,
        "captures": view.captures,
        "verdict": posed.verdict,
        "accepted": bool(posed.accepted),
        "T_cell_camera": posed.T_cell_camera.tolist(),
        "T_robot": view.robot.T_cell_camera.tolist(),
        "sigma": np.sqrt(np.diag(posed.cov)).tolist(),
    }


def _score(path: Path, result: LabelResult) -> None:
    """Errors of views and captures against the label, accuracy of the labels, and reasons of removed pixels."""
    from tof_sim_label.dataset import open_dataset
    from tof_sim_label.reasons import LabelReason

    dataset = open_dataset(path)
    of_view, sigma = dataset.column("captures/view"), list[float]()
    for v in range(dataset.views):
        label, mask = dataset.frame("views/label", v), dataset.frame("views/mask", v) > 0
        counts = np.bincount(dataset.frame("views/reason", v).ravel(), minlength=len(LabelReason))
        result.reasons.update({code.name.lower(): int(counts[code]) for code in LabelReason if counts[code]})
        result.filtered.add(dataset.frame("views/depth", v), label, mask)
        if mask.any():
            sigma.append(1e3 * float(np.median(dataset.frame("views/label_sigma", v)[mask])))
        for capture in np.flatnonzero(of_view == v):
            result.raw.add(dataset.frame("captures/raw", int(capture)), label, mask)
    result.label_sigma_mm = float(np.median(sigma)) if sigma else None
