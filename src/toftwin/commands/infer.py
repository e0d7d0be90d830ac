# SPDX-License-Identifier: Apache-2.0
"""`toftwin infer`: the depth of a bag repaired by a trained network, as a new bag."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from tof_core.shares import in_percent

if TYPE_CHECKING:
    import argparse

NAME = "infer"
HELP = "repair the depth of a bag with a trained network"
ABOUT = (
    "Writes a bag with corrected depth and its standard deviation (sigma) for each frame. A pixel whose sigma is too large "
    "keeps its raw depth and gets an infinite sigma."
)
EXAMPLE = "toftwin infer session/bag --model model.onnx --out out/repaired"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the flags."""
    from toftwin.options import add_bag, add_bag_arguments, add_config_arguments

    add_bag(parser)
    parser.add_argument(
        "--model", dest="infer.model", metavar="FILE", help="network (.onnx) of `toftwin train` (default: the one in the package)"
    )
    parser.add_argument("--out", type=Path, required=True, metavar="BAG", help="folder of the bag to write; it must not exist")
    parser.add_argument(
        "--device", dest="infer.device", choices=("cpu", "cuda", "auto"), help="processor that runs the network (default: cpu)"
    )
    parser.add_argument("--threads", dest="infer.threads", type=int, metavar="N", help="threads of the CPU (default: 2)")
    parser.add_argument(
        "--force", dest="infer.force", action="store_const", const=True, help="use a network that was trained for another camera or range"
    )
    parser.add_argument(
        "--only",
        action="store_true",
        help="write only infer/depth, infer/sigma and infer/camera_info, without the other messages of the bag",
    )
    parser.add_argument("--json", action="store_true", help="print the counts as JSON")
    add_bag_arguments(parser)
    add_config_arguments(parser, "toftwin.inference:InferenceConfig")


def run(args: argparse.Namespace) -> int:
    """Repair the bag, print the counts and the time per frame."""
    from tof_core.bag import open_bag
    from toftwin.inference import InferenceConfig, infer_bag
    from toftwin.options import load_config

    config = load_config(InferenceConfig, args)
    with open_bag(args.bag, config.input) as reader:
        tally = infer_bag(reader, args.out, config.infer, copy=not args.only)
    if args.json:
        import json

        print(json.dumps(tally.to_dict(), indent=1))
        return 0
    print(
        f"{tally.frames} frames to {args.out}: {in_percent(tally.share('repaired'), 1)} of their pixels repaired, {in_percent(tally.share('raw_kept'), 1)} kept raw "
        f"(sigma infinite), {in_percent(tally.share('invalid'), 1)} without depth"
    )
    print(f"{tally.median_ms:.1f} ms a frame on {tally.device} ({tally.model})")
    return 0
