# SPDX-License-Identifier: Apache-2.0
"""The posterior of every set of up to four effects: likelihoods in a table, which numpyro samples and enumeration sums."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations, permutations
from math import lgamma
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.second_opinion.hypotheses import SIZES_M, TOGETHER, log_prior_count

if TYPE_CHECKING:
    from collections.abc import Sequence

    from benchmarks.second_opinion.hypotheses import Form, Search
    from tof_core.arrays import Float, Ints

IMPOSSIBLE = -1e6
"""ln of the probability of a set that holds two forms of a name, beside the best set: small enough, and finite for a sampler that starts there."""


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """ln of marginal likelihood times the forms' prior, less its maximum, of every set of forms at every size of maps.

    forms (F,); names: of the session, how many were asked; sets: ascending indices of forms; values (sizes, sets).
    """

    forms: tuple[Form, ...]
    names: int
    sets: tuple[tuple[int, ...], ...]
    values: Float

    @classmethod
    def of(cls, search: Search, forms: Sequence[Form]) -> Table:
        """All sets of up to `TOGETHER` forms of different names."""
        chosen = [s for n in range(TOGETHER + 1) for s in combinations(range(len(forms)), n) if len({forms[i].name for i in s}) == n]
        prior = np.array([sum(search.log_prior(forms[i]) for i in s) for s in chosen])
        members = [[m for i in s for m in forms[i].members] for s in chosen]
        values = np.array([[search.evidence.log_likelihood(m, size) for m in members] for size in SIZES_M]) + prior
        return cls(tuple(forms), len(search.names), tuple(chosen), values - values.max())

    def posterior(self) -> Float:
        """(sizes, sets) probabilities, the inclusion rate integrated out: exact, by enumeration."""
        count = np.array([log_prior_count(len(s), self.names) for s in self.sets])
        weights = np.exp(self.values + count - (self.values + count).max())
        return np.asarray(weights / weights.sum())

    def inclusion(self, probabilities: Float) -> Float:
        """(F,) probability of each form from those of the sets (sets,)."""
        out = np.zeros(len(self.forms))
        for p, s in zip(probabilities, self.sets, strict=True):
            out[list(s)] += p
        return out

    def dense(self) -> Float:
        """(sizes, F + 1, F + 1, ...) the values by what stands in each of `TOGETHER` places, 0 for nothing; a set stands in any order.

        Each order of a set has an equal part of it.
        """
        n = len(self.forms) + 1
        out = np.full((len(SIZES_M), *(n,) * TOGETHER), IMPOSSIBLE)
        for k, s in enumerate(self.sets):
            filled = [i + 1 for i in s] + [0] * (TOGETHER - len(s))
            orders = lgamma(TOGETHER + 1) - lgamma(TOGETHER - len(s) + 1)
            for order in set(permutations(filled)):
                place: tuple[slice | int, ...] = (slice(None), *order)
                out[place] = self.values[:, k] - orders
        return out


@dataclass(frozen=True, slots=True, eq=False)
class Sampled:
    """What the sampler found: (chains, F) inclusion of each form by chain; split R-hat, the worst of all forms and of the rate."""

    inclusion: Float
    r_hat: float

    @property
    def apart(self) -> float:
        """Largest difference of two chains' inclusion probabilities."""
        return float(np.ptp(self.inclusion, axis=0).max(initial=0.0))


def drawn_forms(places: Ints, forms: int) -> Float:
    """(chains, samples, F) whether each form is there, from what stands in the places (chains, samples, `TOGETHER`), 0 for nothing."""
    return np.asarray((places[..., None] == np.arange(1, forms + 1)).any(axis=2), float)
