# SPDX-License-Identifier: Apache-2.0
"""The causal mode: each view's pose from the views so far, and the final solution at the end."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from tof_align import verdict as verdicts
from tof_align.approach import approach
from tof_align.carry import Carry
from tof_align.chain import Chain, chain_of
from tof_align.discrepancy import basis_of, least_sizes
from tof_align.known import removed_at, through_known
from tof_align.linearise import Linearised, linearise
from tof_align.mixed import Mixed, Normal, estimate, solve
from tof_align.observability import Observability, most_disputed, observe_block, pinned
from tof_align.pixels import Pixels, Sample, sample, take_pixels
from tof_align.robust import first_look, misfit, weigh
from tof_align.session import SessionSolution, solve_samples
from tof_align.system import assemble, camera_cov, camera_step, unmodelled
from tof_align.view_columns import columns_of
from tof_core import se3
from tof_core.capture import Posed

if TYPE_CHECKING:
    from tof_align.config import AlignConfig
    from tof_align.discrepancy import Basis
    from tof_align.known import Bias
    from tof_align.view_columns import ViewColumns
    from tof_core.arrays import Float
    from tof_core.capture import View
    from tof_scene.raycast import Raycaster

STILL = 1e-4
"""Step of a live camera (metres, radians) below which its fit ends: a tenth of the arm error."""
STEPS = 3
"""Most linearisations of a live view; its predicted pose is within the arm error."""


@dataclass(frozen=True, slots=True, eq=False)
class _Kept:
    """A view of this station as normal equations at the pose where it was linearised."""

    sample: Sample
    T_cell_camera: Float
    gram: Float
    arm: Float
    information: verdicts.Information


@dataclass(frozen=True, slots=True, eq=False)
class _Fit:
    """The new view at the end of a chain, fitted with the window; `answer`'s step is not taken yet."""

    chain: Chain
    basis: Basis
    lin: Linearised
    columns: ViewColumns
    weights: Float
    gram: Float
    normal: Normal
    answer: Mixed
    pull: tuple[Float, Float] | None


