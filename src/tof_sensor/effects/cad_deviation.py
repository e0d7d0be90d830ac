# SPDX-License-Identifier: Apache-2.0
"""CAD deviation: a part is moved or bent relative to its CAD, the same in every view."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from tof_core.config import param
from tof_sensor.action import ASIDE, FARTHER, NEARER
from tof_sensor.effect import FieldEffect, Form
from tof_sensor.geometry import cell_surface

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from tof_core.arrays import Float
    from tof_scene.scene import Part
    from tof_sensor.frame import Frame
    from tof_sensor.session import Session

RIGID, BOW = 6, 3
STATED_MM, STATED_DEG = 0.5, 0.1
"""Least displacement or bow, and least turn, that a text states: a healthy camera's errors are as large."""
UNCERTAIN = 0.2
"""Standard deviation over the size, from which a text states it: below, the digits that are printed hold."""
FACE = 0.25
"""Longest edge of a bent part's faces in half-sizes: between their corners a bow is then exact to a 64th."""
COEFFICIENT_SD = np.repeat([0.02, 0.1, 0.02], 3)
"""Prior of each coefficient (m, rad, m of bow): a part that slides in its own plane changes no pixel, so that only this prior holds it."""


@dataclass(frozen=True, slots=True)
class CadDeviation(FieldEffect):
    """Rigid motion plus bow of one part (docs/effects.md).

    `values`: translation (3) m, rotation about `centre` (3) rad, then bow (3) in metres at one
    half-size from the centre: u^2, v^2 and u v along `normal`, u and v across it. Cell frame.
    `bow_reach`: how far the seen surface reaches of u^2, v^2 and |u v|, 98 % quantiles: a pipe is narrow across.
    """

    NAME: ClassVar[str] = "cad_deviation"
    ORDER: ClassVar[int] = 0
    UNEVEN: ClassVar[float] = 0.15  # Of the scene: a real part may be bent in other shapes.
    ROUGH: ClassVar[float] = 0.04  # Of a bend that is no parabola, 0.54 mm of 3 were left.
    MEANING: ClassVar[str] = "a part stands or bends otherwise than drawn"
    REMEDY: ClassVar[str] = (
        "measure the part by other means (light from its neighbours can look alike); if it is off, put it back or correct the CAD"
    )
    SEPARATED_BY: ClassVar[str] = "a measurement of the part by other means"
    ACTIONS: ClassVar = (ASIDE, NEARER, FARTHER)
    REPEATS: ClassVar[bool] = True
    REACH_M: ClassVar[float] = 0.008  # Nine coefficients together must not fit the error of a single view.
    COEFFICIENTS: ClassVar[tuple[str, ...]] = (
        "x_m", "y_m", "z_m", "rx_rad", "ry_rad", "rz_rad", "bow_uu_m", "bow_vv_m", "bow_uv_m",
    )  # fmt: skip

    values: tuple[float, ...] = (0.0,) * (RIGID + BOW)
    part: int = param(0, "index of the part in the scene", low=0)
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)
    normal: tuple[float, float, float] = (0.0, 0.0, 1.0)
    half_size_m: float = param(0.1, "half of the part's largest side", unit="m", low=1e-4)
    bow_reach: tuple[float, ...] = (1.0,) * BOW

    @property
    def stated(self) -> str:
        """Displacement of the part's middle, turn about it, and bow, as far as the views show them; without what is too small to be read."""
        return self._stated(np.zeros(RIGID))

    def stated_to(self, std: Mapping[str, float]) -> str:
        """`stated`, with the standard deviation of a displacement or a turn that is uncertain; std: of the coefficients, by name.

        A part whose faces are seen from one side slides and turns in their plane without a change of depth.
        """
        return self._stated(np.array([std[name] for name in self.COEFFICIENTS[:RIGID]]))

    def _stated(self, sd: Float) -> str:
        values = np.asarray(self.values, float)
        moved_mm, shift_to = _length(values[:3], sd[:3], 1e3)
        turned_deg, turn_to = _length(values[3:RIGID], sd[3:], 180.0 / np.pi)
        bent_mm = 1e3 * float(np.abs(values[RIGID:] * self.bow_reach).max())
        says = [
            f"displaced by {moved_mm:.1f} mm{shift_to}" if moved_mm >= STATED_MM else "",
            f"turned by {turned_deg:.1f} degrees{turn_to}" if turned_deg >= STATED_DEG else "",
            f"bent by {bent_mm:.1f} mm" if bent_mm >= STATED_MM else "",
        ]
        return ", ".join(filter(None, says))

    @property
    def needs_scene(self) -> bool:
        """Yes: its part."""
        return True

    @property
    def rough(self) -> float:
        """`ROUGH` times the share of the deviation that is a bend: the map of a part that is only moved and turned is exact."""
        values = np.asarray(self.values, float)
        rigid2 = float(values[:3] @ values[:3] + self.half_size_m**2 * (values[3:RIGID] @ values[3:RIGID]))
        bent2 = float((values[RIGID:] * self.bow_reach) @ (values[RIGID:] * self.bow_reach))
        return self.ROUGH * bent2 / (bent2 + rigid2) if bent2 > 0.0 else 0.0

    def columns(self, frame: Frame) -> Float:
        """Change of z per unit of each of the nine values, on the pixels of the part."""
        at = np.flatnonzero(frame.rendering.part == self.part)
        points, per_motion = (image.reshape(-1, 3)[at] for image in cell_surface(frame))
        arm, bow, n = self._shape(points)
        out = np.zeros((frame.depth.size, RIGID + BOW))
        out[at, :3], out[at, 3:RIGID] = per_motion, np.cross(arm, per_motion)  # A turn w moves a point by w x arm.
        out[at, RIGID:] = bow * (per_motion @ n)[:, None]
        return out.reshape(*frame.depth.shape, RIGID + BOW)

    def motion(self, points: Float) -> Float:
        """(n, 3) metres by which points (n, 3) of the part's CAD are off, cell frame."""
        arm, bow, n = self._shape(points)
        values = np.asarray(self.values, float)
        return np.asarray(values[:3] + np.cross(values[3:RIGID], arm) + (bow @ values[RIGID:])[:, None] * n)

    def moved(self, part: Part) -> Part:
        """The part where it stands, as it is bent; its faces are divided, so that they can be bent."""
        fine = part.divided(FACE * self.half_size_m) if any(self.values[RIGID:]) else part
        return replace(fine, vertices=fine.vertices + self.motion(fine.vertices))

    def _shape(self, points: Float) -> tuple[Float, Float, Float]:
        """Of points (n, 3): lever arms (n, 3) about the centre, the three bows (n, 3) per metre, and their direction (3,)."""
        arm = points - self.centre
        n = np.asarray(self.normal, float) / np.linalg.norm(self.normal)
        u_axis = np.cross(n, np.eye(3)[np.argmin(np.abs(n))])
        u_axis /= np.linalg.norm(u_axis)
        u, v = arm @ u_axis / self.half_size_m, arm @ np.cross(n, u_axis) / self.half_size_m
        return arm, np.stack([u * u, v * v, u * v], axis=-1), n

    def prior_sd(self, scale: Float) -> Float:
        """(9,) prior standard deviations: the smaller of `REACH_M` and `COEFFICIENT_SD`."""
        return np.asarray(np.minimum(self.REACH_M, COEFFICIENT_SD * scale))

    @classmethod
    def hypotheses(cls, session: Session) -> Iterator[Form]:
        """One form for each part with enough pixels."""
        for part, name in session.parts_seen():
            yield Form(cls.of(session, part), name)

    @classmethod
    def of(cls, session: Session, part: int) -> CadDeviation:
        """The deviation of a part, centred on its visible surface, with the bow along its mean normal."""
        points, normals = session.surface(part)
        low, high = np.quantile(points, [0.02, 0.98], axis=0)
        mean = normals.mean(axis=0)
        normal = mean if np.linalg.norm(mean) > 0.1 else np.array([0.0, 0.0, 1.0])
        made = cls(
            part=part,
            centre=_triple(0.5 * (low + high)),
            normal=_triple(normal / np.linalg.norm(normal)),
            half_size_m=float(max(0.5 * (high - low).max(), 1e-3)),
        )
        _, bow, _ = made._shape(points)
        return replace(made, bow_reach=_triple(np.quantile(np.abs(bow), 0.98, axis=0)))


def _triple(v: Float) -> tuple[float, float, float]:
    return float(v[0]), float(v[1]), float(v[2])


def _length(vector: Float, sd: Float, scale: float) -> tuple[float, str]:
    """Length of a vector times `scale`, and its standard deviation along itself in words, where it is uncertain."""
    length = float(np.linalg.norm(vector))
    off = float(np.linalg.norm(sd * vector)) / max(length, 1e-12)
    return scale * length, f" (±{scale * off:.1f})" if off > UNCERTAIN * length else ""
