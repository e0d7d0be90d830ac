# SPDX-License-Identifier: Apache-2.0
"""`toftwin doctor`: whether host, bag or running robot provide what the graph needs."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import argparse
    from collections.abc import Iterator
    from pathlib import Path

    from tof_core.options import BagOptions
    from tof_scene.scene import Scene
    from toftwin.doctor.finding import Finding

NAME = "doctor"
HELP = "check this host, a bag or a running robot; each finding says what to do"
ABOUT = (
    "Checks whether this host can run the graph, and whether a bag or the running robot provides what the graph needs: "
    "topics, stamps, calibration, transforms, units. Each finding says what to do. The exit code is 1 if something must be "
    "fixed."
)
EXAMPLE = "toftwin doctor session/bag --scene cell/scene.yaml"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the flags."""
    from toftwin.options import add_bag_arguments, add_scene, positive

    parser.add_argument(
        "bag",
        nargs="?",
        metavar="BAG",
        help="folder of the bag, or its .mcap or .db3 file, or a folder of PNG pairs; without it this host alone, and --scene",
    )
    parser.add_argument("--live", action="store_true", help="check the topics that are published now in this ROS_DOMAIN_ID, with their QoS")
    parser.add_argument(
        "--seconds",
        type=positive,
        default=5.0,
        help="seconds of --live in which every topic is heard (default: 5); up to 10 s longer where one is not found or silent",
    )
    add_scene(parser)
    parser.add_argument("--json", action="store_true", help="print the findings as JSON")
    add_bag_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Check and print; 1 if something must be fixed."""
    from tof_core.errors import UsageError
    from toftwin.doctor.finding import healthy

    if args.bag and args.live:
        raise UsageError("a bag and --live exclude each other", where="doctor", todo="check one at a time")
    findings = []
    for finding in _examine(args):
        findings.append(finding)
        if not args.json:
            print(finding.line(), flush=True)
    if args.json:
        import json

        print(json.dumps({"healthy": healthy(findings), "findings": [f.to_dict() for f in findings]}, indent=1))
    else:
        print(_summary(findings))
    return int(not healthy(findings))


def _examine(args: argparse.Namespace) -> Iterator[Finding]:
    from pathlib import Path

    from tof_core.image_folder import is_image_folder
    from toftwin.doctor.host import examine_host

    yield from examine_host()
    options = _bag_options(args)
    scene, findings = _scene(args.scene)
    yield from findings
    if args.live:
        from toftwin.doctor.live import examine_live

        yield from examine_live(options, scene, args.initial_pose, args.seconds)
    elif args.bag and is_image_folder(Path(args.bag)):
        from toftwin.doctor.png_pairs import examine_png_pairs

        yield from examine_png_pairs(Path(args.bag), options)
    elif args.bag:
        from toftwin.doctor.bag import examine_bag

        yield from examine_bag(args.bag, options, scene, args.initial_pose)


def _bag_options(args: argparse.Namespace) -> BagOptions:
    """The bag's options from the flags."""
    from tof_core.config import from_mapping
    from tof_core.options import BagOptions

    given = {name.removeprefix("input."): value for name, value in vars(args).items() if name.startswith("input.") and value is not None}
    return from_mapping(BagOptions, given, where="doctor")


def _scene(path: Path | None) -> tuple[Scene | None, list[Finding]]:
    """The scene, and the findings about it."""
    from tof_core.errors import ToftwinError
    from toftwin.doctor.finding import ok, refused

    if path is None:
        return None, []
    from tof_scene.builtin import open_scene

    try:
        scene = open_scene(path)
    except ToftwinError as error:
        return None, [refused("scene", error)]
    inspected = sum(part.inspect for part in scene.parts)
    triangles = sum(len(part.faces) for part in scene.parts)
    from toftwin.doctor.fit import examine_parts

    return scene, [
        *examine_parts(scene, path),
        ok("scene", f"{len(scene.parts)} parts, {inspected} inspected, {triangles} triangles, frame '{scene.frame}'"),
    ]


def _summary(findings: list[Finding]) -> str:
    from toftwin.doctor.finding import Level

    fix, note = (sum(f.level is level for f in findings) for level in (Level.FIX, Level.NOTE))
    return f"{len(findings)} findings: {fix} to fix, {note} to know" if fix or note else f"{len(findings)} findings, nothing to do"
