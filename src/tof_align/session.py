# SPDX-License-Identifier: Apache-2.0
"""One solution of a whole session: bases, arm, hand-eye, extra columns and unmodelled errors."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from tof_align import verdict as verdicts
from tof_align.approach import approach
from tof_align.chain import Chain, chain_of
from tof_align.fit import Columns, Fitter
from tof_align.lens import Lens, estimated_lens
from tof_align.linearise import linearise
from tof_align.mixed import Mixed, solve
from tof_align.observability import Observability, most_disputed, observe_block, pinned
from tof_align.pixels import Sample, sample
from tof_align.single import align_sample
from tof_align.terms import Terms, columns_of_terms
from tof_core import se3
from tof_core.capture import Posed, View
from tof_core.cores import in_threads
from tof_core.errors import RefusedError
from tof_core.lens import apart_px

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_align.config import AlignConfig
    from tof_align.system import SessionSystem
    from tof_core.arrays import Float
    from tof_core.camera import Camera
    from tof_scene.raycast import Raycaster


@dataclass(frozen=True, slots=True, eq=False)
class SessionSolution:
    """Poses and coefficients of a session.

    posed (V,): the cameras with covariance and verdict; stations (S,): their numbers;
    B (S, 4, 4): T_cell_body is really B @ T_cell_body; A (V, 4, 4); X (4, 4), X_cov (6, 6) of its
    right perturbation; theta (k,), theta_cov (k, k): coefficients of the extra columns;
    sizes: metres of unmodelled error per kind of `discrepancy` (`part I` for part I of the scene);
    observability (S,): degenerate directions of each base; system: the linear system at the solution, for
    further fits; fitted: its answer; lens: the estimated lens, None where it was not estimated.
    """

    posed: tuple[Posed, ...]
    verdicts: tuple[verdicts.Verdict, ...]
    stations: tuple[int, ...]
    B: Float
    A: Float
    X: Float
    X_cov: Float
    theta: Float
    theta_cov: Float
    sizes: dict[str, float]
    observability: tuple[Observability, ...]
    system: SessionSystem[Chain]
    fitted: Mixed
    lens: Lens | None = None

    @property
    def chain(self) -> Chain:
        """The state behind B, A and X."""
        return self.system.rig


def solve_session(
    views: Sequence[View],
    caster: Raycaster,
    config: AlignConfig,
    *,
    terms: Terms | None = None,
    theta_std: Float | None = None,
    start: Chain | None = None,
) -> SessionSolution:
    """Solve T_cell_camera = B_station T_cell_body T_body_camera A_view X for all views together.

    Args:
        views: of one camera, each with its robot pose and station.
        caster: the scene.
        config: priors, weights, limits, and the mode.
        terms: extra columns, fitted jointly.
        theta_std: (k,) prior standard deviations of their coefficients (default: none).
        start: poses to start from (an earlier solution's `chain`); default: the robot's.

    Raises:
        RefusedError: no view sees the CAD, or the session fits it nowhere.
        TransformError: a view has no robot pose.
    """
    samples = [sample(v, config.weights) for v in views]
    columns = None if terms is None else columns_of_terms(terms, views, caster)
    return solve_samples(samples, caster, config, columns=columns, theta_std=theta_std, start=start)


def solve_samples(
    samples: Sequence[Sample],
    caster: Raycaster,
    config: AlignConfig,
    *,
    columns: Columns | None = None,
    theta_std: Float | None = None,
    start: Chain | None = None,
    once: bool = False,
) -> SessionSolution:
    """`solve_session` for samples of the views; `columns(v, linearised) -> (n, k)`; `once`: not again through the lens that was found."""
    if not samples:
        raise RefusedError("there are no views", where="alignment", todo="record at least one still view of the parts")
    seed = chain_of(samples, config.priors)
    if config.mode != "session":
        return _without_session(samples, seed, caster, config)
    chain = start or near(samples, seed, caster, config)
    share = config.weights.last_total // len(samples)
    last = [s.full.thinned(max(share, config.weights.pixels)) for s in samples]
    fitter = Fitter([s.fine for s in samples], caster, config, columns, theta_std, last=last)
    system, answer, given = fitter.fit(chain, config.iterations)
    stated = samples[0].full.camera
    lens = _lens(system, answer, stated)
    if once or lens is None or columns is not None or apart_px(stated, lens.camera) < config.discrepancy.lens_again_px:
        return _through(_conclude(fitter, system, answer, given, seed), lens)
    through = [replace(s, full=s.full.through(lens.camera)) for s in samples]
    again = solve_samples(through, caster, config, start=system.rig.moved(answer.x, answer.own), once=True)
    return _through(again, again.lens or lens)


def _lens(system: SessionSystem[Chain], answer: Mixed, stated: Camera) -> Lens | None:
    """The lens by the answer's coefficients; None where it was not estimated."""
    at = system.kinds.get("lens", np.zeros(0, np.int64))
    return estimated_lens(stated, answer.x[at], system.basis.lens_m) if len(at) else None


def _through(solution: SessionSolution, lens: Lens | None) -> SessionSolution:
    """The solution with the lens that it was found with."""
    camera = None if lens is None else lens.camera
    return replace(solution, lens=lens, posed=tuple(replace(p, camera=camera) for p in solution.posed))


def _without_session(samples: Sequence[Sample], seed: Chain, caster: Raycaster, config: AlignConfig) -> SessionSolution:
    """The modes that the session solution is compared with: a free pose per view, or the robot's own.

    A contains every view's correction; B and X are the identity.
    """
    chain, found = seed, None
    if config.mode == "per_view":
        found = [align_sample(s, caster, seed.pose(v), None, config) for v, s in enumerate(samples)]
        arm = np.array([se3.inverse(seed.pose(v)) @ f.posed.T_cell_camera for v, f in enumerate(found)])
        chain = replace(seed, arm=arm)
    plain = replace(config, discrepancy=replace(config.discrepancy, enabled=False))
    fitter = Fitter([s.fine for s in samples], caster, plain)
    system, answer, columns = fitter.once(chain)
    still = replace(answer, x=np.zeros_like(answer.x), own=np.zeros_like(answer.own))
    solution = _conclude(fitter, system, still, columns, seed)
    if found is not None:
        return replace(solution, posed=tuple(f.posed for f in found), verdicts=tuple(f.verdict for f in found))
    by_robot = (
        replace(p, T_cell_camera=seed.pose(v), cov=se3.cov_fixed_axes(seed.pose(v), seed.prior_cov(v)))
        for v, p in enumerate(solution.posed)
    )
    posed = tuple(replace(p, accepted=True, verdict="robot", short="robot") for p in by_robot)
    return replace(solution, posed=posed)


def near(samples: Sequence[Sample], chain: Chain, caster: Raycaster, config: AlignConfig) -> Chain:
    """The chain with every station's base brought near the CAD; arm and hand-eye are unchanged."""
    base = chain.base.copy()
    for s in range(len(chain.names)):
        mine = [int(v) for v in np.flatnonzero(chain.station == s)]
        poses = np.array([chain.pose(v) for v in mine])
        base[s] = base[s] @ approach([samples[v].coarse for v in mine], poses, chain.frame(s), config.priors.base, caster, config)
    return replace(chain, base=base)


def _conclude(
    fitter: Fitter,
    system: SessionSystem[Chain],
    answer: Mixed,
    columns: list[Float] | None,
    seed: Chain,
) -> SessionSolution:
    """Keep the robot's pose along degenerate directions, judge every view, and make the solution."""
    config, g = fitter.config, seed.globals_
    seen = tuple(_observe_station(system, answer, s, seed, config) for s in range(len(seed.names)))
    kept = _keep(system, columns, answer, seen)
    chain = system.rig.moved(kept.x, kept.own)
    explained = in_threads(lambda v: system.explained(kept, v, columns), range(len(system.views)))
    disputed = _disputed(system, explained, seen, config)
    shifts = system.without_each_part(answer)
    apart, unsure = system.stand_off(answer, len(fitter.caster.scene.parts))
    parts = np.hypot(apart, unsure)
    sure = verdicts.disagreeing(apart, unsure, config.verdict)
    words = verdicts.apart_in_words(fitter.caster.scene.names, sure)
    judged = tuple(
        in_threads(lambda v: _judge_view(fitter, system, explained[v], chain, seed, seen, disputed, words, v), range(len(system.views)))
    )
    given = config.mode == "robot" and seed.root is not None  # Poses by a board's corners do not depend on depth.
    if not given and not any(j.accepted for j in judged):
        raise RefusedError(judged[0].reason, where="alignment", todo="check the scene, its placement and the robot's pose")
    k = 0 if columns is None else columns[0].shape[1]
    end = g + sum(system.basis.shared)
    return SessionSolution(
        posed=tuple(_posed(system, answer, chain, seen, v, judged[v], parts, shifts[:, v], sure) for v in range(len(judged))),
        verdicts=judged,
        stations=chain.names,
        B=chain.B,
        A=chain.arm,
        X=chain.hand_eye,
        X_cov=answer.cov[g - 6 : g, g - 6 : g],
        theta=kept.x[end : end + k],
        theta_cov=answer.cov[end : end + k, end : end + k],
        sizes=dict(answer.sizes),
        observability=seen,
        system=replace(system, rig=chain),
        fitted=kept,
    )


def _observe_station(system: SessionSystem[Chain], answer: Mixed, s: int, seed: Chain, config: AlignConfig) -> Observability:
    """Observability of a station's base by its views, with all other unknowns marginalised."""
    at = slice(6 * s, 6 * s + 6)
    centre = np.mean([seed.pose(int(v))[:3, 3] for v in np.flatnonzero(seed.station == s)], axis=0)
    return observe_block(answer.cov[at, at], np.diag(config.priors.base**2), system.rig.frame(s), centre, config.verdict)


def _keep(
    system: SessionSystem[Chain],
    columns: Sequence[Float] | None,
    answer: Mixed,
    seen: Sequence[Observability],
) -> Mixed:
    """Solve again with the base held at the robot's pose along degenerate directions."""
    if not any(len(o.null) for o in seen):
        return answer
    normal = system.normal(columns)
    H, b = np.zeros((normal.info.size, normal.info.size)), np.zeros(normal.info.size)
    for s, o in enumerate(seen):
        at = slice(6 * s, 6 * s + 6)
        H[at, at], b[at] = pinned(o, system.rig.frame(s), system.rig.B[s])
    return solve(normal, answer.sizes, (H, b))


def _disputed(
    system: SessionSystem[Chain],
    explained: Sequence[Float],
    seen: Sequence[Observability],
    config: AlignConfig,
) -> list[tuple[float, str]]:
    """For each station, the direction of its base on which its views disagree most; views that fit nowhere do not count."""
    if config.mode != "session":
        return [(1.0, "") for _ in seen]
    rig = system.rig
    total = [verdicts.Information(np.zeros((6, 6)), np.zeros((6, 6))) for _ in seen]
    for v, view in enumerate(system.views):
        if verdicts.fit_of(view, config, explained[v]).support >= config.verdict.min_support:
            station = int(rig.station[v])
            total[station] += verdicts.information_of(view, system.weights[v], config, explained[v]).moved(rig.links(v)[0][:, :6])
    prior = np.diag(config.priors.base**-2)
    return [most_disputed(o, rig.frame(s), t.agreeing, t.everyone, prior) for s, (o, t) in enumerate(zip(seen, total, strict=True))]


def _judge_view(
    fitter: Fitter,
    system: SessionSystem[Chain],
    explained: Float,
    chain: Chain,
    seed: Chain,
    seen: Sequence[Observability],
    disputed: Sequence[tuple[float, str]],
    apart: str,
    v: int,
) -> verdicts.Verdict:
    config, T_seed = fitter.config, seed.pose(v)
    before = verdicts.fit_of(linearise(fitter.pixels[v], T_seed, fitter.caster, config.weights), config)
    after = verdicts.fit_of(system.views[v], config, explained)
    station = int(chain.station[v])
    return verdicts.judge(before, after, T_seed, chain.pose(v), seed.prior_cov(v), seen[station].names, config, disputed[station], apart)


def _posed(
    system: SessionSystem[Chain],
    answer: Mixed,
    chain: Chain,
    seen: Sequence[Observability],
    v: int,
    verdict: verdicts.Verdict,
    parts: Float,
    shifts: Float,
    apart: Float,
) -> Posed:
    T = chain.pose(v)
    cov = se3.cov_fixed_axes(T, system.camera_cov(answer, v) + shifts.T @ shifts)
    null = seen[int(chain.station[v])].at(T[:3, 3])
    return Posed(T, cov, null, verdict.accepted, verdict.reason, parts, apart=apart, short=verdict.short)
