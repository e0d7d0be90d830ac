# SPDX-License-Identifier: Apache-2.0
"""The hypotheses of a session: every effect in every form that it asks to try."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from tof_gap.seen.detected import judged
from tof_gap.seen.session import session_of
from tof_gap.solve.hypotheses.candidate import Candidate
from tof_sensor.registry import EFFECTS, PHYSICAL_ORDER, VOCABULARY

if TYPE_CHECKING:
    from collections.abc import Sequence
    from collections.abc import Set as AbstractSet

    from tof_gap.limits.noise import NoiseLimits
    from tof_gap.seen.evidence.view import ViewEvidence
    from tof_scene.scene import Scene
    from tof_sensor.effects.photon_law import PhotonLaw


def candidates(
    views: Sequence[ViewEvidence],
    scene: Scene,
    noise: NoiseLimits,
    left_out: AbstractSet[str] = frozenset(),
    *,
    quick: bool = False,
    stated_mhz: tuple[float, ...] = (),
) -> list[Candidate]:
    """All hypotheses that this session can test.

    left_out: names of effects that are not considered; quick: only effects whose bias depends on the pixel alone; stated_mhz: modulation
    frequencies that calibration.yaml states.
    """
    session = session_of(views, noise, scene, stated_mhz=stated_mhz)
    tested = [kind for kind in PHYSICAL_ORDER if kind.NAME not in left_out and kind.not_testable(session) is None]
    made = [
        Candidate(kind.NAME, None if kind.IN_CHAIN else form.effect, form.note, further=form.further)
        for kind in tested
        for form in kind.hypotheses(session)
    ]
    return [c for c in made if not (quick and c.effect is not None and not c.effect.LOCAL)]


def not_testable(
    views: Sequence[ViewEvidence],
    noise: NoiseLimits,
    law: PhotonLaw | None = None,
    stated_mhz: tuple[float, ...] = (),
    left_out: AbstractSet[str] = frozenset(),
) -> dict[str, str]:
    """Effects that the session cannot test, each with what it lacks.

    law: the photon law that `--sensor` states; stated_mhz: the modulation frequencies that calibration.yaml states; left_out: effects that
    nothing is asked of: a reason may say what their detector found.
    """
    session = replace(judged(views, noise, law), stated_mhz=stated_mhz)
    reasons = {name: EFFECTS[name].not_testable(session) for name in VOCABULARY if name not in left_out}
    return {name: reason for name, reason in reasons.items() if reason is not None}