@dataclass(slots=True, eq=False)
class SessionAligner:
    """Poses of views as they arrive, each from itself and the views before it.

    A view is linearised at the pose that earlier views predict, and solved with the station's last `window` views, which are kept as
    small normal equations. Views that leave the window, and finished stations, remain as information about hand-eye and shared errors.
    `finish` solves the whole session again.

    caster: the scene; config: as for `solve_session` (in the modes per_view and robot, views are independent); window: views that are
    solved together; bias: known bias of the camera, removed at the predicted pose.
    """

    caster: Raycaster
    config: AlignConfig
    window: int = 24
    bias: Bias | None = None
    samples: list[Sample] = field(default_factory=list)
    _kept: list[_Kept] = field(default_factory=list)
    _chain: Chain | None = None
    _basis: Basis | None = None
    _carry: Carry | None = None
    _sizes: dict[str, float] = field(default_factory=dict)
    _start_ns: int | None = None

    def push(self, view: View) -> Posed:
        """The pose of a view, from the views so far.

        A refused view (too few pixels, fits nowhere, too large a step) gets the pose that the robot and earlier views predict. Its
        `accepted` is False, and it does not influence later views.

        Raises:
            TransformError: the view has no robot pose.
        """
        taken = sample(view, self.config.weights)
        robot = chain_of([taken], self.config.priors)
        session = self.config.mode == "session"
        predicted = self._predicted(taken) if session else robot
        if self.bias is not None:
            self._start_ns = self._start_ns or view.stamp_ns
            view = removed_at([view], [predicted.pose(-1)], self.caster, self.bias, self._start_ns)[0]
            taken = sample(view, self.config.weights)
        self.samples.append(taken)
        if session:
            live = take_pixels(view, self.config.weights, pixels=self.config.weights.live_pixels)
            posed = self._place(taken, live, predicted)
        else:
            posed = solve_samples([taken], self.caster, self.config).posed[0]
        return posed if self.bias is None else through_known([posed], [view], self.bias)[0]

    def finish(self) -> SessionSolution:
        """The final solution over all views pushed so far.

        Raises:
            RefusedError: there were none, or they fit nowhere.
        """
        return solve_samples(self.samples, self.caster, self.config)

    def reset(self) -> None:
        """Forget everything."""
        self.samples, self._kept, self._sizes = [], [], {}
        self._chain = self._basis = self._carry = self._start_ns = None

    def _place(self, taken: Sample, live: Pixels, predicted: Chain) -> Posed:
        lin = linearise(live, predicted.pose(len(self._kept)), self.caster, self.config.weights)
        if len(lin.residual) < self.config.verdict.min_pixels:
            return self._refused(predicted, verdicts.FEW_PIXELS, f"only {len(lin.residual)} pixels see the CAD")
        fit = self._fit(live, predicted, lin)
        seen = self._observe(fit.chain, fit.answer)
        kept = _pin(fit, seen)
        moved = fit.chain.moved(kept.x, kept.own)
        explained = unmodelled(fit.columns, fit.chain, fit.basis, kept, len(self._kept)).sum(axis=1)
        information = verdicts.information_of(fit.lin, fit.weights, self.config, explained).moved(
            fit.chain.links(len(self._kept))[0][:, :6]
        )
        verdict = self._judge(taken, fit, explained, information, moved, seen)
        if not verdict.accepted:
            return self._refused(predicted, verdict.short, verdict.reason)
        self._remember(taken, moved, fit, information)
        T = moved.pose(-1)
        cov = se3.cov_fixed_axes(T, camera_cov(fit.chain, fit.answer, len(self._kept) - 1))
        return Posed(T, cov, seen.at(T[:3, 3]), verdict=verdict.reason, short=verdict.short)

    def _fit(self, live: Pixels, chain: Chain, lin: Linearised) -> _Fit:
        """Gauss-Newton on the new view and the window; the answer's step is not taken yet."""
        last = len(self._kept)
        basis = self._basis or basis_of([lin], self.config.discrepancy.of_one_view, widen=1.6)
        weights = weigh(lin, first_look(lin, self.config.weights.shared), self.config.weights)
        fit = self._solved(chain, basis, lin, columns_of(lin, basis), weights)
        for _ in range(STEPS - 1):
            if np.abs(camera_step(chain, fit.answer, last)).max() < STILL:
                break
            chain = chain.moved(fit.answer.x, fit.answer.own)
            lin = linearise(live, chain.pose(last), self.caster, self.config.weights)
            columns = columns_of(lin, basis)
            smooth = unmodelled(columns, chain, basis, fit.answer, last)
            weights = weigh(lin, lin.residual - smooth.sum(axis=1), self.config.weights, misfit(smooth, self.config.weights.shared))
            fit = self._solved(chain, basis, lin, columns, weights)
        return fit

    def _judge(
        self, taken: Sample, fit: _Fit, explained: Float, information: verdicts.Information, moved: Chain, seen: Observability
    ) -> verdicts.Verdict:
        T_robot = _robot(taken)
        before = verdicts.fit_of(linearise(taken.coarse, T_robot, self.caster, self.config.weights), self.config)
        after = verdicts.fit_of(fit.lin, self.config, explained)
        for k in self._kept:
            information = information + k.information
        prior = np.diag(self.config.priors.base**-2)
        disputed = most_disputed(seen, fit.chain.frame(0), information.agreeing, information.everyone, prior)
        return verdicts.judge(before, after, T_robot, moved.pose(-1), _prior_cov(fit.chain), seen.names, self.config, disputed)

    def _predicted(self, taken: Sample) -> Chain:
        """The window's chain with the new view at its end; until a view of a station is accepted, its base is searched from afar."""
        if self._chain is None or self._chain.names != (taken.station,) or not self._kept:
            self._close_station()
            fresh = chain_of([taken], self.config.priors)
            if self._chain is not None:
                fresh = replace(fresh, hand_eye=self._chain.hand_eye)
            motion = approach([taken.coarse], fresh.pose(0)[None], fresh.frame(0), self.config.priors.base, self.caster, self.config)
            self._chain = replace(fresh, base=fresh.base @ motion)
        station = chain_of([*(k.sample for k in self._kept), taken], self.config.priors)
        arm = np.array([*(k.arm for k in self._kept), np.eye(4)])
        return replace(station, pivot=self._chain.pivot, base=self._chain.base, arm=arm, hand_eye=self._chain.hand_eye)

    def _solved(self, chain: Chain, basis: Basis, lin: Linearised, columns: ViewColumns, weights: Float) -> _Fit:
        """The window and the new view's normal equations together, with what is carried."""
        d = self.config.discrepancy
        gram = columns.gram(weights)
        at = [*(k.T_cell_camera for k in self._kept), lin.T_cell_camera]
        shifts = np.array([se3.log(se3.inverse(T_lin) @ chain.pose(v)) for v, T_lin in enumerate(at)])
        normal = assemble([*(k.gram for k in self._kept), gram], chain, basis, np.zeros(0), shifts)
        pull = None if self._carry is None else self._carry.at(chain)
        sizes = {kind: self._sizes.get(kind, d.start_mm * 1e-3) for kind in (*normal.kinds, *normal.own_kinds)}
        rounds = 3 if self._sizes else d.rounds
        answer = estimate(normal, sizes, rounds=rounds, low=least_sizes(sizes, basis, d), high=d.ceiling_mm * 1e-3, pull=pull)
        return _Fit(chain, basis, lin, columns, weights, gram, normal, answer, pull)

    def _observe(self, chain: Chain, answer: Mixed) -> Observability:
        centre = chain.robot[:, :3, 3].mean(axis=0)
        prior = np.diag(self.config.priors.base**2)
        return observe_block(answer.cov[:6, :6], prior, chain.frame(0), centre, self.config.verdict)

    def _remember(self, taken: Sample, moved: Chain, fit: _Fit, information: verdicts.Information) -> None:
        self._basis, self._sizes, self._chain = fit.basis, dict(fit.answer.sizes), moved
        self._kept = [replace(k, arm=arm) for k, arm in zip(self._kept, moved.arm, strict=False)]
        self._kept.append(_Kept(taken, fit.lin.T_cell_camera, fit.gram, moved.arm[-1], information))
        if len(self._kept) > self.window:
            self._fold(self._kept[:1])
            self._kept = self._kept[1:]

    def _fold(self, views: list[_Kept]) -> None:
        """Views leave the window: their information about base, hand-eye and shared errors is kept in `_carry`."""
        assert self._chain is not None
        assert self._basis is not None
        chain = chain_of([k.sample for k in views], self.config.priors)
        chain = replace(
            chain, pivot=self._chain.pivot, base=self._chain.base, hand_eye=self._chain.hand_eye, arm=np.array([k.arm for k in views])
        )
        shifts = np.array([se3.log(se3.inverse(k.T_cell_camera) @ chain.pose(v)) for v, k in enumerate(views)])
        normal = assemble([k.gram for k in views], chain, self._basis, np.zeros(0), shifts)
        self._carry = Carry.of(normal, self._sizes, chain, self._carry)

    def _close_station(self) -> None:
        """The base drives on: its pose is integrated out, the other information is kept."""
        if self._kept:
            self._fold(self._kept)
            self._kept = []
        if self._carry is not None and self._chain is not None:
            self._carry = self._carry.without_base(self._chain)

    def _refused(self, chain: Chain, short: str, reason: str) -> Posed:
        T = chain.pose(-1)
        return Posed(T, se3.cov_fixed_axes(T, _prior_cov(chain)), accepted=False, verdict=reason, short=short)


def _robot(taken: Sample) -> Float:
    assert taken.robot is not None
    return taken.robot.T_cell_camera


def _prior_cov(chain: Chain) -> Float:
    """(6, 6) covariance of the last view's camera by the robot's priors."""
    return replace(chain, base=np.eye(4)[None], hand_eye=np.eye(4)).prior_cov(-1)


def _pin(fit: _Fit, seen: Observability) -> Mixed:
    """Solve again with the base held at the robot's pose along directions that the data do not determine."""
    if not len(seen.null):
        return fit.answer
    G = fit.normal.info.size
    H, b = (np.zeros((G, G)), np.zeros(G)) if fit.pull is None else (fit.pull[0].copy(), fit.pull[1].copy())
    held = pinned(seen, fit.chain.frame(0), fit.chain.B[0])
    H[:6, :6] += held[0]
    b[:6] += held[1]
    return solve(fit.normal, fit.answer.sizes, (H, b))
