# SPDX-License-Identifier: Apache-2.0
"""Information of views that left the window: a quadratic form in base, hand-eye and shared errors."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from tof_align.mixed import reduce
from tof_align.parts import PART
from tof_align.system import kinds_of
from tof_core import se3

if TYPE_CHECKING:
    from tof_align.chain import Chain
    from tof_align.discrepancy import Basis
    from tof_align.mixed import Normal
    from tof_core.arrays import Float, Ints


@dataclass(frozen=True, slots=True, eq=False)
class Carry:
    """Information H (G, G) and right side b (G,) about steps of [base, hand-eye | shared errors].

    Steps of base and hand-eye are relative to the state `base` and `hand_eye` (4, 4); coefficients of shared errors are absolute.
    """

    H: Float
    b: Float
    base: Float
    hand_eye: Float

    @classmethod
    def of(cls, normal: Normal, sizes: dict[str, float], chain: Chain, before: Carry | None) -> Carry:
        """The information of these views and of `before`; no prior is counted twice."""
        bare = replace(normal, info=np.zeros_like(normal.info))
        own = {kind: size for kind, size in sizes.items() if kind in normal.own_kinds}
        r = reduce(bare, own)
        H, b = r.H, r.b
        if before is not None:
            H_before, b_before = before.at(chain)
            H, b = H + H_before, b + b_before
        return cls(H, b, chain.base[0], chain.hand_eye)

    def at(self, chain: Chain) -> tuple[Float, Float]:
        """H and b about steps from the state of `chain`."""
        moved = np.zeros(len(self.b))
        moved[:6] = se3.log(se3.inverse(self.base) @ chain.base[0])
        moved[6:12] = se3.log(se3.inverse(self.hand_eye) @ chain.hand_eye)
        return self.H, self.b - self.H @ moved

    def without_base(self, chain: Chain) -> Carry:
        """Integrate the base out (with its prior): the station is over."""
        H, b = self.at(chain)
        info, _, error, _ = chain.prior()
        rest, right = np.zeros_like(H), np.zeros_like(b)
        rest[6:, 6:], right[6:] = _integrated_out(H, b, np.arange(6), info[:6], error[:6])
        return Carry(rest, right, np.eye(4), chain.hand_eye)

    def with_surface_of(self, after: Basis, before: Basis, sizes: dict[str, float]) -> Carry:
        """For other columns of surfaces and parts, or of all: what is known of those that change is integrated out, with their prior."""
        start = 12
        old, new = kinds_of(before, start), kinds_of(after, start)
        same = {
            "range": np.array_equal(before.knots_range, after.knots_range),
            "amplitude": np.array_equal(before.knots_amplitude, after.knots_amplitude),
            "object": np.array_equal(before.centres, after.centres),
        }
        kept = [kind for kind in old if kind in new and same.get(kind, not kind.startswith(PART))]
        goes = np.setdiff1d(np.arange(len(self.b)), np.concatenate([np.arange(start), *(old[kind] for kind in kept)]))
        # Columns without a size were never used: nothing is known of them, and any prior does.
        prior = np.concatenate(
            [np.full(len(at), sizes.get(kind, 1.0) ** -2) for kind, at in old.items() if kind not in kept] or [np.zeros(0)]
        )
        at = np.concatenate([np.arange(start), *(new[kind] for kind in kept)])
        count = start + sum(after.shared)
        H, b = np.zeros((count, count)), np.zeros(count)
        H[np.ix_(at, at)], b[at] = _integrated_out(self.H, self.b, goes, prior)
        return Carry(H, b, self.base, self.hand_eye)


def _integrated_out(H: Float, b: Float, goes: Ints, prior: Float, error: Float | float = 0.0) -> tuple[Float, Float]:
    """Information and right side of the other unknowns without those at `goes` (k,), whose prior is known.

    prior (k,): inverse variances; error (k,): deviation of the present state from the prior's mean.
    """
    stays = np.setdiff1d(np.arange(len(b)), goes)
    across = H[np.ix_(goes, stays)]
    gain = np.linalg.solve(H[np.ix_(goes, goes)] + np.diag(prior), across)
    return H[np.ix_(stays, stays)] - gain.T @ across, b[stays] - gain.T @ (b[goes] - prior * error)
