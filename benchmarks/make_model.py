# SPDX-License-Identifier: Apache-2.0
"""Train the network that the package carries: record virtual sessions of many scenes, label them, train (`make model`)."""

from __future__ import annotations

import argparse
import shutil
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks.infer_data import EXACT_ROBOT, label_bag, record_bag
from benchmarks.infer_scenes import random_scene
from tof_core.config import from_mapping
from tof_core.progress import progress
from tof_infer.config import TrainConfig
from tof_infer.sigma_calibration import Calibration
from tof_virtual.twin import TwinCamera

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_infer.card import Card

HELD_OUT = "body_section"
"""The scene on which the sweep is judged. No built-in scene is ever trained or tuned on; random ones are."""
HOLLOW = 0.45
"""Share of scenes with a cavity in the second half of those that sigma is learnt on: it must hold before what is unlike the training."""
OF_DEPTH = ("val_mae_mm", "val_raw_mae_mm")
"""Figures of the validation views that do not depend on sigma."""
THREADS = 1
"""Threads of the training: sums over several are added in another order, and by default as many train as other processes leave free."""
DEFAULT = Path("src/tof_infer/models/default.onnx")
EXAMPLE = "example: python -m benchmarks.make_model --work out/model --scenes 57 --epochs 40"


def make_data(work: Path, scenes: range, views: int, hollow: float = 0.0) -> list[Path]:
    """Labelled datasets of random scenes, one for each number, such a share with a cavity; those that are there are kept."""
    camera = TwinCamera()
    datasets = []
    for seed in progress(scenes, "scenes", len(scenes)):
        name = f"{'hollow' if hollow else 'random'}_{seed:02d}"
        dataset = work / f"{name}.zarr"
        datasets.append(dataset)
        if dataset.exists():
            continue
        scene = random_scene(seed, hollow)
        shutil.rmtree(work / f"{name}.part", ignore_errors=True)
        bag = work / f"{name}_session"
        shutil.rmtree(bag, ignore_errors=True)
        record_bag(
            scene, camera, bag, seed=10_000 + seed, settings={"plan.views": views, "plan.stations": max(views // 2, 1), **EXACT_ROBOT}
        )
        label_bag(bag, scene, work / f"{name}.part")
        (work / f"{name}.part").rename(dataset)
    return datasets


def recalibrate_sigma(model: Path, unseen: Sequence[Path], out: Path) -> Card:
    """Write the model with a sigma trained and calibrated on these datasets; its depth network is unchanged.

    Raises:
        ModelError: not a network of `toftwin train`.
        RefusedError: too few stations.
        DatasetError: a damaged dataset, or of another camera than the first.
    """
    import torch

    from tof_infer.export import export, restore
    from tof_infer.samples import Pool
    from tof_infer.unseen import Unseen, calibrate_sigma

    net, card = restore(model)
    net.doubt = None
    config = from_mapping(TrainConfig, card.config, where="card")
    torch.set_num_threads(max(config.threads, 1))
    others = Unseen.of(unseen, Pool(unseen))
    figures, limit = calibrate_sigma(net, {}, others, config, torch.device("cpu"))
    kept = {name: card.figures[name] for name in OF_DEPTH if name in card.figures}
    split = {name: value for name, value in card.split.items() if not name.startswith("unseen")}
    card = replace(card, figures={**kept, **figures}, max_sigma_m=limit, split={**split, **others.facts})
    export(net, Calibration(**figures["calibration"]), card, out)
    return card


def main(arguments: list[str] | None = None) -> int:
    """Make data, then train; both go on where they were stopped."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.make_model", description=__doc__, epilog=EXAMPLE)
    parser.add_argument("--work", type=Path, default=Path("out/model"), help="folder of sessions, datasets and checkpoints")
    parser.add_argument("--out", type=Path, default=DEFAULT, help="the model to write")
    parser.add_argument("--scenes", type=int, default=57, help="random scenes")
    parser.add_argument(
        "--unseen", type=int, default=60, help="scenes of either kind that sigma is learnt and calibrated on, never trained on"
    )
    parser.add_argument("--views", type=int, default=10, help="views of each")
    parser.add_argument("--data-only", action="store_true", help="stop before training")
    parser.add_argument("--sigma-only", action="store_true", help="do not train: give the model that is there a new sigma")
    options, rest = parser.parse_known_args(arguments)
    options.work.mkdir(parents=True, exist_ok=True)
    first = options.scenes + 1
    unseen = make_data(options.work, range(first, first + options.unseen), options.views)
    unseen += make_data(options.work, range(1, 1 + options.unseen), options.views, HOLLOW)
    if options.sigma_only:
        print(recalibrate_sigma(options.out, unseen, options.out).figures)
        return 0
    datasets = make_data(options.work, range(1, first), options.views)
    if options.data_only:
        return 0
    from toftwin.cli import main as toftwin

    fixed = ["--epochs", "40", "--threads", str(THREADS)]
    return toftwin(["train", *map(str, datasets), "--unseen", *map(str, unseen), "--out", str(options.out), *fixed, *rest])


if __name__ == "__main__":
    sys.exit(main())
