# SPDX-License-Identifier: Apache-2.0
"""Effects with a free form beside their formulas: any function of the observable on which the effect depends."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar, NamedTuple, Self

import numpy as np

from tof_core.stats import hats
from tof_sensor.effect import Effect, stack

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_sensor.frame import Frame


class Knots(NamedTuple):
    """Knots of a curve: `at` (k,) ascending, in the observable's unit; `means` (k,): means of the knots' hat functions over the session's pixels."""

    at: tuple[float, ...]
    means: tuple[float, ...]


class CurveEffect(Effect):
    """Base of effects whose mechanism determines the quantity that the error depends on, but not the function.

    The fields `knots` (k,), ascending, and `values` (k,), metres along the ray at them, are the free form: piecewise linear, constant
    beyond the ends. Both are empty in the forms with a formula. The error of a factory table measured on another camera follows no formula.
    """

    __slots__ = ()

    CURVE_OF: ClassVar[str]
    """The observable, by its name in `tof_gap.solve.hypotheses.free`."""
    CENTRED: ClassVar[bool] = False
    """Whether the curve's mean over the session is removed from the effect; the field `means` (k,) then holds the means of its hat functions."""

    if TYPE_CHECKING:
        knots: tuple[float, ...]
        values: tuple[float, ...]
        means: tuple[float, ...]

    @classmethod
    def curve(cls, over: Knots) -> Self:
        """The free form with these knots and all values 0."""
        centred = {"means": over.means} if cls.CENTRED else {}
        return replace(cls(), knots=over.at, values=(0.0,) * len(over.at), **centred)  # type: ignore[type-var]

    def observable(self, frame: Frame) -> Float:
        """(H, W) the observable; NaN where it is unknown."""
        raise NotImplementedError

    def curve_columns(self, frame: Frame) -> Float:
        """(H, W, k) change of z in metres per metre along the ray at each knot; 0 where the observable is unknown."""
        value = np.broadcast_to(self.observable(frame), frame.depth.shape)
        known = frame.valid & np.isfinite(value)
        bends = hats(np.where(known, value, self.knots[0]).ravel(), self.knots).reshape(*value.shape, len(self.knots))
        if self.CENTRED:
            bends = bends - self.means
        return stack(list(np.moveaxis(np.where(known, 1.0 / frame.length, 0.0)[..., None] * bends, -1, 0)), frame)

    @property
    def free_form(self) -> bool:
        """Whether this form is a curve."""
        return bool(self.knots)

    @property
    def swing_m(self) -> float:
        """Difference of the curve's highest and lowest value, metres."""
        return float(np.ptp(self.values)) if self.values else 0.0

    @property
    def coefficients(self) -> Float:
        """(k,) values at the knots, or the linear parameters of the formula."""
        return np.asarray(self.values, float) if self.knots else super().coefficients

    @property
    def coefficient_names(self) -> tuple[str, ...]:
        """`at_` and the knot's number, or the names of the formula's linear parameters."""
        return tuple(f"at_{i}" for i in range(len(self.knots))) if self.knots else super().coefficient_names

    @property
    def bounds(self) -> tuple[Float, Float]:
        """Infinite for a curve's values; otherwise the bounds of the formula's linear parameters."""
        every = np.full(len(self.knots), np.inf)
        return (-every, every) if self.knots else super().bounds

    def with_coefficients(self, values: Float) -> Effect:
        """The same knots with other values (k,), or the same formula with other linear parameters."""
        if not self.knots:
            return super().with_coefficients(values)
        return replace(self, values=tuple(float(v) for v in values))  # type: ignore[type-var]
