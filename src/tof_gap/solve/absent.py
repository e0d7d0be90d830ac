# SPDX-License-Identifier: Apache-2.0
"""How large an effect may be that a session tests and does not show."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_gap.solve.choose.judge import Selector
from tof_gap.solve.choose.worth import rms_m
from tof_gap.solved import ANY_PART, Bound

if TYPE_CHECKING:
    from tof_gap.config import GapConfig
    from tof_gap.solve.choose.judge import Hypothesis
    from tof_gap.solve.solution import Joint

SURE = 1.645
"""Standard deviations of a one-sided bound with 95 % confidence."""


def bounds(joint: Joint, config: GapConfig) -> dict[str, Bound]:
    """For each effect that was tried and not chosen, what it stays below with 95 % confidence, by the form that could be largest.

    Each form is fitted beside the chosen effects, with all poses free: what poses or the chosen effects can make is not bounded. Hand-eye
    and a lens within a stated calibration have no bound here, since the solution states them.
    """
    judge, chosen = Selector(joint.design, config.select), joint.selection.chosen
    named = {joint.design.candidates[m].name for m in chosen.members}
    out: dict[str, Bound] = {}
    for member, candidate in enumerate(joint.design.candidates):
        own = candidate.effect is not None and len(judge.design.groups[member]) > 0
        bounded = own and candidate.name not in named and not judge.against_priors(member)
        if bounded and not judge.repeats(member, chosen.members):
            part = int(getattr(candidate.effect, "part", ANY_PART))
            one = Bound(_largest_m(judge, chosen, member) / float(np.sqrt(_share(joint, part))), part)
            out[candidate.name] = max(out.get(candidate.name, one), one, key=lambda b: b.below_m)
    return out


def _largest_m(judge: Selector, chosen: Hypothesis, member: int) -> float:
    """Metres RMS over all drawn pixels that a candidate beside the chosen ones stays below: its estimate and `SURE` deviations of it."""
    members, group, system = (*chosen.members, member), judge.design.groups[member], judge.design.system
    solution = system.fit(judge.columns(members), inflate=chosen.inflate, free_hand=judge.frees_hand(members))
    own = slice(len(solution.theta) - len(group), None)
    theta, products = solution.theta[own], system.products(group)
    energies, directions = np.linalg.eigh(products)
    root = directions * np.sqrt(np.maximum(energies, 0.0))
    widest = np.linalg.eigvalsh(root.T @ solution.theta_cov[own, own] @ root)[-1]
    estimate, deviation = rms_m(system, [theta @ products @ theta, widest])
    return float(estimate + SURE * deviation)


def _share(joint: Joint, part: int) -> float:
    """Share of the drawn pixels that lie on a part, at least one pixel; 1 for `ANY_PART`."""
    if part == ANY_PART:
        return 1.0
    on_it = sum(int((v.rendering.part.ravel()[v.pixels] == part).sum()) for v in joint.views)
    return max(on_it, 1) / max(sum(len(v.pixels) for v in joint.views), 1)
