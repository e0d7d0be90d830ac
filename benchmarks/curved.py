# SPDX-License-Identifier: Apache-2.0
"""`python -m benchmarks.curved FOLDER`: errors of no formula here, grafted onto healthy sessions of the emerging camera; is each named by what it depends on?

FOLDER is one that `python -m benchmarks.gap_check --form foreign --step record --out FOLDER` has made. A curve goes through random
points (monotone cubic), repeats what is published, or has a knee, a step or two slopes: no piecewise linear function over quantiles.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.board_grafts import TABLE_COUNTS, TURN_COUNTS, TURN_M, WIGGLE_COUNTS
from benchmarks.gap_check.examine import DATA_SHEET
from benchmarks.gap_check.record import BAGS, SEALED
from tof_core.cores import one_thread
from tof_scene.render import render

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from tof_core.arrays import Float
    from tof_core.capture import View
    from tof_scene.raycast import Raycaster

    Curve = Callable[["Seen"], Float]  # (H, W) error along the ray of a view, in any unit: `grafted` gives it its size

LEAST_M, MOST_M = 2e-3, 6e-3
"""Spread (standard deviation over the pixels on the CAD) of a grafted error, from half to twice 3 mm."""


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """What an error may depend on: per view (H, W) range in metres, (H, W) amplitude, () seconds since the first view."""

    radial: Float
    amplitude: Float
    seconds: float


def points(rng: np.random.Generator, low: float, high: float, count: int) -> Callable[[Float], Float]:
    """A smooth function through random points between two ends, flat beyond them."""
    from scipy.interpolate import PchipInterpolator

    at = np.linspace(low, high, count)
    smooth = PchipInterpolator(at, rng.normal(size=count))
    return lambda x: np.asarray(smooth(np.clip(x, low, high)))


def spans(seen: Sequence[Seen]) -> dict[str, tuple[float, float]]:
    """1 % and 99 % quantiles of each observable."""

    def of(values: Sequence[Float | float]) -> tuple[float, float]:
        every = np.concatenate([np.ravel(v) for v in values])
        low, high = np.nanquantile(every[np.isfinite(every)], [0.01, 0.99])
        return float(low), float(high)

    with np.errstate(divide="ignore", invalid="ignore"):
        return {
            "range": of([s.radial for s in seen]),
            "light": of([np.log(s.amplitude) for s in seen]),
            "time": of([s.seconds for s in seen]),
        }


def knee(rng: np.random.Generator, span: dict[str, tuple[float, float]]) -> Curve:
    """Amplitude: nothing until a knee, then in proportion to the darkness."""
    at = rng.uniform(0.3, 0.6)
    low, high = span["light"]
    return lambda s: np.maximum(low + at * (high - low) - np.log(s.amplitude), 0.0)


def walk_table(rng: np.random.Generator, span: dict[str, tuple[float, float]]) -> Curve:
    """Amplitude: a correction by a table of six points that was measured on another unit."""
    curve = points(rng, *span["light"], 6)
    return lambda s: curve(np.log(s.amplitude))


def steep(rng: np.random.Generator, span: dict[str, tuple[float, float]]) -> Curve:
    """Amplitude: a power of the light."""
    power = rng.uniform(0.4, 1.6)
    low, _ = span["light"]
    return lambda s: np.minimum(np.exp(-power * (np.log(s.amplitude) - low)), 3.0)


def by_range_and_light(rng: np.random.Generator, span: dict[str, tuple[float, float]]) -> Curve:
    """Amplitude: a walk error whose slope grows with range."""
    middle, share = sum(span["light"]) / 2, rng.uniform(0.3, 1.0)
    return lambda s: (np.log(s.amplitude) - middle) * (1 - share + share * s.radial)


def fan(rng: np.random.Generator, span: dict[str, tuple[float, float]]) -> Curve:
    """Time: it warms up evenly until a fan starts, and cools from then on."""
    low, high = span["time"]
    start, tau = low + rng.uniform(0.3, 0.6) * (high - low), rng.uniform(0.1, 0.3) * (high - low)
    return lambda s: np.full(s.radial.shape, s.seconds - low if s.seconds < start else (start - low) * np.exp(-(s.seconds - start) / tau))


def steps(rng: np.random.Generator, span: dict[str, tuple[float, float]]) -> Curve:
    """Time: a compensation that its firmware renews twice in the session."""
    low, high = span["time"]
    at, size = low + rng.uniform((0.2, 0.55), (0.45, 0.8)) * (high - low), rng.uniform(0.5, 1.0, 2) * rng.choice([-1, 1], 2)
    return lambda s: np.full(s.radial.shape, float(size @ (s.seconds > at)))


def time_table(rng: np.random.Generator, span: dict[str, tuple[float, float]]) -> Curve:
    """Time: a course through five random points."""
    curve = points(rng, *span["time"], 5)
    return lambda s: np.broadcast_to(curve(np.array(s.seconds)), s.radial.shape)


def clock(rng: np.random.Generator, span: dict[str, tuple[float, float]]) -> Curve:
    """Time: a clock that drifts, so that the error grows with range."""
    tau = rng.uniform(0.2, 2.0) * (span["time"][1] - span["time"][0])
    return lambda s: s.radial * np.exp(-s.seconds / tau)


def range_table(rng: np.random.Generator, span: dict[str, tuple[float, float]]) -> Curve:
    """Range: a linearisation by eight points that was measured on another unit."""
    curve = points(rng, *span["range"], 8)
    return lambda s: curve(s.radial)


def published(rng: np.random.Generator, span: dict[str, tuple[float, float]]) -> Curve:
    """Range: the look-up table of an evaluation kit, at a frequency between 36 and 110 MHz."""
    del span
    turn_m = TURN_M * 36.0 / rng.uniform(36.0, 110.0)
    at = np.linspace(0, TABLE_COUNTS / TURN_COUNTS, len(WIGGLE_COUNTS))
    return lambda s: np.interp(np.mod(s.radial / turn_m, at[-1]), at, WIGGLE_COUNTS)


def saw(rng: np.random.Generator, span: dict[str, tuple[float, float]]) -> Curve:
    """Range: a delay line whose steps are uneven."""
    del span
    period = rng.uniform(0.12, 0.45)
    return lambda s: np.mod(s.radial, period) / period


KINDS: dict[str, tuple[Callable[[np.random.Generator, dict[str, tuple[float, float]]], Curve], str]] = {
    "knee": (knee, "amplitude_bias"),
    "walk table": (walk_table, "amplitude_bias"),
    "power of light": (steep, "amplitude_bias"),
    "light times range": (by_range_and_light, "amplitude_bias"),
    "fan": (fan, "temperature_drift"),
    "renewed compensation": (steps, "temperature_drift"),
    "course of time": (time_table, "temperature_drift"),
    "drifting clock": (clock, "temperature_drift"),
    "range table": (range_table, "wiggling"),
    "published table": (published, "wiggling"),
    "delay line": (saw, "wiggling"),
}


def grafted(views: Sequence[View], caster: Raycaster, kind: str, rng: np.random.Generator) -> tuple[list[View], float]:
    """The views with an error of this kind, and its spread in metres over the pixels that see the CAD where the robot says the camera is."""
    start = min(v.stamp_ns for v in views)
    length = views[0].camera.ray_length()
    seen, on_cad = [], []
    for v in views:
        assert v.robot is not None
        assert v.amplitude is not None
        seen.append(Seen(v.depth * length, np.asarray(v.amplitude, float), (v.stamp_ns - start) * 1e-9))
        on_cad.append(np.isfinite(render(caster, v.camera, v.robot.T_cell_camera).depth) & np.isfinite(v.depth))
    curve = KINDS[kind][0](
        rng, spans([replace(s, radial=s.radial[at], amplitude=s.amplitude[at]) for s, at in zip(seen, on_cad, strict=True)])
    )
    size = float(np.exp(rng.uniform(np.log(LEAST_M), np.log(MOST_M)))) * rng.choice([-1, 1])
    with np.errstate(divide="ignore", invalid="ignore"):
        shapes = [np.where(np.isfinite(s.radial), curve(s), np.nan) for s in seen]
    spread = float(np.nanstd(np.concatenate([s[at] for s, at in zip(shapes, on_cad, strict=True)])))
    wrong = [(v.depth + size / spread * np.nan_to_num(s) / length).astype(np.float32) for v, s in zip(views, shapes, strict=True)]
    return [replace(v, depth=depth) for v, depth in zip(views, wrong, strict=True)], abs(size)


def verdict_of(bag: Path, changed: Callable[[Sequence[View], Raycaster], Sequence[View]]) -> list[str]:
    """Verdict on a recorded session whose views are changed before the diagnosis."""
    from tof_gap.session import diagnose_session
    from tof_scene.raycast import Raycaster
    from tof_sensor.model import load_model
    from toftwin.diagnosis import GapPipelineConfig
    from toftwin.inputs import opened
    from toftwin.pipeline import raw_views

    config = GapPipelineConfig()
    with opened(bag / "bag", bag / "scene" / "scene.yaml", config) as (reader, scene):
        assert scene is not None
        caster = Raycaster(scene)
        views = changed(raw_views(reader, config, config.moving_views), caster)
        found = diagnose_session(views, caster, config.gap, config.align, known=load_model(bag / "scene" / DATA_SHEET))
    return list(found.verdict)


def answer(bag: Path, kind: str, seed: int) -> tuple[list[str], float]:
    """Verdict on a healthy session with a grafted error, and the error's spread in metres."""
    sizes_m: list[float] = []

    def with_error(views: Sequence[View], caster: Raycaster) -> Sequence[View]:
        wrong, size_m = grafted(views, caster, kind, np.random.default_rng(seed))
        sizes_m.append(size_m)
        return wrong

    return verdict_of(bag, with_error), sizes_m[0]


