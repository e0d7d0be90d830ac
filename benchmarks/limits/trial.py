# SPDX-License-Identifier: Apache-2.0
"""One session diagnosed, or aligned, with one number changed; what does not depend on the number is not computed again."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any
from unittest.mock import patch

import numpy as np

import tof_gap.diagnose as diagnosis
import tof_gap.solve.start as first
from benchmarks.limits.names import SECTIONS, Reads, replaced
from tof_align.config import AlignConfig
from tof_align.session import near, solve_session
from tof_core import se3
from tof_core.config import updated
from tof_core.errors import ToftwinError
from tof_gap.config import GapConfig
from tof_gap.solve import brief, settle
from tof_gap.solve.apart import set_apart
from tof_gap.solve.conclude import conclude
from tof_gap.solve.radial import gate
from tof_gap.solve.solution import Joint
from tof_gap.solve.start import Start
from tof_gap.solve.stray import solve_agreeing
from tof_scene.render import render
from tof_sensor.stated import StatedNoise

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from benchmarks.limits.sessions import Session
    from tof_align.chain import Chain
    from tof_align.pixels import Sample
    from tof_core.arrays import Float
    from tof_core.camera import Camera
    from tof_scene.raycast import Raycaster

POSES, SOLUTION, CLOSED, REPORT = "poses", "solution", "closed", "report"
STAGES = (POSES, SOLUTION, CLOSED)
"""Stages of a diagnosis; each uses what the one before it found."""
GATE, APART, SOLVE, CONCLUDE, RENDER, NEAR = gate, set_apart, solve_agreeing, conclude, render, near
"""What is computed, before any of it is replaced by what is kept."""


@dataclass(slots=True)
class Trials:
    """A session, which numbers each stage of it reads, and the results of its stages with default numbers."""

    session: Session
    reads: dict[str, set[str]] = field(default_factory=dict)
    stage: list[str] = field(default_factory=lambda: [POSES])
    kept: dict[Any, Any] = field(default_factory=dict)
    default: dict[str, dict[str, Any]] = field(default_factory=dict)

    def run_default(self) -> None:
        """Diagnose and align with default numbers, and note which of them are read."""
        self.default["gap"] = self._diagnosed(Reads(self._gap(), self.reads, self.stage))
        self.stage[0] = "align"
        self.default["align"] = self._aligned(Reads(AlignConfig(), self.reads, self.stage))

    def _gap(self) -> GapConfig:
        """Default numbers of a diagnosis, and the calibration that the session states."""
        return GapConfig(calibration=self.session.calibration)

    def is_read(self, of: str, name: str) -> bool:
        """Whether the session depends on a number at all."""
        return name in self.reads["align"] if of == "align" else any(name in self.reads.get(s, ()) for s in (*STAGES, REPORT))

    def run(self, of: str, name: str, value: float) -> dict[str, Any]:
        """The outcome with one number changed."""
        if of == "align":
            return self._aligned(updated(SECTIONS[of](), {name: value}))
        return self._diagnosed(updated(self._gap(), {name: value}), list(STAGES[: self.reused(of, name)]))

    def reused(self, of: str, name: str) -> int:
        """Stages whose results with default numbers can be used again: 0 to 3 of a diagnosis."""
        if of == "align":
            return 0
        return next((i for i, stage in enumerate(STAGES) if name in self.reads.get(stage, ())), len(STAGES))

    def _diagnosed(self, config: Any, keep: list[str] | None = None) -> dict[str, Any]:
        """Verdict, shrink with its interval, and explainable share; `keep`: stages whose results with default numbers are used again."""
        keep = keep or []

        def staged(stage: str, after: str, function: Callable[..., Any]) -> Callable[..., Any]:
            def run(*args: Any, **asked: Any) -> Any:
                self.stage[0], key = stage, (stage, function.__name__)
                if stage not in keep:
                    self.kept.setdefault(key, copies(found := function(*args, **asked)))
                else:
                    found = self.kept[key]
                self.stage[0] = after
                return tuple(_with_limits(x, config.evidence) for x in found)

            return run

        def solved(*args: Any) -> Any:
            joint, used, *views = staged(SOLUTION, CLOSED, SOLVE)(*args)
            # Of the settings that the solution changed, those of blur alone differ from the ones that are tried.
            short = used.evidence.blur.creases != config.evidence.blur.creases
            return joint, replaced(config, evidence=replaced(config.evidence, blur=used.evidence.blur)) if short else config, *views

        def closed(joint: Joint, *args: Any) -> Any:
            key = (CLOSED, id(joint.selection))
            self.stage[0] = CLOSED
            if CLOSED not in keep or key not in self.kept:
                found = CONCLUDE(joint, *args)
                self.kept.setdefault((key, "rng"), args[-1].bit_generator.state)
                self.kept.setdefault(key, found)
                self.kept.setdefault((key, "alive"), joint.selection)
            else:
                found = self.kept[key]
                args[-1].bit_generator.state = self.kept[key, "rng"]  # Intervals are resampled with what follows.
            self.stage[0] = REPORT
            views = [tuple(replace(v, limits=config.evidence) for v in seen) for seen in (found.evidence, found.linearised)]
            return replace(found, evidence=views[0], linearised=views[1])

        with (
            patch.object(diagnosis, "solve_agreeing", solved),
            patch.object(diagnosis, "conclude", closed),
            patch.object(diagnosis, "gate", staged(POSES, POSES, GATE)),
            patch.object(diagnosis, "set_apart", staged(POSES, SOLUTION, APART)),
            patch.object(brief, "replace", replaced),
            patch.object(settle, "replace", replaced),
            patch.object(first, "render", self._render),
            patch.object(first, "near", self._near),
        ):
            self.stage[0] = POSES
            try:
                s = self.session
                d = diagnosis.diagnose(s.views, s.caster, config, AlignConfig(), s.left_out, stated=StatedNoise(s.law))
            except ToftwinError as error:
                return {"verdict": [f"refused: {error}"], "figures": []}
        return {"verdict": list(d.verdict), "figures": [d.gap.shrink, *(d.gap.ci95 or (None, None)), d.explainable]}

    def _render(self, caster: Raycaster, camera: Camera, pose: Float, *, footprints: bool = True) -> Any:
        """The CAD from one camera and pose; rendered once, as no number of the gap enters it."""
        key = ("render", camera, pose.tobytes(), footprints)
        if key not in self.kept:
            self.kept[key] = RENDER(caster, camera, pose, footprints=footprints)
        return self.kept[key]

    def _near(self, samples: Sequence[Sample], chain: Chain, caster: Raycaster, config: AlignConfig) -> Any:
        """Bases found from afar; searched once per reading of the depth images."""
        key = ("near", *(float(np.nansum(s.full.depth)) for s in samples))
        if key not in self.kept:
            self.kept[key] = NEAR(samples, chain, caster, config)
        return self.kept[key]

    def _aligned(self, config: Any) -> dict[str, Any]:
        """Poses and how many of them are accepted."""
        try:
            found = solve_session(self.session.views, self.session.caster, config)
        except ToftwinError as error:
            return {"accepted": 0, "refused": str(error), "poses": []}
        return {"accepted": sum(p.accepted for p in found.posed), "poses": [p.T_cell_camera for p in found.posed]}

    def outcome(self, of: str, found: dict[str, Any]) -> dict[str, Any]:
        """A result against that with default numbers, as JSON holds it."""
        usual = self.default[of]
        if of == "gap":
            return {
                "verdict": found["verdict"],
                "changed": found["verdict"] != usual["verdict"],
                "points": _points(usual["figures"], found["figures"]),
            }
        moved = [se3.distance(a, b)[0] for a, b in zip(usual["poses"], found["poses"], strict=False)]
        return {"accepted": found["accepted"], "changed": found["accepted"] != usual["accepted"], "mm": 1e3 * max(moved, default=0.0)}


def _points(one: list[float | None], other: list[float | None]) -> float | None:
    """Percentage points by which a figure differs at most; None where none is stated in both."""
    both = [100.0 * abs(a - b) for a, b in zip(one, other, strict=False) if a is not None and b is not None]
    return max(both, default=None)


def copies(found: tuple[Any, ...]) -> tuple[Any, ...]:
    """A result with copies of what hands its views over to the next stage."""
    return tuple(replace(x) if isinstance(x, Start) else x for x in found)


def _with_limits(found: Any, evidence: Any) -> Any:
    """A result of an earlier stage whose views, where it has some, are judged by other limits from here on."""
    if isinstance(found, Start):
        return replace(found, evidence=tuple(replace(v, limits=evidence) for v in found.evidence))
    return replace(found, views=tuple(replace(v, limits=evidence) for v in found.views)) if isinstance(found, Joint) else found
