# SPDX-License-Identifier: Apache-2.0
"""What to capture: less light, or what would separate tied effects, each capture tried on the design matrix."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tof_core import se3
from tof_core.board.spec import USUAL_VIEWS
from tof_core.shares import in_percent
from tof_gap.seen.evidence.edges import edge_band
from tof_gap.solve.hypotheses.candidate import HAND_EYE, Candidate
from tof_gap.solve.hypotheses.columns import build, stored
from tof_gap.tell.over_exposed import over_exposed
from tof_gap.tell.report.phrases import listed
from tof_scene.render import render
from tof_sensor.effects.hand_eye import HandEye
from tof_sensor.frame import ideal_frame

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_align.chain import Chain
    from tof_core.arrays import Float
    from tof_gap.seen.evidence.view import ViewEvidence
    from tof_gap.tell.diagnosis import Diagnosis
    from tof_scene.raycast import Raycaster
    from tof_sensor.action import Action
    from tof_sensor.effect import Effect

MANY = 3
"""Ties of one effect from which they stand in one line."""
EXTRA = 4
"""Largest number of views that advice may ask for."""


def advise(d: Diagnosis, caster: Raycaster) -> list[str]:
    """What to capture: views with less light where many pixels are over-exposed, and a line for each tie.

    For a tie it is the action after which poses and one effect imitate least of the other effect. Each action is tried with a few views
    of the session; the share that would be left follows from Gram matrices.
    """
    light = over_exposed(d.evidence, caster.scene.names, d.config.missing, d.config.report.over_exposed)
    found = [_for_tie(d, caster, one, other) for one, other in d.solved.tied]
    apart = sorted({f.capture for f in found if f.capture})
    return [line for line in (light, _before_a_board(d), *apart, *_by_reference([f for f in found if not f.capture])) if line]


class _ForTie(NamedTuple):
    """What separates two effects: the line of a capture, or "" and a reference of either effect."""

    one: str
    other: str
    references: tuple[str, ...]
    capture: str = ""

    @property
    def names(self) -> str:
        """Both, in order."""
        return "|".join(sorted((self.one, self.other)))


def _by_reference(ties: Sequence[_ForTie]) -> list[str]:
    """A line for each tie that more views do not separate; one for all ties of an effect that has `MANY` of them."""
    left, out = {t.names: t for t in ties}, list[str]()
    for name in sorted({n for t in left.values() for n in (t.one, t.other)}):
        own = [t for t in left.values() if name in (t.one, t.other)]
        shared = [r for r in own[0].references if all(r in t.references for t in own)] if own else []
        if len(own) >= MANY and shared:
            others = sorted(t.other if t.one == name else t.one for t in own)
            out.append(_no_capture(f"{name} from {listed(others, 'or')}", shared))
            left = {names: t for names, t in left.items() if t not in own}
    return sorted([*out, *(_no_capture(t.names, t.references) for t in left.values())])


def _no_capture(effects: str, references: Sequence[str]) -> str:
    return f"no capture of {EXTRA} more views separates {effects}; {' or '.join(references)} would"


def _before_a_board(d: Diagnosis) -> str:
    """More poses of a board, where an error without a name is common to few views; empty elsewhere."""
    views = len(d.evidence)
    if d.chain.root is None or views >= USUAL_VIEWS or "unknown" not in d.verdict:
        return ""
    return f"the board in {USUAL_VIEWS} poses and more, at several distances and tilts: {views} views cannot prove an error that is common to all"


def _for_tie(d: Diagnosis, caster: Raycaster, effect: Effect | None, other: Effect | None) -> _ForTie:
    """The action after which poses and one effect imitate least of the other, if it gains enough."""
    one, two = (Candidate(HAND_EYE, None) if e is None else Candidate(e.NAME, e) for e in (effect, other))
    if one.effect is None:
        one, two = two, one
    kinds = [HandEye if c.effect is None else type(c.effect) for c in (one, two)]
    actions = dict.fromkeys(action for kind in kinds for action in kind.ACTIONS)
    tried = [(visible_share(d, caster, one, two, action), action.text) for action in actions]
    best, text = max(tried, default=(0.0, ""))
    now, limits = visible_share(d, caster, one, two, None), d.config.report
    found = _ForTie(one.name, two.name, tuple(dict.fromkeys(kind.SEPARATED_BY for kind in kinds)))
    if best < limits.advice_gain * now + limits.advice_least:
        return found
    gain = f"the share of one effect that the other cannot imitate rises from {in_percent(now)} to {in_percent(best)}"
    return found._replace(capture=f"{text}: separates {found.names} ({gain})")


def visible_share(d: Diagnosis, caster: Raycaster, one: Candidate, two: Candidate, action: Action | None) -> float:
    """Share of the energy of `one` after poses that `two` cannot explain, with the action's views added."""
    views, chain = list(d.solved.evidence), d.solved.chain
    if action is not None:
        chosen = np.linspace(0, len(views) - 1, EXTRA).round().astype(int)
        extra = [_imagined(views[i], caster, action) for i in chosen]
        chain = _longer(chain, chosen, [v.rendering.T_cell_camera for v in extra])
        views += extra
    store = stored(views, chain, d.config.select.folds)
    design = build(store, [one, two], chain, d.config.hand_sd)
    system, (target, beside) = design.system, design.groups
    coefficients = np.ones(len(target))
    alone = system.left_of(target, coefficients, np.zeros(0, np.int64))
    return system.left_of(target, coefficients, beside, free_hand=two.effect is None) / max(alone, 1e-12)


def _imagined(view: ViewEvidence, caster: Raycaster, action: Action) -> ViewEvidence:
    """The view after the action, without noise; sigma as before."""
    range_m = float(np.nanmedian(view.frame.depth))
    rendering = render(caster, view.frame.camera, action.pose(view.rendering.T_cell_camera, range_m), footprints=False)
    frame = action.change(ideal_frame(rendering, view.frame.context))
    frame = replace(frame, amplitude=frame.amplitude * _gain(view))
    smooth = frame.valid & ~edge_band(frame, view.limits.edge_px, view.limits)
    index = np.flatnonzero(smooth)
    pixels = index[:: max(1, len(index) // max(len(view.pixels), 1))]
    sigma = np.full(frame.depth.shape, float(np.median(view.sigma[view.smooth])))
    return replace(view, frame=frame, residual=np.where(smooth, 0.0, np.nan), sigma=sigma, smooth=smooth, pixels=pixels)


def _gain(view: ViewEvidence) -> float:
    from tof_sensor.frame import lambert_amplitude

    lambert = lambert_amplitude(view.rendering)
    both = view.smooth & (lambert > 0)
    return float(np.median(view.frame.amplitude[both] / lambert[both])) if both.any() else 1.0


def _longer(chain: Chain, chosen: Sequence[int] | Float, poses: Sequence[Float]) -> Chain:
    """The chain with views at `poses` from the stations of `chosen`, their arms at the prior's mean."""
    at = np.asarray(chosen, int)
    robot = [np.asarray(se3.inverse(chain.B[chain.station[i]]) @ T @ se3.inverse(chain.hand_eye)) for i, T in zip(at, poses, strict=True)]
    return replace(
        chain,
        station=np.concatenate([chain.station, chain.station[at]]),
        robot=np.concatenate([chain.robot, np.array(robot)]),
        arm=np.concatenate([chain.arm, np.tile(np.eye(4), (len(at), 1, 1))]),
    )
