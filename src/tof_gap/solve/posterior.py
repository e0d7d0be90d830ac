# SPDX-License-Identifier: Apache-2.0
"""What the joint solution leaves uncertain: pose by view, seen as depth; and fits to some views only."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tof_gap.solve.system import ARM, POSE, fit
from tof_sensor.geometry import pose_columns

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_align.chain import Chain
    from tof_core.arrays import Float
    from tof_gap.seen.residual import ViewEvidence
    from tof_gap.solve.system import Fit, System


def subset(system: System, views: Sequence[int]) -> System:
    """The system of some views only; all stations stay."""
    at = np.asarray(views, np.int64)
    return replace(
        system,
        G=system.G[at],
        station=system.station[at],
        n=system.n[at],
        weight=system.weight[at],
        arm0=system.arm0[at],
    )


def fit_to(system: System, views: Sequence[int], solution: Fit, *, inflate: float, free_hand: bool) -> Fit:
    """The columns of a solution fitted anew to some views only, the bases held where the solution has them.

    Figures are stated at the solution's poses: coefficients that some views alone would trade against a base do not fit those.
    """
    held = replace(subset(system, views), base0=-solution.base, base_sd=np.full(6, 1e-7))
    return fit(held, solution.active, inflate=inflate, free_hand=free_hand)


def camera_covs(system: System, solution: Fit, chain: Chain, *, inflate: float) -> Float:
    """(V, 6, 6) covariance of each camera's right perturbation under the joint solution."""
    k, S = len(solution.active), solution.stations
    take = np.concatenate([np.arange(POSE), POSE + solution.active]).astype(np.int64)
    N = system.G[:, take[:, None], take][:, ARM] / inflate
    rest = np.concatenate([np.arange(12), POSE + np.arange(k)])
    cov_a = np.linalg.inv(N[:, :, ARM] + np.diag(system.arm_sd**-2))
    out = np.empty((len(N), 6, 6))
    for v, s in enumerate(system.station):
        at = np.concatenate([6 * s + np.arange(6), 6 * S + np.arange(6 + k)])
        shared, own = chain.links(v)
        # a = a0 - cov_a Na z: z moves the camera directly and by way of a.
        direct = np.concatenate([shared, np.zeros((6, k))], axis=1)
        M = direct - own @ cov_a[v] @ N[v][:, rest]
        out[v] = M @ solution.cov[np.ix_(at, at)] @ M.T + own @ cov_a[v] @ own.T
    return out


def floor2(views: Sequence[ViewEvidence], covs: Float) -> list[Float]:
    """(H, W) m^2 per view: scatter and pose posterior, below which no model can go."""
    out = []
    for view, cov in zip(views, covs, strict=True):
        J = pose_columns(view.frame)
        out.append(view.sigma**2 + np.einsum("hwi,ij,hwj->hw", J, cov, J))
    return out
