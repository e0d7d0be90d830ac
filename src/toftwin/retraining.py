# SPDX-License-Identifier: Apache-2.0
"""Test of the fitted sensor as training data: two networks, trained on views simulated with and without the effects, repair the real session."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from tof_core.config import section
from tof_core.errors import UsageError
from tof_infer.config import TrainConfig
from tof_sensor.effects.photon_law import PhotonLaw
from tof_sensor.frame import ideal_frame
from tof_sensor.model import SensorModel
from toftwin.extras import trainer
from toftwin.rendered import Near, RenderedConfig, as_capture, rendered_dataset

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from tof_core.arrays import Image
    from tof_gap.tell.diagnosis import Diagnosis
    from tof_scene.raycast import Raycaster


@dataclass(frozen=True, slots=True)
class RetrainConfig(RenderedConfig):
    """Settings of the two trainings."""

    train: TrainConfig = section(TrainConfig, "the training of both networks")


@dataclass(frozen=True, slots=True)
class Retrained:
    """Mean absolute error in mm on the session's held-out views, at the poses of the diagnosis: raw, and repaired by each network."""

    raw_mm: float
    without_mm: float
    with_mm: float
    effects: tuple[str, ...]
    pixels: int

    @property
    def helps(self) -> bool:
        """Whether the effects in the training data lowered the error."""
        return self.with_mm < self.without_mm


def retrain(
    d: Diagnosis, model: SensorModel, caster: Raycaster, out: Path, config: RetrainConfig, say: Callable[[str], None] = lambda _: None
) -> Retrained:
    """Simulate, train and compare; a run that was interrupted continues where it stopped.

    Args:
        d: the diagnosis of the real session.
        model: its fitted sensor.
        caster: the scene.
        out: folder of datasets, networks and `retrain.json`.
        config: number of views and settings of the training.
        say: called with a line at each step.
    """
    from tof_infer.config import InferConfig
    from tof_infer.session import Session

    named = tuple(n for n in model.names if n != PhotonLaw.NAME)
    if not named:
        raise UsageError(
            "the diagnosis named no effect that training could use", where="--retrain", todo="omit it: both networks would be the same"
        )
    law = SensorModel(tuple(e for e in model.effects if isinstance(e, PhotonLaw)))
    near, errors = near_views(d, caster), {}
    for name, sensor in (("without", law), ("with", model)):
        say(f"simulating {config.views} views {name} {', '.join(named)}")
        data = rendered_dataset(near, d.evidence[0].frame.camera, sensor, caster, out / f"{name}.zarr", config)
        network = out / f"{name}.onnx"
        if not network.exists():
            say(f"training {name}")
            trainer("--retrain")([data], network, config.train, say=say)
        session = Session(InferConfig(model=str(network), force=True))
        errors[name] = [_error(d, v, session.repair(as_capture(d.evidence[v].view)).depth) for v in d.split.held_out]
    raw = [_error(d, v, as_capture(d.evidence[v].view).depth) for v in d.split.held_out]
    pixels = sum(n for _, n in raw)
    mae = {k: 1e3 * sum(e * n for e, n in rows) / max(sum(n for _, n in rows), 1) for k, rows in (errors | {"raw": raw}).items()}
    result = Retrained(mae["raw"], mae["without"], mae["with"], named, pixels)
    (out / "retrain.json").write_text(json.dumps(asdict(result) | {"helps": result.helps}, indent=1))
    return result


def _error(d: Diagnosis, view: int, depth: Image) -> tuple[float, int]:
    """Mean absolute error in metres against the CAD at the diagnosis's pose, away from edges; and its pixels."""
    e = d.evidence[view]
    miss = np.abs(depth - e.frame.depth)[e.smooth & np.isfinite(depth)]
    return (float(miss.mean()), len(miss)) if len(miss) else (0.0, 0)


def near_views(d: Diagnosis, caster: Raycaster) -> list[Near]:
    """The session's views with temperature and time, and the unit of amplitude of each."""
    out = []
    for pose, seen in zip(d.cameras, d.evidence, strict=True):
        context = replace(seen.frame.context, caster=caster)
        lit = seen.smooth & (seen.frame.amplitude > 0)
        own = ideal_frame(seen.rendering, context).amplitude
        gain = float(np.median(seen.frame.amplitude[lit] / own[lit])) if lit.any() else 1.0
        out.append(Near(pose, context, gain))
    return out
