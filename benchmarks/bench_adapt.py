# SPDX-License-Identifier: Apache-2.0
"""The default network adapted to emerging cameras by five labelled views: beside raw depth, filters, the fitted sensor model and longer training."""

from __future__ import annotations

import tempfile
import time
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.adapt_sessions import CALIBRATION_VIEWS, camera_sessions
from benchmarks.figure import Figure, at_least, at_most
from benchmarks.kept import kept

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from benchmarks.adapt_sessions import CameraSessions
    from tof_core.arrays import Float
    from tof_core.capture import Capture
    from tof_eval.methods import Method

LONG = True
SEED, CAMERAS = 401, 8
LONGER = 2
"""Cameras on which networks are trained for ten minutes, too."""
LONG_STEPS = 10_000
"""Ten minutes of one core, as one minute is for the adaptation."""
SCRATCH_RATE = 3e-3
"""The rate of `toftwin train`."""


@dataclass(frozen=True, slots=True)
class Row:
    """One camera.

    mae_mm: by method, over the pixels for which all give a depth. Of the adapted network, repaired: share of pixels; within: shares of
    errors within one and two sigma; seconds: processor time of the adaptation.
    """

    name: str
    causes: str
    mae_mm: dict[str, float]
    repaired: float
    within: tuple[float, float]
    seconds: float

    def over(self, rival: str) -> float:
        """MAE of the adapted network over that of a rival."""
        return self.mae_mm["adapted"] / self.mae_mm[rival]

    def line(self) -> str:
        """One camera as a row of text."""
        maes = "  ".join(f"{name} {x:.2f}" for name, x in self.mae_mm.items())
        one, two = self.within
        return f"{self.name}: {maes} mm; repaired {self.repaired:.0%}, within sigma {one:.1%} and {two:.1%}, {self.seconds:.0f} s; {self.causes or 'healthy'}"


def run() -> list[Figure]:
    """Medians and 90 % quantiles over the cameras."""
    cameras = [one for one in camera_sessions(CAMERAS, SEED) if one.dataset.exists()]
    rows = []
    for one in cameras:
        rows += [Row(**r) for r in kept(f"adapt-{SEED}-{one.name}", partial(_row, one))]
        print(f"{rows[-1].line()}; labels {one.label_error_mm():.2f} mm off", flush=True)
    longer = [kept(f"adapt-long-{SEED}-{one.name}", partial(_longer, one))[0] for one in cameras[:LONGER]]
    return [*_errors(rows, CAMERAS - len(rows)), *_sigma(rows), _time(rows), _gain(longer)]


def _errors(rows: Sequence[Row], refused: int) -> list[Figure]:
    shown = ", ".join(f"{name} {np.median([r.mae_mm[name] for r in rows]):.2f}" for name in rows[0].mae_mm)
    remark = f"median MAE mm: {shown}; {len(rows)} cameras, {refused} without labels"
    out = []
    for rival, words in (("rules", "filters"), ("corrected", "fitted sensor model and filters")):
        over = [r.over(rival) for r in rows]
        what = f"default network adapted by {CALIBRATION_VIEWS} views, MAE over that of {words}"
        out.append(at_most(f"{what}: median of cameras", float(np.median(over)), 0.5, "", remark=remark))
        out.append(
            at_most(
                f"{what}: 90 % quantile",
                float(np.quantile(over, 0.9)),
                0.5,
                "",
                remark=f"{sum(x <= 0.5 for x in over)} of {len(over)} cameras",
            )
        )
    return out


def _sigma(rows: Sequence[Row]) -> list[Figure]:
    out = []
    for k, word, wanted in ((0, "one", 68), (1, "two", 95)):
        shares = np.array([100 * r.within[k] for r in rows])
        median, tolerance = float(np.median(shares)), 3
        remark = f"within {tolerance} points on {(np.abs(shares - wanted) <= tolerance).sum()} of {len(rows)} cameras; {shares.min():.0f} to {shares.max():.0f} %"
        what = f"adapted network: errors within {word} sigma, median of cameras"
        out.append(Figure(what, median, "%", f"{wanted} +- {tolerance} %", abs(median - wanted) <= tolerance, remark=remark))
    return out


def _time(rows: Sequence[Row]) -> Figure:
    seconds = [r.seconds for r in rows]
    return at_most(
        "adaptation, processor time, 90 % quantile",
        float(np.quantile(seconds, 0.9)),
        60,
        "s",
        remark=f"median {np.median(seconds):.0f} s, one thread",
    )


def _gain(longer: Sequence[dict[str, Any]]) -> Figure:
    shares = [(r["raw"] - r["adapted"]) / (r["raw"] - min(r.values())) for r in longer]
    remark = "; ".join(", ".join(f"{name} {mae:.2f}" for name, mae in r.items()) + " mm" for r in longer)
    what = "adaptation: share of the gain on raw depth of the best network, trained for ten minutes or not, least of cameras"
    return at_least(what, 100 * min(shares), 70, "%", remark=remark)


