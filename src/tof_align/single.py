# SPDX-License-Identifier: Apache-2.0
"""Registration of one view to the CAD, with the robot's pose as a prior or without one (the paper's method)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from tof_align import verdict as verdicts
from tof_align.approach import approach
from tof_align.chain import Single
from tof_align.config import AlignConfig
from tof_align.fit import Fitter
from tof_align.linearise import linearise
from tof_align.mixed import Mixed, solve
from tof_align.observability import Observability, most_disputed, observe_block, pinned
from tof_align.pixels import Sample, sample
from tof_core import se3
from tof_core.capture import Posed, View

if TYPE_CHECKING:
    from tof_align.system import SessionSystem
    from tof_core.arrays import Float
    from tof_scene.raycast import Raycaster

FREE = np.diag(np.repeat([0.3, np.radians(20.0)], 3)) ** 2
"""Covariance (6, 6) in place of a missing prior: wider than the range of convergence."""


@dataclass(frozen=True, slots=True, eq=False)
class ViewAlignment:
    """One view's pose with its evidence.

    posed: pose, covariance (with the discrepancy's share), open directions, verdict in a line;
    hessian (6, 6): information of this view's pixels about the right perturbation of the camera,
    weights as in the fit (1/m^2, 1/(m rad), 1/rad^2), without prior or discrepancy;
    observability: rank and open directions; verdict: support, improvement, step, reason;
    sizes: unmodelled errors found, metres; system: to refit with.
    """

    posed: Posed
    hessian: Float
    observability: Observability
    verdict: verdicts.Verdict
    sizes: dict[str, float]
    system: SessionSystem[Single]
    fitted: Mixed

    @property
    def rank(self) -> int:
        """Number of the six directions that the data determine."""
        return self.observability.rank


def align_view(
    view: View,
    caster: Raycaster,
    T_prior: Float,
    cov_prior: Float | None,
    config: AlignConfig | None = None,
) -> ViewAlignment:
    """Register one view to the CAD: point to plane along the pixels' rays, with a robust kernel, coarse to fine.

    Args:
        view: depth in metres along z.
        caster: the scene.
        T_prior: (4, 4) T_cell_camera by the robot.
        cov_prior: (6, 6) covariance of its right perturbation; None: a free pose, as in the paper's
            ICP per view, without unmodelled errors.
        config: default `AlignConfig()`.

    A refused alignment keeps `T_prior` with its covariance (`posed.accepted` is False).

    Raises:
        RefusedError: no pixel sees the CAD.
    """
    config = config or AlignConfig()
    return align_sample(sample(view, config.weights), caster, T_prior, cov_prior, config)


def align_sample(taken: Sample, caster: Raycaster, T_prior: Float, cov_prior: Float | None, config: AlignConfig) -> ViewAlignment:
    """`align_view` for the sample of a view."""
    free = cov_prior is None
    prior = FREE if cov_prior is None else np.asarray(cov_prior, float)
    if free:
        config = replace(config, discrepancy=replace(config.discrepancy, enabled=False))
    else:
        # In one view, errors of the surface are smooth in the image: one kind is enough.
        config = replace(config, discrepancy=config.discrepancy.of_one_view)
    std = np.sqrt(np.diag(prior))
    start = T_prior @ approach([taken.coarse], T_prior[None], T_prior, std, caster, config)
    fitter = Fitter([taken.fine], caster, config, last=[taken.full])
    rig = Single(T_prior, start, np.linalg.cholesky(prior))
    system, answer, _ = fitter.fit(rig, 3 * config.iterations if free else config.iterations)
    return _conclude(fitter, system, answer, T_prior, None if free else prior)


def _conclude(
    fitter: Fitter,
    system: SessionSystem[Single],
    answer: Mixed,
    T_prior: Float,
    cov_prior: Float | None,
) -> ViewAlignment:
    config, lin, rig = fitter.config, system.views[0], system.rig
    cov = system.camera_cov(answer, 0)
    prior = rig.root @ rig.root.T
    seen = observe_block(cov, prior, rig.T, T_prior[:3, 3], config.verdict)
    kept = answer
    if len(seen.null):
        H, b = pinned(seen, rig.T, rig.T @ se3.inverse(T_prior))
        size = answer.x.size
        pull, right = np.zeros((size, size)), np.zeros(size)
        pull[:6, :6], right[:6] = rig.root.T @ H @ rig.root, rig.root.T @ b
        kept = solve(system.normal(), answer.sizes, (pull, right))
    T = rig.moved(kept.x, kept.own).T
    before = verdicts.fit_of(linearise(fitter.pixels[0], T_prior, fitter.caster, config.weights), config)
    explained = system.explained(kept, 0)
    after = verdicts.fit_of(lin, config, explained)
    information = verdicts.information_of(lin, system.weights[0], config, explained)
    disputed = most_disputed(seen, rig.T, information.agreeing, information.everyone, np.asarray(np.linalg.inv(prior), float))
    verdict = verdicts.judge(before, after, T_prior, T, cov_prior, seen.names, config, disputed)
    if not verdict.accepted:
        T, cov = T_prior, prior
    posed = Posed(T, se3.cov_fixed_axes(T, cov), seen.at(T[:3, 3]), verdict.accepted, verdict.reason, short=verdict.short)
    hessian = (lin.jacobian * system.weights[0][:, None]).T @ lin.jacobian
    return ViewAlignment(posed, hessian, seen, verdict, dict(answer.sizes), system, kept)
