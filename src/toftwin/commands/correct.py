# SPDX-License-Identifier: Apache-2.0
"""`toftwin correct`: the hand pose at which the camera sees its reference view again."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from tof_core.shares import in_percent

if TYPE_CHECKING:
    import argparse

    from tof_core.arrays import Mask

NAME = "correct"
HELP = "propose the hand pose that brings the camera back to its reference view"
ABOUT = (
    "Compares a view of the bag with a stored reference view, with the CAD, or with both, and proposes the pose to which "
    "the hand must move so that the camera sees the reference view again. Nothing is moved. A proposal that is unsafe or "
    "uncertain is refused, with the reason and exit code 1."
)
EXAMPLE = "toftwin correct today/bag --reference out/first --scene cell/scene.yaml"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the flags."""
    from toftwin.options import add_bag, add_bag_arguments, add_config_arguments, add_scene, add_sensor

    add_bag(parser)
    parser.add_argument("--reference", type=Path, metavar="REF", help="reference view, written by --save")
    add_scene(parser, use="the view is compared with it, too")
    add_sensor(parser, "the view is compared with the CAD")
    parser.add_argument("--save", type=Path, metavar="REF", help="store a view of this bag as the reference (REF.json, REF.npz) and stop")
    parser.add_argument(
        "--region",
        metavar="U,V,W,H",
        help="with --save: use only this rectangle of the depth image (left, top, width, height in pixels; default: all)",
    )
    parser.add_argument("--view", type=int, default=-1, metavar="N", help="number of the view: 0 is the first, -1 the last (default: -1)")
    parser.add_argument("--frame", default="body", metavar="FRAME", help="TF frame in which the hand pose is given (default: body)")
    parser.add_argument("--hand-frame", default="", metavar="FRAME", help="TF frame whose pose the arm's driver commands (default: hand)")
    parser.add_argument("--out", type=Path, metavar="DIR", help="folder for correction.json and correction.html (default: print only)")
    parser.add_argument("--json", action="store_true", help="print the corrections as JSON")
    add_bag_arguments(parser)
    add_config_arguments(parser, "toftwin.correcting:CorrectionConfig")


def run(args: argparse.Namespace) -> int:
    """Store a reference, or propose a correction; 1 when it is refused."""
    from arm_correction.frames import frames_of
    from arm_correction.reference import load_reference, save_reference
    from tof_core.errors import UsageError
    from toftwin.correcting import CorrectionConfig, corrector_of, views_of
    from toftwin.inputs import opened
    from toftwin.known import bias_in
    from toftwin.options import load_config
    from toftwin.paths import session_name

    config = load_config(CorrectionConfig, args)
    if not (args.save or args.reference or args.scene):
        raise UsageError("neither a reference nor a scene is given", where="correct", todo="pass --reference, --scene, or --save")
    reference = load_reference(args.reference) if args.reference else None
    with opened(args.bag, args.scene, config, args.initial_pose) as (reader, scene):
        views = views_of(reader, config)
        if not -len(views) <= args.view < len(views):
            raise UsageError(f"there is no view {args.view}; the bag has {len(views)}", where="--view")
        chosen = views[: args.view % len(views) + 1]
        corrector = corrector_of(scene, reference, config, bias_in(scene, args.sensor))
        if args.save:
            kept = save_reference(corrector.capture(chosen[-1], _region(args.region, chosen[-1].camera.shape)), args.save)
            print(f"reference: {kept}")
            return 0
        frames = frames_of(reader.chain, reader.camera.frame_id, chosen[-1].stamp_ns, args.hand_frame, args.frame)
        made = corrector.propose(chosen, frames)
    _print(made, as_json=args.json)
    if args.out:
        from arm_correction.report import write

        page = write(made, chosen[-1], frames, args.out, session_name(args.bag), reference=reference, caster=corrector.caster)
        if not args.json:
            print(f"report: {page}")
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
        found = c.to_dict()
        print(f"{by}: {c.verdict}: {c.reason}")
        if c.accepted:
            xyz = " ".join(f"{v:.4f}" for v in found["target"]["xyz"])
            xyzw = " ".join(f"{v:.5f}" for v in found["target"]["xyzw"])
            print(f"  move the hand by {mm:.1f} mm and {deg:.2f} deg, to {xyz} {xyzw} in {c.frame}")
        print(f"  {in_percent(found['support'])} of {found['pixels']:.0f} pixels agree, {found['rms_mm']:.2f} mm RMS")
