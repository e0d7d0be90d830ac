# SPDX-License-Identifier: Apache-2.0
"""Effects whose form has a parameter: the best one beside the others, searched more finely than the candidates are spaced."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tof_gap.solve.candidates import Candidate
from tof_gap.solve.columns import build
from tof_gap.solve.judge import Selector
from tof_sensor.effects.lens_scatter import LensScatter
from tof_sensor.effects.motion import Motion
from tof_sensor.effects.multipath import Multipath
from tof_sensor.effects.specular import Specular
from tof_sensor.effects.wiggling import Wiggling

if TYPE_CHECKING:
    from typing import Any

    from tof_align.chain import Chain
    from tof_gap.config import GapConfig
    from tof_gap.solve.columns import ColumnStore, Design
    from tof_gap.solve.select import Selection
    from tof_sensor.effect import Effect

SHAPES: dict[type[Effect], tuple[tuple[str, float], ...]] = {
    Wiggling: (("modulation_mhz", 0.2), ("modulation_mhz", 0.05), ("modulation_mhz", 0.012)),
    LensScatter: (("modulation_mhz", 0.1),),
    Motion: (("tap_s", 0.5), ("modulation_mhz", 0.2), ("tap_s", 0.15)),
    Multipath: (("modulation_mhz", 0.3),),
    Specular: (("lobe_deg", 0.3), ("gloss", 0.7), ("lobe_deg", 0.15), ("gloss", 0.4)),
}
"""Which parameters of shape are searched for more finely, in turn, and how far (relative)."""


def refined(store: ColumnStore, design: Design, selection: Selection, chain: Chain, config: GapConfig) -> list[Candidate]:
    """Finer shapes around those of the chosen effects."""
    chosen = [design.candidates[m] for m in selection.chosen.members]
    out: list[Candidate] = []
    for place, candidate in enumerate(chosen):
        if candidate.effect is None or type(candidate.effect) not in SHAPES:
            continue
        others = [c for i, c in enumerate(chosen) if i != place]
        best = candidate.effect
        for name, width in SHAPES[type(best)]:
            best = _best_shape(best, name, width, others, store, chain, config, selection.chosen.inflate)
        out.append(Candidate(best.NAME, best, "refined"))
    return out


def _best_shape(
    effect: Any,
    name: str,
    width: float,
    others: list[Candidate],
    store: ColumnStore,
    chain: Chain,
    config: GapConfig,
    inflate: float,
) -> Any:
    """The effect whose parameter `name`, within a factor 1 +- `width`, does best on held-out views."""
    steps = np.linspace(-1, 1, 5 if isinstance(effect, Specular | LensScatter | Multipath | Motion) else 13)
    near_by = [replace(effect, **{name: float(getattr(effect, name) * (1 + width) ** s)}) for s in steps]
    trial = [Candidate(e.NAME, e) for e in near_by]
    judge = Selector(build(store, [*others, *trial], chain, config.hand_sd), config.select)
    base = list(range(len(others)))
    scores = [judge.score([*base, len(others) + i], inflate).score for i in range(len(trial))]
    return near_by[int(np.argmin(scores))]
