# SPDX-License-Identifier: Apache-2.0
"""The comparison of methods composed: a bag and its scene in, the scores of methods out."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tof_core.errors import RefusedError
from tof_eval.comparison import Comparison, compare
from tof_eval.reference import by_label, by_truth
from tof_scene.rendering import depth_only
from tof_sensor.frame import Context, Frame
from toftwin.pipeline import ViewStream

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from tof_core.arrays import Float
    from tof_core.bag import BagReader
    from tof_core.capture import Capture
    from tof_eval.methods import Method
    from tof_scene.raycast import Raycaster
    from tof_sensor.model import SensorModel
    from toftwin.boarded import BoardSource
    from toftwin.pipeline import PipelineConfig

BY_FRAME = frozenset(
    {"range_offset", "depth_scale", "wiggling", "amplitude_bias", "temperature_drift", "fixed_pattern", "emitter_offset", "z_conversion"}
)
"""Effects whose bias follows from a measured frame alone, without CAD."""


def evaluate_bag(
    reader: BagReader | BoardSource, caster: Raycaster, methods: Sequence[Method], config: PipelineConfig, *, truth: Path | None = None
) -> Comparison:
    """Compare methods on every view of a bag, with the truth file if there is one, else with the session's own labels.

    Raises:
        RefusedError: no frame can be used, no view has a reference or as many captures as a method takes, or a model was made for another camera.
    """
    from tof_align.session import solve_session

    # A dwell must hold as many captures as any method needs.
    most, accumulate = max(m.frames for m in methods), config.preproc.accumulate
    accumulate = replace(accumulate, max_captures=max(accumulate.max_captures, most))
    config = replace(config, preproc=replace(config.preproc, accumulate=accumulate))
    stream = ViewStream(reader, config)
    views = [(view, tuple(stream.members[-most:])) for view in stream]
    if not views:
        what = f"no frame of {reader.frame_count} can be used: {reader.last_error}"
        raise RefusedError(what, where="evaluate", todo="toftwin doctor lists what the bag lacks")
    there = max(len(captures) for _, captures in views)
    if there < most:
        raise RefusedError(f"no view has {most} captures, the longest has {there}", where="evaluate", todo=f"pass --frames {there}")
    if truth is not None:
        judged, reference = by_truth(views, caster, truth), "the truth beside the bag"
    else:
        posed = solve_session([view for view, _ in views], caster, config.align).posed
        source = "TF or the board's corners alone" if config.align.mode == "robot" else "solved from the same frames"
        reference = f"the session's own labels (poses {source}); an offset that is the same everywhere is in both and not seen"
        judged = by_label(views, posed, caster, config.label)
    found = compare(judged, methods, caster.scene.names)
    return replace(found, result={**found.result, "scene": caster.scene.folder.name, "reference": reference})


def frame_bias(model: SensorModel) -> Callable[[Capture], Float]:
    """A function that predicts the (H, W) error of a capture in metres, as far as the model computes it from the frame alone."""
    effects = [e for e in model.effects if e.NAME in BY_FRAME]

    def bias(capture: Capture) -> Float:
        frame = measured_frame(capture)
        return np.asarray(sum((e.bias(frame) for e in effects), np.zeros(frame.depth.shape)))

    return bias


def measured_frame(capture: Capture) -> Frame:
    """A measured frame in the form of a rendered one; a missing amplitude is 1."""
    depth = capture.depth.astype(np.float64)
    amplitude = np.ones_like(depth) if capture.amplitude is None else np.nan_to_num(capture.amplitude.astype(np.float64))
    rendering, zero = depth_only(capture.camera, capture.depth), np.zeros_like(depth)
    return Frame(rendering, capture.camera.rays(), depth, amplitude, zero, zero, Context(temperature=capture.temperature))
