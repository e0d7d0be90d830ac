# SPDX-License-Identifier: Apache-2.0
"""`toftwin demo`: the whole pipeline on a virtual robot."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import argparse

NAME = "demo"
HELP = "record a virtual session, label, diagnose, correct, inspect and simulate it, and write a report"
ABOUT = (
    "Needs no robot, no CAD and no data. A virtual robot looks at a built-in scene and records a bag. The bag is replayed "
    "through the ROS graph, aligned to the CAD and labelled; the gap between camera and simulation is diagnosed. On the day "
    "after, one part is gone and one displaced: the hand is corrected, the parts are inspected, and the day is simulated with "
    "the fitted sensor. The report compares each result with the truth, which the virtual robot stores beside the bag."
)
EXAMPLE = "toftwin demo --out out/demo"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the flags."""
    from toftwin.options import add_config_arguments

    parser.add_argument(
        "--out",
        type=Path,
        default=Path("out/demo"),
        metavar="DIR",
        help="folder of the results; an earlier demo in it is replaced (default: out/demo)",
    )
    parser.add_argument("--json", action="store_true", help="print the figures as JSON")
    add_config_arguments(parser, "toftwin.demo.config:DemoConfig")


def run(args: argparse.Namespace) -> int:
    """Run the demo, print the table."""
    from tof_core.errors import UsageError
    from toftwin.demo.config import DemoConfig
    from toftwin.demo.run import MARK, run_demo, summary
    from toftwin.options import load_config

    config = load_config(DemoConfig, args)
    if args.out.exists() and not (args.out / MARK).exists() and (not args.out.is_dir() or any(args.out.iterdir())):
        raise UsageError("is not a demo's folder and would be replaced", where=args.out, todo="name another with --out")
    result = run_demo(args.out, config)
    if args.json:
        import json

        rows = {name: error.to_dict() for name, error in result.errors.rows}
        poses = {p.name: {"mm": p.millimetres.tolist(), "deg": p.degrees.tolist()} for p in result.errors.poses}
        spent = {name: {"seconds": s.seconds, "processor": s.processor} for name, s in result.spent.items()}
        print(json.dumps({"depth": rows, "poses": poses, "honest": result.errors.honest, "spent": spent}, indent=1))
        return 0
    print(summary(result))
    print(f"report: {args.out / 'report.html'}")
    return 0
