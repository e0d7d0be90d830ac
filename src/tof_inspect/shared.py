# SPDX-License-Identifier: Apache-2.0
"""Errors common to the pixels of a part: of the camera poses, and of the camera, as estimated by the session's solution."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from tof_align.camera_error import beyond_data, camera_columns
from tof_align.discrepancy import LOCAL, SHARED
from tof_align.parts import MOTIONS, PART
from tof_align.system import FREE_PART_M, unmodelled
from tof_align.view_columns import columns_of
from tof_core import se3

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from tof_align.config import DiscrepancyConfig
    from tof_align.session import SessionSolution
    from tof_core.arrays import Float, Ints
    from tof_core.capture import Posed


BEYOND = 3
"""Columns of errors that the solution does not model, each one unknown of unit variance for all views: at ranges and amplitudes outside
its data (`beyond_data`, 2 columns), and its remaining errors within (`Left`)."""
ALIKE = 0.3, 0.15
"""Sides of the cells of ln amplitude and of range (metres); pixels of a cell and its neighbour cells count as alike."""
LEAST_ALIKE = 12
"""Fewest alike pixels for a median."""


@dataclass(frozen=True, slots=True, eq=False)
class Left:
    """Residuals of all pixels in depth: cell (n, 2) of ln amplitude and range, left (n,) metres, part (n,).

    The modelled errors of the camera are subtracted; motions of parts and errors tied to a surface are not. Otherwise an error of the
    camera on a few dark surfaces would count as theirs, not as the camera's error on dark surfaces at this range.
    """

    cell: Ints
    left: Float
    part: Ints
    known: dict[tuple[int, int, int], float]

    @classmethod
    def of(cls, solution: SessionSolution) -> Left:
        """Residuals of all views; pixels without amplitude are in cells of their own."""
        system, kinds = solution.system, [*(name in OF_CAMERA for name in SHARED), *(name in OF_CAMERA for name in LOCAL)]
        cells: list[Ints] = []
        left: list[Float] = []
        for v, view in enumerate(system.views):
            described = unmodelled(columns_of(view, system.basis), system.rig, system.basis, solution.fitted, v)[:, kinds].sum(axis=1)
            left.append(view.residual - described)
            amplitude = np.full(len(view.residual), np.nan) if view.log_amplitude is None else view.log_amplitude
            cells.append(_cells(amplitude, view.depth * view.ray_length))
        return cls(np.concatenate(cells), np.concatenate(left), np.concatenate([v.part for v in system.views]), {})

    def at(self, log_amplitude: Float, radial: Float, part: int) -> Float:
        """(n,) metres: absolute median residual of alike pixels of other parts; 0 where there are too few."""
        cells, which = np.unique(_cells(log_amplitude, radial), axis=0, return_inverse=True)
        return np.array([self._median(int(a), int(r), part) for a, r in cells])[which.ravel()]

    def _median(self, amplitude: int, radial: int, part: int) -> float:
        key = amplitude, radial, part
        if key not in self.known:
            alike = (np.abs(self.cell - (amplitude, radial)) <= 1).all(axis=1) & (self.part != part)
            self.known[key] = abs(float(np.median(self.left[alike]))) if alike.sum() >= LEAST_ALIKE else 0.0
        return self.known[key]


def _cells(log_amplitude: Float, radial: Float) -> Ints:
    """(n, 2) cells of ln amplitude and range."""
    return np.floor(np.stack([np.nan_to_num(log_amplitude), radial], axis=1) / ALIKE).astype(np.int64)


OF_CAMERA = ("range", "amplitude", "image", "offset", "bend", "smooth")
"""Kinds of discrepancy that are errors of the camera."""


class SharedErrors(Protocol):
    """Estimated errors common to pixels, while one part is judged."""

    def pose(self, view: int) -> Float:
        """T_cell_camera (4, 4) of a view."""

    def columns(self, view: int, radial: Float, log_amplitude: Float, index: Ints) -> Float:
        """(n, k) change of z in metres of pixels of a view per unknown of the camera's errors; k may be zero."""

    def bias(self, view: int, columns: Float) -> Float:
        """(n,) estimated error of the camera in z at those pixels, metres."""

    def cov(self, maps: Mapping[int, tuple[Float, Float]]) -> Float:
        """(3, 3) covariance of the sum over views of pose_map @ xi + camera_map @ u.

        maps: per view pose_map (3, 6), of the camera's right perturbation, and camera_map (3, k), of the unknowns of `columns`.
        """


@dataclass(frozen=True, slots=True, eq=False)
class PosesAlone:
    """Views with given, independent poses; errors of the camera are not estimated."""

    posed: Sequence[Posed]

    def pose(self, view: int) -> Float:
        """The given pose."""
        return self.posed[view].T_cell_camera

    def columns(self, view: int, radial: Float, log_amplitude: Float, index: Ints) -> Float:  # noqa: ARG002
        """No columns."""
        return np.zeros((len(index), 0))

    def bias(self, view: int, columns: Float) -> Float:  # noqa: ARG002
        """Zeros."""
        return np.zeros(len(columns))

    def cov(self, maps: Mapping[int, tuple[Float, Float]]) -> Float:
        """Covariance by the poses."""
        return np.asarray(sum((A @ self.posed[v].cov_right @ A.T for v, (A, _) in maps.items()), np.zeros((3, 3))))


