# SPDX-License-Identifier: Apache-2.0
"""`toftwin sensor`: a simulator's ideal depth to the depth that a camera with known effects would measure."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from tof_core.shares import in_percent

if TYPE_CHECKING:
    import argparse

NAME = "sensor"
HELP = "turn a simulator's ideal depth into what this camera would measure"
ABOUT = (
    "Reads ideal depth of any simulator (Gazebo, Isaac Sim, Blender, Unity) with its CameraInfo, and adds the effects of a "
    "sensor.yaml that `toftwin gap` fitted to a real camera: bias, noise, mixed pixels at edges, lost pixels, and an "
    "amplitude image. Surface normals come from the depth, from a topic, or from the scene."
)
EXAMPLE = "toftwin sensor ideal/bag --sensor sensor.yaml --out out/measured"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the flags."""
    from toftwin.options import add_bag_arguments, add_config_arguments, add_scene

    parser.add_argument("bag", metavar="IDEAL", help="bag with ideal depth: its folder, or its .mcap or .db3 file")
    parser.add_argument(
        "--sensor", dest="sensor.model", required=True, metavar="FILE", help="sensor.yaml of the camera, from `toftwin gap`"
    )
    parser.add_argument("--out", type=Path, required=True, metavar="BAG", help="folder of the bag to write; it must not exist")
    add_scene(parser, use="gives part, albedo, normals and mixed pixels; needed for effects of single parts and for multipath")
    parser.add_argument("--seed", dest="sensor.seed", type=int, metavar="N", help="seed of noise, losses and edges (default: 0)")
    parser.add_argument(
        "--light",
        dest="sensor.light",
        choices=("albedo", "amplitude"),
        help="content of the ideal bag's amplitude topic: albedo of the surfaces (default), or amplitude in the camera's unit",
    )
    parser.add_argument("--albedo", dest="sensor.albedo", type=float, metavar="A", help="albedo where none is given (default: 0.5)")
    parser.add_argument(
        "--gain", dest="sensor.gain", type=float, metavar="G", help="amplitude of albedo 1 head-on from 1 m (default: the sensor.yaml's)"
    )
    parser.add_argument("--normals-topic", default="", metavar="TOPIC", help="images of unit normals, 32FC3, in the camera's optical frame")
    parser.add_argument("--json", action="store_true", help="print the counts as JSON")
    add_bag_arguments(parser)
    add_config_arguments(parser, "toftwin.sensing:SensingConfig")


def run(args: argparse.Namespace) -> int:
    """Simulate the bag, print the counts and the time per frame."""
    import json

    from tof_scene.raycast import Raycaster
    from toftwin.inputs import opened
    from toftwin.options import load_config
    from toftwin.sensing import SensingConfig, sense_bag

    config = load_config(SensingConfig, args)
    with opened(args.bag, args.scene, config, args.initial_pose) as (reader, scene):
        tally = sense_bag(reader, args.out, config.sensor, None if scene is None else Raycaster(scene), normals_topic=args.normals_topic)
    counts = tally.to_dict()
    if args.json:
        print(json.dumps(counts, indent=1))
        return 0
    print(
        f"{tally.frames} frames to {args.out}: {', '.join(tally.effects) or 'no effect'}; depth changes by {counts['rms_mm']:.2f} mm RMS, "
        f"{in_percent(counts['lost'])} of the pixels are lost; {counts['ms_per_frame']:.1f} ms of processor a frame"
    )
    for note in tally.notes:
        print(f"note: {note}")
    if tally.without_effect:
        print(f"without a scene these effects do nothing: {', '.join(tally.without_effect)} (pass --scene)")
    return 0
