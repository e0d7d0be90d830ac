# SPDX-License-Identifier: Apache-2.0
"""`toftwin inspect`: whether each part is where the CAD has it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import argparse

NAME = "inspect"
HELP = "decide for each part whether it is present, absent, displaced or not observable"
ABOUT = (
    "Compares the measured depth with the CAD, each part with and without it; colour pictures of the complete scene add "
    "evidence. A part that no view shows well enough is not observable: nothing is guessed. The exit code is 1 if a part is "
    "absent or displaced."
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
        help="reference view in colour of the complete scene (toftwin correct --save --scene); may be repeated",
    )
    add_sensor(parser, "poses are solved and parts judged")
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
    from tof_sensor.known import known_bias
    from toftwin.inputs import opened
    from toftwin.inspection import InspectionConfig, first_pictures, inspect_bag
    from toftwin.options import load_config

    config = load_config(InspectionConfig, args)
    with opened(args.bag, args.scene, config, args.initial_pose) as (reader, scene):
        assert scene is not None
        first, lacking = first_pictures({str(path): load_reference(path) for path in args.reference}, scene.digest)
        for line in lacking:
            print(line, file=sys.stderr)
        inspector = Inspector(Raycaster(scene), config.inspect, config.align, first, known_bias(args.sensor))
        found = inspect_bag(reader, inspector, config)
    result = content(found, scene.digest)
    page = write(inspector, found, args.out, Path(args.bag).name) if args.out else None
    if args.json:
        print(json.dumps(result, indent=1))
    else:
        for v in found.verdicts:
            print(f"{v.name:20} {v.state.replace('_', ' '):15} p={v.probability:.4f}  {v.why}")
        print(found.colour)
        print(", ".join(f"{count} {state.replace('_', ' ')}" for state, count in result["counts"].items()))
        if page:
            print(f"report: {page}")
    return 1 if result["counts"]["absent"] or result["counts"]["displaced"] else 0
