# SPDX-License-Identifier: Apache-2.0
"""A bag through a trained network into another bag: `infer/depth`, `infer/sigma`, `infer/camera_info`."""

from __future__ import annotations

import shutil
import time
from collections import Counter
from dataclasses import dataclass, field, replace
from statistics import median
from typing import TYPE_CHECKING, Any

import numpy as np

from tof_core.bag_writer import BagWriter
from tof_core.config import section
from tof_core.cores import FREE
from tof_core.errors import RefusedError
from tof_core.options import BagOptions
from tof_core.progress import progress
from tof_infer.config import InferConfig
from tof_infer.frames import Mark
from tof_infer.session import Repaired, Session
from toftwin.inputs import must_have_frames

if TYPE_CHECKING:
    from pathlib import Path

    from tof_core.bag import BagReader
    from tof_core.capture import Capture


@dataclass(frozen=True, slots=True)
class InferenceConfig:
    """Topics of the bag, and the network."""

    input: BagOptions = section(BagOptions, "topics, frames and units")
    infer: InferConfig = section(InferConfig, "the network")


@dataclass(slots=True)
class Tally:
    """Counts of the pixels of a bag by mark, and the time of each frame."""

    model: str
    device: str
    frames: int = 0
    pixels: Counter[str] = field(default_factory=Counter)
    seconds: list[float] = field(default_factory=list)

    def add(self, repaired: Repaired, seconds: float) -> None:
        """Count one frame."""
        self.frames += 1
        self.seconds.append(seconds)
        for mark in Mark:
            self.pixels[mark.name.lower()] += int(np.count_nonzero(repaired.mark == mark))

    def share(self, mark: str) -> float:
        """Share of the pixels with that mark."""
        return self.pixels[mark] / max(sum(self.pixels.values()), 1)

    @property
    def median_ms(self) -> float:
        """Milliseconds of a frame."""
        return 1e3 * median(self.seconds) if self.seconds else float("nan")

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {
            "model": self.model,
            "device": self.device,
            "frames": self.frames,
            "ms_per_frame": self.median_ms,
            **{mark.name.lower(): self.share(mark.name.lower()) for mark in Mark},
        }


def infer_bag(reader: BagReader, out: Path, config: InferConfig, *, copy: bool = True) -> Tally:
    """Repair every frame of a bag; with `copy` the new bag also holds the messages of the old one.

    Raises:
        ModelError: a damaged or foreign model.
        RefusedError: a model for another camera or range, or a bag without a frame that can be read. Then no bag is written.
    """
    session = Session(replace(config, threads=min(config.threads, FREE.count())))
    session.accept(reader.camera)
    tally = Tally(session.path.name, session.device)
    try:
        with BagWriter(out) as bag:
            if copy:
                for m in reader.messages():
                    bag.raw(m.topic, m.type, m.cdr, m.stamp_ns)
            for capture in progress(reader.captures(need_tf=False), "infer", reader.frame_count):
                started = time.perf_counter()
                repaired = session.repair(capture)
                tally.add(repaired, time.perf_counter() - started)
                write_repaired(bag, capture, repaired)
        must_have_frames(tally.frames, reader, "infer")
    except RefusedError:
        shutil.rmtree(out, ignore_errors=True)
        raise
    return tally


def write_repaired(bag: BagWriter, capture: Capture, repaired: Repaired) -> None:
    """Write one repaired frame, as the node `infer` publishes it."""
    frame, stamp = capture.camera.frame_id, capture.stamp_ns
    bag.image("/infer/depth", repaired.depth, "32FC1", frame, stamp)
    bag.image("/infer/sigma", repaired.sigma, "32FC1", frame, stamp)
    bag.camera_info("/infer/camera_info", capture.camera, stamp)
