# SPDX-License-Identifier: Apache-2.0
"""A finer search around an effect's best form, in the passes that the effect states; the candidates' forms are spaced wider."""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from tof_core.config import bounds_of
from tof_gap.solve.choose.judge import Selector
from tof_gap.solve.hypotheses.candidate import Candidate
from tof_gap.solve.hypotheses.columns import build

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from typing import Any

    from tof_align.chain import Chain
    from tof_gap.config import GapConfig
    from tof_gap.solve.choose.select import Selection
    from tof_gap.solve.hypotheses.columns import ColumnStore, Design
    from tof_sensor.effect import Finer


FREQUENCY = "modulation_mhz"
"""Parameter of a form that a data sheet may state."""
ROUNDED = 0.02
"""Relative error of a stated frequency: 60 MHz are stated for 60.24 or 61."""
FARTHER = 3
"""Times that a search goes on from the end of its width: from a form at 90 MHz to 257 MHz, beyond the 200 MHz of today's fastest cameras."""


def refined(store: ColumnStore, design: Design, selection: Selection, chain: Chain, config: GapConfig) -> list[Candidate]:
    """Finer shapes around those of the chosen effects; none of a suspected one, whose shape the views do not determine."""
    chosen = [design.candidates[m] for m in selection.chosen.members]
    out: list[Candidate] = []
    for place, candidate in enumerate(chosen):
        if candidate.effect is None or not candidate.effect.FINER or selection.chosen.members[place] in selection.suspected:
            continue
        others = [c for i, c in enumerate(chosen) if i != place]
        shaped = partial(_best_shape, others=others, store=store, chain=chain, config=config, inflate=selection.chosen.inflate)
        best = candidate.effect
        for finer in _undecided(candidate.effect.FINER, config.stated_mhz):
            best = _farther(best, finer, shaped)
        out.append(Candidate(best.NAME, best, "refined", further=candidate.further))
    return out


def _undecided(passes: Sequence[Finer], stated_mhz: tuple[float, ...]) -> list[Finer]:
    """The passes whose parameter is not known: a frequency that a data sheet states is at most rounded."""
    return [f for f in passes if not stated_mhz or f.parameter != FREQUENCY or f.width < ROUNDED]


def _farther(effect: Any, finer: Finer, shaped: Callable[[Any, Finer], Any]) -> Any:
    """The best effect of a pass; one at the end of the pass's width is the middle of the next, since candidates do not reach every camera."""
    for _ in range(1 + FARTHER):
        tried = finer.near(getattr(effect, finer.parameter))
        effect = shaped(effect, finer)
        if not finer.relative or getattr(effect, finer.parameter) not in (float(tried[0]), float(tried[-1])):
            break
    return effect


def _best_shape(
    effect: Any,
    finer: Finer,
    others: list[Candidate],
    store: ColumnStore,
    chain: Chain,
    config: GapConfig,
    inflate: float,
) -> Any:
    """The effect with the value of its parameter, within the pass's width of the present one, that is best on held-out views.

    A parameter of 0 stays 0 unless another value wins as much as an effect must win: it would add a term to the effect.
    """
    value = getattr(effect, finer.parameter)
    if finer.relative and value == 0.0:
        return effect
    tried = np.clip(finer.near(value), *bounds_of(type(effect), finer.parameter))
    near_by = [replace(effect, **{finer.parameter: float(x)}) for x in tried]
    trial = [Candidate(e.NAME, e) for e in near_by]
    # A hundred shapes are tried and one is used: those of a long session would take half a gigabyte beside the store's own.
    judge = Selector(build(copy(store), [*others, *trial], chain, config.hand_sd, config.lens_sd), config.select)
    base = list(range(len(others)))
    shaped = judge.beside(base, len(base), inflate)
    scores = [shaped(len(others) + i).score for i in range(len(trial))]
    best = int(np.argmin(scores))
    wins = scores[len(scores) // 2] - scores[best]
    return effect if value == 0.0 and wins < config.select.gain else near_by[best]
