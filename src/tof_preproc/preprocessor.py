# SPDX-License-Identifier: Apache-2.0
"""Captures to views: running views for the live graph, one per dwell for whole sessions, with the same numbers."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

import numpy as np

from tof_core.camera import Camera
from tof_core.capture import Capture
from tof_core.motion import StationTracker
from tof_preproc.config import PreprocConfig
from tof_preproc.dwell import Dwell
from tof_preproc.frame import Report
from tof_preproc.surface import cos_incidence

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from tof_core.capture import View


class DwellKeeper:
    """Sorts captures into dwells. `events` counts what was `frozen` or `moved`, and the `dwells` begun."""

    def __init__(self, config: PreprocConfig) -> None:
        """No dwell yet; `config` is resolved."""
        self._config = config
        self._dwell: Dwell | None = None
        self._last: Capture | None = None
        self.events: Counter[str] = Counter()

    def add(self, capture: Capture, *, still: bool, station: int) -> Dwell | None:
        """The dwell that now holds this capture; None for a frozen frame, which changes nothing."""
        if self._config.frozen.enable and self._last is not None and is_repeated(self._last, capture):
            self.events["frozen"] += 1
            return None
        self._last = capture
        still = still or not self._config.motion.enable
        dwell = self._dwell
        if dwell is None or not still or dwell.station != station or not dwell.takes(capture):
            dwell = Dwell(capture, station, self._config)
            self.events["dwells"] += 1
        dwell.add(capture, last=not still)
        self._dwell = dwell if still else None
        self.events["moved"] += not still
        return dwell


class Preprocessor:
    """Accumulates dwells and filters them; one per camera. `report` holds what each stage did to the latest view."""

    def __init__(self, config: PreprocConfig | None = None) -> None:
        """Nothing seen yet."""
        self.config = (config or PreprocConfig()).resolved
        self.reset()

    def reset(self) -> None:
        """Forget the dwell and the counts."""
        self._keeper = DwellKeeper(self.config)
        self._view: View | None = None
        self.report = Report()

    @property
    def counts(self) -> Counter[str]:
        """Pixels (captures of pixels for `iqr` and `sigma3`) removed per stage in the latest view."""
        return Counter(self.report.removed)

    @property
    def events(self) -> Counter[str]:
        """Captures that were `frozen` or `moved`, and `dwells` begun, since the last reset."""
        return self._keeper.events

    def add(self, capture: Capture, *, still: bool = True, station: int = 0) -> Dwell | None:
        """The dwell that now holds this capture; None for a frozen frame. `view` gives its view."""
        return self._keeper.add(capture, still=still, station=station)

    def view(self, dwell: Dwell) -> View:
        """The view of a dwell as far as it has come."""
        self._view, self.report = dwell.view()
        return self._view

    def push(self, capture: Capture, still: bool = True, station: int = 0) -> View:  # noqa: FBT001, FBT002  (the rooms' interface)
        """The view of the current dwell with this capture in it.

        A capture in motion (`still` false) is a view of one. A frozen frame changes nothing: the last view comes back.
        """
        dwell = self.add(capture, still=still, station=station)
        if dwell is not None or self._view is None:
            assert dwell is not None
            return self.view(dwell)
        return self._view


def accumulate_views(
    captures: Iterable[Capture],
    config: PreprocConfig | None = None,
    *,
    still: Callable[[Capture], bool] | None = None,
    stations: StationTracker | None = None,
) -> Iterator[View]:
    """The final view of each dwell of a session, in order of time: what `Preprocessor.push` gives with its last capture.

    `still` is the motion gate (without it the captures' own poses decide); `stations` numbers stations by `T_cell_body`.
    """
    keeper = DwellKeeper((config or PreprocConfig()).resolved)
    stations = stations or StationTracker()
    current: Dwell | None = None
    for capture in captures:
        station = stations.push(capture.robot.T_cell_body) if capture.robot else 0
        dwell = keeper.add(capture, still=still is None or still(capture), station=station)
        if dwell is None or dwell is current:
            continue
        if current is not None:
            yield current.view()[0]
        current = dwell
    if current is not None:
        yield current.view()[0]


def warm_up(camera: Camera | None = None) -> None:
    """Load all kernels and per-camera tables before frames arrive; the first time, compiling takes some 20 s."""
    shape = (24, 32)
    small = Camera(shape[1], shape[0], 30.0, 30.0, 15.5, 11.5)
    rng = np.random.default_rng(0)
    for preset in ("default", "paper"):
        preprocessor = Preprocessor(PreprocConfig(preset=preset))
        for i in range(6):
            depth = (1 + 0.01 * rng.standard_normal(shape)).astype(np.float32)
            depth[5, i] = np.nan
            reason = np.where(np.isnan(depth), np.uint8(1), np.uint8(0))
            preprocessor.push(Capture(1 + i, small, depth, reason, amplitude=np.ones(shape, np.float32)))
    if camera is not None:
        cos_incidence(np.ones(camera.shape, np.float32), camera)
        camera.ray_length()


def is_repeated(last: Capture, capture: Capture) -> bool:
    """Whether a frame repeats the stamp or the content of the one before it; False for a frame without valid pixels."""
    if capture.stamp_ns == last.stamp_ns:
        return True
    same = capture.depth.shape == last.depth.shape and np.array_equal(capture.depth.view(np.uint32), last.depth.view(np.uint32))
    return same and bool(np.isfinite(capture.depth).any())
