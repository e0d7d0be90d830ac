# SPDX-License-Identifier: Apache-2.0
"""The last step of a joint solution: chosen effects and poses, fitted to more pixels than the selection used."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tof_gap.seen.evidence.residual import drawn
from tof_gap.solve.choose.judge import Selector
from tof_gap.solve.choose.select import Selection
from tof_gap.solve.choose.worth import rescored
from tof_gap.solve.hypotheses.columns import build, stored

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_align.chain import Chain
    from tof_gap.config import GapConfig
    from tof_gap.seen.evidence.view import ViewEvidence
    from tof_gap.solve.hypotheses.candidate import Candidate
    from tof_gap.solve.solution import Joint


def judge_of(candidates: Sequence[Candidate], views: Sequence[ViewEvidence], chain: Chain, config: GapConfig) -> Selector:
    """The judge of a few hypotheses, linearised at `chain` and `views`."""
    store = stored(views, chain, config.select.folds)
    return Selector(build(store, candidates, chain, config.hand_sd, config.lens_sd), config.select)


def followed(members: Sequence[Candidate], views: Sequence[ViewEvidence], chain: Chain, config: GapConfig) -> Chain:
    """The chain after one more step of the same hypothesis, linearised at `chain` and `views`: a selection of all hypotheses takes ten times as long."""
    judge = judge_of(members, views, chain, config)
    return judge.fit(rescored(judge, range(len(members)))).moved(chain)


def settled(joint: Joint, config: GapConfig) -> Joint:
    """The same effects, fitted to `solve.joint.settle_pixels` pixels of each view, too many for a selection among hundreds of forms.

    White noise limits the poses of a good camera: four times the pixels halve the error of its labels.
    """
    rng = np.random.default_rng(config.evidence.seed)
    views = tuple(replace(v, pixels=drawn(v.smooth, config.solve.joint.settle_pixels, rng)) for v in joint.views)
    denser = sum(len(v.pixels) for v in views) / max(sum(len(v.pixels) for v in joint.views), 1)
    chosen, ties = joint.selection.chosen, joint.selection.ties
    kept = list(dict.fromkeys([*chosen.members, *joint.selection.fullest, *(other for of_one in ties for other in of_one)]))
    # An error that neighbours share covers more of the drawn pixels, by the ratio of their density.
    dense = replace(config, select=replace(config.select, neighbours=config.select.neighbours * denser))
    judge = judge_of([joint.design.candidates[m] for m in kept], views, joint.chain, dense)
    members = [kept.index(m) for m in chosen.members]
    final = rescored(judge, members)
    selection = Selection(
        final,
        judge.fit(final),
        tuple(tuple(kept.index(other) for other in of_one) for of_one in ties),
        joint.selection.unknown,
        joint.selection.small_together,
        tuple(kept.index(m) for m in joint.selection.suspected),
        tuple(kept.index(m) for m in joint.selection.fullest),
    )
    return replace(joint, views=views, design=judge.design, selection=selection)