def main() -> int:
    """Graft, diagnose, and print a line for each session; then how many are right."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.curved", description=__doc__)
    parser.add_argument("folder", type=Path, help="recorded sessions of the emerging camera")
    parser.add_argument("--count", type=int, default=len(KINDS), help="how many grafts; the kinds take turns")
    parser.add_argument("--seed", type=int, default=1, help="seed of the draw")
    parser.add_argument("--kinds", default="", help="kinds of curve, joined by commas; all if empty")
    args = parser.parse_args()
    one_thread()
    healthy = [p.parent for p in sorted((args.folder / SEALED).glob("*/case.json")) if json.loads(p.read_text())["kind"] == "null"]
    kinds = [k.strip() for k in args.kinds.split(",") if k.strip()] or list(KINDS)
    right = 0
    for number in range(args.count):
        kind, bag = kinds[number % len(kinds)], args.folder / BAGS / healthy[number % len(healthy)].name
        verdict, size_m = answer(bag, kind, args.seed * 1000 + number)
        good = verdict == [KINDS[kind][1]]
        right += good
        print(f"{'right' if good else 'WRONG'}  {bag.name}  {kind:22s} {1e3 * size_m:4.1f} mm  {', '.join(verdict)}", flush=True)
    print(f"named by what it depends on, and nothing else: {right} of {args.count}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
