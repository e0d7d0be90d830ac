# SPDX-License-Identifier: Apache-2.0
"""The hypotheses of a session: every effect at every shape worth trying, as columns."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tof_gap.seen.stereo import like_stereo
from tof_sensor.effects.amplitude_bias import AmplitudeBias
from tof_sensor.effects.cad_deviation import CadDeviation
from tof_sensor.effects.depth_scale import DepthScale
from tof_sensor.effects.fixed_pattern import FixedPattern
from tof_sensor.effects.intrinsics import Intrinsics
from tof_sensor.effects.lens_scatter import LensScatter
from tof_sensor.effects.motion import Motion
from tof_sensor.effects.multipath import Multipath
from tof_sensor.effects.radial_depth import RadialDepth
from tof_sensor.effects.range_offset import RangeOffset
from tof_sensor.effects.specular import Specular
from tof_sensor.effects.subsurface import Subsurface
from tof_sensor.effects.temperature_drift import TemperatureDrift
from tof_sensor.effects.time_sync import TimeSync
from tof_sensor.effects.wiggling import Wiggling
from tof_sensor.frame import LIGHT_M_PER_S

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from collections.abc import Set as AbstractSet

    from tof_core.arrays import Float
    from tof_gap.limits.seen import NoiseLimits
    from tof_gap.seen.residual import ViewEvidence
    from tof_scene.scene import Scene
    from tof_sensor.effect import Effect

HAND_EYE = "hand_eye"
"""X of the chain; it has no columns of its own: the system frees X instead."""

MIN_PART_PIXELS = 150
"""Sampled pixels over the session below which a part gets no hypothesis of its own."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """One hypothesis: an effect at one shape. `effect` is None for hand-eye."""

    name: str
    effect: Effect | None
    note: str = ""


def candidates(
    views: Sequence[ViewEvidence], scene: Scene, noise: NoiseLimits, left_out: AbstractSet[str] = frozenset(), *, quick: bool = False
) -> list[Candidate]:
    """All hypotheses that this session can test.

    `left_out` names effects not to be considered; `quick` takes only those that look at each pixel by itself.
    """
    untestable = not_testable(views, noise).keys()
    made = [Candidate(HAND_EYE, None)]
    made += [Candidate(e.NAME, e, note) for e, note in _global_effects(views, untestable)]
    made += [Candidate(e.NAME, e, note) for e, note in _part_effects(views, scene)]
    return [c for c in made if c.name not in left_out | untestable and not (quick and c.effect is not None and not c.effect.LOCAL)]


def not_testable(views: Sequence[ViewEvidence], noise: NoiseLimits) -> dict[str, str]:
    """Effects for which the session lacks what a test needs, with the reason."""
    out: dict[str, str] = {}
    if all(v.view.amplitude is None for v in views):
        why = "no amplitude image"
        out |= {"amplitude_bias": why, "lens_scatter": why, "noise": f"{why}: rows and single pixels alone can show it"}
    if not moving(views):
        out |= {"motion": "no view was taken in motion", "time_sync": "no view was taken in motion"}
    if not warming(views):
        out["temperature_drift"] = "temperature steady or unknown, and under 60 s"
    if range_span(views) < 0.08:
        out["wiggling"] = "one range only"
    if like_stereo(views, noise):
        out |= dict.fromkeys(OF_MODULATED_LIGHT, "scatter goes with range squared and not with light: no time-of-flight camera")
    return out


OF_MODULATED_LIGHT = (
    "amplitude_bias",
    "interference",
    "lens_scatter",
    "motion",
    "multipath",
    "phase_wrap",
    "specular",
    "subsurface",
    "wiggling",
)
"""Effects that a camera has only if it times modulated light."""


def moving(views: Sequence[ViewEvidence]) -> bool:
    """Whether some views were taken at 5 mm/s or 0.5 degrees/s or more."""
    twists = np.array([v.frame.context.twist for v in views])
    return bool((np.linalg.norm(twists[:, :3], axis=1) > 5e-3).any() or (np.linalg.norm(twists[:, 3:], axis=1) > np.radians(0.5)).any())


def warming(views: Sequence[ViewEvidence]) -> bool:
    """Whether temperature changes by 0.5 K, or is unknown and 60 s pass."""
    temperature = np.array([v.view.temperature for v in views])
    if np.isfinite(temperature).all():
        return bool(np.ptp(temperature) >= 0.5)
    times = [v.frame.context.time_s for v in views]
    return max(times) - min(times) >= 60.0


def range_span(views: Sequence[ViewEvidence]) -> float:
    """Metres between the 2 % and 98 % quantiles of range over the session."""
    r = np.concatenate([v.frame.radial.ravel()[v.pixels] for v in views])
    low, high = np.quantile(r, [0.02, 0.98])
    return float(high - low)


def _global_effects(views: Sequence[ViewEvidence], out: AbstractSet[str]) -> Iterator[tuple[Effect, str]]:
    yield RangeOffset(), ""
    yield DepthScale(), ""
    yield RadialDepth(), ""
    yield Intrinsics(), ""
    yield FixedPattern(), "smooth field"
    for mhz in (30.0, 90.0):
        yield Multipath(modulation_mhz=mhz), f"{mhz:g} MHz"
    if "amplitude_bias" not in out:
        seen = np.concatenate([v.frame.amplitude.ravel()[v.pixels] for v in views])
        middle = float(np.median(seen[seen > 0]))
        yield AmplitudeBias(reference=middle), ""
        for mhz in (15.0, 30.0, 50.0, 65.0, 80.0, 90.0, 100.0, 110.0, 120.0):
            yield LensScatter(modulation_mhz=mhz), f"{mhz:g} MHz"
    if "temperature_drift" not in out:
        yield from _drifts(views)
    if "wiggling" not in out:
        for period in periods(range_span(views)):
            yield Wiggling(modulation_mhz=_mhz(period)), f"period {period * 1e3:.0f} mm"
    if "motion" not in out:
        for mhz, tap, opposite in itertools.product((60.0, 80.0, 100.0), (0.005, 0.01, 0.02, 0.035, 0.06), (False, True)):
            order = "opposite first" if opposite else "in turn"
            yield Motion(modulation_mhz=mhz, tap_s=tap, opposite_first=opposite), f"{mhz:g} MHz, {1e3 * tap:g} ms, {order}"
        yield TimeSync(), ""
    for lobe in (5.0, 10.0, 16.0, 24.0, 34.0):
        for gloss in (0.05, 0.3, 1.5):
            yield Specular(lobe_deg=lobe, gloss=gloss), f"lobe {lobe:g} deg, gloss {gloss:g}"


def _drifts(views: Sequence[ViewEvidence]) -> Iterator[tuple[Effect, str]]:
    temperature = np.array([v.view.temperature for v in views])
    if np.isfinite(temperature).all():
        yield TemperatureDrift(reference_c=float(temperature.mean())), ""
        return
    for tau in (60.0, 300.0, 1200.0):
        yield TemperatureDrift(tau_s=tau), f"tau {tau:g} s"


def periods(span: float) -> Float:
    """Wiggle periods to try, metres: from 60 mm to twice the span, neighbours 90 degrees apart over it."""
    out, period = [], 2.0 * max(span, 0.2)
    while period > 0.06:
        out.append(period)
        period = 1.0 / (1.0 / period + 0.25 / max(span, 0.2))
    return np.array(out[:40])


def _mhz(period: float) -> float:
    return LIGHT_M_PER_S / (8e6 * period)


def _part_effects(views: Sequence[ViewEvidence], scene: Scene) -> Iterator[tuple[Effect, str]]:
    counts = np.zeros(len(scene.parts), int)
    for v in views:
        seen = v.rendering.part.ravel()[v.pixels]
        counts += np.bincount(seen[seen >= 0], minlength=len(scene.parts))
    for i, part in enumerate(scene.parts):
        if counts[i] < MIN_PART_PIXELS:
            continue
        yield deviation(views, i), part.name
        yield Subsurface(part=i), part.name


def deviation(views: Sequence[ViewEvidence], part: int) -> CadDeviation:
    """The deviation hypothesis of a part, centred on what was seen of it, bowing along its mean normal."""
    points, normals = [], []
    for v in views:
        here = v.pixels[v.rendering.part.ravel()[v.pixels] == part]
        T = v.rendering.T_cell_camera
        points.append(v.frame.points.reshape(-1, 3)[here] @ T[:3, :3].T + T[:3, 3])
        normals.append(v.rendering.normal.reshape(-1, 3)[here].astype(np.float64) @ T[:3, :3].T)
    p, n = np.concatenate(points), np.concatenate(normals)
    low, high = np.quantile(p, [0.02, 0.98], axis=0)
    mean = n.mean(axis=0)
    normal = mean if np.linalg.norm(mean) > 0.1 else np.array([0.0, 0.0, 1.0])
    return CadDeviation(
        part=part,
        centre=_triple(0.5 * (low + high)),
        normal=_triple(normal / np.linalg.norm(normal)),
        half_size_m=float(max(0.5 * (high - low).max(), 1e-3)),
    )


def _triple(v: Float) -> tuple[float, float, float]:
    return float(v[0]), float(v[1]), float(v[2])
