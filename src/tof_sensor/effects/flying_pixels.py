# SPDX-License-Identifier: Apache-2.0
"""Flying pixels: a footprint on two surfaces adds their phasors; its depth is between or beside them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numba import njit

from tof_core.config import param
from tof_core.shares import in_percent
from tof_sensor.effect import Effect, stack
from tof_sensor.frame import LIGHT_M_PER_S, MODULATION

if TYPE_CHECKING:
    from tof_core.arrays import Float, Image, Ints, Mask
    from tof_sensor.frame import Frame


@dataclass(frozen=True, slots=True)
class FlyingPixels(Effect):
    """(1 - m) A1 e^{j phi1} + m A2 e^{j phi2}, m the second surface's share (docs/effects.md).

    `share` interpolates between the depth of the larger surface (0) and the full mixture (1). A1 and A2 are the
    amplitudes of unmixed pixels beside the edge, on the first and on the second surface.
    """

    NAME: ClassVar[str] = "flying_pixels"
    ORDER: ClassVar[int] = 34
    MEANING: ClassVar[str] = "pixels at edges see two surfaces at once and lie between them"
    REMEDY: ClassVar[str] = "switch on the camera's edge filter, or mask pixels at depth edges"
    LOCAL: ClassVar[bool] = False
    LINEAR: ClassVar[tuple[str, ...]] = ("share",)

    share: float = param(0.0, "1: the footprint's phasors add in full", low=0.0, high=1.5)
    footprint_px: float = param(1.0, "side of a pixel's real footprint, for straight edges", unit="px", low=0.2, high=1.0)
    modulation_mhz: float = param(100.0, MODULATION, unit="MHz", low=5.0, high=400.0)

    @property
    def stated(self) -> str:
        """Share of full mixing."""
        return f"{in_percent(self.share)} of the mixing that the CAD's edges predict"

    def columns(self, frame: Frame) -> Float:
        """The mixture's depth minus the larger surface's, on mixed pixels."""
        edge = Edge.of(frame)
        out = np.zeros(frame.depth.shape)
        out[edge.where] = self.mixture(edge)
        return stack([out], frame)

    def mixture(self, edge: Edge) -> Float:
        """(n,) metres of z that mixing adds at the pixels of an edge."""
        wave = 4e6 * np.pi * self.modulation_mhz / LIGHT_M_PER_S
        m = np.clip(0.5 + (edge.mixed - 0.5) / self.footprint_px, 0.0, 1.0)
        ratio = m / np.maximum(1 - m, 1e-6) * edge.light
        # Phase is unwrapped to the stronger return's range.
        stronger = np.where(ratio > 1, edge.step, 0.0)
        sum_of_both = np.exp(-1j * wave * stronger) + ratio * np.exp(1j * wave * (edge.step - stronger))
        return np.asarray((stronger + np.angle(sum_of_both) / wave) / edge.length)


@dataclass(frozen=True, slots=True, eq=False)
class Edge:
    """A view's mixed pixels (n,).

    where: rows and columns; mixed: share of the second surface in the footprint; light: ratio of its amplitude to the first one's; step:
    metres along the ray from the first to the second surface; length: of the ray per metre of z.
    """

    where: tuple[Ints, Ints]
    mixed: Float
    light: Float
    step: Float
    length: Float

    @classmethod
    def of(cls, frame: Frame) -> Edge:
        """The mixed pixels of a view with both depths known."""
        share, other = np.nan_to_num(frame.rendering.mixed), frame.rendering.second
        rows, columns = np.nonzero((share > 0) & np.isfinite(other) & frame.valid)
        where = rows, columns
        own, second = frame.radial[where], other[where].astype(np.float64) * frame.length[where]
        A1, A2 = (neighbour_amplitude(frame, d)[where] for d in (frame.depth, other))
        light = np.where((A1 > 0) & (A2 > 0), A2 / np.maximum(A1, 1e-12), (own / second) ** 2)
        return cls(where, share[where].astype(np.float64), light, second - own, frame.length[where])


REACH_PX = 3
"""Distance in pixels from a mixed pixel within which its surfaces are searched."""
NEAR_M = 0.05
"""Depth difference in metres beyond which a neighbour is on another surface."""


def neighbour_amplitude(frame: Frame, depth: Float | Image) -> Float:
    """(H, W) amplitude of the unmixed neighbour whose depth is nearest to `depth`; 0 where there is none.

    Only mixed pixels are filled.
    """
    mixed = np.nan_to_num(frame.rendering.mixed) > 0
    rows, columns = np.nonzero(mixed)
    out = np.zeros(frame.depth.shape)
    out[rows, columns] = _nearest(
        rows, columns, np.asarray(depth, float)[rows, columns], frame.valid & ~mixed, frame.depth, frame.amplitude
    )
    return out


@njit(cache=True, nogil=True)
def _nearest(rows: Ints, columns: Ints, target: Float, clean: Mask, depth: Float, amplitude: Float) -> Float:
    """(n,) amplitude of the clean pixel around (row, column) whose depth is nearest to the target."""
    height, width = depth.shape
    found = np.zeros(len(rows))
    for i in range(len(rows)):
        best = np.inf
        for v in range(max(rows[i] - REACH_PX, 0), min(rows[i] + REACH_PX + 1, height)):
            for u in range(max(columns[i] - REACH_PX, 0), min(columns[i] + REACH_PX + 1, width)):
                # Surfaces may slope: at similar depths the nearer pixel is better.
                miss = abs(depth[v, u] - target[i]) + 1e-3 * np.hypot(v - rows[i], u - columns[i])
                if clean[v, u] and miss < min(best, NEAR_M):
                    best, found[i] = miss, amplitude[v, u]
    return found
