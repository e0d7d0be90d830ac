# SPDX-License-Identifier: Apache-2.0
"""`toftwin evaluate`: the error of raw, filtered and repaired depth (figure 9 of the paper), and where it is large."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import argparse

NAME = "evaluate"
HELP = "compare methods that repair depth with the true depth"
ABOUT = (
    "Applies several methods to the same views: none (raw), the filters (rules), the filters after a correction of the "
    "sensor's bias (corrected), and the trained network (model). The reference is the truth file of a virtual session, or "
    "else the session's own labels. Errors are listed by capture, part, range, incidence, albedo and distance to an edge."
)
EXAMPLE = "toftwin evaluate out/sweep --scene cell/scene.yaml --methods raw,rules,model --truth out/sweep.truth.npz --out out/evaluation"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the flags."""
    from toftwin.options import add_bag, add_bag_arguments, add_config_arguments, add_scene_arguments, at_least

    add_bag(parser)
    add_scene_arguments(parser)
    parser.add_argument(
        "--methods",
        default="raw,rules,model",
        metavar="LIST",
        help="methods, separated by commas: raw, rules, corrected, model (default: raw,rules,model)",
    )
    parser.add_argument(
        "--truth", type=Path, metavar="FILE", help="truth file (.npz) of a virtual session (default: compare with the session's own labels)"
    )
    parser.add_argument(
        "--model", default="default", metavar="FILE", help="network (.onnx) of `toftwin train` (default: the one in the package)"
    )
    parser.add_argument("--sensor", type=Path, metavar="FILE", help="sensor.yaml of `toftwin gap`, for the method 'corrected'")
    parser.add_argument(
        "--frames",
        type=at_least(1),
        default=1,
        metavar="N",
        help="add the filters with N captures of a dwell as a further method (default: 1, none)",
    )
    parser.add_argument("--force", action="store_true", help="use a network that was trained for another camera or range")
    parser.add_argument("--out", type=Path, metavar="DIR", help="folder for evaluation.json and report.html")
    parser.add_argument("--json", action="store_true", help="print the figures as JSON")
    add_bag_arguments(parser)
    add_config_arguments(parser, "toftwin.pipeline:PipelineConfig")


def run(args: argparse.Namespace) -> int:
    """Evaluate, print the table."""
    from dataclasses import replace

    from tof_eval.methods import make_methods
    from tof_eval.tables import captures_table, methods_table
    from tof_infer.config import InferConfig
    from tof_infer.session import Session
    from tof_scene.raycast import Raycaster
    from tof_sensor.model import load_model
    from toftwin.boarded import posed_by_board
    from toftwin.evaluating import evaluate_bag, frame_bias
    from toftwin.inputs import source
    from toftwin.options import load_config
    from toftwin.paths import session_name
    from toftwin.pipeline import PipelineConfig

    config = load_config(PipelineConfig, args)
    names = [n.strip() for n in args.methods.split(",") if n.strip()]
    session = Session(InferConfig(model=args.model, force=args.force)) if "model" in names else None
    bias = frame_bias(load_model(args.sensor)) if args.sensor else None
    methods = make_methods(names, config.preproc, session, bias, args.frames)
    opened = source(args.bag, config, scene=args.scene, board=args.board, calibrate=args.calibrate, initial_pose=args.initial_pose)
    with opened as (reader, scene):
        config = replace(config, align=posed_by_board(reader, config.align))
        evaluation = evaluate_bag(reader, Raycaster(scene), methods, config, truth=args.truth)
    result = {**evaluation.result, "bag": session_name(args.bag), "scene": evaluation.result["scene"] or str(args.scene or args.board)}
    if args.out is not None:
        from tof_eval.report import write

        write(args.out, result, evaluation.shown)
    if args.json:
        import json

        print(json.dumps(result, indent=1))
    else:
        print(
            f"{result['views']} views, compared with {result['reference']}\n\n{methods_table(result['methods'])}\n\n{captures_table(result['methods'])}"
        )
        if args.out is not None:
            print(f"report: {args.out / 'report.html'}")
    return 0
