# SPDX-License-Identifier: Apache-2.0
"""Fixed pattern: signal delays differ over the array, mainly by column and row."""

from __future__ import annotations

import base64
import binascii
import zlib
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from tof_core.config import param
from tof_core.errors import ConfigError
from tof_sensor.action import ASIDE, FARTHER, NEARER
from tof_sensor.effect import FieldEffect, Form, stack

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tof_core.arrays import Float, Ints
    from tof_sensor.frame import Frame
    from tof_sensor.session import Session


@dataclass(frozen=True, slots=True)
class FixedPattern(FieldEffect):
    """dr(u, v) = one value per column, per row, a smooth field (docs/effects.md), areas of pixels, and single pixels.

    `values` are W columns, H rows, then `order`^2 - 1 cosines (DCT-II) without the constant, which is
    `range_offset`. `areas` and `pixels` are images as text (`packed`), empty if areas or pixels do not differ.
    """

    NAME: ClassVar[str] = "fixed_pattern"
    ORDER: ClassVar[int] = 54
    MEANING: ClassVar[str] = "each pixel, column, row or corner of the sensor has its own offset"
    REMEDY: ClassVar[str] = "renew the camera's pixel calibration at a flat wall, from several distances"
    SEPARATED_BY: ClassVar[str] = "a flat wall seen from several distances"
    ACTIONS: ClassVar = (ASIDE, NEARER, FARTHER)
    LOCAL: ClassVar[bool] = False
    IN_IMAGE: ClassVar[bool] = True

    values: tuple[float, ...] = ()
    order: int = param(4, "smooth field: cosines per axis", low=1, high=16)
    lines: int = param(
        0, "cosines of columns and of rows that are fitted beyond those of the smooth field, up to this number", low=0, high=64
    )
    areas: str = param("", "errors of areas of pixels beyond that: an image as of `pixels`")
    pixels: str = param("", "errors of single pixels beyond that: int16 in steps of 10 um, row after row, deflated, base64")

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
        """The pattern along z, without building the dense columns.

        Raises:
            ConfigError: the pattern belongs to another raster.
        """
        h, w = frame.depth.shape
        field = sum((unpacked(image, (h, w)) for image in (self.areas, self.pixels) if image), np.zeros((h, w)))
        if self.values:
            v = np.asarray(self.values)
            if len(v) != w + h + self.order**2 - 1:
                raise _other_raster((h, w))
            field = field + v[:w][None, :] + v[w : w + h][:, None] + cosines(h, w, self.order) @ v[w + h :]
        return stack([np.where(frame.valid, field / frame.length, 0)], frame)[..., 0]

    def prior_sd(self, scale: Float) -> Float:
        """(k,) prior: falling with the squared frequency for the field's cosines, with the frequency for those of lines; `REACH_M` for lines.

        Delays over an array are smooth: between pixels with data, the prior keeps the field from bending.
        """
        i, j = np.mgrid[: self.order, : self.order].reshape(2, -1)[:, 1:]
        sd = np.full(len(scale), self.REACH_M)
        sd[: len(i)] /= i**2 + j**2
        blocks = np.tile(np.arange(self.order, max(self.order, self.lines)), 2)
        sd[len(i) : len(i) + len(blocks)] /= blocks
        return sd

    @property
    def free_form(self) -> bool:
        """Whether columns and rows are free."""
        return self.lines > 0

    @property
    def smooth(self) -> FixedPattern:
        """The pattern without single pixels."""
        return replace(self, pixels="")

    @classmethod
    def hypotheses(cls, session: Session) -> Iterator[Form]:
        """A tilt, a smooth field, and a field with blocks of columns and rows; lines and pixels are estimated from residuals."""
        del session
        yield Form(cls(order=TILT), "tilt")
        yield Form(cls(), "smooth field")
        yield Form(cls(lines=BLOCKS), "blocks of columns and rows")


TILT = 2
"""Cosines per axis of a pattern that is a tilt: few views determine it, but not a field of 15 cosines."""
BLOCKS = 16
"""Cosines of columns and of rows: clock buffers drive groups of lines wider than the neighbourhood to which lines are compared."""
STEP_M = 1e-5
"""Step of `pixels` in metres: far below any camera's depth step; int16 reaches 0.3 m."""


def packed(image: Float) -> str:
    """`pixels` of an image (H, W) in metres along the ray."""
    steps = np.clip(np.rint(image / STEP_M), -32767, 32767).astype("<i2")
    return base64.b64encode(zlib.compress(steps.tobytes(), 9)).decode("ascii")


@lru_cache(maxsize=8)
def unpacked(pixels: str, shape: tuple[int, int]) -> Float:
    """(H, W) metres along the ray from `pixels`; inflates at most the size of the raster."""
    size = 2 * shape[0] * shape[1]
    try:
        data = zlib.decompressobj().decompress(base64.b64decode(pixels, validate=True), size + 1)
    except (binascii.Error, ValueError, zlib.error):
        data = b""
    if len(data) != size:
        raise _other_raster(shape)
    return STEP_M * np.frombuffer(data, "<i2").reshape(shape).astype(np.float64)


def _other_raster(shape: tuple[int, int]) -> ConfigError:
    msg = f"is not of the camera's raster ({shape[1]}x{shape[0]})"
    return ConfigError(msg, where=FixedPattern.NAME, todo="take the sensor.yaml of this camera, or leave the effect out")


@lru_cache(maxsize=8)
def cosines(height: int, width: int, order: int) -> Float:
    """(H, W, order^2 - 1) products of cosines, largest value 1, constant left out."""
    y, x = (np.arange(height) + 0.5) / height, (np.arange(width) + 0.5) / width
    fields = [np.cos(np.pi * i * y)[:, None] * np.cos(np.pi * j * x)[None, :] for i in range(order) for j in range(order) if i + j]
    return np.stack(fields, axis=-1) if fields else np.zeros((height, width, 0))


@lru_cache(maxsize=8)
def line_cosines(count: int, low: int, high: int) -> Float:
    """(count, high - low) cosines number `low` to `high` - 1 over `count` columns or rows, largest value 1."""
    at = (np.arange(count) + 0.5) / count
    return np.cos(np.pi * np.arange(low, max(low, high)) * at[:, None])
