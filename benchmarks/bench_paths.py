# SPDX-License-Identifier: Apache-2.0
"""Multipath against a path tracer (mitransient): energy of the traced range error that the effect leaves at its best strength.

Needs `pip install toftwin[rivals]` and an LLVM library of version 16 or later (`DRJIT_LIBLLVM_PATH`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.figure import Figure, at_most
from benchmarks.path_traced.tracer import Traced, runs, traced
from tof_core.camera import Camera
from tof_scene.builtin import NAMES, make_builtin
from tof_scene.raycast import Raycaster
from tof_scene.render import render
from tof_sensor.effects.multipath import Multipath
from tof_sensor.frame import Context, ideal_frame
from tof_sensor.known import seen_albedo
from tof_virtual.plan import look_at

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float
    from tof_scene.rendering import Rendering

LONG = True
CAMERA = Camera(64, 48, 60.0, 60.0, 31.5, 23.5)
MHZ = 80.0
ALBEDO_OFF = 0.4
"""Deviation of ln albedo of the traced parts from what their scene states."""
AZIMUTHS = (-0.6, 0.0, 0.6)
"""Directions in radians from which each scene is seen, from 1 m."""
SEED = 0
MIXED, GRAZING_DEG = 0.02, 75.0
"""Pixels count that see one surface, to this share, no more grazing than this: others are mixed pixels, another effect."""
BAR = 0.04


def run() -> list[Figure]:
    """Energy left in the mean of the scenes, with albedo from amplitude, as a diagnosis takes it, and with the stated one."""
    what = "energy of path traced multipath that the effect leaves at its best strength"
    if why := runs():
        remark = f"Mitsuba does not run here (toftwin[rivals], LLVM 16 or later): {why}"
        return [Figure(what, float("nan"), "", f"at most {BAR:g}", remark=remark)]
    rng = np.random.default_rng(SEED)
    left = [scene_left(name, rng) for name in NAMES]
    remark = "; ".join(f"{name} {a:.3f} at strength {s:.2f}" for name, (a, s, _) in zip(NAMES, left, strict=True))
    means = np.mean([(a, stated) for a, _, stated in left], axis=0)
    return [
        at_most(f"{what}, albedo from amplitude", float(means[0]), BAR, "", remark=remark),
        Figure(f"{what}, albedo of the scene file", float(means[1]), "", remark=f"traced albedos deviate by {ALBEDO_OFF:g} in ln"),
    ]


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """A view: its rendering, and two independent traces of it."""

    rendering: Rendering
    traces: tuple[Traced, Traced]


def scene_left(name: str, rng: np.random.Generator) -> tuple[float, float, float]:
    """Energy left with albedo from amplitude, its strength, and energy left with the stated albedo."""
    scene = make_builtin(name)
    caster = Raycaster(scene)
    true = {p.name: float(np.clip(p.material.albedo * np.exp(rng.normal(0.0, ALBEDO_OFF)), 0.05, 0.9)) for p in scene.parts}
    sights = []
    for k, azimuth in enumerate(AZIMUTHS):
        T = look_at(np.array([np.cos(azimuth), np.sin(azimuth), 0.95 + 0.15 * k]), np.array([0.0, 0.0, 0.8]))
        one, other = (traced(scene, true, CAMERA, T, MHZ, seed) for seed in (0, 1))
        sights.append(Sight(render(caster, CAMERA, T), (one, other)))
    albedo = seen_albedo([np.abs(s.traces[0].everything) for s in sights], [s.rendering for s in sights], caster.albedo.astype(float))
    found, strength = energy_left(sights, caster, albedo)
    return found, strength, energy_left(sights, caster, None)[0]


def energy_left(sights: Sequence[Sight], caster: Raycaster, albedo: Float | None) -> tuple[float, float]:
    """Share of the traced energy that the best strength leaves, and that strength; noise of the paths is in neither: two traces are multiplied."""
    rows = []
    for sight in sights:
        r = sight.rendering
        bias = Multipath(strength=1.0, modulation_mhz=MHZ).bias(ideal_frame(r, Context(caster=caster, albedo=albedo))) * CAMERA.ray_length()
        one, other = (t.range_error for t in sight.traces)
        counts = (np.nan_to_num(r.mixed) < MIXED) & (r.incidence < np.radians(GRAZING_DEG)) & np.isfinite(one) & np.isfinite(other)
        rows.append(np.stack([bias, one, other])[:, counts])
    bias, one, other = np.concatenate(rows, axis=1)
    strength = float(bias @ (one + other) / 2.0 / (bias @ bias))
    return float((one - strength * bias) @ (other - strength * bias) / (one @ other)), strength
