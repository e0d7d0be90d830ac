# SPDX-License-Identifier: Apache-2.0
"""The fit of one live view with the views that are kept of its station, and with what earlier ones leave about shared errors."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from tof_align.discrepancy import basis_of, least_sizes
from tof_align.linearise import linearise
from tof_align.mixed import estimate, solve
from tof_align.observability import pinned
from tof_align.parts import PART, counts
from tof_align.robust import first_look, halfway, misfit, weigh
from tof_align.surroundings import described, surroundings, unseen, within
from tof_align.system import assemble, camera_step, unmodelled
from tof_align.view_columns import columns_of
from tof_core import se3

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_align import verdict as verdicts
    from tof_align.carry import Carry
    from tof_align.chain import Chain
    from tof_align.config import AlignConfig
    from tof_align.discrepancy import Basis
    from tof_align.linearise import Linearised
    from tof_align.mixed import Mixed, Normal
    from tof_align.observability import Observability
    from tof_align.pixels import Pixels, Sample
    from tof_align.view_columns import ViewColumns
    from tof_core.arrays import Float
    from tof_scene.raycast import Raycaster

STILL = 1e-4
"""Step of a live camera (metres, radians) below which its fit ends: a tenth of the arm error."""
STEPS = 3
"""Most linearisations of a live view; its predicted pose is within the arm error."""
ROUNDS = 3
"""Rounds that estimate the sizes of errors, from those of the view before."""
WIDEN = 1.6
"""Factor by which later views may see nearer and farther surfaces than the first one."""
NEW_SHARE = 0.5
"""Share of a view's pixels on surfaces without columns from which the columns are chosen again: the others then determine its pose less."""


@dataclass(frozen=True, slots=True, eq=False)
class Kept:
    """A view of this station as normal equations at the pose where it was linearised."""

    sample: Sample
    T_cell_camera: Float
    gram: Float
    arm: Float
    information: verdicts.Information


@dataclass(frozen=True, slots=True, eq=False)
class SharedErrors:
    """What earlier views leave: columns and sizes of shared errors, information about them, and the misfit of the last view in metres."""

    basis: Basis
    sizes: dict[str, float] = field(default_factory=dict)
    carry: Carry | None = None
    misfit_m: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """The new view at the end of a chain, fitted with the window; `answer`'s step is not taken yet."""

    chain: Chain
    lin: Linearised
    columns: ViewColumns
    weights: Float
    gram: Float
    normal: Normal
    answer: Mixed
    pull: tuple[Float, Float] | None
    misfit_m: float | None


def basis_around(lin: Linearised, caster: Raycaster, config: AlignConfig, before: Basis | None = None) -> Basis:
    """Columns for a view and for what the next ones will see.

    Those of range and amplitude stay as they were `before`, if they reach over the view's.
    """
    basis = basis_of([lin], config.discrepancy.live, widen=WIDEN, around=[surroundings(lin, caster)])
    if before is None or not within(before, lin).all():
        return basis
    return replace(before, centres=basis.centres, root_object=basis.root_object, parts=basis.parts)


def is_new(basis: Basis, lin: Linearised) -> bool:
    """Whether a view sees surfaces that the columns do not describe."""
    return len(basis.centres) > 0 and float(np.mean(~described(basis, lin))) > NEW_SHARE


def fit_view(
    live: Pixels, chain: Chain, lin: Linearised, kept: Sequence[Kept], shared: SharedErrors, caster: Raycaster, config: AlignConfig
) -> Fit:
    """Gauss-Newton on the new view and the window; the answer's step is not taken yet.

    Weights are those of a session: an error that the columns describe incompletely counts as one error of a patch, not of each pixel.
    """
    last, limits, misfit_m = len(kept), config.weights.shared, shared.misfit_m
    columns = columns_of(lin, shared.basis)
    weights = _weighed(lin, first_look(lin, limits), columns, shared.basis, shared.sizes, misfit_m, config)
    fit = _solved(chain, lin, columns, weights, kept, shared, config, misfit_m)
    for _ in range(STEPS - 1):
        if np.abs(camera_step(chain, fit.answer, last)).max() < STILL:
            break
        chain = chain.moved(fit.answer.x, fit.answer.own)
        lin = linearise(live, chain.pose(last), caster, config.weights)
        columns = columns_of(lin, shared.basis)
        smooth = unmodelled(columns, chain, shared.basis, fit.answer, last)
        misfit_m = halfway(misfit(smooth, limits), misfit_m)
        weights = _weighed(lin, lin.residual - smooth.sum(axis=1), columns, shared.basis, fit.answer.sizes, misfit_m, config)
        fit = _solved(chain, lin, columns, weights, kept, shared, config, misfit_m)
    return fit


def _weighed(
    lin: Linearised, error: Float, columns: ViewColumns, basis: Basis, sizes: dict[str, float], misfit_m: float | None, config: AlignConfig
) -> Float:
    """(n,) weights of the pixels that count; nothing is known of errors at ranges and amplitudes for which there are no columns."""
    unknown = np.linalg.norm(unseen(basis, lin, sizes, config.discrepancy), axis=1)
    beyond = np.hypot(columns.beyond(sizes, config.weights.shared), unknown)
    return weigh(lin, error, config.weights, misfit_m or 0.0, beyond) * counts(basis.parts, lin)


def _solved(
    chain: Chain,
    lin: Linearised,
    columns: ViewColumns,
    weights: Float,
    kept: Sequence[Kept],
    shared: SharedErrors,
    config: AlignConfig,
    misfit_m: float | None,
) -> Fit:
    """The window and the new view's normal equations together, with what is carried."""
    d, gram = config.discrepancy, columns.gram(weights)
    at = [*(k.T_cell_camera for k in kept), lin.T_cell_camera]
    shifts = np.array([se3.log(se3.inverse(T_lin) @ chain.pose(v)) for v, T_lin in enumerate(at)])
    normal = assemble([*(k.gram for k in kept), gram], chain, shared.basis, np.zeros(0), shifts)
    pull = None if shared.carry is None else shared.carry.at(chain)
    start = {kind: 1e-3 * (d.part_start_mm if kind.startswith(PART) else d.start_mm) for kind in (*normal.kinds, *normal.own_kinds)}
    # A part that was in its place may be moved while the robot works; a size near zero would stay there.
    sizes = {kind: max(shared.sizes.get(kind, size), size if kind.startswith(PART) else 0.0) for kind, size in start.items()}
    rounds = ROUNDS if shared.sizes else d.rounds
    answer = estimate(normal, sizes, rounds=rounds, low=least_sizes(sizes, shared.basis, d), high=d.ceiling_mm * 1e-3, pull=pull)
    return Fit(chain, lin, columns, weights, gram, normal, answer, pull, misfit_m)


def pin(fit: Fit, seen: Observability) -> Mixed:
    """Solve again with the base held at the robot's pose along directions that the data do not determine."""
    if not len(seen.null):
        return fit.answer
    G = fit.normal.info.size
    H, b = (np.zeros((G, G)), np.zeros(G)) if fit.pull is None else (fit.pull[0].copy(), fit.pull[1].copy())
    held = pinned(seen, fit.chain.frame(0), fit.chain.B[0])
    H[:6, :6] += held[0]
    b[:6] += held[1]
    return solve(fit.normal, fit.answer.sizes, (H, b))
