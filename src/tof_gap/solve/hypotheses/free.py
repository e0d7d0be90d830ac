# SPDX-License-Identifier: Apache-2.0
"""Errors along the ray that are any function of one observable: a form of the effect that owns the observable, or of none."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tof_core.stats import hats
from tof_gap.solve.hypotheses.candidate import Candidate
from tof_gap.solve.hypotheses.nameless import Nameless, inverse_light
from tof_sensor.curve import CurveEffect, Knots
from tof_sensor.geometry import cell_points
from tof_sensor.registry import PHYSICAL_ORDER

if TYPE_CHECKING:
    from collections.abc import Sequence
    from collections.abc import Set as AbstractSet

    from tof_core.arrays import Float, Ints
    from tof_gap.seen.evidence.view import ViewEvidence

KNOTS = {"range_m": 12, "incidence_deg": 12, "amplitude": 12, "time_s": 9}
USUAL_KNOTS = 7
"""Knots of the piecewise linear functions, at equal numbers of pixels. Over time, at most one for two views."""
EVEN_KNOTS = {"range_m": 6, "amplitude": 6}
"""Further knots at equal distances: a curve is steepest at low amplitude and short range, where there are few pixels."""
APART = 0.02
"""Least distance of two knots, as a share of the span of all: closer ones cannot be separated."""


@dataclass(frozen=True, slots=True)
class FreeFunction(Nameless):
    """An error along the ray that is any function of the observable `quantity`, piecewise linear between `knots`, with mean 0.

    Its columns are the hat functions at the knots, with their `means`. For `STRAY_LIGHT` the function is one of range, divided by the
    pixel's own light: stray light of one phase covers the whole image.
    """

    quantity: str
    knots: tuple[float, ...]
    means: tuple[float, ...]

    def along_ray(self, view: ViewEvidence, at: Ints) -> Float:
        """(n, knots) hat functions at pixels (flat indices)."""
        return _bends(view, self.quantity, self.knots, at)


UNKNOWN = "unknown"
"""Name of a free function that is no form of an effect."""
OWNERS = {kind.CURVE_OF: kind for kind in PHYSICAL_ORDER if issubclass(kind, CurveEffect)}
"""For each observable, the effect of which any function of that observable is a form."""


def curves(views: Sequence[ViewEvidence], asked: AbstractSet[str]) -> list[Candidate]:
    """Any function of each observable that varies over the pixels: a form of the effect that owns it, if `asked` for, else of none."""
    out = []
    for name in OBSERVABLES:
        over = knots_of(views, name)
        if over is None:
            continue
        owner = OWNERS.get(name)
        if owner is not None and owner.NAME in asked:
            out.append(Candidate(owner.NAME, owner.curve(over), f"any function of {name}"))
        else:
            out.append(Candidate(UNKNOWN, None, name, FreeFunction(name, over.at, over.means)))
    return out


def knots_of(views: Sequence[ViewEvidence], name: str) -> Knots | None:
    """Knots over the values of an observable at the session's drawn pixels; None where it does not vary."""
    base = RANGE if name == STRAY_LIGHT else name
    if name == STRAY_LIGHT and knots_of(views, AMPLITUDE) is None:
        return None
    seen = np.concatenate([observed(v, base, v.pixels) for v in views])
    seen = seen[np.isfinite(seen)]
    if not len(seen):
        return None
    count = KNOTS.get(name, USUAL_KNOTS)
    if name == TIME:
        count = min(count, len(views) // 2)
    quantiles = np.quantile(seen, np.linspace(0.01, 0.99, count))
    even = np.linspace(quantiles[0], quantiles[-1], EVEN_KNOTS.get(name, 2))
    knots = _spaced(np.unique([*quantiles, *even]))
    if len(knots) < LEAST_KNOTS:
        return None
    bends = np.concatenate([_bends(v, name, knots, v.pixels) for v in views])
    return Knots(tuple(knots.tolist()), tuple(bends[np.isfinite(bends).all(axis=1)].mean(axis=0).tolist()))


def _spaced(ascending: Float) -> Float:
    """The knots without those closer to the previous one than `APART` of their span."""
    kept: list[float] = []
    for knot in ascending:
        if not kept or knot - kept[-1] > APART * np.ptp(ascending):
            kept.append(float(knot))
    return np.array(kept)


def _bends(view: ViewEvidence, name: str, knots: Sequence[float] | Float, at: Ints) -> Float:
    """(n, knots) hat functions at pixels (flat indices), for stray light divided by the pixel's own light; NaN where unknown."""
    if name != STRAY_LIGHT:
        return hats(observed(view, name, at), knots)
    return hats(observed(view, RANGE, at), knots) * inverse_light(view, at)


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


RANGE, AMPLITUDE, TIME, STRAY_LIGHT = "range_m", "amplitude", "time_s", "stray_light"
LEAST_KNOTS = 3
"""Least number of knots: fewer describe a constant or a straight line."""
PLACE = ("x_m", "y_m", "z_m")
OBSERVABLES = ("range_m", "incidence_deg", "amplitude", "row", "column", "time_s", "concavity", STRAY_LIGHT, *PLACE)
"""Quantities that an error may depend on. Temperature and speed are not among them: they are constant in a view, as time is."""
