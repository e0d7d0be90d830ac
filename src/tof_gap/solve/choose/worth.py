# SPDX-License-Identifier: Apache-2.0
"""Chi-square that each member of a hypothesis explains."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike

    from tof_align.columns import ColumnFit, ColumnSystem
    from tof_core.arrays import Float
    from tof_gap.solve.choose.judge import Hypothesis, Selector


def rescored(judge: Selector, members: Sequence[int]) -> Hypothesis:
    """The hypothesis of these members, with the inflation of the noise by the residual that they leave."""
    return judge.score(members, judge.inflation(members))


def worth(judge: Selector, current: Hypothesis) -> tuple[Float, Float]:
    """For each member: held-out chi-square that is lost without it, and the same as metres RMS over all pixels."""
    lost = np.array(
        [
            judge.score([m for i, m in enumerate(current.members) if i != place], current.inflate).score - current.score
            for place in range(len(current.members))
        ]
    )
    return lost, visible_m(judge, current, lost)


def visible_m(judge: Selector, current: Hypothesis, chi2: ArrayLike) -> Float:
    """Held-out chi-square as metres RMS over all pixels."""
    return rms_m(judge.design.system, np.asarray(chi2) * current.inflate)


def rms_m(system: ColumnSystem, chi2: ArrayLike) -> Float:
    """Chi-square of a map over the drawn pixels as metres RMS over all pixels; 0 where it is negative."""
    return np.asarray(np.sqrt(np.maximum(chi2, 0.0) / system.pixels.sum()) * system.sigma)


def coefficients(judge: Selector, hypothesis: Hypothesis, solution: ColumnFit, place: int) -> Float:
    """(k,) coefficients of the member at `place` in a solution of the hypothesis."""
    at = [columns for _, _, columns in judge.design.placed(hypothesis.members)]
    return solution.theta[at[place]]
