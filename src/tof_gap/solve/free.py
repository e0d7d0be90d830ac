# SPDX-License-Identifier: Apache-2.0
"""What an effect that nobody named would look like: an error along the ray that is some function of one observable."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tof_core.stats import hats
from tof_sensor.geometry import cell_points

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float, Ints
    from tof_gap.seen.residual import ViewEvidence

KNOTS = {"range_m": 12, "incidence_deg": 12, "amplitude": 12, "time_s": 5}
USUAL_KNOTS = 7
"""Linear pieces between so many knots, at equal numbers of pixels: no form is assumed. Time has no more values than views."""


@dataclass(frozen=True, slots=True)
class FreeFunction:
    """An error along the ray that is any function of the observable `quantity`, piecewise linear between `knots`, 0 in the mean.

    `means` are those of the function's hats over the session's pixels: what is common to all pixels is an offset, and no dependence. It stands among the hypotheses so that named effects do not stand in for one that is missing from the vocabulary.
    """

    quantity: str
    knots: tuple[float, ...]
    means: tuple[float, ...]

    def columns(self, view: ViewEvidence) -> Float:
        """(n, knots) on a view's drawn pixels: metres of z for a metre along the ray at each knot."""
        value = observed(view, self.quantity, view.pixels)
        centred = hats(value, self.knots) - self.means
        return np.asarray(np.nan_to_num(centred) / view.frame.length.ravel()[view.pixels, None])

    def share(self, values: Float, view: ViewEvidence) -> Float:
        """(H, W) metres of z for `values` (knots,), metres along the ray at the knots."""
        value = observed(view, self.quantity, np.arange(view.residual.size)).reshape(view.residual.shape)
        return np.asarray(np.nan_to_num(np.interp(value, self.knots, values) - values @ self.means) / view.frame.length)


UNKNOWN = "unknown"
"""Name of what a free function explains."""


def free_functions(views: Sequence[ViewEvidence]) -> list[FreeFunction]:
    """One for each observable that varies over the session's pixels."""
    out = []
    for name in OBSERVABLES:
        seen = np.concatenate([observed(v, name, v.pixels) for v in views])
        knots = (
            np.unique(np.quantile(seen[np.isfinite(seen)], np.linspace(0.01, 0.99, KNOTS.get(name, USUAL_KNOTS))))
            if np.isfinite(seen).any()
            else np.zeros(0)
        )
        if len(knots) > 2:
            means = hats(seen[np.isfinite(seen)], knots).mean(axis=0)
            out.append(FreeFunction(name, tuple(knots.tolist()), tuple(means.tolist())))
    return out


def observed(view: ViewEvidence, name: str, at: Ints) -> Float:
    """(n,) an observable at pixels (flat indices)."""
    row, column = np.divmod(at, view.residual.shape[1])
    match name:
        case "range_m":
            return np.asarray(view.frame.radial.ravel()[at])
        case "incidence_deg":
            return np.degrees(view.rendering.incidence.ravel()[at].astype(np.float64))
        case "amplitude":
            return np.log(np.maximum(view.frame.amplitude.ravel()[at], 1e-12))
        case "row":
            return row.astype(np.float64)
        case "column":
            return column.astype(np.float64)
        case "time_s":
            return np.full(len(at), view.frame.context.time_s)
        case "concavity":
            return view.concavity.ravel()[at].astype(np.float64)
        case _:
            return np.asarray(cell_points(view.frame).reshape(-1, 3)[at, PLACE.index(name)])


PLACE = ("x_m", "y_m", "z_m")
OBSERVABLES = ("range_m", "incidence_deg", "amplitude", "row", "column", "time_s", "concavity", *PLACE)
"""What an error may depend on; temperature and speed change with the view, as time does."""
