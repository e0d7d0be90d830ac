# SPDX-License-Identifier: Apache-2.0
"""The causal mode: each view's pose from the views so far, and the final solution at the end."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from tof_align import verdict as verdicts
from tof_align.approach import approach
from tof_align.carry import Carry
from tof_align.causal_fit import Fit, Kept, SharedErrors, basis_around, fit_view, is_new, pin
from tof_align.chain import Chain, chain_of
from tof_align.known import removed_at, through_known
from tof_align.linearise import Linearised, linearise
from tof_align.observability import Observability, most_disputed, observe_block
from tof_align.pixels import Pixels, Sample, sample, take_pixels
from tof_align.session import SessionSolution, solve_samples
from tof_align.system import assemble, camera_cov, unmodelled
from tof_core import se3
from tof_core.capture import Posed

if TYPE_CHECKING:
    from tof_align.config import AlignConfig
    from tof_align.known import Bias
    from tof_align.mixed import Mixed
    from tof_core.arrays import Float
    from tof_core.capture import View
    from tof_scene.raycast import Raycaster


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
    _kept: list[Kept] = field(default_factory=list)
    _chain: Chain | None = None
    _shared: SharedErrors | None = None
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
        self.samples, self._kept = [], []
        self._chain = self._shared = self._start_ns = None

    def _place(self, taken: Sample, live: Pixels, predicted: Chain) -> Posed:
        lin = linearise(live, predicted.pose(-1), self.caster, self.config.weights)
        if self._shared is not None and len(lin.residual) and is_new(self._shared.basis, lin):
            predicted = self._looking_elsewhere(taken, lin)
            lin = linearise(live, predicted.pose(-1), self.caster, self.config.weights)
        if len(lin.residual) < self.config.verdict.min_pixels:
            return self._refused(predicted, verdicts.FEW_PIXELS, f"only {len(lin.residual)} pixels see the CAD")
        shared = self._shared or SharedErrors(basis_around(lin, self.caster, self.config))
        fit = fit_view(live, predicted, lin, self._kept, shared, self.caster, self.config)
        seen = self._observe(fit.chain, fit.answer)
        kept = pin(fit, seen)
        moved = fit.chain.moved(kept.x, kept.own)
        explained = unmodelled(fit.columns, fit.chain, shared.basis, kept, len(self._kept)).sum(axis=1)
        information = verdicts.information_of(fit.lin, fit.weights, self.config, explained).moved(
            fit.chain.links(len(self._kept))[0][:, :6]
        )
        verdict = self._judge(taken, fit, explained, information, moved, seen)
        if not verdict.accepted:
            return self._refused(predicted, verdict.short, verdict.reason)
        self._remember(taken, moved, fit, shared, information)
        T = moved.pose(-1)
        cov = se3.cov_fixed_axes(T, camera_cov(fit.chain, fit.answer, len(self._kept) - 1))
        return Posed(T, cov, seen.at(T[:3, 3]), verdict=verdict.reason, short=verdict.short)

    def _judge(
        self, taken: Sample, fit: Fit, explained: Float, information: verdicts.Information, moved: Chain, seen: Observability
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

    def _observe(self, chain: Chain, answer: Mixed) -> Observability:
        centre = chain.robot[:, :3, 3].mean(axis=0)
        prior = np.diag(self.config.priors.base**2)
        return observe_block(answer.cov[:6, :6], prior, chain.frame(0), centre, self.config.verdict)

    def _remember(self, taken: Sample, moved: Chain, fit: Fit, shared: SharedErrors, information: verdicts.Information) -> None:
        self._shared, self._chain = replace(shared, sizes=dict(fit.answer.sizes), misfit_m=fit.misfit_m), moved
        self._kept = [replace(k, arm=arm) for k, arm in zip(self._kept, moved.arm, strict=False)]
        self._kept.append(Kept(taken, fit.lin.T_cell_camera, fit.gram, moved.arm[-1], information))
        if len(self._kept) > self.window:
            self._fold(self._kept[:1])
            self._kept = self._kept[1:]

    def _fold(self, views: list[Kept]) -> None:
        """Views leave the window: their information about base, hand-eye and shared errors is carried on."""
        assert self._chain is not None
        assert self._shared is not None
        chain = chain_of([k.sample for k in views], self.config.priors)
        chain = replace(
            chain, pivot=self._chain.pivot, base=self._chain.base, hand_eye=self._chain.hand_eye, arm=np.array([k.arm for k in views])
        )
        shifts = np.array([se3.log(se3.inverse(k.T_cell_camera) @ chain.pose(v)) for v, k in enumerate(views)])
        normal = assemble([k.gram for k in views], chain, self._shared.basis, np.zeros(0), shifts)
        self._shared = replace(self._shared, carry=Carry.of(normal, self._shared.sizes, chain, self._shared.carry))

    def _close_station(self) -> None:
        """The base drives on: its pose is integrated out, the other information is kept."""
        if self._kept:
            self._fold(self._kept)
            self._kept = []
        if self._shared is not None and self._shared.carry is not None and self._chain is not None:
            self._shared = replace(self._shared, carry=self._shared.carry.without_base(self._chain))

    def _looking_elsewhere(self, taken: Sample, lin: Linearised) -> Chain:
        """The view sees other surfaces: their errors get columns of their own, and the base is looked for as at a new station."""
        self._close_station()
        assert self._shared is not None
        basis = basis_around(lin, self.caster, self.config, self._shared.basis)
        carry = None if self._shared.carry is None else self._shared.carry.with_surface_of(basis, self._shared.basis, self._shared.sizes)
        self._shared = replace(self._shared, basis=basis, carry=carry)
        return self._predicted(taken)

    def _refused(self, chain: Chain, short: str, reason: str) -> Posed:
        T = chain.pose(-1)
        return Posed(T, se3.cov_fixed_axes(T, _prior_cov(chain)), accepted=False, verdict=reason, short=short)


def _robot(taken: Sample) -> Float:
    assert taken.robot is not None
    return taken.robot.T_cell_camera


def _prior_cov(chain: Chain) -> Float:
    """(6, 6) covariance of the last view's camera by the robot's priors."""
    return replace(chain, base=np.eye(4)[None], hand_eye=np.eye(4)).prior_cov(-1)
