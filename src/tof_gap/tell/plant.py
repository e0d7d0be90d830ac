# SPDX-License-Identifier: Apache-2.0
"""The verdict in a plant's words: what it is, where, how large, what to do, and what it costs to leave it."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from tof_gap.tell.unexplained import by_part

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float
    from tof_gap.tell.diagnosis import Diagnosis
    from tof_scene.scene import Scene
    from tof_sensor.effect import Effect

MOST_PARTS = 3
"""Parts that are named one by one; an effect on more is on most of the scene."""
CARRIED = 0.8
"""Share of an effect's squared error that the named parts carry together."""
WORST = 0.95
"""Quantile of the pixels that the cost is stated at: one pixel in twenty is worse."""
MATTERS_M = 1e-3
"""Metres: what healthy cameras are off by; an effect of few pixels is stated by how many are off by more."""


@dataclass(frozen=True, slots=True)
class Words:
    """One effect: its name; what it is; where; how large; what to do; what it costs to leave it. Empty where nothing is known."""

    effect: str
    what: str
    where: str
    size: str
    remedy: str
    cost: str

    def sentence(self) -> str:
        """All of it in a few sentences."""
        head = f"{self.effect.replace('_', ' ').capitalize()}: {self.what}"
        details = "; ".join(x for x in (self.size, self.where) if x)
        todo = f" To do: {self.remedy}." if self.remedy else ""
        cost = f" Left as it is: {self.cost}." if self.cost else ""
        return f"{head}{f' ({details})' if details else ''}.{todo}{cost}"


def plant_words(d: Diagnosis, scene: Scene) -> list[Words]:
    """The effects of the verdict, causes first."""
    maps = dict(d.shares)
    causes = [(c.named.name, c.named.effects, f"{1e3 * c.size_m:.1f} mm RMS where it acts") for c in d.causes]
    found = [(f.name, (f.effect,), "") for f in d.findings]
    return [_words(name, effects, size, maps.get(name), d, scene) for name, effects, size in (*causes, *found)]


def to_dicts(words: Sequence[Words]) -> list[dict[str, Any]]:
    """Plain values for `gap.json`, each with its `sentence`."""
    return [asdict(w) | {"sentence": w.sentence()} for w in words]


def _words(name: str, effects: Sequence[Effect], size: str, maps: Sequence[Float] | None, d: Diagnosis, scene: Scene) -> Words:
    kind = effects[0]
    return Words(
        name,
        kind.MEANING,
        "" if maps is None else where(d, maps, scene),
        ", and ".join(dict.fromkeys(e.stated for e in effects[:MOST_PARTS] if e.stated)) or size,
        kind.REMEDY,
        "" if maps is None else cost(d, maps),
    )


def where(d: Diagnosis, maps: Sequence[Float], scene: Scene) -> str:
    """The parts that carry most of maps (H, W) of metres, one per view."""
    energy = by_part(d.evidence, [np.nan_to_num(m) ** 2 for m in maps], len(scene.parts))
    order = np.argsort(-energy)
    carried = np.cumsum(energy[order]) / max(float(energy.sum()), 1e-18)
    count = int(np.searchsorted(carried, CARRIED)) + 1
    if count > MOST_PARTS:
        return "on most of the scene"
    return f"on {' and '.join(scene.parts[i].name for i in order[:count])}"


def cost(d: Diagnosis, maps: Sequence[Float]) -> str:
    """By how much the worst pixels that count are measured wrongly by maps (H, W) of metres; how many, where they are fewer than that."""
    seen = [np.abs(m)[np.isfinite(r) & np.isfinite(m)] for m, r in zip(maps, d.residual, strict=True)]
    error = np.concatenate(seen) if seen else np.zeros(0)
    if not error.size:
        return ""
    worst = float(np.quantile(error, WORST))
    if worst >= MATTERS_M:
        return f"one pixel in twenty is measured {1e3 * worst:.1f} mm off or more"
    return f"{100 * float((error >= MATTERS_M).mean()):.1g} % of the pixels are measured {1e3 * MATTERS_M:.0f} mm off or more"
