# SPDX-License-Identifier: Apache-2.0
"""`toftwin label`: a bag and its CAD to a dataset in which every pixel has its true distance."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import argparse

    from toftwin.label_call import Outcome
    from toftwin.labelling import LabelResult
    from toftwin.pipeline import PipelineConfig

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
    """Label one bag or a batch, and print the figures; 1 if a bag of a batch failed."""
    from toftwin.batch import is_batch
    from toftwin.label_call import LabelCall
    from toftwin.options import load_config
    from toftwin.pipeline import PipelineConfig

    config = load_config(PipelineConfig, args)
    if is_batch(args.bag, args.engine):
        return _batch(args, config)
    result = LabelCall(args.bag[0], args.scene, args.out, config, args.mode, args.initial_pose or "").run()
    if args.json:
        print(json.dumps(result.to_dict(), indent=1))
    else:
        _print(result)
    return 0


def _batch(args: argparse.Namespace, config: PipelineConfig) -> int:
    from dataclasses import asdict

    from toftwin.batch import REPORT, label_bags
    from toftwin.label_call import FAILED, KEPT

    def show(outcome: Outcome) -> None:
        if not args.json:
            print(outcome.line(), flush=True)

    outcomes = label_bags(
        args.bag,
        args.scene,
        args.out,
        config,
        mode=args.mode,
        initial_pose=args.initial_pose or "",
        engine=args.engine or "local",
        workers=args.workers,
        each=show,
    )
    failed, kept = (sum(o.state == state for o in outcomes) for state in (FAILED, KEPT))
    if args.json:
        print(json.dumps([asdict(o) for o in outcomes], indent=1))
    else:
        print(f"{len(outcomes)} bags: {len(outcomes) - failed} labelled ({kept} of them before), {failed} failed; {args.out / REPORT}")
    return int(failed > 0)


def _print(result: LabelResult) -> None:
    from tof_eval.tables import depth_table

    if result.note:
        print(result.note)
    skipped = "; skipped: " + ", ".join(f"{reason} {count}" for reason, count in result.skipped.items()) if result.skipped else ""
    print(f"{result.captures} captures, {result.views} views in {result.dataset}{skipped}")
    print("verdicts: " + ", ".join(f"{verdict} {count}" for verdict, count in result.verdicts.most_common()))
    print(depth_table(result.rows))