def _row(one: CameraSessions) -> list[dict[str, Any]]:
    from benchmarks.rivals import examples, search_rules
    from tof_eval.methods import Corrected, Raw, Rules
    from tof_infer.config import TrainConfig
    from tof_infer.session import DEFAULT_MODEL
    from tof_sim_label.dataset import open_dataset

    with tempfile.TemporaryDirectory() as folder:
        started = time.process_time()
        adapted = _adapted(one, DEFAULT_MODEL, Path(folder) / "adapted.onnx", TrainConfig(threads=1))
        seconds = time.process_time() - started
        data = open_dataset(one.dataset)
        rules, _ = search_rules(examples(data, sorted({int(v) for v in data.column("captures/view") if v >= 0})), rounds=1)
        fitted = Corrected(_fitted_bias(one), rules)
        found = _scored(one, [Raw(), Rules(rules), fitted, _network("default", DEFAULT_MODEL), _network("adapted", adapted)])
    best = found["adapted"]
    return [
        {
            "name": one.name,
            "causes": ", ".join(one.causes),
            "mae_mm": {name: m["equal_coverage"]["mae_mm"] for name, m in found.items()},
            "repaired": best["all"]["completeness"],
            "within": (best["within_1_sigma"], best["within_2_sigma"]),
            "seconds": seconds,
        }
    ]


def _longer(one: CameraSessions) -> list[dict[str, float]]:
    """MAE in mm of raw depth, of the network adapted in a minute, and of networks trained for ten minutes on the same five views."""
    from tof_eval.methods import Raw
    from tof_infer.config import AdaptConfig, TrainConfig
    from tof_infer.session import DEFAULT_MODEL

    short = TrainConfig(threads=1)
    long = replace(short, adapt=AdaptConfig(steps=LONG_STEPS))
    scratch = replace(short, adapt=AdaptConfig(steps=LONG_STEPS, rate=SCRATCH_RATE))
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        networks = {
            "adapted": _adapted(one, DEFAULT_MODEL, work / "adapted.onnx", short),
            "adapted for ten minutes": _adapted(one, DEFAULT_MODEL, work / "long.onnx", long),
            "from scratch in ten minutes": _adapted(one, _untrained(one, work / "untrained.onnx"), work / "scratch.onnx", scratch),
        }
        found = _scored(one, [Raw(), *(_network(name, path) for name, path in networks.items())])
    return [{name: m["equal_coverage"]["mae_mm"] for name, m in found.items()}]


def _scored(one: CameraSessions, methods: Sequence[Method]) -> dict[str, Any]:
    """Scores of methods on the later session of a camera, against its truth."""
    from tof_core.bag import open_bag
    from tof_scene.raycast import Raycaster
    from tof_scene.scene_file import load_scene
    from toftwin.evaluating import evaluate_bag
    from toftwin.pipeline import PipelineConfig

    scene = load_scene(one.scene)
    with open_bag(one.scored, cell_frame=scene.frame) as reader:
        found: dict[str, Any] = evaluate_bag(reader, Raycaster(scene), methods, PipelineConfig(), truth=one.truth).result["methods"]
    return found


def _network(name: str, path: Path) -> Method:
    """A network as a method of this name."""
    from tof_eval.methods import Model
    from tof_infer.config import InferConfig
    from tof_infer.session import Session

    method = Model(Session(InferConfig(model=str(path), force=True)))
    method.name = name
    return method


def _adapted(one: CameraSessions, base: Path, out: Path, config: Any) -> Path:
    from tof_infer.adapt import adapt

    adapt([one.dataset], base, out, config)
    return out


def _untrained(one: CameraSessions, path: Path) -> Path:
    """A network with random weights, to be trained by the same steps as an adapted one."""
    import torch

    from tof_core.config import to_mapping
    from tof_infer.card import Card
    from tof_infer.config import TrainConfig
    from tof_infer.export import export
    from tof_infer.network import RepairNet
    from tof_infer.samples import Pool, Samples
    from tof_infer.sigma_calibration import Calibration
    from tof_infer.train import measure_amplitude

    config, pool = TrainConfig(), Pool([one.dataset], least=1)
    torch.manual_seed(config.seed)
    net = RepairNet(config.net)
    measure_amplitude(net, Samples(pool, np.arange(pool.views)))
    with torch.no_grad():  # the exporter stores equal weights once, and such a file cannot be read back
        for weight in net.parameters():
            weight.add_(1e-6 * torch.randn_like(weight))
    export(net, Calibration(), Card(config.net.names, config.net.multiple, pool.camera, (0.1, 10.0), 1.0, to_mapping(config)), path)
    return path


def _fitted_bias(one: CameraSessions) -> Callable[[Capture], Float]:
    """The bias of the sensor model that `toftwin gap` fits to the five views; none where it refuses them."""
    from tof_core.errors import RefusedError
    from tof_gap.tell.report.files import sensor_model
    from tof_sensor.model import SensorModel
    from toftwin.diagnosis import GapPipelineConfig, diagnose_bag
    from toftwin.evaluating import frame_bias
    from toftwin.inputs import opened

    config = GapPipelineConfig()
    try:
        with opened(one.calibration / "bag", one.scene, config) as (reader, scene):
            assert scene is not None
            return frame_bias(sensor_model(diagnose_bag(reader, scene, config)[0]))
    except RefusedError:
        return frame_bias(SensorModel(()))
