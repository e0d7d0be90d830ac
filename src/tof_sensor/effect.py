# SPDX-License-Identifier: Apache-2.0
"""What an effect is: a formula with linear coefficients and a shape, that can be added to a view."""

from __future__ import annotations

from abc import ABC
from dataclasses import replace
from enum import Enum
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float, Ints
    from tof_sensor.frame import Frame


class Evidence(Enum):
    """The kind of trace that an effect leaves."""

    BIAS = "bias"
    SCATTER = "scatter"
    MISSING = "missing"


class Effect(ABC):
    """Base of all effects; each is a frozen dataclass whose fields are its parameters.

    `LINEAR` names the fields in which the bias is linear (all others are its *shape*):
    bias = columns(frame) @ coefficients, in metres along z. An effect that leaves scatter or
    missing pixels overrides `apply` instead. Parameters carry units and plausible bounds
    (`tof_core.config.param`).
    """

    __slots__ = ()

    NAME: ClassVar[str]
    EVIDENCE: ClassVar[Evidence] = Evidence.BIAS
    LINEAR: ClassVar[tuple[str, ...]] = ()
    OWN: ClassVar[tuple[str, ...]] = ()
    """Of `LINEAR`, those without which it would be another effect: an offset, or stamps that are late."""
    LOCAL: ClassVar[bool] = True
    """Whether a pixel's bias depends on that pixel alone, so that `Frame.take` may thin the view."""
    ROUGH: ClassVar[float] = 0.0
    """Share of its own size by which its map may be wrong, where no more than a coarse model of it can be reckoned (energy)."""

    @property
    def coefficients(self) -> Float:
        """(k,) values of the linear parameters."""
        return np.concatenate([np.atleast_1d(np.asarray(getattr(self, n), float)) for n in self.LINEAR] or [np.zeros(0)])

    @property
    def bounds(self) -> tuple[Float, Float]:
        """Plausible (low, high) (k,) of the linear parameters; infinite where none is stated."""
        fields = type(self).__dataclass_fields__  # type: ignore[attr-defined]
        limits = [fields[n].metadata for n in self.LINEAR]
        low = [-np.inf if m.get("low") is None else m["low"] for m in limits]
        high = [np.inf if m.get("high") is None else m["high"] for m in limits]
        return np.array(low, float), np.array(high, float)

    def with_coefficients(self, values: Float) -> Effect:
        """The same shape with other linear parameters (k,)."""
        changes: dict[str, Any] = {n: float(v) for n, v in zip(self.LINEAR, values, strict=True)}
        return replace(self, **changes)  # type: ignore[type-var]

    def columns(self, frame: Frame) -> Float:
        """(H, W, k) metres of z per unit of each coefficient; 0 where it does nothing."""
        return np.zeros((*frame.depth.shape, 0))

    def columns_at(self, frame: Frame, pixels: Ints) -> Float:
        """(n, k) of `columns` on chosen pixels (flat indices), without the rest where that is possible."""
        if self.LOCAL:
            return np.asarray(self.columns(frame.take(pixels))[0])
        full = self.columns(frame)
        return np.asarray(full.reshape(-1, full.shape[-1])[pixels])

    def bias(self, frame: Frame) -> Float:
        """(H, W) metres that the effect adds to the depth."""
        return np.asarray(self.columns(frame) @ self.coefficients)

    def apply(self, frame: Frame, rng: np.random.Generator) -> Frame:
        """The view after the effect; `rng` is for effects that scatter."""
        del rng
        return replace(frame, depth=frame.depth + self.bias(frame))


class FieldEffect(Effect):
    """An effect whose coefficients are one tuple in the field `values` (a map, a list of parts)."""

    __slots__ = ()

    LINEAR: ClassVar[tuple[str, ...]] = ("values",)

    def with_coefficients(self, values: Float) -> Effect:
        """The same shape with other values (k,)."""
        return replace(self, values=tuple(float(v) for v in values))  # type: ignore[type-var]


def stack(columns: Sequence[Float], frame: Frame) -> Float:
    """Join (H, W) columns into (H, W, k), 0 where a value is not finite."""
    if not columns:
        return np.zeros((*frame.depth.shape, 0))
    return np.nan_to_num(np.stack(columns, axis=-1), nan=0.0, posinf=0.0, neginf=0.0)
