# SPDX-License-Identifier: Apache-2.0
"""`toftwin inspect`: is every part there, where the CAD has it?"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import argparse

NAME = "inspect"
HELP = "inspect a bag: for each part present, absent, displaced or not observable"
EXAMPLE = "toftwin inspect session/bag --scene cell/scene.yaml --out out/inspection"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the flags."""
    from toftwin.options import add_bag_arguments, add_config_arguments

    parser.add_argument("bag", metavar="BAG", help="the bag's folder, .mcap or .db3 file")
    parser.add_argument(
        "--scene", type=Path, required=True, metavar="SCENE", help="scene.yaml of the cell, its folder, or a built-in scene's name"
    )
    parser.add_argument(
        "--reference",
        type=Path,
        action="append",
        default=[],
        metavar="REF",
        help="a first picture in colour of the complete scene (toftwin correct --save --scene); may be repeated",
    )
    parser.add_argument("--out", type=Path, metavar="DIR", help="folder for inspection.json and inspection.html (default: print only)")
    parser.add_argument("--json", action="store_true", help="print the verdicts as JSON")
    add_bag_arguments(parser)
    add_config_arguments(parser, _settings)


def _settings() -> type[Any]:
    from toftwin.inspection import InspectionConfig

    return InspectionConfig


def run(args: argparse.Namespace) -> int:
    """Inspect; 1 when a part is absent or displaced."""
    import json
    import sys

    from arm_correction.reference import load_reference
    from tof_inspect.judge import Inspector
    from tof_inspect.report import content, write
    from tof_scene.raycast import Raycaster
    from toftwin.inputs import opened
    from toftwin.inspection import InspectionConfig, first_pictures, inspect_bag
    from toftwin.options import load_config

    config = load_config(InspectionConfig, args)
    with opened(args.bag, args.scene, config, args.initial_pose) as (reader, scene):
        assert scene is not None
        first, lacking = first_pictures({str(path): load_reference(path) for path in args.reference}, scene.digest)
        for line in lacking:
            print(line, file=sys.stderr)
        inspector = Inspector(Raycaster(scene), config.inspect, config.align, first)
        found = inspect_bag(reader, inspector, config)
    told = content(found, scene.digest)
    page = write(inspector, found, args.out, Path(args.bag).name) if args.out else None
    if args.json:
        print(json.dumps(told, indent=1))
    else:
        for v in found.verdicts:
            print(f"{v.name:20} {v.state.replace('_', ' '):15} p={v.probability:.4f}  {v.why}")
        print(found.colour)
        print(", ".join(f"{count} {state.replace('_', ' ')}" for state, count in told["counts"].items()))
        if page:
            print(f"report: {page}")
    return 1 if told["counts"]["absent"] or told["counts"]["displaced"] else 0
