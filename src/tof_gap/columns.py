# SPDX-License-Identifier: Apache-2.0
"""Columns of all hypotheses on the drawn pixels, and each view's Gram matrix."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tof_core import se3
from tof_gap.system import Chain, ViewGram
from tof_sensor.geometry import pose_columns

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float, Ints
    from tof_gap.candidates import Candidate
    from tof_gap.evidence import ViewEvidence
    from tof_sensor.effect import Effect

COLUMN_SD_M = 0.05
"""Weak prior of a coefficient: a column of unit RMS may reach 50 mm."""


@dataclass(frozen=True, slots=True, eq=False)
class Design:
    """All columns over the session, each scaled to unit RMS: the linear system of all hypotheses.

    `groups[i]` are the columns of candidate i; a coefficient in physical units is
    theta / scale[column]; `theta_sd` (K,) are the weak priors in metres.
    """

    candidates: tuple[Candidate, ...]
    groups: tuple[Ints, ...]
    scale: Float
    grams: tuple[ViewGram, ...]
    chain: Chain
    theta_sd: Float


def effect_columns(effect: Effect, view: ViewEvidence) -> Float:
    """(n, k) metres of z on the view's drawn pixels."""
    if effect.LOCAL:
        return effect.columns(view.frame.take(view.pixels))[0]
    full = effect.columns(view.frame)
    return np.asarray(full.reshape(-1, full.shape[-1])[view.pixels])


def build(
    views: Sequence[ViewEvidence], tested: Sequence[Candidate], chain: Chain, places: Sequence[tuple[Float, Float, Float]],
) -> Design:
    """Gram matrices of every view; `places` are (to_base, to_arm, arm0) per view."""
    blocks = [[_columns(c, v) for c in tested] for v in views]
    widths = [b.shape[1] for b in blocks[0]]
    ends = np.cumsum([0, *widths])
    groups = tuple(np.arange(a, b) for a, b in zip(ends[:-1], ends[1:], strict=True))
    C = [np.concatenate(b, axis=1) for b in blocks]
    total = sum(len(c) for c in C)
    scale = np.sqrt(sum((c * c).sum(axis=0) for c in C) / total)
    safe = np.where(scale > 1e-12, scale, 1.0)
    grams = tuple(
        _gram(v, c / safe, *place) for v, c, place in zip(views, C, places, strict=True)
    )
    # A column that vanishes everywhere is pinned: it explains nothing.
    theta_sd = np.where(scale > 1e-12, COLUMN_SD_M, 1e-9)
    return Design(tuple(tested), groups, safe, grams, chain, theta_sd)


def _columns(candidate: Candidate, view: ViewEvidence) -> Float:
    if candidate.effect is None:
        return np.zeros((len(view.pixels), 0))
    return effect_columns(candidate.effect, view)


def _gram(view: ViewEvidence, C: Float, to_base: Float, to_arm: Float, arm0: Float) -> ViewGram:
    J = pose_columns(view.frame.take(view.pixels))[0]
    r = view.residual.ravel()[view.pixels]
    sigma = view.sigma.ravel()[view.pixels]
    X = np.concatenate([J, C, r[:, None]], axis=1) / sigma[:, None]
    return ViewGram(X.T @ X, to_base, to_arm, arm0, view.view.station, len(r), float((1 / sigma**2).sum()))


def place_in_chain(T_cell_camera: Float, X: Float, A: Float) -> tuple[Float, Float, Float]:
    """(to_base, to_arm, arm0) of a view: how b and a show in the camera's axes, and log(A)."""
    return se3.adjoint(se3.inverse(T_cell_camera)), se3.adjoint(se3.inverse(X)), se3.log(A)
