# SPDX-License-Identifier: Apache-2.0
"""Methods that repair depth, side by side on the same views."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from tof_core.errors import RefusedError
from tof_core.progress import progress
from tof_eval.scores import FLYING_PX, Scores

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from tof_eval.methods import Estimate, Method
    from tof_eval.reference import Judged

SCHEMA = "toftwin.evaluation/1"


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """The scores as plain values (for JSON), and the view with most parts beside each method's estimate."""

    result: dict[str, Any]
    shown: tuple[Judged, Mapping[str, Estimate]]


def compare(views: Iterable[Judged], methods: Sequence[Method], parts: tuple[str, ...]) -> Comparison:
    """Score every method on every view; a method that uses several captures gets the last ones of the dwell.

    Args:
        views: views with their reference, and as many captures as a method uses, if the dwell has them.
        methods: methods to compare.
        parts: names of the scene's parts, by which errors are listed.

    Raises:
        RefusedError: no view has a reference.
    """
    scores = Scores([m.name for m in methods], parts)
    shown: tuple[Judged, Mapping[str, Estimate]] | None = None
    for judged in progress(views, "evaluate"):
        estimates = {m.name: m.estimate(judged.captures[-m.frames :]) for m in methods}
        scores.add(judged, estimates)
        if shown is None or _parts(judged) > _parts(shown[0]):
            shown = judged, estimates
    if shown is None:
        raise RefusedError("no view has a reference", where="evaluate", todo="pass the truth of this bag, or align it first: toftwin label")
    return Comparison({"schema": SCHEMA, "views": scores.views, "flying_px": FLYING_PX, "methods": scores.to_dict()}, shown)


def _parts(judged: Judged) -> int:
    return len(np.unique(judged.rendering.part))
