# SPDX-License-Identifier: Apache-2.0
"""The second judge's opinion of one session: the probability of every name, and whether it exceeds what a healthy camera errs by."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.second_opinion.evidence import mean_square
from benchmarks.second_opinion.hypotheses import SIZES_M, kept, searched
from benchmarks.second_opinion.sampler import sample
from benchmarks.second_opinion.table import Table
from tof_core import se3
from tof_gap.solve.hypotheses.candidate import HAND_EYE

if TYPE_CHECKING:
    from benchmarks.second_opinion.evidence import Evidence
    from benchmarks.second_opinion.hypotheses import Form
    from benchmarks.second_opinion.listen import Heard


@dataclass(frozen=True, slots=True)
class Opinion:
    """What the second judge says of a session.

    asked: names that both judges could choose; inclusion: probability of every name by the sampler; exact: by enumeration; size_mm: of
    each name's map in its most probable set, RMS over the pixels that it touches; exceeds: names above what a healthy camera errs by;
    chosen: names in the diagnosis' selection, before it judged their sizes; inflate: divisor of the pixels' weight; apart: largest
    difference of the two chains; r_hat: worst of all forms.
    """

    asked: tuple[str, ...]
    inclusion: dict[str, float]
    exact: dict[str, float]
    size_mm: dict[str, float]
    exceeds: tuple[str, ...]
    chosen: tuple[str, ...]
    inflate: float
    apart: float
    r_hat: float

    def probability(self, name: str) -> float:
        """Of an effect of that name above what a healthy camera errs by."""
        return self.inclusion.get(name, 0.0) if name in self.exceeds else 0.0


def opinion_of(heard: Heard, seed: int = 0) -> Opinion:
    """The opinion on the evidence of one diagnosis."""
    design, config = heard.design, heard.config
    search, inflate = searched(design, heard.members, config.select.neighbours)
    table = Table.of(search, kept(search.pool))
    posterior, sampled = table.posterior(), sample(table, seed)
    names = sorted({f.name for f in table.forms})
    by_name = np.array([[f.name == n for f in table.forms] for n in names], float)
    exact = by_name @ table.inclusion(posterior.sum(axis=0))
    sizes = {n: _most_probable_size(heard, search.evidence, table, posterior, n) for n in names}
    return Opinion(
        tuple(search.names),
        dict(zip(names, (by_name @ sampled.inclusion.mean(axis=0)).tolist(), strict=True)),
        dict(zip(names, exact.tolist(), strict=True)),
        {n: 1e3 * size for n, (size, _) in sizes.items()},
        tuple(n for n, (_, above) in sizes.items() if above),
        tuple(sorted({design.candidates[m].name for m in heard.members})),
        inflate,
        sampled.apart,
        sampled.r_hat,
    )


def _most_probable_size(heard: Heard, evidence: Evidence, table: Table, posterior: np.ndarray, name: str) -> tuple[float, bool]:
    """Metres of the name's map in its most probable set, and whether that is more than a healthy camera errs by (NaN for hand-eye)."""
    holds = np.array([any(table.forms[i].name == name for i in s) for s in table.sets])
    size, which = np.unravel_index(int(np.argmax(posterior * holds)), posterior.shape)
    forms = [table.forms[i] for i in table.sets[which]]
    members = [m for f in forms for m in f.members]
    x = evidence.joined(members, SIZES_M[size]).solved()[0]
    if name == HAND_EYE:
        return float("nan"), _mounted_elsewhere(heard, x[evidence.hand_at])
    own = next(f for f in forms if f.name == name)
    metres = _size(heard, evidence, own, {m: x[at] for m, at in zip(members, evidence.places(members), strict=True)})
    # What errs most at edges, which are in no fit, shows little of its size here.
    at_edges = any(e is not None and e.AT_EDGES for e in (heard.design.candidates[m].effect for m in own.members))
    return metres, at_edges or metres > heard.config.select.least_mm * 1e-3


def _size(heard: Heard, evidence: Evidence, form: Form, coordinates: dict[int, np.ndarray]) -> float:
    """Metres RMS of a form's map over the pixels that its candidates touch; parts touch pixels of their own."""
    theta: dict[int, float] = defaultdict(float)
    for m in form.members:
        group = evidence.groups[m]
        for column, value in zip(group.columns.tolist(), (group.whitened @ coordinates[m]).tolist(), strict=True):
            theta[column] += value
    columns, values = np.array(list(theta), np.int64), np.array(list(theta.values()))
    square = mean_square(heard.design.system)[np.ix_(columns, columns)]
    touched = min(sum(float(heard.touched[m]) for m in form.members), 1.0)
    return float(np.sqrt(values @ square @ values / max(touched, 1e-12)))


def _mounted_elsewhere(heard: Heard, step: np.ndarray) -> bool:
    """Whether the camera's mount is farther off than its calibration states."""
    off = se3.log(heard.design.system.chain.hand_eye @ se3.exp(step))
    most = heard.config.calibration.hand_eye_most
    return bool(np.linalg.norm(off[:3]) > most[0] or np.linalg.norm(off[3:]) > most[1])
