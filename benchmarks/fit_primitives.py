# SPDX-License-Identifier: Apache-2.0
"""Fit planes and spheres to one capture of a bag and write them as a scene, for places that have no CAD.

The scene's frame is the camera of that capture, so a capture taken from elsewhere is aligned to it
with `toftwin label BAG --scene OUT --initial-pose "x y z qx qy qz qw"`.
"""

from __future__ import annotations

import argparse
import sys
from itertools import islice
from pathlib import Path

from benchmarks.primitive_scene import primitive_scene
from benchmarks.primitives import PrimitiveConfig, fit_primitives
from tof_core.bag import BagOptions, open_bag
from tof_core.errors import BagError, ToftwinError
from tof_scene.scene_file import save_scene

EXAMPLE = "example: python -m benchmarks.fit_primitives ../shared/data/real/azure_kinect_static/bag --out out/room"


def main(arguments: list[str] | None = None) -> int:
    """Fit, write, and say what was found."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.fit_primitives", description=__doc__, epilog=EXAMPLE)
    parser.add_argument("bag", type=Path)
    parser.add_argument("--out", type=Path, required=True, help="folder for scene.yaml and its meshes")
    parser.add_argument("--capture", type=int, default=0, help="number of the capture to fit (default 0)")
    parser.add_argument("--depth", choices=("z", "radial"), default="z", help="what the bag's depth is")
    args = parser.parse_args(arguments)
    try:
        fit(args.bag, args.out, args.capture, args.depth)
    except ToftwinError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    return 0


def fit(bag: Path, out: Path, number: int, kind: str) -> None:
    """Write the scene of one capture."""
    config = PrimitiveConfig()
    with open_bag(bag, BagOptions(depth=kind)) as reader:
        capture = next(islice(reader.captures(need_tf=False), number, None), None)
    if capture is None:
        raise BagError(f"has no capture {number}", where=bag)
    found = fit_primitives(capture.depth, capture.camera, config)
    scene = primitive_scene(found, capture.camera, config.stride)
    for part, fitted in zip(scene.parts, found, strict=True):
        print(f"{part.name:10s} {int(fitted.pixels.sum()):7d} points, RMS {1e3 * fitted.rms:.2f} mm")
    print(save_scene(scene, out))


if __name__ == "__main__":
    sys.exit(main())
