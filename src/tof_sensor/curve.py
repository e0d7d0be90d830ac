# SPDX-License-Identifier: Apache-2.0
"""Effects that have, beside their formulas, a form that is any function of the observable on which the effect depends."""

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
    """Where a curve bends: `at` (k,) ascending, in the observable's unit; `means` (k,) of the curve's hats over the session's pixels."""

    at: tuple[float, ...]
    means: tuple[float, ...]


class CurveEffect(Effect):
    """Base of effects whose mechanism determines the quantity that the error depends on, but not the function.

    The fields `knots` (k,), ascending, and `values` (k,), metres along the ray at them, are the free form: piecewise linear, constant
    beyond the ends. Both are empty in the forms with a formula. A table that a factory measured on another unit bends as no formula does.
    """

    __slots__ = ()

    CURVE_OF: ClassVar[str]
    """The observable, by its name in `tof_gap.solve.free`."""
    CENTRED: ClassVar[bool] = False
    """Whether a curve's mean over the session is no part of the effect; the field `means` (k,) then holds those of its hats."""

    if TYPE_CHECKING:
        knots: tuple[float, ...]
        values: tuple[float, ...]
        means: tuple[float, ...]

    @classmethod
    def curve(cls, over: Knots) -> Self:
        """The free form over these knots, without an error as yet."""
        centred = {"means": over.means} if cls.CENTRED else {}
        return replace(cls(), knots=over.at, values=(0.0,) * len(over.at), **centred)  # type: ignore[type-var]

    def observable(self, frame: Frame) -> Float:
        """(H, W) the observable; NaN where it is not known."""
        raise NotImplementedError

    def curve_columns(self, frame: Frame) -> Float:
        """(H, W, k) metres of z for a metre along the ray at each knot; 0 where the observable is not known."""
        value = np.broadcast_to(self.observable(frame), frame.depth.shape)
        known = frame.valid & np.isfinite(value)
        bends = hats(np.where(known, value, self.knots[0]).ravel(), self.knots).reshape(*value.shape, len(self.knots))
        if self.CENTRED:
            bends = bends - self.means
        return stack(list(np.moveaxis(np.where(known, 1.0 / frame.length, 0.0)[..., None] * bends, -1, 0)), frame)

    @property
    def free_form(self) -> bool:
        """Whether it is a curve."""
        return bool(self.knots)

    @property
    def swing_m(self) -> float:
        """Metres between the curve's highest and lowest value."""
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
        """None of a curve's values; those of the formula's linear parameters."""
        every = np.full(len(self.knots), np.inf)
        return (-every, every) if self.knots else super().bounds

    def with_coefficients(self, values: Float) -> Effect:
        """The same knots with other values (k,), or the same formula with other linear parameters."""
        if not self.knots:
            return super().with_coefficients(values)
        return replace(self, values=tuple(float(v) for v in values))  # type: ignore[type-var]
