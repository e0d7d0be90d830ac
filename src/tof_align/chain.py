# SPDX-License-Identifier: Apache-2.0
"""The pose chain T_cell_camera = B_station T_cell_body T_body_camera A_view X, and the Jacobian of each link."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol

import numpy as np

from tof_core import se3
from tof_core.errors import TransformError

if TYPE_CHECKING:
    from collections.abc import Sequence
    from typing import Self

    from tof_align.config import Priors
    from tof_align.pixels import Sample
    from tof_core.arrays import Float, Ints
    from tof_core.capture import RobotPose, View


class Rig(Protocol):
    """Pose unknowns of cameras: `globals_` of them are shared by views, `own` belong to each view."""

    @property
    def globals_(self) -> int:
        """Pose unknowns that views share."""

    @property
    def own(self) -> int:
        """Pose unknowns of each view."""

    def pose(self, view: int) -> Float:
        """T_cell_camera (4, 4)."""

    def where(self, view: int) -> Ints:
        """(s,) indices of the global unknowns that move this view's camera."""

    def links(self, view: int) -> tuple[Float, Float]:
        """(6, s), (6, own): the camera's right perturbation per global and per own unknown."""

    def prior(self) -> tuple[Float, Float, Float, Float]:
        """Inverse prior variances (G,), (own,), and deviation of the state from the prior's mean, (G,), (V, own)."""

    def moved(self, x: Float, own: Float) -> Self:
        """The rig after steps x (G,) and own (V, own)."""


@dataclass(frozen=True, slots=True, eq=False)
class Chain:
    """Poses of all cameras, for S stations and V views.

    station (V,): index of each view's station (0..S-1); names (S,): the stations' numbers;
    pivot (S, 4, 4): T_cell_pivot, the frame in which B's prior holds (the body where TF
    has one, else the middle of the cameras); robot (V, 4, 4): T_cell_camera by the robot.
    base (S, 4, 4), arm (V, 4, 4), hand_eye (4, 4): the corrections, with
    B = pivot @ base @ inv(pivot), A = arm, X = hand_eye.
    root (V, 6, 6): with root @ root.T the covariance of each arm pose, where each has its own; the arm's unknowns are then
    whitened, A = exp(root z), z ~ N(0, 1). None: the configured priors hold for every pose.
    """

    station: Ints
    names: tuple[int, ...]
    pivot: Float
    robot: Float
    base: Float
    arm: Float
    hand_eye: Float
    priors: Priors
    root: Float | None = None

    @property
    def globals_(self) -> int:
        """Base of every station, then hand-eye."""
        return 6 * len(self.names) + 6

    @property
    def own(self) -> int:
        """The arm's error."""
        return 6

    @property
    def B(self) -> Float:
        """(S, 4, 4): T_cell_body is really B @ T_cell_body."""
        return np.asarray(self.pivot @ self.base @ se3.inverse(self.pivot))

    def frame(self, s: int) -> Float:
        """Corrected T_cell_pivot (4, 4) of a station; a step of its base is a right perturbation of it."""
        return np.asarray(self.pivot[s] @ self.base[s])

    def pose(self, view: int) -> Float:
        """T_cell_camera (4, 4) of a view."""
        return np.asarray(self.B[self.station[view]] @ self.robot[view] @ self.arm[view] @ self.hand_eye)

    def where(self, view: int) -> Ints:
        """The unknowns of the station's base, and of hand-eye."""
        return np.concatenate([6 * self.station[view] + np.arange(6), 6 * len(self.names) + np.arange(6)])

    def links(self, view: int) -> tuple[Float, Float]:
        """(6, 12) for base and hand-eye, (6, 6) for the arm."""
        s = int(self.station[view])
        after_base = se3.inverse(self.pivot[s]) @ self.robot[view] @ self.arm[view] @ self.hand_eye
        base, arm = se3.adjoint(se3.inverse(after_base)), se3.adjoint(se3.inverse(self.hand_eye))
        return np.concatenate([base, np.eye(6)], axis=1), arm if self.root is None else np.asarray(arm @ self.root[view])

    def prior(self) -> tuple[Float, Float, Float, Float]:
        """By the configured priors."""
        p = self.priors
        info = np.concatenate([np.tile(p.base**-2, len(self.names)), p.hand_eye**-2])
        error = np.concatenate([*(se3.log(T) for T in self.base), se3.log(self.hand_eye)])
        arm = np.array([se3.log(T) for T in self.arm])
        if self.root is None:
            return info, p.arm**-2, error, arm
        return info, np.ones(6), error, np.linalg.solve(self.root, arm[..., None])[..., 0]

    def prior_cov(self, view: int) -> Float:
        """(6, 6) of the right perturbation of the robot's own pose of a camera."""
        shared, own = self.links(view)
        std = np.concatenate([self.priors.base, self.priors.hand_eye])
        arm = self.priors.arm if self.root is None else np.ones(6)
        return np.asarray((shared * std**2) @ shared.T + (own * arm**2) @ own.T)

    def moved(self, x: Float, own: Float) -> Chain:
        """The chain after right perturbations of base, hand-eye and arm."""
        steps = x[: self.globals_].reshape(-1, 6)
        own = own[:, :6] if self.root is None else np.einsum("vij,vj->vi", self.root, own[:, :6])
        return replace(
            self,
            base=np.array([T @ se3.exp(d) for T, d in zip(self.base, steps[:-1], strict=True)]),
            arm=np.array([T @ se3.exp(d) for T, d in zip(self.arm, own, strict=True)]),
            hand_eye=self.hand_eye @ se3.exp(steps[-1]),
        )

    def subset(self, views: Sequence[int]) -> Chain:
        """Some views only; all stations stay."""
        at = list(views)
        root = None if self.root is None else self.root[at]
        return replace(self, station=self.station[at], robot=self.robot[at], arm=self.arm[at], root=root)


