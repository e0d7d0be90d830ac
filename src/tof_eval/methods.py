# SPDX-License-Identifier: Apache-2.0
"""The methods compared, each from captures to one depth image: raw frame, filters, filters after a sensor correction, network."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol

import numpy as np

from tof_core.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from tof_core.arrays import Float, Image
    from tof_core.capture import Capture
    from tof_infer.session import Session
    from tof_preproc.config import PreprocConfig

METHODS = ("raw", "rules", "corrected", "model")


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """Result of a method for one view: depth (H, W) metres, NaN where invalid; sigma (H, W) or None; run time in seconds."""

    depth: Image
    sigma: Image | None
    seconds: float


class Method(Protocol):
    """A method that repairs depth; frames: number of captures of a view that it uses."""

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
    """Rules after a correction of the sensor's bias; `bias` gives the error of a capture's depth (H, W) in metres, which is subtracted."""

    def __init__(self, bias: Callable[[Capture], Float], config: PreprocConfig, frames: int = 1) -> None:
        super().__init__(config, frames, "corrected" if frames == 1 else f"corrected{frames}")
        self.bias = bias

    def estimate(self, captures: Sequence[Capture]) -> Estimate:
        """Correct each capture, then filter."""
        started = time.perf_counter()
        better = [replace(c, depth=(c.depth - self.bias(c)).astype(np.float32)) for c in captures]
        e = super().estimate(better)
        return Estimate(e.depth, e.sigma, time.perf_counter() - started)


class Model:
    """A trained network on one frame. A pixel that it marks as unknown counts as not measured."""

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
    bias: Callable[[Capture], Float] | None,
    frames: int,
) -> list[Method]:
    """Methods by name; with `frames` above 1 each filter method is listed a second time, with that many captures.

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
            if bias is None:
                raise UsageError(
                    "'corrected' needs a fitted sensor model", where="--methods", todo="pass --sensor sensor.yaml (toftwin gap)"
                )
            out += [Corrected(bias, rules, n) for n in _counts(frames)]
        else:
            raise UsageError(f"there is no method '{name}'", where="--methods", todo=f"methods: {', '.join(METHODS)}")
    return out


def _counts(frames: int) -> tuple[int, ...]:
    return (1,) if frames <= 1 else (1, frames)
