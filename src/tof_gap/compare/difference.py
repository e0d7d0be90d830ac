# SPDX-License-Identifier: Apache-2.0
"""An effect in which simulator and camera differ: what the simulator does with it, its size in both, and from which size it is stated."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from tof_core.config import param
from tof_core.shares import in_percent
from tof_sensor.effects.noise import Noise

LACKS, SUPERFLUOUS, WEAK, STRONG, OTHER = "lacks", "reality has not", "understates", "exaggerates", "has it in another form"
"""What a simulator does with an effect."""
SENTENCES = {
    LACKS: "the simulator lacks {}",
    SUPERFLUOUS: "the simulator has {}, and the camera has not",
    WEAK: "the simulator understates {}",
    STRONG: "the simulator exaggerates {}",
    OTHER: "the simulator has {} in another form",
}
MOST_PARTS = 3
"""Parts of a difference that are listed: those with most of it."""


@dataclass(frozen=True, slots=True)
class AgainstLimits:
    """From which size a difference of simulator and camera is stated."""

    shrink: float = param(
        0.05,
        "share of the squared distance, or of the chi-square of all differing coefficients, that a corrected effect must remove",
        low=0.0,
        high=1.0,
        why="two fits of one camera differ by less",
    )
    apart: float = param(
        0.3,
        "difference of an effect in two sessions (RMS of maps, or root of the chi-square of coefficients), over the effect itself in that with more, from which they differ",
        low=0.0,
        high=1.0,
        why="the middle between one size and twice the size; two fits of one camera differ by a tenth to a fifth",
    )
    shown: float = param(
        0.5,
        "share of a difference that the views of both sessions must show, whatever their poses are",
        low=0.0,
        high=1.0,
        why="1 if it is there, 0 if one diagnosis missed the effect and its poses took it up",
    )
    absent: float = param(
        0.1,
        "size of an effect in one session, over its size in the other, below which the first has not got it",
        low=0.0,
        high=1.0,
        why="what is left of a known effect that is removed from a session without it: poses are known to a few per cent of it",
    )
    of_lines: float = param(
        0.5,
        "share of a difference in noise variance that whole lines must make to be stated as what differs",
        low=0.0,
        why="noise of lines is in every pixel; less leaves most of the difference to another cause",
    )
    pattern: float = param(
        2.0,
        "squared difference of two fixed patterns, over the variance of both fits",
        low=1.0,
        why="two fits of one camera differ by just that variance",
    )
    unit: float = param(
        1.67,
        "ratio of the amplitudes of one albedo in both sessions up to which both have one unit",
        low=1.0,
        why="albedos of a scene are stated to 40 %, so that all of them may be 1 / 0.6 of the true ones; units differ by a power of two or ten",
    )
    noise: float = param(1.25, "ratio of the two noises from which they differ", low=1.0, why="noise is known to 10 % in each session")
    light: float = param(
        1.15,
        "the same from which noise of foreign light beyond a stated photon law is compared by itself",
        low=1.0,
        why="noise is known to 10 % in each session, the ratio of both to 14 %",
    )
    loss: float = param(
        0.01,
        "difference of the two shares of lost pixels from which they differ",
        low=0.0,
        high=1.0,
        why="edges lose some tenths of a per cent",
    )
    wraps: float = param(
        0.001,
        "difference of the two shares of pixels off by whole periods from which they differ",
        low=0.0,
        high=1.0,
        why="half of the share from which a diagnosis names them",
    )
    shares: float = param(
        1.4,
        "ratio of lost, wrapped or mixed pixels of both from which they differ",
        low=1.0,
        why="the middle between one size and twice the size",
    )


class Apart(NamedTuple):
    """How an effect differs in the two sessions, as chi-squares by one weight: the inverse covariance of the difference.

    difference: of the difference of the coefficients; real, simulated: of the effect in either session; both: their product;
    share: of the chi-square of all differences that this one explains; differs: whether the sessions contradict its equality; of_maps:
    that errors of the other effects' maps may make (`Effect.rough`): of one such effect, each session's views show other errors.
    """

    difference: float
    real: float
    simulated: float
    both: float
    share: float
    differs: bool
    of_maps: float = 0.0

    @property
    def within_maps(self) -> bool:
        """Whether errors of another effect's map may make the difference that the sessions show."""
        return self.differs and self.difference < self.of_maps

    @property
    def ratio(self) -> float:
        """Size of the difference over that of the effect in the session that has more of it."""
        return float(np.sqrt(self.difference / max(self.real, self.simulated, 1e-12)))


@dataclass(frozen=True, slots=True)
class Difference:
    """One effect in which simulator and camera differ.

    real_mm, simulated_mm: RMS of the effect over the real session's pixels (noise: median of one capture; loss: NaN); parts: RMS in mm of their
    difference by part; shrink: share of the squared distance that disappears once this effect is corrected, None where it changes no mean depth;
    note: the size in words, where it is no bias; ties: effects that the sessions cannot distinguish from it.
    """

    effect: str
    simulator: str
    real_mm: float
    simulated_mm: float
    parts: dict[str, float]
    shrink: float | None
    ci95: tuple[float, float] | None
    note: str = ""
    ties: tuple[str, ...] = ()

    @property
    def verdict(self) -> str:
        """`a`, or `a|b` for effects that the sessions cannot distinguish."""
        return "|".join(sorted({self.effect, *self.ties}))

    @property
    def sentence(self) -> str:
        """What the simulator does with the effect."""
        return SENTENCES[self.simulator].format(self.verdict.replace("_", " ").replace("|", " or "))

    @property
    def todo(self) -> str:
        """How the simulator is put right; tied effects are alike on these views, so the one that was fitted is stated."""
        if self.simulator == SUPERFLUOUS:
            return f"take {self.effect} out of the simulator"
        if self.simulator in (WEAK, STRONG) and self.ratio is not None:
            return f"give {self.effect} {self.ratio:.2g} times its size in the simulator"
        return f"give the simulator the {'photon_law and noise' if self.effect == Noise.NAME else self.effect} of sensor.yaml"

    @property
    def ratio(self) -> float | None:
        """Size in the real session over the size in the simulator's; None where either is not in millimetres."""
        known = np.isfinite([self.real_mm, self.simulated_mm]).all() and self.simulated_mm > 0
        return self.real_mm / self.simulated_mm if known else None

    @property
    def where(self) -> str:
        """The parts with most of the difference, with RMS in mm."""
        most = sorted(self.parts, key=self.parts.__getitem__, reverse=True)[:MOST_PARTS]
        return ", ".join(f"{part} {self.parts[part]:.1f} mm" for part in most)

    def line(self) -> str:
        """The difference in words."""
        if self.note:
            return f"{self.sentence} ({self.note})"
        gone = "" if self.shrink is None else f"; once corrected, {in_percent(self.shrink)} of the squared distance disappears"
        return f"{self.sentence} ({self.real_mm:.2f} mm real, {self.simulated_mm:.2f} mm simulated; {self.where}){gone}"

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON; NaN becomes null."""
        return {
            "effect": self.effect,
            "tied_with": list(self.ties),
            "simulator": self.simulator,
            "real_mm": _number(self.real_mm),
            "simulated_mm": _number(self.simulated_mm),
            "parts_mm": self.parts,
            "shrink": self.shrink,
            "shrink_ci95": None if self.ci95 is None else list(self.ci95),
            "note": self.note,
            "sentence": self.sentence,
            "where": self.where,
            "todo": self.todo,
        }


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
