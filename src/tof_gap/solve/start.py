# SPDX-License-Identifier: Apache-2.0
"""First poses: the robot's poses registered to the CAD, before any effect is considered."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from tof_align.chain import chain_of
from tof_align.pixels import sample
from tof_align.session import near
from tof_core import se3
from tof_core.cores import in_threads
from tof_core.errors import RefusedError
from tof_core.memory import give_back
from tof_gap.seen.evidence.motion import moving
from tof_gap.seen.evidence.rectified import ray_shift
from tof_gap.seen.evidence.residual import gather
from tof_gap.solve.hypotheses.columns import ColumnStore, build
from tof_gap.solve.solution import through
from tof_scene.render import render

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_align.chain import Chain
    from tof_align.config import AlignConfig
    from tof_core.capture import View
    from tof_gap.config import GapConfig
    from tof_gap.limits.solve import JointLimits, StartLimits
    from tof_gap.seen.evidence.view import ViewEvidence
    from tof_scene.raycast import Raycaster
    from tof_sensor.effect import Effect


@dataclass(slots=True, eq=False)
class Start:
    """Views at the poses by robot and CAD before any effect is fitted, and the evidence there."""

    views: Sequence[View]
    chain: Chain
    evidence: tuple[ViewEvidence, ...]

    def hand_over(self) -> tuple[ViewEvidence, ...]:
        """The evidence, which the start then forgets: the images of all views are most of a session's memory."""
        evidence, self.evidence = self.evidence, ()
        return evidence


def start(views: Sequence[View], caster: Raycaster, config: GapConfig, align: AlignConfig) -> Start:
    """The robot's poses registered to the CAD: bases from afar, then all poses, without effects.

    Poses with a covariance of their own, such as those by a board's corners, do not depend on depth. They are not registered, so that
    they do not absorb errors of depth.
    """
    samples = [sample(v, align.weights) for v in views]
    chain = chain_of(samples, align.priors)
    if chain.root is not None:
        return Start(views, chain, observe(views, caster, chain, config, footprints=False))
    chain = near(samples, chain, caster, align)
    evidence = observe(views, caster, chain, config, footprints=False)
    for _ in range(config.solve.start.rounds):
        if moving(evidence):
            break  # These poses were found by edges, which are not used from here on.
        design = build(ColumnStore(evidence, chain.station), [], chain, config.hand_sd, config.lens_sd)
        before, chain = chain, design.system.fit(design.always, inflate=config.solve.start.inflate).moved(chain)
        del evidence
        evidence = observe(views, caster, chain, config, footprints=False)
        if farthest(before, chain, config.solve.joint) <= 1.0:
            break
    return Start(views, chain, evidence)


def as_rectified(begun: Start, caster: Raycaster, config: GapConfig) -> Start:
    """The start with the rays of a driver that rectified by the nearest pixel; as it is where the views show no such shift."""
    shift = ray_shift(begun.evidence)
    if shift is None:
        return begun
    begun.hand_over()
    views = [replace(v, ray_shift=shift) for v in begun.views]
    return Start(views, begun.chain, observe(views, caster, begun.chain, config, footprints=False))


def farthest(one: Chain, other: Chain, limits: JointLimits) -> float:
    """The largest step of any camera between two chains; up to 1, nothing is rendered again."""
    steps = [se3.distance(one.pose(v), other.pose(v)) for v in range(len(one.station))]
    return max(max(metres / (limits.near_mm * 1e-3), degrees / limits.near_deg) for metres, degrees in steps)


def check_fit(views: Sequence[ViewEvidence], limits: StartLimits) -> None:
    """Refuse a session that fits the scene nowhere; the message names a wrong unit if that is the cause.

    Raises:
        RefusedError: less than the share `near_share` of the pixels that see the CAD lies within the gross bound of it.
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
    """Render every view at its pose in the chain, and compute residuals and noise.

    concavity: whether to compute it; wider_px: pixels added to the edges of still views; lens: of the camera, None for CameraInfo's.
    """
    give_back()  # The images of an earlier round are freed by now.
    seen = through(lens, views)
    renderings = in_threads(lambda i, v: render(caster, v.camera, chain.pose(i), footprints=footprints), range(len(seen)), seen)
    return gather(seen, renderings, caster, config.evidence, concavity=concavity, wider_px=wider_px)
