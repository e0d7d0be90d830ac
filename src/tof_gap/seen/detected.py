# SPDX-License-Identifier: Apache-2.0
"""Effects with a detector of their own: each detector gets the session and its noise by amplitude."""

from __future__ import annotations

from dataclasses import replace
from functools import reduce
from typing import TYPE_CHECKING

import numpy as np

from tof_gap.seen.evidence.residual import single
from tof_gap.seen.finding import Finding
from tof_gap.seen.foreign.lit_places import lit_places
from tof_gap.seen.noise.dwells import as_captures_differ, usual_ratio
from tof_gap.seen.noise.exposure import exposed
from tof_gap.seen.noise.photons import binned, brightness, code_step, fit_law, variance_of_mean
from tof_gap.seen.noise.whole_average import wholly_averaged
from tof_gap.seen.session import session_of
from tof_sensor.effects.ambient import Ambient
from tof_sensor.registry import PHYSICAL_ORDER

if TYPE_CHECKING:
    from collections.abc import Sequence
    from collections.abc import Set as AbstractSet

    from tof_gap.limits.noise import NoiseLimits
    from tof_gap.seen.evidence.view import ViewEvidence
    from tof_sensor.effects.photon_law import PhotonLaw
    from tof_sensor.session import Session


def detected_effects(
    views: Sequence[ViewEvidence], limits: NoiseLimits, law: PhotonLaw | None, left_out: AbstractSet[str] = frozenset()
) -> list[Finding]:
    """Findings of all effects' own detectors but those in `left_out`; `law`: the camera's photon law as `--sensor` states it."""
    session = judged(views, limits, law)
    found = [kind.detect(session) for kind in PHYSICAL_ORDER if kind.NAME not in left_out and kind.not_testable(session) is None]
    made = [
        Finding(
            d.effect,
            d.confidence,
            d.std,
            share=np.stack([single(np.where(v.smooth, d.effect.noise(v.frame) / np.sqrt(v.view.captures), np.nan)) for v in views]),
            note=d.note,
            beside=law,
        )
        for d in found
        if d is not None
    ]
    # Places are compared with each other: a law that is larger as a whole hides no light there.
    untested = Ambient.not_testable(replace(session, noise=None)) is not None
    if law is None or Ambient.NAME in {*left_out, *(f.name for f in made)} or untested:
        return made
    lit = lit_places(views, law, limits.lit)
    return made if lit is None else [lit, *made]


def judged(views: Sequence[ViewEvidence], limits: NoiseLimits, law: PhotonLaw | None) -> Session:
    """The session with its noise by amplitude, where a stated law holds, and whether exposures change, which matters beside such a law alone."""
    bins = binned(views, limits.bins, limits)
    if law is not None:
        bins = bins.of(law.holds(bins.amplitude))
        bins = as_captures_differ(bins, usual_ratio(bins, law))
    whole = wholly_averaged(bins, views[0].correlation)
    # Where an average takes in fewer neighbours, views of other contents differ in noise as those of other exposures do.
    compared = whole if len(whole.view) >= limits.least_bins else bins
    many = law is not None and len(compared.view) >= limits.least_bins
    changes = many and exposed(compared, fit_law(compared, code_step(views), limits), limits, brightness(views))
    return replace(session_of(views, limits, law=law), noise=wholly_averaged(bins, views[0].correlation, law), exposed=changes)


def explained(views: Sequence[ViewEvidence], found: Sequence[Finding]) -> list[ViewEvidence]:
    """The views with `sigma` of each pixel as a stated law and the effects found beside it predict it.

    `sigma` is otherwise estimated over pixels of like amplitude, which is wrong where noise also follows range.
    """
    law = next((f.beside for f in found if f.beside is not None), None)
    if law is None:
        return list(views)
    whole = reduce(lambda so_far, f: f.effect.added_to(so_far), found, law)
    return [replace(v, sigma=np.sqrt(variance_of_mean(whole, v)) / v.frame.length) for v in views]
