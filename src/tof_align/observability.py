# SPDX-License-Identifier: Apache-2.0
"""Degenerate directions: motions that the data do not determine, described by axes, mm and degrees.

A direction is judged by the ratio of the data's standard deviation to the robot's. (A threshold on eigenvalues of the Hessian, as in
Zhang 2016, has no unit that a user can set.) Eigenvectors are mapped to axes, as in X-ICP and DCReg.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tof_core import se3

if TYPE_CHECKING:
    from tof_align.config import VerdictConfig
    from tof_core.arrays import Float

AXES = np.array([[1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0]])
NO_TURN, NO_SLIDE = 0.05, 0.05
"""Turn and slide in a unit direction below which they are not mentioned: 3 degrees beside it."""
SCREW = 0.2
"""Slide along the axis of a turn, as a share of the unit direction, from which both are mentioned."""
SAME_AXIS_DEG = 8.0
"""Angle to an axis of the cell within which a direction has the axis's name."""
MOST_SLIDE_M, MOST_TURN_DEG = 10.0, 180.0
"""Largest standard deviations that are stated: larger than a cell, and any rotation."""


@dataclass(frozen=True, slots=True, eq=False)
class Observability:
    """Directions of a rigid motion about `centre`, with the cell's axes, that the data do or do not determine.

    null (k, 6): orthonormal degenerate directions in (x, y, z, lever * rotX, lever * rotY,
    lever * rotZ); names (k,): in words; rank: 6 - k; data_std (6,) ascending:
    standard deviations of the data alone along the eigenvectors, metres.
    """

    null: Float
    names: tuple[str, ...]
    data_std: Float
    centre: Float
    lever: float

    @property
    def rank(self) -> int:
        """Number of the six directions that the data determine."""
        return 6 - len(self.null)

    def at(self, point: Float) -> Float:
        """The same directions for motions about another point (cell frame), orthonormal again."""
        if not len(self.null):
            return self.null
        scale = np.repeat([1.0, self.lever], 3)
        v, w = np.split(self.null / scale, 2, axis=1)
        there = np.concatenate([v + np.cross(w, point - self.centre), w], axis=1) * scale
        return np.asarray(np.linalg.qr(there.T)[0].T)


def centred(T_cell_frame: Float, centre: Float) -> Float:
    """(6, 6): Jacobian of the motion about `centre`, with the cell's axes, by a right perturbation of a frame."""
    at_centre = np.eye(4)
    at_centre[:3, 3] = centre
    return se3.adjoint(se3.inverse(at_centre) @ T_cell_frame)


def observe(info: Float, root: Float, T_cell_frame: Float, centre: Float, *, lever: float, ratio: float) -> Observability:
    """Split motions into known and degenerate directions.

    Args:
        info: (6, 6) information of the data alone about a right perturbation of the frame.
        root: (6, 6) with root @ root.T the covariance of the robot's pose in that frame.
        T_cell_frame: the frame.
        centre: (3,) cell frame; the point about which degenerate directions turn.
        lever: metres that count as much as one radian.
        ratio: a direction is known if the data's standard deviation is below ratio times the robot's.
    """
    to_y = np.repeat([1.0, lever], 3)[:, None] * centred(T_cell_frame, centre)
    back = np.linalg.inv(to_y)
    values, vectors = np.linalg.eigh(back.T @ (0.5 * (info + info.T)) @ back)
    data = 1.0 / np.sqrt(np.maximum(values, 1e-12))
    prior = np.sqrt(((vectors.T @ (to_y @ root)) ** 2).sum(1))
    open_ = data > ratio * prior
    null = _tidy(vectors[:, open_].T)
    names = tuple(
        f"{describe(n, centre, lever)} (data {_amount(n, spread(n, vectors, data), lever)}, robot "
        f"{_amount(n, float(np.sqrt(((n @ (to_y @ root)) ** 2).sum())), lever)})"
        for n in null
    )
    return Observability(null, names, np.sort(data), centre, lever)


def observe_block(cov: Float, prior: Float, T_cell_frame: Float, centre: Float, config: VerdictConfig) -> Observability:
    """Split motions into known and degenerate directions, from posterior and prior covariance (6, 6) of the frame."""
    root = np.linalg.cholesky(prior)
    inverse = np.linalg.inv(root)
    values, vectors = np.linalg.eigh(inverse @ cov @ inverse.T)
    values = np.clip(values, 1e-12, 1.0 - 1e-9)
    white = inverse.T @ vectors
    info = (white * (1.0 / values - 1.0)) @ white.T
    return observe(info, np.asarray(root, float), T_cell_frame, centre, lever=config.lever_m, ratio=config.null_ratio)


