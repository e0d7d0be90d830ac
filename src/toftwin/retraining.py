# SPDX-License-Identifier: Apache-2.0
"""Use of the fitted sensor for training: two networks, trained on views simulated with and without the effects, repair the real session."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from tof_core import se3
from tof_core.capture import Capture, Posed, RobotPose, View
from tof_core.config import param, section, to_mapping
from tof_core.errors import UsageError
from tof_core.hashing import digest_config
from tof_core.progress import progress
from tof_infer.config import TrainConfig
from tof_scene.render import render
from tof_sensor.effects.photon_law import PhotonLaw
from tof_sensor.frame import ideal_frame
from tof_sensor.model import SensorModel, simulate
from tof_sim_label.dataset import DatasetWriter
from tof_sim_label.label import label_view
from tof_sim_label.schema import Attributes

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from tof_core.arrays import Image
    from tof_gap.tell.diagnosis import Diagnosis
    from tof_scene.raycast import Raycaster

VIEWS_OF_A_STATION = 3
POSE_COV = np.diag(np.repeat([1e-5, 1e-5], 3) ** 2)
"""The pose of a simulated camera is known."""


@dataclass(frozen=True, slots=True)
class RetrainConfig:
    """Learning from the fitted sensor."""

    views: int = param(60, "views simulated around those of the session", low=6, high=100_000)
    spread_m: float = param(0.06, "largest distance from a camera of the session", unit="m", low=0.0, high=2.0)
    spread_deg: float = param(6.0, "largest rotation against that camera", unit="deg", low=0.0, high=90.0)
    seed: int = param(0, "seed of poses and noise", low=0)
    train: TrainConfig = section(TrainConfig, "the training of both networks")


@dataclass(frozen=True, slots=True)
class Retrained:
    """Mean absolute error in mm on the session's held-out views, at the poses of the diagnosis: raw, and repaired by either network."""

    raw_mm: float
    without_mm: float
    with_mm: float
    effects: tuple[str, ...]
    pixels: int

    @property
    def helps(self) -> bool:
        """Whether the fitted effects lowered the error."""
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
    errors = {}
    for name, sensor in (("without", law), ("with", model)):
        say(f"simulating {config.views} views {name} {', '.join(named)}")
        data = simulated(d, sensor, caster, out / f"{name}.zarr", config)
        network = out / f"{name}.onnx"
        if not network.exists():
            say(f"training {name}")
            _train(data, network, config.train, say)
        session = Session(InferConfig(model=str(network), force=True))
        errors[name] = [_error(d, v, session.repair(_capture(d, v)).depth) for v in d.split.held_out]
    raw = [_error(d, v, _capture(d, v).depth) for v in d.split.held_out]
    pixels = sum(n for _, n in raw)
    mae = {k: 1e3 * sum(e * n for e, n in rows) / max(sum(n for _, n in rows), 1) for k, rows in (errors | {"raw": raw}).items()}
    result = Retrained(mae["raw"], mae["without"], mae["with"], named, pixels)
    (out / "retrain.json").write_text(json.dumps(asdict(result) | {"helps": result.helps}, indent=1))
    return result


def _train(data: Path, network: Path, config: TrainConfig, say: Callable[[str], None]) -> None:
    try:
        from tof_infer.train import train
    except ModuleNotFoundError as error:
        if error.name not in {"torch", "onnx"}:
            raise
        from toftwin.extras import install_line

        raise UsageError(f"needs {error.name}, which is not installed", where="--retrain", todo=install_line("train")) from None
    train([data], network, config, say=say)


def _capture(d: Diagnosis, view: int) -> Capture:
    """A view as the input of the network."""
    v = d.evidence[view].view
    return _as_capture(v)


def _error(d: Diagnosis, view: int, depth: Image) -> tuple[float, int]:
    """Mean absolute error in metres against the CAD at the diagnosis's pose, away from edges; and its pixels."""
    e = d.evidence[view]
    miss = np.abs(depth - e.frame.depth)[e.smooth & np.isfinite(depth)]
    return (float(miss.mean()), len(miss)) if len(miss) else (0.0, 0)


def simulated(d: Diagnosis, model: SensorModel, caster: Raycaster, path: Path, config: RetrainConfig) -> Path:
    """A labelled dataset of views near those of the session, simulated with the model; an interrupted run continues.

    Poses and noise follow from the number of the view alone, so that they are the same with and without effects.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    camera = d.evidence[0].frame.camera
    digest = digest_config({"retrain": to_mapping(config), "effects": [repr(e) for e in model.effects]})
    attributes = Attributes("simulated", digest, "simulated", tuple(p.name for p in caster.scene.parts))
    with DatasetWriter(path, camera, attributes, resume=True) as writer:
        for number in progress(range(writer.views, config.views), f"simulating {path.stem}", config.views - writer.views):
            view, posed = _simulated_view(d, model, caster, number, config)
            if writer.captures == number:
                writer.append_capture(_as_capture(view), number)
            writer.append_view(view, label_view(view, posed, caster))
    return path


def _as_capture(view: View) -> Capture:
    return Capture(view.stamp_ns, view.camera, view.depth, view.reason, view.robot, view.amplitude, temperature=view.temperature)


def _simulated_view(d: Diagnosis, model: SensorModel, caster: Raycaster, number: int, config: RetrainConfig) -> tuple[View, Posed]:
    rng = np.random.default_rng([config.seed, number])
    near = int(rng.integers(len(d.evidence)))
    seen = d.evidence[near]
    spread = np.repeat([config.spread_m, np.radians(config.spread_deg)], 3)
    T = np.asarray(d.cameras[near] @ se3.exp(rng.uniform(-1, 1, 6) * spread))
    rendering = render(caster, seen.frame.camera, T)
    context = replace(seen.frame.context, caster=caster)
    frame = ideal_frame(rendering, context)
    lit = seen.smooth & (seen.frame.amplitude > 0)
    own = ideal_frame(seen.rendering, context).amplitude
    gain = float(np.median(seen.frame.amplitude[lit] / own[lit])) if lit.any() else 1.0
    made = simulate(rendering, model, np.random.default_rng([config.seed, number, 1]), context=context, amplitude=frame.amplitude * gain)
    depth = made.depth.astype(np.float32)
    capture = Capture(
        1_000_000_000 + number,
        rendering.camera,
        depth,
        np.isnan(depth).astype(np.uint8),
        RobotPose(np.eye(4), T),
        made.amplitude.astype(np.float32),
        temperature=seen.frame.context.temperature,
    )
    return replace(View.of_capture(capture), station=number // VIEWS_OF_A_STATION), Posed(T, POSE_COV)
