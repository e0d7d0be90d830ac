# SPDX-License-Identifier: Apache-2.0
"""The captures taken while nothing moves, and the view that they are accumulated to."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_core import se3
from tof_core.capture import View
from tof_preproc import stages
from tof_preproc.accumulate import accumulate
from tof_preproc.frame import Frame, Report
from tof_preproc.jumps import step_over_time
from tof_preproc.noise import law_of_capture, law_of_dwell
from tof_preproc.quantum import quantum_of
from tof_preproc.stack import Stack

if TYPE_CHECKING:
    from tof_core.arrays import Image
    from tof_core.capture import Capture, Colour
    from tof_preproc.config import MotionConfig, PreprocConfig


class Dwell:
    """Captures of one dwell with the pixels removed from each; at most `accumulate.max_captures`."""

    def __init__(self, first: Capture, station: int, config: PreprocConfig) -> None:
        """A dwell that begins with `first`; it still has to be added."""
        self.first = self.last = first
        self.station = station
        self._config = config
        self._before, self._over, self._after = stages.split(config)
        shape = (first.depth.shape[0], first.depth.shape[1])
        self._stack = Stack(shape, config.accumulate.max_captures, in_time=config.accumulate.method == "paper")
        self._report = Report()
        self._light: Image | None = None
        self._lit: Image | None = None
        self._quantum = quantum_of(first.depth)
        self._colour: Colour | None = None
        self._ended = False

    @property
    def captures(self) -> int:
        """How many it holds."""
        return self._stack.captures

    @property
    def ended(self) -> bool:
        """Whether it takes no further capture: it is full, or its capture was taken in motion."""
        return self._ended or self._stack.captures >= self._config.accumulate.max_captures

    def takes(self, capture: Capture) -> bool:
        """Whether the capture belongs to this dwell: same camera and place, soon after, and room for it."""
        gap = (capture.stamp_ns - self.last.stamp_ns) * 1e-9
        return (
            not self.ended
            and 0 < gap <= self._config.motion.max_gap_s
            and capture.camera == self.first.camera
            and not (self._config.motion.enable and moved(self.first, capture, self._config.motion))
        )

    def add(self, capture: Capture, *, last: bool = False) -> None:
        """Filter one capture and keep it; last: whether no other one follows."""
        self._ended = last
        frame = Frame(capture.camera, capture.depth.copy(), capture.reason.copy(), np.zeros_like(capture.depth), capture.amplitude)
        if any(s not in ("range", "amplitude", "self") for s in self._before):
            frame.sigma = law_of_capture(capture.depth, capture.amplitude, self._quantum).sigma(capture.depth, capture.amplitude)
        stages.apply(self._before, frame, self._config, self._report)
        self._stack.add(frame.depth, frame.reason)
        self._add_light(capture.amplitude)
        self._colour = capture.colour or self._colour
        self.last = capture

    def _add_light(self, amplitude: Image | None) -> None:
        if amplitude is None:
            return
        known = np.isfinite(amplitude)
        if self._light is None or self._lit is None:
            self._light, self._lit = np.zeros(amplitude.shape, np.float32), np.zeros(amplitude.shape, np.float32)
        np.add(self._light, amplitude, out=self._light, where=known)
        self._lit += known

    def view(self) -> tuple[View, Report]:
        """View of the captures so far, accumulated and filtered, and the report of the stages."""
        last, amplitude = self.last, self._amplitude()
        step = step_over_time(self._stack, last.camera.ray_length(), self._quantum)
        result = accumulate(self._stack, self._expected_noise(amplitude), max(self._quantum, step), self._config, self._over)
        report = Report({**self._report.removed, **result.rejected}, {**self._report.passed, **result.passed})
        frame = Frame(last.camera, result.depth, result.reason, result.sigma, amplitude)
        stages.apply(self._after, frame, self._config, report)
        valid = np.isfinite(frame.depth)
        view = View(
            stamp_ns=last.stamp_ns,
            dwell_ns=self.first.stamp_ns,
            camera=last.camera,
            depth=frame.depth,
            sigma=frame.sigma,
            count=np.where(valid, result.count, 0).astype(np.uint16),
            reason=frame.reason,
            robot=last.robot,
            station=self.station,
            captures=self._stack.captures,
            amplitude=amplitude,
            colour=self._colour,
            temperature=last.temperature,
            noise=np.where(valid, result.noise, np.nan).astype(np.float32),
            code_m=step or None,
            written_m=self._quantum,
        )
        return view, report

    def _expected_noise(self, amplitude: Image | None) -> Image:
        one = self._stack.captures == 1
        law = law_of_capture(self.first.depth, amplitude, self._quantum) if one else law_of_dwell(self._stack, amplitude, self._quantum)
        return law.sigma(self._stack.nearest() if amplitude is None else self.first.depth, amplitude)

    def _amplitude(self) -> Image | None:
        if self._light is None or self._lit is None:
            return None
        with np.errstate(invalid="ignore"):
            return np.asarray(self._light / self._lit, np.float32)


def moved(one: Capture, other: Capture, config: MotionConfig) -> bool:
    """Whether two captures have different poses by TF; False where a pose is unknown."""
    if one.robot is None or other.robot is None:
        return False
    metres, degrees = se3.distance(one.robot.T_cell_camera, other.robot.T_cell_camera)
    return metres * 1e3 > config.tolerance_mm or degrees > config.tolerance_deg
