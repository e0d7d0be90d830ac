# SPDX-License-Identifier: Apache-2.0
"""`toftwin train`: labelled datasets to a network that repairs depth, with a card that lists its data and figures."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from tof_core.errors import UsageError
from tof_core.shares import in_percent

if TYPE_CHECKING:
    import argparse

    from tof_infer.card import Card
    from tof_infer.config import TrainConfig
    from tof_scene.scene import Scene

NAME = "train"
HELP = "train the network that repairs depth, from labelled datasets"
ABOUT = (
    "Learns from the datasets of one camera how far each pixel is off, and how uncertain that is. Some stations take no "
    "part in training and judge the result. A run that was interrupted continues where it stopped. With --adapt a trained "
    "network is adapted to another camera: five labelled views and a minute of one core. Needs the extra 'train'."
)
EXAMPLE = (
    "toftwin train out/monday/dataset.zarr out/tuesday/dataset.zarr --out model.onnx --epochs 60\n"
    "  toftwin train out/five_views --adapt default --out model.onnx\n"
    "  toftwin train board/bag --board 5x7x0.030 --out model.onnx\n"
    "  toftwin train out/monday --sensor out/gap/sensor.yaml --rendered --scene cell/scene.yaml --out model.onnx"
)
FLAGS = ("recipe", "epochs", "batch", "rate", "seed", "limit", "threads", "device")
"""Settings that have a flag of their own; --set reaches all of them."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the flags."""
    from tof_core.config import table
    from tof_infer.config import TrainConfig
    from toftwin.options import add_config_arguments

    parser.add_argument(
        "datasets",
        nargs="+",
        type=Path,
        metavar="DATASET",
        help="dataset.zarr, or the folder that `toftwin label` wrote; with --board bags, or folders of PNG pairs",
    )
    parser.add_argument(
        "--board",
        metavar="BOARD",
        help="label bags of this calibration board first, as `toftwin label --board` does, into folders beside --out; 5x7x0.030 for instance",
    )
    parser.add_argument(
        "--out",
        type=Path,
        required=True,
        metavar="FILE",
        help="network to write (.onnx); its card, data and figures, is written beside it (.json), and a report (.html)",
    )
    parser.add_argument(
        "--adapt",
        metavar="MODEL",
        help="adapt this network (.onnx of any camera, or 'default': the one in the package) instead of training from the beginning",
    )
    parser.add_argument(
        "--unseen",
        nargs="+",
        type=Path,
        default=[],
        metavar="DATASET",
        help="datasets of other scenes of the same camera, on which sigma is calibrated",
    )
    parser.add_argument(
        "--sensor", type=Path, metavar="FILE", help="sensor.yaml of `toftwin gap`; half of the training frames are simulated with it"
    )
    parser.add_argument(
        "--rendered",
        action="store_true",
        help="train on rendered views alone: the scene around the datasets' poses, as the camera of --sensor measures it; no measured image is seen",
    )
    parser.add_argument(
        "--scene", type=Path, metavar="FILE", help="with --rendered: scene.yaml of the datasets; with --board it is the board"
    )
    parser.add_argument("--views", type=int, default=240, metavar="N", help="with --rendered: views that are rendered (default: 240)")
    parser.add_argument("--fresh", action="store_true", help="start from the beginning, even if a checkpoint exists")
    parser.add_argument("--json", action="store_true", help="print the card's figures as JSON")
    for info in table(TrainConfig):
        if info.name in FLAGS:
            parser.add_argument(
                f"--{info.name}", type=info.kind, choices=info.choices or None, help=f"{info.text} (default: {info.default})"
            )
    add_config_arguments(parser, "tof_infer.config:TrainConfig")


def run(args: argparse.Namespace) -> int:
    """Train, and print the figures of the network."""
    import sys

    from toftwin.extras import trainer

    config = load(args)
    if args.out.suffix != ".onnx":
        raise UsageError("must end in .onnx", where=f"--out {args.out}")
    _check_adapt(args)
    _check_rendered(args)
    train, bag = trainer("train"), args.datasets[0]
    if args.board is not None:
        from toftwin.board_training import labelled, near_labels

        args.datasets, config = labelled(args.datasets, args.board, args.out), near_labels(config)
    datasets, redraw = [dataset_at(p) for p in args.datasets], _redraw(args)
    if args.rendered:
        from toftwin.rendered_training import rendered

        redraw, datasets = None, [rendered(datasets, _scene(args, bag), args.sensor, args.out, args.views, fresh=args.fresh)]

    def say(line: str) -> None:
        print(line, file=sys.stderr, flush=True)

    if args.adapt is not None:
        from tof_infer.adapt import adapt
        from tof_infer.session import model_path

        card = adapt(datasets, model_path(args.adapt), args.out, config, redraw=redraw, say=say)
    else:
        card = train(datasets, args.out, config, redraw=redraw, fresh=args.fresh, unseen=[dataset_at(p) for p in args.unseen], say=say)
    from tof_infer.report import write

    page = write(card, args.out)
    if args.json:
        import json

        print(json.dumps(card.figures, indent=1))
    else:
        _print(card, args.out)
        print(f"report: {page}")
    return 0


