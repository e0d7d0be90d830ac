# SPDX-License-Identifier: Apache-2.0
"""`toftwin correct`: where the hand must go so that the next picture is the first picture again."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import argparse

    from tof_core.arrays import Mask

NAME = "correct"
HELP = "propose the hand's pose that brings back the first picture, from a reference, the CAD, or both"
EXAMPLE = "toftwin correct today/bag --reference out/first --scene cell/scene.yaml"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the flags."""
    from toftwin.options import add_bag_arguments, add_config_arguments

    parser.add_argument("bag", metavar="BAG", help="the bag's folder, .mcap or .db3 file")
    parser.add_argument("--reference", type=Path, metavar="REF", help="the first picture, written by --save")
    parser.add_argument("--scene", type=Path, metavar="SCENE", help="scene.yaml of the cell: corrects to the CAD, too")
    parser.add_argument(
        "--save", type=Path, metavar="REF", help="keep a view of this bag as the first picture (REF.json, REF.npz) and stop"
    )
    parser.add_argument(
        "--region", metavar="U,V,W,H", help="with --save: only this rectangle of the depth image matters (pixels; default: all)"
    )
    parser.add_argument("--view", type=int, default=-1, metavar="N", help="which view: 0 the first, -1 the last (default: -1)")
    parser.add_argument("--frame", default="body", metavar="FRAME", help="TF frame in which the target is given (default: the body)")
    parser.add_argument("--hand-frame", default="", metavar="FRAME", help="TF frame that the arm is commanded by (default: hand)")
    parser.add_argument("--json", action="store_true", help="print the corrections as JSON")
    add_bag_arguments(parser)
    add_config_arguments(parser, _settings)


def _settings() -> type[Any]:
    from toftwin.correcting import CorrectionConfig

    return CorrectionConfig


def run(args: argparse.Namespace) -> int:
    """Save a reference, or correct; 1 when the correction is refused."""
    from arm_correction.frames import frames_of
    from arm_correction.reference import load_reference, save_reference
    from tof_core.errors import UsageError
    from toftwin.correcting import CorrectionConfig, corrector_of, views_of
    from toftwin.inputs import opened
    from toftwin.options import load_config

    config = load_config(CorrectionConfig, args)
    if not (args.save or args.reference or args.scene):
        raise UsageError("neither a reference nor a scene is given", where="correct", todo="pass --reference, --scene, or --save")
    reference = load_reference(args.reference) if args.reference else None
    with opened(args.bag, args.scene, config, args.initial_pose) as (reader, scene):
        views = views_of(reader, config)
        if not -len(views) <= args.view < len(views):
            raise UsageError(f"there is no view {args.view}; the bag has {len(views)}", where="--view")
        chosen = views[: args.view % len(views) + 1]
        corrector = corrector_of(scene, reference, config)
        if args.save:
            kept = save_reference(corrector.capture(chosen[-1], _region(args.region, chosen[-1].camera.shape)), args.save)
            print(f"reference: {kept}")
            return 0
        frames = frames_of(reader.chain, reader.camera.frame_id, chosen[-1].stamp_ns, args.hand_frame, args.frame)
        made = corrector.propose(chosen, frames)
    _print(made, as_json=args.json)
    return 0 if next(iter(made.values())).accepted else 1


def _region(text: str | None, shape: tuple[int, int]) -> Mask | None:
    """(H, W) mask of a rectangle given as left, top, width, height."""
    import numpy as np

    from tof_core.errors import UsageError

    if text is None:
        return None
    numbers = text.split(",")
    if len(numbers) != 4 or not all(n.strip().isdigit() for n in numbers):
        raise UsageError(
            f"'{text}' is no rectangle", where="--region", todo="write left,top,width,height in pixels, for instance 40,30,120,90"
        )
    left, top, width, height = map(int, numbers)
    mask = np.zeros(shape, bool)
    mask[top : top + height, left : left + width] = True
    return mask


def _print(made: dict[str, Any], *, as_json: bool) -> None:
    import json

    if as_json:
        print(json.dumps({by: c.to_dict() for by, c in made.items()}, indent=1))
        return
    for by, c in made.items():
        mm, deg = c.step
        told = c.to_dict()
        print(f"{by}: {c.verdict}: {c.reason}")
        if c.accepted:
            xyz = " ".join(f"{v:.4f}" for v in told["target"]["xyz"])
            xyzw = " ".join(f"{v:.5f}" for v in told["target"]["xyzw"])
            print(f"  move the hand by {mm:.1f} mm and {deg:.2f} deg, to {xyz} {xyzw} in {c.frame}")
        print(f"  {100 * told['support']:.0f} % of {told['pixels']:.0f} pixels agree, {told['rms_mm']:.2f} mm RMS")
