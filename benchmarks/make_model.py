# SPDX-License-Identifier: Apache-2.0
"""Train the network that the package carries: record virtual sessions of many scenes, label them, train (`make model`)."""

from __future__ import annotations

import argparse
import shutil
import sys
from pathlib import Path

from benchmarks.infer_data import EXACT_ROBOT, label_bag, record_bag
from benchmarks.infer_scenes import random_scene
from tof_core.progress import progress
from tof_virtual.twin import TwinCamera

HELD_OUT = "body_section"
"""The scene on which the sweep is judged. No built-in scene is ever trained or tuned on; random ones are."""
HOLLOW = 0.45
"""Share of scenes with a cavity in the second half of those that sigma is learnt on: it must hold before what is unlike the training."""
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
        from tof_infer.unseen import make_sure_again

        print(make_sure_again(options.out, unseen, options.out).figures)
        return 0
    datasets = make_data(options.work, range(1, first), options.views)
    if options.data_only:
        return 0
    from toftwin.cli import main as toftwin

    fixed = ["--epochs", "40", "--threads", str(THREADS)]
    return toftwin(["train", *map(str, datasets), "--unseen", *map(str, unseen), "--out", str(options.out), *fixed, *rest])


if __name__ == "__main__":
    sys.exit(main())
