# SPDX-License-Identifier: Apache-2.0
"""`toftwin label`: a bag and its CAD to a dataset in which every pixel has its true distance."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import argparse

    from toftwin.labelling import LabelResult

NAME = "label"
HELP = "label a bag: accumulate, align to the CAD, ray cast, write a dataset"
EXAMPLE = "toftwin label session/bag --scene cell/scene.yaml --out out/session\n  toftwin label 'bags/*.mcap' --scene cell/scene.yaml --out out/bags"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the flags."""
    from toftwin.options import add_bag_arguments, add_config_arguments, at_least

    parser.add_argument(
        "bag", nargs="+", metavar="BAG", help="the bag's folder, .mcap or .db3 file; several, or a quoted pattern, make a batch"
    )
    parser.add_argument(
        "--scene", type=Path, required=True, metavar="SCENE", help="scene.yaml of the cell, its folder, or a built-in scene's name"
    )
    parser.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="folder for dataset.zarr, poses.json, metrics.json, config.yaml"
    )
    parser.add_argument(
        "--mode",
        default="final",
        choices=("final", "causal", "per_view", "robot"),
        help=(
            "final: one solution of the whole session (for training); causal: as the nodes do live; "
            "per_view: a free pose per view (the paper's); robot: the robot's own pose (default: final)"
        ),
    )
    parser.add_argument("--engine", choices=("local", "ray"), help="where a batch runs: processes of this host (default), or a Ray cluster")
    parser.add_argument(
        "--workers", type=at_least(1), default=0, metavar="N", help="of a batch, one core each (default: as many as there are cores)"
    )
    parser.add_argument("--json", action="store_true", help="print the figures as JSON")
    add_bag_arguments(parser)
    add_config_arguments(parser, _settings)


def _settings() -> type[Any]:
    from toftwin.pipeline import PipelineConfig

    return PipelineConfig


def run(args: argparse.Namespace) -> int:
    """Label, print the table."""
    from toftwin.batch import is_batch, label_batch

    if is_batch(args):
        return label_batch(args)
    (args.bag,) = args.bag
    result = label(args)
    if args.json:
        import json

        print(json.dumps(result.to_dict(), indent=1))
        return 0
    _print(result)
    return 0


def label(args: argparse.Namespace) -> LabelResult:
    """Label one bag."""
    from tof_scene.raycast import Raycaster
    from toftwin.inputs import opened
    from toftwin.labelling import label_bag
    from toftwin.options import load_config
    from toftwin.pipeline import PipelineConfig

    config = load_config(PipelineConfig, args)
    with opened(args.bag, args.scene, config, args.initial_pose) as (reader, scene):
        assert scene is not None
        return label_bag(reader, Raycaster(scene), config, args.out, mode=args.mode)


def hashes(args: argparse.Namespace) -> tuple[str, str, str]:
    """What a dataset of this call says it was made with: scene, configuration, way of posing."""
    from dataclasses import replace

    from tof_core.hashing import digest_config
    from tof_scene.builtin import open_scene
    from toftwin.labelling import MODES, POSE_SOURCES
    from toftwin.options import load_config
    from toftwin.pipeline import PipelineConfig

    config = load_config(PipelineConfig, args)
    config = replace(config, align=replace(config.align, mode=MODES[args.mode]))
    return open_scene(args.scene).digest, digest_config(config), POSE_SOURCES[args.mode]


def _print(result: Any) -> None:
    from tof_eval.tables import depth_table

    if result.note:
        print(result.note)
    skipped = "; skipped: " + ", ".join(f"{reason} {count}" for reason, count in result.skipped.items()) if result.skipped else ""
    print(f"{result.captures} captures, {result.views} views in {result.dataset}{skipped}")
    print("verdicts: " + ", ".join(f"{verdict} {count}" for verdict, count in result.verdicts.most_common()))
    print(depth_table(result.rows))
