# SPDX-License-Identifier: Apache-2.0
"""`toftwin inspect`: whether each part is where the CAD has it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import argparse
    from collections.abc import Sequence

    from tof_inspect.history import Trend
    from tof_inspect.judge import Inspection, Inspector
    from toftwin.inspection import InspectionConfig

NAME = "inspect"
HELP = "decide for each part whether it is present, absent, displaced or not observable"
ABOUT = (
    "Compares the measured depth with the CAD, each part with and without it; colour pictures of the complete scene add "
    "evidence. The camera's errors are estimated from everything else that the session shows. A part that no view shows well enough "
    "is not observable: nothing is guessed. The exit code is 1 if a part is absent or displaced."
)
EXAMPLE = "toftwin inspect session/bag --scene cell/scene.yaml --out out/inspection"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the flags."""
    from toftwin.options import add_bag, add_bag_arguments, add_config_arguments, add_scene, add_sensor

    add_bag(parser)
    add_scene(parser, required=True)
    parser.add_argument(
        "--reference",
        type=Path,
        action="append",
        default=[],
        metavar="REF",
        help="reference of the complete cell: a bag (displacements are measured since then, from about the same views) or a view in "
        "colour (toftwin correct --save --scene); may be repeated",
    )
    parser.add_argument(
        "--history",
        type=Path,
        metavar="DIR",
        help="folder that keeps this inspection beside the earlier ones; parts that creep are named before they leave their tolerance",
    )
    parser.add_argument(
        "--all-judged", action="store_true", help="exit code 1 also where a part is not observable or its tolerance cannot be judged"
    )
    add_sensor(parser, "poses are solved and parts judged")
    parser.add_argument("--out", type=Path, metavar="DIR", help="folder for inspection.json and inspection.html (default: print only)")
    parser.add_argument("--json", action="store_true", help="print the verdicts as JSON")
    add_bag_arguments(parser)
    add_config_arguments(parser, "toftwin.inspection:InspectionConfig")


def run(args: argparse.Namespace) -> int:
    """Inspect; 1 if a part is absent or displaced, or, with --all-judged, not judged."""
    import json

    from toftwin.inputs import opened
    from toftwin.inspection import InspectionConfig, inspect_views
    from toftwin.options import load_config
    from toftwin.paths import session_name
    from toftwin.pipeline import ViewStream

    config = load_config(InspectionConfig, args)
    with opened(args.bag, args.scene, config, args.initial_pose) as (reader, scene):
        assert scene is not None
        views = tuple(ViewStream(reader, config))

    from tof_inspect import history
    from tof_inspect.judge import Inspector
    from tof_inspect.report import content, write
    from tof_scene.raycast import Raycaster
    from toftwin.known import bias_in

    inspector = Inspector(Raycaster(scene), config.inspect, config.align, bias=bias_in(scene, args.sensor))
    _learn(args, inspector, config)
    found = inspect_views(views, inspector)
    result = content(found, scene.digest)
    trends = history.trends(history.add(args.history, result)) if args.history else []
    result["trends"] = [t.to_dict() for t in trends]
    page = write(inspector, found, args.out, session_name(args.bag), trends) if args.out else None
    if args.json:
        print(json.dumps(result, indent=1))
    else:
        print("\n".join(_lines(found, trends)))
        if page:
            print(f"report: {page}")
    wrong = result["counts"]["absent"] or result["counts"]["displaced"]
    return 1 if wrong or (args.all_judged and not all(v.judged for v in found.verdicts)) else 0


def _learn(args: argparse.Namespace, inspector: Inspector, config: InspectionConfig) -> None:
    """Set the inspector's references: views in colour, and at most one session."""
    import sys

    from arm_correction.reference import load_reference
    from tof_core.errors import UsageError
    from toftwin.inputs import opened
    from toftwin.inspection import first_pictures, learn_bag

    views = [path for path in args.reference if path.with_suffix("").with_suffix(".json").exists()]
    bags = [path for path in args.reference if path not in views]
    if len(bags) > 1:
        raise UsageError("two reference sessions are given", where="--reference", todo="give one bag; views in colour may be several")
    inspector.first, lacking = first_pictures({str(path): load_reference(path) for path in views}, inspector.scene.digest)
    for line in lacking:
        print(line, file=sys.stderr)
    for bag in bags:
        with opened(bag, args.scene, config, args.initial_pose) as (reader, _):
            inspector.standing = learn_bag(reader, inspector, config)


def _lines(found: Inspection, trends: Sequence[Trend]) -> list[str]:
    """The printed lines: one for each part, the trends, and the counts."""
    lines = []
    for v in found.verdicts:
        p = "      " if v.probability != v.probability else f"{v.probability:.4f}"  # NaN: nothing was seen
        lines.append(f"{v.name:20} {v.state.replace('_', ' '):15} {p}  {v.why}" + (f"; {v.todo}" if v.todo else ""))
    states = [v.state for v in found.verdicts]
    counts = ", ".join(f"{states.count(s)} {s.replace('_', ' ')}" for s in ("present", "absent", "displaced", "not_observable"))
    unjudged = sum(v.state == "present" and not v.judged for v in found.verdicts)
    return [
        *lines,
        *(t.words() for t in trends if t.creeps),
        found.colour,
        counts + (f"; tolerance not judged: {unjudged}" if unjudged else ""),
    ]