def most_disputed(seen: Observability, T_cell_frame: Float, agreeing: Float, everyone: Float, prior: Float) -> tuple[float, str]:
    """The known direction with the least share of information from agreeing pixels: that share, and the direction in words.

    A flat wall agrees wherever it is slid to, and only few pixels determine the slide. If most of these disagree, the agreement of the
    others must not make the pose acceptable.

    Args:
        seen: degenerate directions, which are not judged.
        T_cell_frame: the frame.
        agreeing: (6, 6) information of the pixels that agree, about a right perturbation of the frame.
        everyone: (6, 6) the same of all pixels.
        prior: (6, 6) the same of the robot.
    """
    to_y = np.repeat([1.0, seen.lever], 3)[:, None] * centred(T_cell_frame, seen.centre)
    known = np.linalg.svd(seen.null.reshape(-1, 6))[2][len(seen.null) :].T
    if not known.size:
        return 1.0, ""
    back = np.linalg.solve(to_y, known)
    root = np.linalg.inv(np.linalg.cholesky(back.T @ (everyone + prior) @ back))
    shares, vectors = np.linalg.eigh(root @ back.T @ (agreeing + prior) @ back @ root.T)
    direction = known @ root.T @ vectors[:, 0]
    return float(shares[0]), describe(direction / np.linalg.norm(direction), seen.centre, seen.lever)


def pinned(o: Observability, T_cell_frame: Float, moved: Float, strength: float = 1e12) -> tuple[Float, Float]:
    """Information (6, 6) and right side (6,) that hold a frame at its former pose along degenerate directions.

    moved (4, 4): motion of the frame so far, as a left factor in the cell.
    """
    if not len(o.null):
        return np.zeros((6, 6)), np.zeros(6)
    N = o.null @ (np.repeat([1.0, o.lever], 3)[:, None] * centred(T_cell_frame, o.centre))
    so_far = np.concatenate([se3.apply(moved, o.centre) - o.centre, o.lever * se3.so3_log(moved[:3, :3])])
    return strength * N.T @ N, -strength * N.T @ (o.null @ so_far)


def spread(direction: Float, vectors: Float, std: Float) -> float:
    """Standard deviation along a unit direction, of a Gaussian with these principal axes."""
    return float(np.sqrt((((direction @ vectors) * std) ** 2).sum()))


def _amount(direction: Float, std: float, lever: float) -> str:
    """A standard deviation in mm for slides and in degrees for turns, at most `MOST_SLIDE_M` and `MOST_TURN_DEG`."""
    if np.linalg.norm(direction[:3]) >= np.linalg.norm(direction[3:]):
        return f"±{std * 1000:.3g} mm" if std < MOST_SLIDE_M else "nothing"
    degrees = np.degrees(std / lever)
    return f"±{degrees:.2g}°" if degrees < MOST_TURN_DEG else "nothing"


def describe(direction: Float, centre: Float, lever: float) -> str:
    """A unit direction in words: a slide along an axis, a turn about an axis through a point, or both."""
    v, w = direction[:3], direction[3:] / lever
    turn = float(np.linalg.norm(w)) * lever
    if turn < NO_TURN:
        return f"slides along {_axis(v)}"
    axis = w / np.linalg.norm(w)
    pitch = float(v @ axis)
    through = np.round(centre + np.cross(w, v) / (w @ w), 2) + 0.0
    if abs(pitch) > SCREW * np.linalg.norm(direction):
        return f"slides along and turns about {_axis(axis)}"
    if np.linalg.norm(v - pitch * axis) < NO_SLIDE:
        return f"turns about {_axis(axis)}"
    return f"turns about {_axis(axis)} through ({through[0]:.2f}, {through[1]:.2f}, {through[2]:.2f}) m"


def _axis(v: Float) -> str:
    v = v / np.linalg.norm(v)
    nearest = int(np.argmax(np.abs(v)))
    if abs(v[nearest]) > np.cos(np.radians(SAME_AXIS_DEG)):
        return f"cell {'xyz'[nearest]}"
    v = v * np.sign(v[nearest])
    return f"cell ({v[0]:.2f}, {v[1]:.2f}, {v[2]:.2f})"


def _tidy(null: Float) -> Float:
    """Another basis of the subspace: pure slides first, and directions as near to the cell's axes as possible."""
    if not len(null):
        return null.reshape(0, 6)
    _, sizes, mix = np.linalg.svd(null[:, 3:].T, full_matrices=True)
    sizes = np.concatenate([sizes, np.zeros(len(mix) - len(sizes))])
    slides, turns = mix[sizes < NO_TURN] @ null, mix[sizes >= NO_TURN] @ null
    return np.concatenate([_along_axes(slides, slice(0, 3)), _along_axes(turns, slice(3, 6))])


def _along_axes(null: Float, part: slice) -> Float:
    """Rotate a basis within its span towards the cell's axes, best match first."""
    out = np.zeros((0, 6))
    while len(null):
        share = np.linalg.norm(null[:, part], axis=0)
        axis = np.zeros(6)
        axis[part.start + int(np.argmax(np.round(share, 4)))] = 1.0
        along = null.T @ (null @ axis)
        along /= np.linalg.norm(along)
        out = np.concatenate([out, along[None]])
        keep = np.linalg.svd((null @ along)[None])[2][1:]
        null = keep @ null
    return out
