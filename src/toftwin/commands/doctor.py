# SPDX-License-Identifier: Apache-2.0
"""`toftwin doctor`: is this host fit, and does a bag or a running robot have what the graph needs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import argparse
    from collections.abc import Iterator

    from tof_core.options import BagOptions
    from tof_scene.scene import Scene
    from toftwin.doctor.finding import Finding

NAME = "doctor"
HELP = "say what the graph would miss: on this host, in a bag, or on the running robot; each finding with what to do"
EXAMPLE = "toftwin doctor session/bag --scene cell/scene.yaml"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the flags."""
    from toftwin.options import add_bag_arguments, positive

    parser.add_argument("bag", nargs="?", metavar="BAG", help="the bag's folder, .mcap or .db3 file; without it this host alone")
    parser.add_argument("--live", action="store_true", help="examine what is published now in this ROS_DOMAIN_ID, QoS included")
    parser.add_argument("--seconds", type=positive, default=5.0, help="how long --live listens (default: 5)")
    parser.add_argument("--scene", type=Path, metavar="SCENE", help="scene.yaml of the cell, its folder, or a built-in scene's name")
    parser.add_argument("--json", action="store_true", help="print the findings as JSON")
    add_bag_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Examine, print; 1 if something needs mending."""
    from tof_core.errors import UsageError
    from toftwin.doctor.finding import healthy

    if args.bag and args.live:
        raise UsageError("a bag and --live are two questions", where="doctor", todo="ask one at a time")
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
    from toftwin.doctor.host import examine_host

    yield from examine_host()
    options = _bag_options(args)
    scene, said = _scene(args.scene)
    yield from said
    if args.live:
        from toftwin.doctor.live import examine_live

        yield from examine_live(options, scene, args.initial_pose, args.seconds)
    elif args.bag:
        from toftwin.doctor.bag import examine_bag

        yield from examine_bag(args.bag, options, scene, args.initial_pose)


def _bag_options(args: argparse.Namespace) -> BagOptions:
    """What the flags say of the bag."""
    from tof_core.config import from_mapping
    from tof_core.options import BagOptions

    given = {name.removeprefix("input."): value for name, value in vars(args).items() if name.startswith("input.") and value is not None}
    return from_mapping(BagOptions, given, where="doctor")


def _scene(path: Path | None) -> tuple[Scene | None, list[Finding]]:
    """The scene, and what is said of it."""
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
    return scene, [ok("scene", f"{len(scene.parts)} parts, {inspected} inspected, {triangles} triangles, frame '{scene.frame}'")]


def _summary(findings: list[Finding]) -> str:
    from toftwin.doctor.finding import Level

    mend, note = (sum(f.level is level for f in findings) for level in (Level.MEND, Level.NOTE))
    return (
        f"{len(findings)} findings: {mend} to mend, {note} worth knowing"
        if mend or note
        else f"{len(findings)} findings, all as it should be"
    )
