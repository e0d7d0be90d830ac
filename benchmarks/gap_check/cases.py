# SPDX-License-Identifier: Apache-2.0
"""Which sessions are drawn: nulls, every effect at three strengths, pairs, and effects left out of the list."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

STRENGTHS = {"small": 1 / 3, "usual": 1.0, "large": 10 / 3}
"""Of effects measured in millimetres: 1, 3 and 10 mm RMS over the pixels they touch."""
MOVING = frozenset({"motion", "time_sync"})
PAIRABLE = (
    "multipath",
    "wiggling",
    "flying_pixels",
    "lens_scatter",
    "temperature_drift",
    "amplitude_bias",
    "fixed_pattern",
    "noise",
    "intrinsics",
    "hand_eye",
    "dropout",
    "cad_deviation",
    "depth_scale",
    "specular",
    "subsurface",
    "phase_wrap",
)
SMALL_NULL = {"plan.views": 8, "plan.pause_s": 45.0, "camera.width": 112, "camera.height": 86}
"""Of a null of the short form: the six minutes that twelve views with their pauses take."""
SINGLE = (*PAIRABLE, "radial_depth", "range_offset", "quantization", "interference", "motion", "time_sync")


@dataclass(frozen=True, slots=True)
class Case:
    """One session: what it is for, its scene, its effects by strength, the effect withheld from the list, its seed."""

    name: str
    kind: str
    scene: str
    effects: dict[str, float]
    left_out: str
    seed: int
    modulation_mhz: float
    settings: dict[str, Any] = field(default_factory=dict)
    """Of the virtual robot, besides what all sessions have."""

    def to_dict(self) -> dict[str, Any]:
        """Plain values for the sealed answer."""
        return asdict(self)


def draw(count: int, scenes: tuple[str, ...], seed: int) -> list[Case]:
    """`count` cases: two fifths nulls, then singles, pairs and left-out effects in turn; the seed fixes all."""
    rng = np.random.default_rng(seed)
    nulls = round(0.4 * count)
    others = [_other(i, rng) for i in range(count - nulls)]
    null: tuple[str, dict[str, float], str] = ("null", {}, "")
    plan = [null] * nulls + others
    order = rng.permutation(count)
    return [_case(int(number), plan[i], scenes, rng) for number, i in enumerate(order)]


def with_small_nulls(cases: Sequence[Case]) -> list[Case]:
    """The cases, nulls with eight views of fewer pixels: there is nothing to find in them, and false alarms are no rarer with fewer views."""
    return [case if case.effects else replace(case, settings=case.settings | SMALL_NULL) for case in cases]


def _other(i: int, rng: np.random.Generator) -> tuple[str, dict[str, float], str]:
    """Of six: four singles (usual twice, small, large), one pair, one left out."""
    turn, effect = i % 6, SINGLE[(i // 6 * 4 + i % 6) % len(SINGLE)]
    if turn < 4:
        kind = ("usual", "usual", "small", "large")[turn]
        return f"single-{kind}", {effect: STRENGTHS[kind]}, ""
    if turn == 4:
        one, two = rng.choice(len(PAIRABLE), 2, replace=False)
        return "pair", {PAIRABLE[one]: 1.0, PAIRABLE[two]: 1.0}, ""
    withheld = PAIRABLE[int(rng.integers(len(PAIRABLE)))]
    return "left-out", {withheld: 1.0}, withheld


def _case(number: int, plan: tuple[str, dict[str, float], str], scenes: tuple[str, ...], rng: np.random.Generator) -> Case:
    kind, effects, left_out = plan
    return Case(
        f"case{number:04d}",
        kind,
        scenes[number % len(scenes)],
        dict(effects),
        left_out,
        int(rng.integers(1, 2**31)),
        float(rng.choice([60.0, 80.0, 100.0])),
    )
