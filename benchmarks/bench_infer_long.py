# SPDX-License-Identifier: Apache-2.0
"""What buys accuracy: training views, inputs, width, recipe; each trained for the same steps, judged on a scene that none has seen."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.figure import Figure
from benchmarks.infer_data import EXACT_ROBOT, label_bag, record_bag
from benchmarks.make_model import HELD_OUT, make_data
from tof_core.capture import Capture
from tof_infer.config import CAD_INPUTS, SENSOR_INPUTS, InferConfig, NetConfig, TrainConfig
from tof_virtual.twin import TwinCamera

if TYPE_CHECKING:
    from collections.abc import Mapping

LONG = True
WORK = Path("out/model")
"""Sessions are kept here and shared with `make model`."""
PLOT = Path(__file__).resolve().parent.parent / "docs" / "pictures" / "infer_views.png"
SCENES, VIEWS, HELD_VIEWS = 24, 10, 12
STEPS, BATCH = 500, 2
COUNTS = (10, 20, 40, 80, 160)
TRUSTED = 0.85
"""Share of pixels, each network's most certain ones, whose error is printed beside that of all."""


@dataclass(frozen=True, slots=True)
class Found:
    """Errors on the held-out scene in mm: of the most certain pixels, of all; raw's on the same."""

    trusted: float
    every: float
    raw: float


def run() -> list[Figure]:
    """Train them all; one that is there already (same settings and data) is not trained again."""
    WORK.mkdir(parents=True, exist_ok=True)
    datasets = make_data(WORK, range(1, SCENES + 1), VIEWS)
    held = held_out()
    curve = {n: trained(f"views_{n}", TrainConfig(limit=n), datasets, held, n) for n in COUNTS}
    plot(curve)
    most = max(COUNTS)
    rows = [Figure(f"{n} training views, {STEPS} steps: MAE on {HELD_OUT}", f.trusted, "mm", remark=remark_of(f)) for n, f in curve.items()]
    for name, inputs in ABLATIONS.items():
        f = trained(f"inputs_{name}", TrainConfig(limit=most, net=NetConfig(inputs=inputs)), datasets, held, most)
        rows.append(Figure(f"inputs: {name}, {most} views, {STEPS} steps: MAE", f.trusted, "mm", remark=remark_of(f)))
    f = trained("base_8", TrainConfig(limit=most, net=NetConfig(base=8)), datasets, held, most)
    rows.append(Figure(f"width: 8 channels for {NetConfig().base}, {most} views, {STEPS} steps: MAE", f.trusted, "mm", remark=remark_of(f)))
    f = trained("fast", TrainConfig(limit=most, recipe="fast"), datasets, held, most)
    rows.append(Figure(f"--recipe fast, {most} views, {STEPS} steps: MAE", f.trusted, "mm", remark=remark_of(f)))
    paper = trained("paper", TrainConfig(limit=40, recipe="paper", net=NetConfig(base=8)), datasets, held, 40, epochs=100)
    return [
        *rows,
        Figure(
            "the paper's recipe (depth alone, MSE, no residual), 40 views, 100 epochs: MAE of all pixels",
            paper.every,
            "mm",
            remark=f"raw {paper.raw:.2f} mm; on other stations of its own scenes {card_of('paper')['val_mae_mm']:.2f} mm, raw {card_of('paper')['val_raw_mae_mm']:.2f} mm",
        ),
    ]


ABLATIONS = {
    "depth alone": "depth",
    "without amplitude": "depth,ray,temperature",
    "and the CAD's incidence and material": ",".join(SENSOR_INPUTS + CAD_INPUTS),
}


def card_of(name: str) -> dict[str, float]:
    """Figures on the card of a network that was trained here."""
    figures: dict[str, float] = json.loads((WORK / f"long_{name}_{STEPS}.json").read_text(encoding="utf-8"))["figures"]
    return figures


def remark_of(f: Found) -> str:
    """A remark."""
    return f"{100 * TRUSTED:.0f} % most certain pixels; all pixels {f.every:.2f} mm, raw {f.raw:.2f} mm"


def held_out() -> Path:
    """Labelled views of the scene that nothing is trained on."""
    from tof_scene.builtin import make_builtin

    dataset = WORK / "held_out.zarr"
    if not dataset.exists():
        scene = make_builtin(HELD_OUT)
        bag = record_bag(
            scene,
            TwinCamera(),
            WORK / "held_out_session",
            seed=4242,
            settings={"plan.views": HELD_VIEWS, "plan.stations": 3, **EXACT_ROBOT},
        )
        label_bag(bag, scene, dataset)
    return dataset


def trained(name: str, config: TrainConfig, datasets: list[Path], held: Path, views: int, epochs: int = 0) -> Found:
    """Train for the same number of steps, whatever the number of views (or for so many epochs); judge."""
    from tof_infer.train import train

    out = WORK / f"long_{name.replace(' ', '_')}_{STEPS}.onnx"
    if not out.exists():
        train(datasets, out, replace(config, epochs=epochs or max(round(STEPS * BATCH / views), 1), batch=BATCH, threads=1))
    return judged(out, held)


def judged(model: Path, held: Path) -> Found:
    """Errors of a network on every view of the held-out dataset."""
    from tof_infer.samples import Pool, Samples
    from tof_infer.session import Session

    session = Session(InferConfig(model=str(model), max_sigma_mm=1000.0, force=True))
    pool = Pool([held])
    samples = Samples(pool, np.arange(pool.views))
    rows = []
    for k in range(len(samples)):
        s = samples[k]
        capture = Capture(k, pool.camera, s.depth, np.zeros(s.depth.shape, np.uint8), None, s.amplitude, None, s.temperature)
        repaired = session.repair(capture, incidence=s.incidence, material=s.material)
        use = s.mask & np.isfinite(s.depth) & np.isfinite(repaired.sigma)
        rows.append(np.stack([np.abs(repaired.depth - s.label)[use], np.abs(s.depth - s.label)[use], repaired.sigma[use]]))
    error, raw, sigma = np.concatenate(rows, axis=1)
    certain = sigma <= np.quantile(sigma, TRUSTED)
    return Found(*(float(1e3 * e.mean()) for e in (error[certain], error, raw)))


def plot(curve: Mapping[int, Found]) -> None:
    """What more data buys."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure, ax = plt.subplots(figsize=(5.2, 3.2), layout="constrained")
    ax.plot(list(curve), [f.trusted for f in curve.values()], "-o", color="#0b7285", label=f"{100 * TRUSTED:.0f} % most certain pixels")
    ax.plot(list(curve), [f.every for f in curve.values()], "--o", color="#868e96", label="all pixels")
    ax.axhline(next(iter(curve.values())).raw, color="#e8590c", linestyle=":", label="raw, all pixels")
    ax.set_xscale("log")
    ax.set_xticks(list(curve), [str(n) for n in curve])
    ax.set_xlabel("training views")
    ax.set_ylabel(f"MAE on {HELD_OUT}, mm")
    ax.set_ylim(bottom=0)
    ax.legend(frameon=False)
    PLOT.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(PLOT, dpi=110)
    plt.close(figure)
