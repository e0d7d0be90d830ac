# SPDX-License-Identifier: Apache-2.0
"""The offline pipeline from bag to views; the same code as in the nodes."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from tof_align.config import AlignConfig
from tof_core.config import section
from tof_core.motion import StationTracker
from tof_core.progress import progress
from tof_preproc.stream_config import StreamConfig
from tof_sim_label.config import LabelConfig
from toftwin.thinned import thinned

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from tof_core.bag import BagReader
    from tof_core.capture import Capture, View
    from tof_sim_label.labeller import LabellerConfig
    from toftwin.boarded import BoardSource

FIRST_READING_S = 60.0
"""Seconds from a view to the thermometer's first message, up to which its reading holds: a housing warms over minutes."""


@dataclass(frozen=True, slots=True)
class PipelineConfig(StreamConfig):
    """Settings from the bag to the labels; the ROS parameters of the nodes have the same names."""

    align: AlignConfig = section(AlignConfig, "where the camera was")
    label: LabelConfig = section(LabelConfig, "what its label holds")

    @property
    def labeller(self) -> LabellerConfig:
        """Settings of poses and labels."""
        from tof_sim_label.labeller import LabellerConfig

        return LabellerConfig(self.align, self.label)


@dataclass(slots=True)
class ViewStream:
    """Views of a bag, one per dwell; `members` holds the captures of the last view."""

    reader: BagReader | BoardSource
    config: StreamConfig
    need_tf: bool = True
    members: list[Capture] = field(default_factory=list)

    def __iter__(self) -> Iterator[View]:
        """Each dwell's final view, in order of time."""
        from tof_preproc.preprocessor import accumulate_views

        taken: list[Capture] = []
        stations = StationTracker(self.config.station)
        frames = progress(self.reader.captures(need_tf=self.need_tf), "captures", self.reader.frame_count)
        captures = _noted(frames, taken)
        for view in accumulate_views(captures, self.config.preproc, still=self.still, stations=stations):
            self.members = [c for c in taken if c.stamp_ns <= view.stamp_ns]
            del taken[: len(self.members)]
            yield view

    def still(self, capture: Capture) -> bool:
        """The motion gate."""
        return self.reader.still(capture, self.config.still)


def _noted(captures: Iterable[Capture], taken: list[Capture]) -> Iterator[Capture]:
    for capture in captures:
        taken.append(capture)
        yield capture


def raw_views(reader: BagReader | BoardSource, config: StreamConfig, moving: int | None = None) -> list[View]:
    """Averaged, unfiltered views of a bag for a diagnosis of the sensor: all at rest, and at most `moving` in motion (None: all)."""
    unfiltered = replace(config, preproc=replace(config.preproc, order="accumulate"))
    views = (replace(view, colour=None, noise=None) for view in ViewStream(reader, unfiltered))
    return with_first_temperature(list(views) if moving is None else thinned(views, moving))


def with_first_temperature(views: Sequence[View]) -> list[View]:
    """The views, of which those up to `FIRST_READING_S` before the thermometer's first message take its reading."""
    first = next((v for v in views if math.isfinite(v.temperature)), None)
    if first is None:
        return list(views)
    early = (first.stamp_ns - v.stamp_ns for v in views)
    return [replace(v, temperature=first.temperature) if 0 < ns <= FIRST_READING_S * 1e9 else v for v, ns in zip(views, early, strict=True)]
