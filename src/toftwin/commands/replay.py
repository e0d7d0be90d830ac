# SPDX-License-Identifier: Apache-2.0
"""`toftwin replay`: a bag through the ROS graph over DDS; results recorded, or compared with a recording."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import argparse

    from tof_eval.runs import RunComparison
    from toftwin.replay import ReplayResult

NAME = "replay"
HELP = "run a bag through the ROS graph over DDS, and record or compare the results"
ABOUT = (
    "Starts the node preproc and, with a scene, the node sim_label, plays the bag on its own clock, and waits for each "
    "frame, so that none is lost. The exit code is 1 if a frame is lost or the results differ from an earlier run."
)
EXAMPLE = "toftwin replay session/bag --scene cell/scene.yaml --record out/run\n  toftwin replay session/bag --scene cell/scene.yaml --against out/run"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the flags."""
    from toftwin.options import add_bag, add_bag_arguments, add_config_arguments, add_scene, positive

    add_bag(parser)
    add_scene(parser, use="without it only preproc runs")
    parser.add_argument("--record", type=Path, metavar="OUT", help="record what the graph publishes as a new bag")
    parser.add_argument(
        "--against", type=Path, metavar="OUT", help="compare with the recording of an earlier run; exit code 1 if they differ"
    )
    parser.add_argument("--realtime", action="store_true", help="play at the pace of the bag without waiting; frames may be lost")
    parser.add_argument("--rate", type=positive, metavar="FACTOR", help="pace of --realtime as a multiple of the bag's (default: 1)")
    parser.add_argument(
        "--running",
        action="store_true",
        help="start no nodes; play to those that run in this ROS_DOMAIN_ID (with --realtime, unless they wait for late frames)",
    )
    parser.add_argument("--points", action="store_true", help="record point clouds too")
    parser.add_argument("--exact", action="store_true", help="with --against: compare without tolerances")
    parser.add_argument("--json", action="store_true", help="print the result as JSON")
    add_bag_arguments(parser)
    add_config_arguments(parser, "toftwin.pipeline:PipelineConfig")


def run(args: argparse.Namespace) -> int:
    """Play the bag, then compare if asked to."""
    from tempfile import TemporaryDirectory

    from tof_core.errors import UsageError
    from tof_eval.runs import EXACT, TOLERANCES, compare_runs

    if args.rate and not args.realtime:
        raise UsageError("only --realtime has a pace", where="--rate", todo="add --realtime")
    with TemporaryDirectory(prefix="toftwin-") as scratch:
        record = args.record or (Path(scratch) / "run" if args.against else None)
        result = play(args, record)
        tolerances = dict.fromkeys(TOLERANCES, EXACT) if args.exact else TOLERANCES
        comparison = compare_runs(record, args.against, tolerances) if args.against and record else None
    if args.json:
        print(json.dumps(_facts(result, comparison), indent=1))
    else:
        _print(result, comparison, args)
    return int(result.report.lost > 0 and not args.realtime) or int(comparison is not None and not comparison.same)


def play(args: argparse.Namespace, record: Path | None) -> ReplayResult:
    """Open bag and scene, start the graph, play."""
    from tof_ros.player import PlayOptions
    from toftwin.inputs import opened
    from toftwin.options import load_config
    from toftwin.pipeline import PipelineConfig
    from toftwin.replay import replay

    config = load_config(PipelineConfig, args)
    with opened(args.bag, args.scene, config, args.initial_pose) as (reader, scene):
        options = PlayOptions(realtime=args.realtime, rate=args.rate or 1.0)
        return replay(
            reader, config, scene=args.scene if scene else None, options=options, record=record, points=args.points, running=args.running
        )


def _facts(result: ReplayResult, comparison: RunComparison | None) -> dict[str, Any]:
    r = result.report
    facts = {
        "sent": r.sent,
        "fates": dict(r.fates),
        "lost": r.lost,
        "seconds": round(r.seconds, 2),
        "cpu_seconds": round(result.cpu_s, 2),
        "memory_mb": round(result.memory_bytes / 1e6),
        "recorded": result.recorded,
    }
    if comparison is not None:
        facts |= {
            "same": comparison.same,
            "compared": dict(comparison.compared),
            "largest": dict(comparison.largest),
            "first_difference": str(comparison.first) if comparison.first else None,
        }
    return facts


HINT = (
    "replay: a graph set up for a live camera drops frames that arrive faster than it can process them: "
    "add --realtime, or start it with --param preproc.live.reliable=true --param preproc.live.patience_s=8"
)


def _print(result: ReplayResult, comparison: RunComparison | None, args: argparse.Namespace) -> None:
    r = result.report
    skipped = ", ".join(f"{reason} {count}" for reason, count in sorted(r.fates.items()) if reason != "kept")
    print(f"{r.sent} frames sent, {r.fates['kept']} kept, {r.lost} lost" + (f"; skipped: {skipped}" if skipped else ""))
    took = f"{r.seconds:.1f} s, {r.sent / max(r.seconds, 1e-9):.1f} frames/s"
    used = f"used {result.memory_bytes / 1e6:.0f} MB, {1e3 * result.cpu_s / max(r.sent, 1):.0f} ms of processor a frame"
    print(took if args.running else f"{took}; graph ({', '.join(result.nodes)}) {used}")
    if args.record is not None:
        print(f"{result.recorded} messages recorded in {args.record}")
    if args.running and not args.realtime and r.fates["kept"] < r.sent:
        print(HINT, file=sys.stderr)
    if comparison is not None:
        _print_comparison(comparison)


def _print_comparison(comparison: RunComparison) -> None:
    from tof_eval.runs import tolerance_of

    print(f"{'topic':<24}{'messages':>10}{'largest difference':>20}{'allowed':>12}{'in % of pixels':>16}")
    for topic, count in sorted(comparison.compared.items()):
        t = tolerance_of(topic)
        print(f"{topic:<24}{count:>10}{comparison.largest[topic]:>20.3g}{t.absolute:>12g}{100 * t.share:>16.2f}")
    print("the runs agree" if comparison.same else f"the runs differ: {comparison.first}")
