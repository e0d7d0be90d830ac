# SPDX-License-Identifier: Apache-2.0
"""Run methods over a bag and score them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from tof_core.progress import progress
from toftwin.evaluation.reference import judged_views
from toftwin.evaluation.score import FLYING_PX, Scores

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from tof_core.bag import BagReader
    from tof_scene.raycast import Raycaster
    from toftwin.evaluation.methods import Estimate, Method
    from toftwin.evaluation.reference import Judged
    from toftwin.pipeline import PipelineConfig

SCHEMA = "toftwin.evaluation/1"


@dataclass(frozen=True, slots=True, eq=False)
class Evaluation:
    """The numbers (plain, for JSON), and one view to show."""

    result: dict[str, Any]
    shown: tuple[Judged, Mapping[str, Estimate]]


def evaluate_bag(
    reader: BagReader,
    caster: Raycaster,
    methods: Sequence[Method],
    config: PipelineConfig,
    *,
    truth: Path | None = None,
) -> Evaluation:
    """Every method on every view; a method that takes several captures gets the last ones of the dwell.

    Raises:
        RefusedError: nothing to compare, or a model that was made for another camera.
    """
    # No dwell may be cut short of what a method takes.
    accumulate = config.preproc.accumulate
    most = max(m.frames for m in methods)
    config = replace(
        config, preproc=replace(config.preproc, accumulate=replace(accumulate, max_captures=max(accumulate.max_captures, most)))
    )
    scores = Scores([m.name for m in methods], caster.scene.names)
    shown: tuple[Judged, Mapping[str, Estimate]] | None = None
    for judged in progress(judged_views(reader, caster, config, truth, most), "evaluate"):
        estimates = {m.name: m.estimate(judged.captures[-m.frames :]) for m in methods}
        scores.add(judged, estimates)
        if shown is None or _parts(judged) > _parts(shown[0]):
            shown = judged, estimates
    assert shown is not None
    result = {
        "schema": SCHEMA,
        "bag": "",
        "scene": caster.scene.folder.name,
        "views": scores.views,
        "flying_px": FLYING_PX,
        "reference": "the truth that lies beside the bag"
        if truth is not None
        else "the session's own label (its poses solved from the same frames)",
        "methods": scores.to_dict(),
    }
    return Evaluation(result, shown)


def _parts(judged: Judged) -> int:
    return len(np.unique(judged.rendering.part))