@dataclass(frozen=True, slots=True, eq=False)
class SessionErrors:
    """Poses and camera errors of a session's solution that does not use one part.

    x (G,), own (V, o), covariance (G, G): the solution of the linear system with that part free to be anywhere, so that a displaced part
    neither moves the cameras nor counts as an error of the camera.
    """

    solution: SessionSolution
    shapes: Sequence[tuple[int, int]]
    config: DiscrepancyConfig
    part: int
    left: Left
    x: Float
    own: Float
    covariance: Float

    @classmethod
    def of(
        cls, solution: SessionSolution, shapes: Sequence[tuple[int, int]], part: int, config: DiscrepancyConfig, left: Left
    ) -> SessionErrors:
        """Remove part number `part` of the scene from the solution (Woodbury's identity); the solution is unchanged if it has no columns."""
        system, answer = solution.system, solution.fitted
        at = np.flatnonzero(system.basis.parts.index == part)
        if not len(at):
            return cls(solution, shapes, config, part, left, answer.x, answer.own, answer.cov)
        start = system.rig.globals_ + sum(system.basis.shared) - MOTIONS * (len(system.basis.parts.index) - int(at[0]))
        mine = np.arange(start, start + MOTIONS)
        size = answer.sizes[f"{PART}{part}"]
        less = size**-2 - FREE_PART_M**-2
        if less <= 0:
            return cls(solution, shapes, config, part, left, answer.x, answer.own, answer.cov)
        rows = answer.cov[:, mine]
        gain = rows @ np.linalg.inv(answer.cov[np.ix_(mine, mine)] - np.eye(MOTIONS) / less)
        step = -gain @ answer.x[mine]
        own = answer.own - np.einsum("vij,vj->vi", answer.gain, step[answer.where])
        return cls(solution, shapes, config, part, left, answer.x + step, own, answer.cov - gain @ rows.T)

    def pose(self, view: int) -> Float:
        """The pose of the solution without the part."""
        rig, answer = self.solution.system.rig, self.solution.fitted
        shared, arm = rig.links(view)
        dx, own = self.x - answer.x, self.own[view] - answer.own[view]
        step = shared @ dx[rig.where(view)] + arm @ own[: rig.own]
        return np.asarray(self.solution.posed[view].T_cell_camera @ se3.exp(step))

    def columns(self, view: int, radial: Float, log_amplitude: Float, index: Ints) -> Float:
        """Columns of range, amplitude and image, common to all views; of the view alone; of errors that the solution does not model."""
        basis, start = self.solution.system.basis, self.solution.system.rig.globals_
        shared, local = camera_columns(basis, radial, log_amplitude, self.shapes[view], index)
        first, count = basis.shared[0], basis.shared[1]
        by_amplitude = shared[:, first : first + count] @ self.x[start + first : start + first + count]
        beyond = beyond_data(basis, radial, log_amplitude, by_amplitude, self.solution.sizes, self.config)
        left = self.left.at(log_amplitude, radial, self.part)
        return np.concatenate([shared, local, beyond, left[:, None]], axis=1)

    def bias(self, view: int, columns: Float) -> Float:
        """The columns times their estimated coefficients."""
        rig, m = self.solution.system.rig, sum(self.solution.system.basis.shared)
        shared = self.x[rig.globals_ : rig.globals_ + m]
        return np.asarray(columns @ np.concatenate([shared, self.own[view, rig.own :], np.zeros(BEYOND)]))

    def cov(self, maps: Mapping[int, tuple[Float, Float]]) -> Float:
        """Covariance by poses and camera errors, with their correlations within and between views."""
        answer, rig, m = self.solution.fitted, self.solution.system.rig, sum(self.solution.system.basis.shared)
        shared, beyond, out = np.zeros((3, len(self.x))), np.zeros((3, BEYOND)), np.zeros((3, 3))
        for v, (pose_map, camera_map) in maps.items():
            base, arm = rig.links(v)
            where = answer.where[v]
            on_shared = np.zeros((3, len(where)))
            on_shared[:, : base.shape[1]] = pose_map @ base
            on_shared[:, base.shape[1] : base.shape[1] + m] = camera_map[:, :m]
            on_own = np.concatenate([pose_map @ arm, camera_map[:, m:-BEYOND]], axis=1)
            beyond += camera_map[:, -BEYOND:]
            shared[:, where] += on_shared - on_own @ answer.gain[v]
            out += on_own @ answer.own_cov[v] @ on_own.T
        return np.asarray(out + shared @ self.covariance @ shared.T + beyond @ beyond.T)