@dataclass(frozen=True, slots=True, eq=False)
class Single:
    """One camera with a full prior covariance: T_cell_camera = T_prior exp(root z), z ~ N(0, 1)."""

    T_prior: Float
    T: Float
    root: Float

    @property
    def globals_(self) -> int:
        """The pose."""
        return 6

    @property
    def own(self) -> int:
        """None."""
        return 0

    def pose(self, view: int) -> Float:  # noqa: ARG002
        """The one pose."""
        return self.T

    def where(self, view: int) -> Ints:  # noqa: ARG002
        """All six."""
        return np.arange(6)

    def links(self, view: int) -> tuple[Float, Float]:  # noqa: ARG002
        """The root of the covariance, since the unknowns are whitened."""
        return self.root, np.zeros((6, 0))

    def prior(self) -> tuple[Float, Float, Float, Float]:
        """A unit normal."""
        z = np.linalg.solve(self.root, se3.log(se3.inverse(self.T_prior) @ self.T))
        return np.ones(6), np.zeros(0), np.asarray(z, float), np.zeros((1, 0))

    def moved(self, x: Float, own: Float) -> Single:  # noqa: ARG002
        """The pose after a whitened step."""
        return replace(self, T=self.T @ se3.exp(self.root @ x[:6]))


def chain_of(views: Sequence[View | Sample], priors: Priors) -> Chain:
    """The chain by the robot's poses; a view without one is refused."""
    missing = [v.stamp_ns for v in views if v.robot is None]
    if missing:
        msg = f"{len(missing)} of {len(views)} views have no robot pose (first stamp {missing[0]})"
        raise TransformError(msg, where="alignment", todo="record /tf, or give --initial-pose")
    names = tuple(sorted({v.station for v in views}))
    station = np.array([names.index(v.station) for v in views])
    robot = np.array([v.robot.T_cell_camera for v in views if v.robot is not None])
    pivot = np.array([_pivot([v for v in views if v.station == name]) for name in names])
    eye = np.eye(4)
    base, arm = np.tile(eye, (len(names), 1, 1)), np.tile(eye, (len(views), 1, 1))
    return Chain(station, names, pivot, robot, base, arm, eye, priors, _roots([v.robot for v in views if v.robot is not None]))


def _roots(robots: Sequence[RobotPose]) -> Float | None:
    """(V, 6, 6) factors of the poses' own covariances, None where not every pose has one."""
    covs = [r.cov for r in robots if r.cov is not None]
    return np.linalg.cholesky(np.stack(covs)) if len(covs) == len(robots) else None


def _pivot(views: Sequence[View | Sample]) -> Float:
    """The body's frame; without one, the middle of the cameras with the cell's axes."""
    robots = [v.robot for v in views if v.robot is not None]
    if not np.allclose(robots[0].T_cell_body, np.eye(4)):
        return robots[0].T_cell_body
    middle = np.eye(4)
    middle[:3, 3] = np.mean([r.T_cell_camera[:3, 3] for r in robots], axis=0)
    return middle
