# SPDX-License-Identifier: Apache-2.0
"""Errors that the pixels of a part share: of the camera poses, and of the camera itself, as the solution of the session estimates them."""

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
"""Columns of what the solution does not describe, each one unknown of unit variance for all views: ranges and amplitudes that it did not
see (`beyond_data`), and what it leaves at those that it saw (`Left`)."""
ALIKE = 0.3, 0.15
"""Sides of the cells of ln amplitude and range (metres) in which, with their neighbours, pixels count as alike."""
LEAST_ALIKE = 12
"""Pixels that are alike from which their median is taken."""


@dataclass(frozen=True, slots=True, eq=False)
class Left:
    """What the solution leaves of the depth of all pixels: cell (n, 2) of ln amplitude and range, left (n,) metres, part (n,).

    The camera's described errors are off it, motions of parts and errors that stick to the surface are not: what only a few dark surfaces
    show would else pass for their own, and not for what the camera does to dark surfaces at this range.
    """

    cell: Ints
    left: Float
    part: Ints
    known: dict[tuple[int, int, int], float]

    @classmethod
    def of(cls, solution: SessionSolution) -> Left:
        """Of all views; pixels without amplitude have one of their own."""
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
        """(n,) metres: size of the median that is left of other parts' pixels that are alike; 0 where there are too few."""
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
"""Kinds of discrepancy that are the camera's own."""


class SharedErrors(Protocol):
    """What is known of the shared errors while one part is judged."""

    def pose(self, view: int) -> Float:
        """T_cell_camera (4, 4) of a view."""

    def columns(self, view: int, radial: Float, log_amplitude: Float, index: Ints) -> Float:
        """(n, k) metres of z of pixels of a view per unknown of the camera's errors; k may be zero."""

    def bias(self, view: int, columns: Float) -> Float:
        """(n,) metres of z: the estimated error of the camera at those pixels."""

    def cov(self, maps: Mapping[int, tuple[Float, Float]]) -> Float:
        """(3, 3) covariance of the sum over views of pose_map @ xi + camera_map @ u.

        maps: per view pose_map (3, 6), of the camera's right perturbation, and camera_map (3, k), of the unknowns of `columns`.
        """


@dataclass(frozen=True, slots=True, eq=False)
class PosesAlone:
    """Views with given poses: the poses are uncertain each by itself, of the camera's errors nothing is known."""

    posed: Sequence[Posed]

    def pose(self, view: int) -> Float:
        """The given pose."""
        return self.posed[view].T_cell_camera

    def columns(self, view: int, radial: Float, log_amplitude: Float, index: Ints) -> Float:  # noqa: ARG002
        """None."""
        return np.zeros((len(index), 0))

    def bias(self, view: int, columns: Float) -> Float:  # noqa: ARG002
        """Zero."""
        return np.zeros(len(columns))

    def cov(self, maps: Mapping[int, tuple[Float, Float]]) -> Float:
        """Of the poses."""
        return np.asarray(sum((A @ self.posed[v].cov_right @ A.T for v, (A, _) in maps.items()), np.zeros((3, 3))))


@dataclass(frozen=True, slots=True, eq=False)
class SessionErrors:
    """Poses and the camera's errors of a session solution in which one part has no vote.

    x (G,), own (V, o), cov (G, G): the solution of the linear system with that part free to stand anywhere, so that a displaced part
    neither moves the cameras nor passes for an error of the camera.
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
        """Take the vote of part number `part` of the scene off the solution (Woodbury's identity); one without columns has none."""
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
        """The solution's pose, moved by what the part's vote had moved it."""
        rig, answer = self.solution.system.rig, self.solution.fitted
        shared, arm = rig.links(view)
        dx, own = self.x - answer.x, self.own[view] - answer.own[view]
        step = shared @ dx[rig.where(view)] + arm @ own[: rig.own]
        return np.asarray(self.solution.posed[view].T_cell_camera @ se3.exp(step))

    def columns(self, view: int, radial: Float, log_amplitude: Float, index: Ints) -> Float:
        """Of range, amplitude and image, shared by the views; of the view alone; of ranges and amplitudes that the session did not see."""
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
        """Poses and the camera's errors together, with all their correlations within and between the views."""
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
