# SPDX-License-Identifier: Apache-2.0
"""What one joint solution says of a session: its causes, what else shows beside them, and how far the gap shrinks."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from tof_gap.seen import missing, noise
from tof_gap.solve.joint import at_solution
from tof_gap.solve.judge import Selector
from tof_gap.tell.causes import Named, named, nameless_share, shares, without_pixels
from tof_gap.tell.figures import figures
from tof_sensor.effects.motion import Motion

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from collections.abc import Set as AbstractSet

    from tof_align.chain import Chain
    from tof_core.arrays import Float
    from tof_core.capture import View
    from tof_gap.config import GapConfig
    from tof_gap.seen.finding import Finding
    from tof_gap.seen.residual import ViewEvidence
    from tof_gap.solve.joint import Joint
    from tof_gap.tell.figures import Figures
    from tof_gap.tell.shrink import Shrink
    from tof_scene.raycast import Raycaster

WORSENS = 0.05
"""Share of the gap by which held-out views come out better without an effect that is not there."""


@dataclass(frozen=True, slots=True, eq=False)
class Cause:
    """One effect of the verdict with what it does on held-out views."""

    named: Named
    alone: Shrink
    left_out: float | None


@dataclass(frozen=True, slots=True, eq=False)
class Account:
    """Everything that is read off one solution.

    chain: where the views are seen from; findings: what speaks otherwise than by smooth bias; nameless: those of them that may not
    be named; told: the figures' arrays; gap: before and after all causes.
    """

    chain: Chain
    evidence: tuple[ViewEvidence, ...]
    causes: tuple[Cause, ...]
    findings: tuple[Finding, ...]
    nameless: tuple[Finding, ...]
    told: Figures
    gap: Shrink

    @property
    def worsens(self) -> str | None:
        """The cause without which the held-out gap shrinks most and by `WORSENS` more: it fitted what is not its own."""
        if self.gap.shrink is None:
            return None
        without = {c.named.name: c.left_out - self.gap.shrink for c in self.causes if c.left_out is not None}
        worst = max(without, key=without.__getitem__, default=None)
        return worst if worst is not None and without[worst] > WORSENS else None


def account(
    joint: Joint,
    views: Sequence[View],
    caster: Raycaster,
    config: GapConfig,
    split: tuple[Sequence[int], Sequence[int]],
    rng: np.random.Generator,
    *,
    along_ray: Finding | None = None,
    alone: bool = False,
    left_out: AbstractSet[str] = frozenset(),
) -> Account:
    """Read a solution off its views.

    Args:
        joint: poses and effects.
        views: what was recorded, in the joint solution's order.
        caster: the scene.
        config: when scatter and loss are effects.
        split: views fitted to and views held out.
        rng: for resampling.
        along_ray: what the first gate found; its share belongs to the residual.
        alone: whether that is all that may be said.
        left_out: effects that may not be named.
    """
    chain, evidence = at_solution(joint, views, caster, config)
    causes = named(joint, split[0], Selector(joint.design, config.select), rng)
    maps = shares(causes, evidence, chain, caster)
    smooth = maps | shares(without_pixels(causes), evidence, chain, caster)
    smooth[""] = [nameless_share(joint, v) for v in evidence]
    gated = () if along_ray is None else (along_ray,)
    found = gated if alone else (*gated, *_findings(evidence, smooth, config))
    findings = tuple(f for f in found if f.name not in left_out)
    told = figures(evidence, joint, maps, findings, split, rng)
    if along_ray is not None and along_ray.share is not None:
        told = replace(told, residual=[r + share for r, share in zip(told.residual, along_ray.share, strict=True)])
    gap = told.shrink(list(told.maps))
    if findings and not told.maps:
        gap = replace(gap, shrink=None, ci95=None)  # Scatter and loss alone: nothing is there to be taken off.
    judged = tuple(Cause(c, told.shrink([c.name]), told.shrink([m for m in told.maps if m != c.name]).shrink) for c in causes)
    return Account(chain, evidence, judged, findings, tuple(f for f in found if f.name in left_out), told, gap)


def _findings(views: Sequence[ViewEvidence], maps: Mapping[str, Sequence[Float]], config: GapConfig) -> tuple[Finding, ...]:
    """What speaks otherwise than by smooth bias, once that is taken off."""
    zero = np.zeros(views[0].residual.shape)
    biased = [np.sum([zero, *(np.nan_to_num(m[v]) for m in maps.values())], axis=0) for v in range(len(views))]
    left = [replace(v, residual=v.residual - b) for v, b in zip(views, biased, strict=True)]
    return (*noise.findings(left, config.scatter), *missing.findings(left, config.missing, smeared=Motion.NAME in maps))
