# SPDX-License-Identifier: Apache-2.0
"""Networks trained on a simulated camera alone, before and after its diagnosis, beside one trained on labelled real views: error left on other real views."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.bench_board import DATA
from benchmarks.figure import Figure, at_most
from benchmarks.gap_check.foreign.cases import ForeignCase
from benchmarks.recorded import FOLDER

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from benchmarks.reality_cameras import Camera
    from tof_core.arrays import Image
    from tof_core.capture import Capture

LONG = True
OUT = FOLDER / "reality"
PICTURE = Path(__file__).resolve().parent.parent / "docs" / "pictures" / "train_reality.png"
SIZE = (128, 98)
PLAN = {"plan.views": 20, "plan.stations": 4, "plan.pause_s": 20.0}
CAMERAS = (
    ForeignCase("driver and traps", "reality", "housing", "walker", {"slow_driver": 2.0, "charge_traps": 2.0}, "", 701, PLAN),
    ForeignCase("four causes", "reality", "gearbox", "cart", dict.fromkeys(("slow_driver", "charge_traps", "flood_light", "clock_columns"), 1.0), "", 702, PLAN),
)  # fmt: skip
"""Emerging cameras; strength 1 is 3 mm RMS over the affected pixels."""
BEFORE_BOARD = "Kinect v2 before a board"
STEPS, BOARD_STEPS, BATCH, CHANNELS = 500, 150, 2, 12
"""Of each network: a small one, so that the whole takes less than half an hour of a core."""
RENDERED = 120
"""Views that are rendered around those of a session."""
EVERY_MM = 1000.0
"""Limit of sigma with which a network repairs every pixel: one that leaves doubtful pixels as measured compares with none that does not."""
NAMES = {"raw": "raw", "labels": "labelled real views", "before": "simulated, before the diagnosis", "after": "simulated, after it"}


@dataclass(frozen=True, slots=True)
class Row:
    """Mean absolute error in mm on held-out real views against the truth, mean of views: raw, and repaired by each network; the verdict."""

    name: str
    raw: float
    labels: float
    before: float
    after: float
    named: tuple[str, ...]


def run() -> list[Figure]:
    """The error left by each network, camera by camera; draws the picture of docs/real.md."""
    from benchmarks.reality_cameras import before_board, emerging

    rows = [_row(case.name, partial(emerging, case, SIZE)) for case in CAMERAS]
    if DATA.is_dir():
        rows.append(_row(BEFORE_BOARD, before_board))
    print(table(rows), flush=True)
    draw(rows)
    return [figure for row in rows for figure in _figures(row)]


def table(rows: Sequence[Row]) -> str:
    """One line a camera."""
    lines = [f"{'MAE in mm':24} " + " ".join(f"{text:>32}" for text in NAMES.values()) + "  named"]
    lines += [f"{r.name:24} " + " ".join(f"{getattr(r, name):32.2f}" for name in NAMES) + f"  {', '.join(r.named)}" for r in rows]
    return "\n".join(lines)


def draw(rows: Sequence[Row]) -> None:
    """Four bars a camera."""
    from tof_core.page import PALETTE, axes

    figure, grid = axes(9, 3.2)
    plot, width = grid[0][0], 0.2
    for k, (name, text) in enumerate(NAMES.items()):
        colour = PALETTE[("neutral", "accent", "third", "contrast")[k]]
        plot.bar(np.arange(len(rows)) + (k - 1.5) * width, [getattr(r, name) for r in rows], 0.9 * width, color=colour, label=text)
    plot.set_xticks(range(len(rows)), [r.name for r in rows])
    plot.set(ylabel="MAE on held-out real views, mm")
    plot.legend(frameon=False)
    figure.savefig(PICTURE, dpi=80)


def _figures(row: Row) -> list[Figure]:
    remark = f"raw {row.raw:.2f} mm, trained on labelled real views {row.labels:.2f} mm; named: {', '.join(row.named)}"
    what = f"{row.name}: error of real views after a network trained on simulated views alone"
    return [
        Figure(f"{what}, before the diagnosis", row.before, "mm", remark=remark),
        at_most(f"{what}, after the diagnosis", row.after, row.before, "mm", remark=remark),
    ]


def _row(name: str, make: Callable[[Path], Camera]) -> Row:
    """One camera; what an interrupted run has measured is read."""
    folder = OUT / name.replace(" ", "-")
    path = folder / "row.json"
    if not path.exists():
        path.write_text(json.dumps(asdict(measured(name, make(folder)))))
    row = Row(**json.loads(path.read_text()))
    print(table([row]), file=sys.stderr, flush=True)
    return row


def measured(name: str, camera: Camera) -> Row:
    """Train the three networks and judge them."""
    from toftwin.rendered_training import rendered

    data = {"labels": camera.dataset}
    for model in ("before", "after"):
        data[model] = rendered([camera.dataset], camera.scene, camera.folder / f"{model}.yaml", camera.folder / f"{model}.onnx", RENDERED)
    steps = BOARD_STEPS if name == BEFORE_BOARD else STEPS
    maes = {model: _mae(camera.held, _trained(camera, path, camera.folder / f"{model}.onnx", steps)) for model, path in data.items()}
    return Row(name, _mae(camera.held, None), maes["labels"], maes["before"], maes["after"], camera.named)


def _trained(camera: Camera, dataset: Path, out: Path, steps: int) -> Path:
    """A small network of one dataset, after as many steps as any other."""
    from tof_infer.train import train
    from tof_sim_label.dataset import open_dataset

    if not out.exists():
        config, captures = camera.settings, open_dataset(dataset).captures
        epochs = max(round(steps * BATCH / (captures * (1 - config.val))), 1)
        train([dataset], out, replace(config, net=replace(config.net, base=CHANNELS), epochs=epochs, batch=BATCH, threads=1))
    return out


def _mae(held: Sequence[tuple[Capture, Image]], network: Path | None) -> float:
    """Mean over the views of the mean absolute error in mm of the pixels that the camera measured."""
    from tof_infer.config import InferConfig
    from tof_infer.session import Session

    session = None if network is None else Session(InferConfig(model=str(network), force=True, max_sigma_mm=EVERY_MM))
    depths = [c.depth if session is None else session.repair(c).depth for c, _ in held]
    return 1e3 * float(np.mean([np.nanmean(np.abs(d - true)) for d, (_, true) in zip(depths, held, strict=True)]))
