# SPDX-License-Identifier: Apache-2.0
"""What is compared: the raw frame, rules, rules after a fitted sensor correction, a network; each from captures to one depth."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from tof_core.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from tof_core.arrays import Image
    from tof_core.capture import Capture
    from tof_infer.session import Session
    from tof_preproc.config import PreprocConfig
    from tof_sensor.model import SensorModel

METHODS = ("raw", "rules", "corrected", "model")


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """A method's answer for one view: depth (H, W) metres, NaN where it gives none; its own sigma (H, W) or None; seconds it took."""

    depth: Image
    sigma: Image | None
    seconds: float


class Method(Protocol):
    """A way to repair depth. `frames`: how many captures of a view it takes."""

    name: str
    frames: int

    def estimate(self, captures: Sequence[Capture]) -> Estimate:
        """Depth of the last of these captures of one dwell."""


class Raw:
    """One frame as the camera gave it."""

    name, frames = "raw", 1

    def estimate(self, captures: Sequence[Capture]) -> Estimate:
        """The last capture."""
        return Estimate(captures[-1].depth, None, 0.0)


class Rules:
    """The filters of `tof_preproc`, on one capture or on several of a dwell."""

    def __init__(self, config: PreprocConfig, frames: int = 1, name: str = "") -> None:
        self.config, self.frames = config, frames
        self.name = name or ("rules" if frames == 1 else f"rules{frames}")

    def estimate(self, captures: Sequence[Capture]) -> Estimate:
        """Accumulate and filter."""
        from tof_preproc.preprocessor import Preprocessor

        started = time.perf_counter()
        preprocessor = Preprocessor(self.config)
        for capture in captures[:-1]:
            preprocessor.push(capture)
        view = preprocessor.push(captures[-1])
        return Estimate(view.depth, view.sigma, time.perf_counter() - started)


class Corrected(Rules):
    """Rules after a fitted sensor model was taken off, as far as it can be told from the frame alone."""

    def __init__(self, model: SensorModel, config: PreprocConfig, frames: int = 1) -> None:
        super().__init__(config, frames, "corrected" if frames == 1 else f"corrected{frames}")
        self.model = model

    def estimate(self, captures: Sequence[Capture]) -> Estimate:
        """Correct each capture, then filter."""
        from dataclasses import replace

        from toftwin.evaluation.rivals import correction

        started = time.perf_counter()
        better = [replace(c, depth=(c.depth - correction(self.model, c)).astype(np.float32)) for c in captures]
        e = super().estimate(better)
        return Estimate(e.depth, e.sigma, time.perf_counter() - started)


class Model:
    """A trained network on one frame. What it marks as unknown counts as not given."""

    name, frames = "model", 1

    def __init__(self, session: Session) -> None:
        self.session = session

    def estimate(self, captures: Sequence[Capture]) -> Estimate:
        """Repair the last capture."""
        started = time.perf_counter()
        repaired = self.session.repair(captures[-1])
        seconds = time.perf_counter() - started
        nan = np.float32(np.nan)
        return Estimate(np.where(repaired.known, repaired.depth, nan), np.where(repaired.known, repaired.sigma, nan), seconds)


def make_methods(
    names: Sequence[str],
    rules: PreprocConfig,
    session: Session | None,
    sensor: Path | None,
    frames: int,
) -> list[Method]:
    """Methods by name; with `frames` above 1 the rules come a second time, given so many captures.

    Raises:
        UsageError: an unknown name, or one that lacks its file.
    """
    out: list[Method] = []
    for name in names:
        if name == "raw":
            out.append(Raw())
        elif name == "rules":
            out += [Rules(rules, n) for n in _counts(frames)]
        elif name == "model" and session is not None:
            out.append(Model(session))
        elif name == "corrected":
            if sensor is None:
                raise UsageError(
                    "'corrected' needs a fitted sensor model", where="--methods", todo="pass --sensor sensor.yaml (toftwin gap)"
                )
            from tof_sensor.model import load_model

            out += [Corrected(load_model(sensor), rules, n) for n in _counts(frames)]
        else:
            raise UsageError(f"there is no method '{name}'", where="--methods", todo=f"methods: {', '.join(METHODS)}")
    return out


def _counts(frames: int) -> tuple[int, ...]:
    return (1,) if frames <= 1 else (1, frames)