NOT_ADAPTED = ("recipe", "epochs", "batch", "rate", "limit", "fresh", "unseen")
"""Flags that have no effect with `--adapt`."""


def _check_adapt(args: argparse.Namespace) -> None:
    """Refuse flags that have no effect with `--adapt`."""
    if args.adapt is None:
        return
    if given := [name for name in NOT_ADAPTED if getattr(args, name)]:
        raise UsageError("is not used with --adapt", where=f"--{given[0]}", todo="see train.adapt in --settings, or leave out --adapt")


def load(args: argparse.Namespace) -> TrainConfig:
    """Settings from file, flags and --set, in this order."""
    from dataclasses import replace

    from tof_infer.config import TrainConfig
    from toftwin.options import load_config, parse_settings

    config = load_config(TrainConfig, args)
    flags = {name: value for name in FLAGS if (value := getattr(args, name)) is not None}
    if both := sorted(flags.keys() & parse_settings(TrainConfig, args.set).keys()):
        raise UsageError(f"'{both[0]}' is given twice", where="--set")
    return replace(config, **flags)


def dataset_at(path: Path) -> Path:
    """A dataset, or the dataset in a folder that `toftwin label` wrote."""
    inside = path / "dataset.zarr"
    return inside if inside.exists() else path


def _check_rendered(args: argparse.Namespace) -> None:
    if args.scene is not None and not args.rendered:
        raise UsageError(
            "is for --rendered alone",
            where=f"--scene {args.scene}",
            todo="leave it out: the datasets contain what training needs of the scene",
        )
    if not args.rendered:
        return
    if args.sensor is None:
        raise UsageError("needs the camera's model", where="--rendered", todo="pass --sensor FILE, which `toftwin gap` writes")
    if (args.scene is None) == (args.board is None):
        raise UsageError(
            "needs what the datasets show", where="--rendered", todo="pass --scene FILE, or --board where the scene is a board"
        )


def _scene(args: argparse.Namespace, bag: Path) -> Scene:
    """The scene to render: scene.yaml, or the board with the albedos that its first bag shows."""
    from toftwin.inputs import source
    from toftwin.pipeline import PipelineConfig

    if args.scene is not None:
        from tof_scene.builtin import open_scene

        return open_scene(args.scene)
    with source(bag, PipelineConfig(), board=args.board) as (_, scene):
        return scene


def _redraw(args: argparse.Namespace) -> Any:
    if args.sensor is None:
        return None
    from tof_infer.augment import Redraw
    from tof_sensor.model import load_model
    from tof_sim_label.dataset import open_dataset

    return Redraw(load_model(args.sensor), open_dataset(dataset_at(args.datasets[0])).camera)


def _print(card: Card, out: Path) -> None:
    f = card.figures
    print(f"{out}: {f['weights']:,} weights, {out.stat().st_size / 1e6:.2f} MB; card in {out.with_suffix('.json')}")
    where = "other stations" if card.split["by"] == "station" else "the other half"
    print(f"validation ({card.split['val_views']} views of {where}): MAE {f['val_mae_mm']:.2f} mm, raw {f['val_raw_mae_mm']:.2f} mm")
    if f["val_mae_known_mm"] is not None:
        print(f"pixels that it repairs ({in_percent(f['val_known'], 1)}): MAE {f['val_mae_known_mm']:.2f} mm")
    print(f"errors within 1 sigma {in_percent(f['val_within_1_sigma'], 1)}, within 2 sigma {in_percent(f['val_within_2_sigma'], 1)}")
    if "unseen_mae_mm" in f:
        print(
            f"scenes never seen: MAE {f['unseen_mae_mm']:.2f} mm, raw {f['unseen_raw_mae_mm']:.2f} mm; pixels that it repairs ({in_percent(f['unseen_known'], 1)}) "
            f"{f['unseen_mae_known_mm']:.2f} mm; within 1 sigma {in_percent(f['unseen_within_1_sigma'], 1)}, within 2 sigma {in_percent(f['unseen_within_2_sigma'], 1)}"
        )
