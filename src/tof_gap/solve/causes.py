# SPDX-License-Identifier: Apache-2.0
"""From a selection to effects in physical units, with standard deviations, ties and maps."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from tof_core import se3
from tof_core.cores import in_threads
from tof_gap.seen.evidence.areas import area_map
from tof_gap.seen.evidence.pattern import line_means, single_pixels
from tof_gap.seen.evidence.residual import single
from tof_gap.seen.rendered import rendered_bias
from tof_gap.solve.solution import calibrated_lens
from tof_gap.solved import Named
from tof_sensor.effects.fixed_pattern import FixedPattern, line_cosines, packed
from tof_sensor.effects.hand_eye import HandEye
from tof_sensor.effects.intrinsics import Intrinsics

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_align.chain import Chain
    from tof_align.columns import ColumnFit
    from tof_core.arrays import Float
    from tof_gap.seen.evidence.view import ViewEvidence
    from tof_gap.solve.choose.judge import Selector
    from tof_gap.solve.solution import Joint
    from tof_scene.raycast import Raycaster
    from tof_sensor.effect import Effect


def named(joint: Joint, fit_views: Sequence[int], judge: Selector, rng: np.random.Generator) -> list[Named]:
    """The chosen effects with coefficients fitted to `fit_views` alone, instances of one name joined."""
    found = fitted(joint, fit_views, judge)
    sure = dict[str, float]()
    for place, member in enumerate(joint.selection.chosen.members):
        if not judge.is_free(member):
            name = joint.design.candidates[member].name
            sure[name] = max(confidence(joint, judge, place, rng), sure.get(name, 0.0))
    return [replace(one, confidence=sure[one.name]) for one in found]


def fitted(joint: Joint, fit_views: Sequence[int], judge: Selector) -> list[Named]:
    """The same without confidence."""
    selection, design = joint.selection, joint.design
    chosen, whole = selection.chosen, selection.fit
    solution = design.system.fit_to(fit_views, whole, inflate=chosen.inflate, free_hand=judge.frees_hand(chosen.members))
    # Uncertainty of the bases is uncertainty of the coefficients too.
    solution = replace(solution, answer=replace(solution.answer, cov=whole.answer.cov))
    out: dict[str, Named] = {}
    for place, (member, (_, _, columns)) in enumerate(zip(chosen.members, design.placed(chosen.members), strict=True)):
        if judge.is_free(member):
            continue
        effect, std = _in_units(joint, member, solution, columns, fit_views)
        ties = tuple(design.candidates[i].name for i in selection.ties[place])
        one = Named(effect.NAME, (effect,), (std,), ties, np.nan, member in selection.suspected)
        if one.name in out:
            both = out[one.name]
            one = replace(
                both,
                effects=(*both.effects, effect),
                std=(*both.std, std),
                ties=tuple(sorted({*both.ties, *ties})),
            )
        out[one.name] = one
    return sorted(out.values(), key=lambda n: n.name)


def _in_units(
    joint: Joint,
    member: int,
    solution: ColumnFit,
    columns: slice,
    fit_views: Sequence[int],
) -> tuple[Effect, dict[str, float]]:
    design = joint.design
    candidate, group = design.candidates[member], design.groups[member]
    if candidate.effect is None:
        # X of the chain and its last step, since the arm errors, which correlate with X, are of that solution.
        x = se3.log(joint.hand_eye)
        sd = np.sqrt(np.diag(solution.hand_eye_cov))
        return HandEye(*(float(v) for v in x)), dict(zip(HandEye.LINEAR, sd.tolist(), strict=True))
    values = solution.theta[columns] / design.scale[group]
    sd = np.sqrt(np.diag(solution.theta_cov)[columns]) / design.scale[group]
    if isinstance(candidate.effect, FixedPattern):
        return _pattern(joint, candidate.effect, values, fit_views), {"smooth": float(sd[:-1].max()), "lines": float(sd[-1])}
    calibrated = calibrated_lens(joint)
    if calibrated is not None and isinstance(candidate.effect, Intrinsics):
        values = values + calibrated.coefficients
    effect = candidate.effect.plausible(values)
    return effect, dict(zip(effect.coefficient_names, sd.tolist(), strict=True))


def _pattern(joint: Joint, effect: FixedPattern, values: Float, fit_views: Sequence[int]) -> FixedPattern:
    views = [joint.views[i] for i in fit_views]
    by_column, by_row = line_means(views)
    pixels = single_pixels(views)
    smooth, of_blocks = effect.order**2 - 1, 2 * max(effect.lines - effect.order, 0)
    field, blocks, areas, (line,) = np.split(values, [smooth, smooth + of_blocks, len(values) - 1])
    lines = [
        line * seen + line_cosines(len(seen), effect.order, effect.lines) @ block
        for seen, block in zip((by_column, by_row), np.split(blocks, 2), strict=True)
    ]
    return replace(
        effect,
        values=tuple(float(v) for v in (*lines[0], *lines[1], *field)),
        lines=0,
        areas=packed(areas * area_map(views)) if len(areas) else "",
        pixels=packed(pixels.image) if pixels.size_m > 0 else "",
    )


def confidence(joint: Joint, judge: Selector, place: int, rng: np.random.Generator) -> float:
    """Share of resampled sets of views (drawn with replacement) in which the member's held-out chi-square exceeds the threshold.

    1 for a wrong lens without which the lens of every hypothesis would contradict its calibration: that one absorbs it, and hardly any chi-square
    is won.
    """
    chosen = joint.selection.chosen
    name = joint.design.candidates[chosen.members[place]].name
    if name == Intrinsics.NAME and judge.needed_by_calibration(name, chosen):
        return 1.0
    rest = [m for i, m in enumerate(chosen.members) if i != place]
    won = judge.score(rest, chosen.inflate).held_out - chosen.held_out
    draws = rng.integers(0, len(won), size=(judge.config.rounds, len(won)))
    return float((won[draws].sum(axis=1) > judge.gain(chosen.members[place])).mean())


def free_shares(joint: Joint, views: Sequence[ViewEvidence]) -> dict[str, list[Float]]:
    """For each observable with a free function in the solution, its (H, W) metres of z in every view: error without a name."""
    return {c.note: [c.free.share(values, view) for view in views] for c, values in joint.members() if c.free is not None}


@dataclass(frozen=True, slots=True, eq=False)
class Posed:
    """The views of a session at the poses of a chain, in a scene; other_surface_m: metres beyond which a moved pixel sees another surface."""

    views: Sequence[ViewEvidence]
    chain: Chain
    caster: Raycaster
    other_surface_m: float

    def shares(self, causes: Sequence[Named], at: Sequence[int] | None = None) -> dict[str, list[Float]]:
        """For each named effect, its (H, W) metres of z in every view, or in the views `at`."""
        places = range(len(self.views)) if at is None else at

        def of_view(cause: Named, v: int) -> Float:
            view = self.views[v]
            total = np.sum([rendered_bias(e, view, v, self.chain, self.caster, self.other_surface_m) for e in cause.effects], axis=0)
            return single(np.where(view.frame.valid, total, np.nan))

        return {c.name: in_threads(partial(of_view, c), places) for c in causes}


def smooth_ones(causes: Sequence[Named]) -> list[Named]:
    """The causes without offsets of single pixels: subtracted, these would lower the noise of the views that they were fitted to."""
    smooth = [replace(c, effects=tuple(e.smooth for e in c.effects)) for c in causes]
    return [c if s.effects == c.effects else s for s, c in zip(smooth, causes, strict=True)]
