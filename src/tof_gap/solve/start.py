# SPDX-License-Identifier: Apache-2.0
"""First poses: the robot's word brought to the CAD, before any effect is considered."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tof_align.chain import chain_of
from tof_align.pixels import sample
from tof_align.session import near
from tof_core import se3
from tof_core.cores import in_threads
from tof_core.errors import RefusedError
from tof_core.memory import give_back
from tof_gap.seen.motion import moving
from tof_gap.seen.residual import ViewEvidence, gather
from tof_gap.solve.columns import ColumnStore, build
from tof_gap.solve.solution import through
from tof_scene.render import render

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_align.chain import Chain
    from tof_align.config import AlignConfig
    from tof_core.capture import View
    from tof_gap.config import GapConfig
    from tof_gap.limits.solve import JointLimits, StartLimits
    from tof_scene.raycast import Raycaster
    from tof_sensor.effect import Effect


@dataclass(slots=True, eq=False)
class Start:
    """Views at the poses that robot and CAD agree on before any effect is asked, and what they show there."""

    views: Sequence[View]
    chain: Chain
    evidence: tuple[ViewEvidence, ...]

    def hand_over(self) -> tuple[ViewEvidence, ...]:
        """The evidence, which the start keeps no longer: the images of all views are most of what a session needs in memory."""
        evidence, self.evidence = self.evidence, ()
        return evidence


def start(views: Sequence[View], caster: Raycaster, config: GapConfig, align: AlignConfig) -> Start:
    """The robot's poses brought to the CAD: bases from afar, then all poses with no effect.

    Poses with a covariance of their own, as those of a board's corners, owe nothing to depth: depth, whose errors they would
    take, does not move them here.
    """
    samples = [sample(v, align.weights) for v in views]
    chain = chain_of(samples, align.priors)
    if chain.root is not None:
        return Start(views, chain, observe(views, caster, chain, config, footprints=False))
    chain = near(samples, chain, caster, align)
    evidence = observe(views, caster, chain, config, footprints=False)
    for _ in range(config.solve.start.rounds):
        if moving(evidence):
            break  # Edges, which these poses are found by, are given up from here on.
        design = build(ColumnStore(evidence, chain.station), [], chain, config.hand_sd, config.lens_sd)
        before, chain = chain, design.system.fit(design.always, inflate=config.solve.start.inflate).moved(chain)
        del evidence
        evidence = observe(views, caster, chain, config, footprints=False)
        if farthest(before, chain, config.solve.joint) <= 1.0:
            break
    return Start(views, chain, evidence)


def farthest(one: Chain, other: Chain, limits: JointLimits) -> float:
    """The largest step of any camera between two chains; 1 is the step up to which nothing is rendered anew."""
    steps = [se3.distance(one.pose(v), other.pose(v)) for v in range(len(one.station))]
    return max(max(metres / (limits.near_mm * 1e-3), degrees / limits.near_deg) for metres, degrees in steps)


def check_fit(views: Sequence[ViewEvidence], limits: StartLimits) -> None:
    """Refuse a session that fits the scene nowhere, naming a wrong unit where that is the cause.

    Raises:
        RefusedError: of the pixels that see the CAD, fewer than `near_share` lie within the gross bound of it.
    """
    both = [np.isfinite(v.residual) & ~v.edge for v in views]
    total = sum(int(b.sum()) for b in both)
    near = sum(int((b & ~v.gross).sum()) for v, b in zip(views, both, strict=True))
    enough = min(limits.pixels, limits.view_pixels * len(views))
    if total >= enough and near >= limits.near_share * total:
        return
    ratio = float(
        np.median(np.concatenate([(1 + v.residual / v.frame.depth)[b] for v, b in zip(views, both, strict=True)] or [np.ones(1)]))
    )
    if total >= enough and not 1.0 / limits.unit_ratio < ratio < limits.unit_ratio:
        msg = f"depth is {ratio:.3g} times what the scene expects"
        raise RefusedError(msg, where="session", todo="check the unit of the depth image (--depth-scale) and the scene's scale")
    msg = f"only {near} of {total} pixels that see the CAD lie near it: the session fits this scene nowhere"
    raise RefusedError(msg, where="session", todo="check the scene, its placement (--initial-pose) and the robot's TF")


def observe(
    views: Sequence[View],
    caster: Raycaster,
    chain: Chain,
    config: GapConfig,
    *,
    footprints: bool = True,
    concavity: bool = False,
    wider_px: int = 0,
    lens: Effect | None = None,
) -> tuple[ViewEvidence, ...]:
    """Render every view where the chain has it, and gather what differs.

    `concavity`: whether to compute it; `wider_px`: of still views' edges; `lens`: the one that the camera has, None for CameraInfo's.
    """
    give_back()  # The images of an earlier round have gone by now.
    seen = through(lens, views)
    renderings = in_threads(lambda i, v: render(caster, v.camera, chain.pose(i), footprints=footprints), range(len(seen)), seen)
    return gather(seen, renderings, caster, config.evidence, concavity=concavity, wider_px=wider_px, recorded=views)
