# SPDX-License-Identifier: Apache-2.0
"""An error along the ray that no named effect owns: a hypothesis, so that no named effect stands in for it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, ClassVar

import numpy as np

if TYPE_CHECKING:
    from tof_core.arrays import Float, Ints
    from tof_gap.seen.evidence.view import ViewEvidence


class Nameless(ABC):
    """An error that depends on the observable `quantity`, in columns less their means over the session's pixels: a constant is an offset.

    FORMULA: whether it is a formula, and no function that fits any error; RIVALS: effects that no hypothesis contains beside it.
    """

    __slots__ = ()
    FORMULA: ClassVar[bool] = False
    RIVALS: ClassVar[frozenset[str]] = frozenset()
    quantity: str
    means: tuple[float, ...]

    @abstractmethod
    def along_ray(self, view: ViewEvidence, at: Ints) -> Float:
        """(n, k) columns along the ray at pixels (flat indices), means included; NaN where unknown."""

    def columns(self, view: ViewEvidence) -> Float:
        """(n, k) at a view's drawn pixels: metres of z per metre along the ray."""
        return self._along_z(view, view.pixels)

    def share(self, values: Float, view: ViewEvidence) -> Float:
        """(H, W) metres of z for `values` (k,), metres along the ray."""
        every = np.arange(view.residual.size)
        return np.asarray((self._along_z(view, every) @ values).reshape(view.residual.shape))

    def _along_z(self, view: ViewEvidence, at: Ints) -> Float:
        return np.asarray(np.nan_to_num(self.along_ray(view, at) - self.means) / view.frame.length.ravel()[at, None])


def inverse_light(view: ViewEvidence, at: Ints) -> Float:
    """(n, 1) inverse of the pixels' own light (flat indices); NaN without light."""
    light = view.frame.amplitude.ravel()[at]
    return np.where(light > 0, 1.0 / np.maximum(light, 1e-12), np.nan)[:, None]
