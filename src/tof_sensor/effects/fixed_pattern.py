# SPDX-License-Identifier: Apache-2.0
"""Fixed pattern: signal run time differs over the array, above all by column and row."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from tof_core.config import param
from tof_sensor.effect import FieldEffect, stack

if TYPE_CHECKING:
    from tof_core.arrays import Float, Ints
    from tof_sensor.frame import Frame


@dataclass(frozen=True, slots=True)
class FixedPattern(FieldEffect):
    """dr(u, v) = one value per column, per row, and a smooth field (TOF_EFFECTS A.4).

    `values` are W columns, H rows, then `order`^2 - 1 cosines (DCT-II) without the constant,
    which is `range_offset`'s.
    """

    NAME: ClassVar[str] = "fixed_pattern"
    LOCAL: ClassVar[bool] = False

    values: tuple[float, ...] = ()
    order: int = param(4, "smooth field: cosines per axis", low=1, high=16)

    def columns(self, frame: Frame) -> Float:
        """(H, W, W + H + order^2 - 1), dense."""
        every = self.columns_at(frame, np.arange(frame.depth.size))
        return every.reshape(*frame.depth.shape, -1)

    def columns_at(self, frame: Frame, pixels: Ints) -> Float:
        """One column per raster column, per row, and per cosine, along z."""
        h, w = frame.depth.shape
        row, column = np.divmod(pixels, w)
        out = np.zeros((len(pixels), w + h + self.order**2 - 1))
        out[np.arange(len(pixels)), column] = 1.0
        out[np.arange(len(pixels)), w + row] = 1.0
        out[:, w + h :] = cosines(h, w, self.order)[row, column]
        return out * np.where(frame.valid, 1 / frame.length, 0).ravel()[pixels, None]

    def bias(self, frame: Frame) -> Float:
        """The pattern along z, without building the dense columns."""
        if not self.values:
            return np.zeros(frame.depth.shape)
        h, w = frame.depth.shape
        v = np.asarray(self.values)
        field = v[:w][None, :] + v[w : w + h][:, None] + cosines(h, w, self.order) @ v[w + h :]
        return stack([np.where(frame.valid, field / frame.length, 0)], frame)[..., 0]


@lru_cache(maxsize=8)
def cosines(height: int, width: int, order: int) -> Float:
    """(H, W, order^2 - 1) products of cosines, largest value 1, constant left out."""
    y, x = (np.arange(height) + 0.5) / height, (np.arange(width) + 0.5) / width
    fields = [np.cos(np.pi * i * y)[:, None] * np.cos(np.pi * j * x)[None, :] for i in range(order) for j in range(order) if i + j]
    return np.stack(fields, axis=-1) if fields else np.zeros((height, width, 0))
