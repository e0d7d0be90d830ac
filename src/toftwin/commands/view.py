# SPDX-License-Identifier: Apache-2.0
"""`toftwin view`: a bag, a dataset or a gap report in the rerun viewer."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import argparse

    from tof_scene.scene import Scene
    from toftwin.viewing import Scribe

NAME = "view"
HELP = "show a bag, a dataset or a gap report in 3D"
ABOUT = (
    "Opens the rerun viewer with the scene, the point clouds, the path of the camera and the images. With a gap report, the "
    "parts are coloured by their gap. Needs the extra 'view'."
)
EXAMPLE = (
    "toftwin view out/session --scene cell/scene.yaml --gap out/gap\n  toftwin view session/bag --scene cell/scene.yaml --save session.rrd"
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the flags."""
    from toftwin.options import add_bag_arguments, add_config_arguments, add_scene, at_least

    parser.add_argument("what", type=Path, metavar="WHAT", help="a bag, a dataset, or a folder that `label` or `gap` wrote")
    add_scene(parser)
    parser.add_argument("--gap", type=Path, metavar="DIR", help="folder of a gap report; the parts are coloured by their gap")
    parser.add_argument("--every", type=at_least(1), default=1, metavar="N", help="show every Nth capture or view (default: all)")
    parser.add_argument("--save", type=Path, metavar="FILE.rrd", help="write a file for the rerun viewer instead of opening it")
    add_bag_arguments(parser)
    add_config_arguments(parser, "toftwin.pipeline:PipelineConfig")


def run(args: argparse.Namespace) -> int:
    """Write the recording; open the viewer unless only the file is asked for."""
    from tempfile import TemporaryDirectory

    from toftwin.viewing import rerun

    rerun()
    if args.save:
        draw(args, args.save)
        print(f"{args.save}: {args.save.stat().st_size / 1e6:.1f} MB; open it with: rerun {args.save}")
        return 0
    with TemporaryDirectory(prefix="toftwin-view-") as folder:
        path = Path(folder) / "view.rrd"
        draw(args, path)
        return show(path)


def draw(args: argparse.Namespace, path: Path) -> None:
    """Write everything in `args.what` into a recording."""
    from toftwin.viewing import Scribe, draw_gap

    scribe = Scribe(path)
    try:
        gaps, scene = _draw_what(scribe, args)
        if args.gap:
            gaps = draw_gap(scribe, args.gap, scene)
        if scene is not None:
            scribe.scene(scene, gaps)
    finally:
        scribe.close()


def _draw_what(scribe: Scribe, args: argparse.Namespace) -> tuple[dict[str, float], Scene | None]:
    """The gap of each part that has one, and the scene."""
    from tof_sim_label.dataset import open_dataset
    from toftwin import viewing

    data = next((p for p in (args.what, args.what / "dataset.zarr") if (p / "zarr.json").is_file()), None)
    if data is not None:
        return viewing.draw_dataset(scribe, open_dataset(data), args.every), _scene(args)
    if (args.what / "gap.json").is_file():
        scene = _scene(args)
        return viewing.draw_gap(scribe, args.what, scene), scene
    from toftwin.inputs import opened
    from toftwin.options import load_config
    from toftwin.pipeline import PipelineConfig

    with opened(args.what, args.scene, load_config(PipelineConfig, args), args.initial_pose) as (reader, scene):
        viewing.draw_bag(scribe, reader, args.every)
        return {}, scene


def _scene(args: argparse.Namespace) -> Scene | None:
    from tof_scene.builtin import open_scene

    return open_scene(args.scene) if args.scene else None


def show(path: Path) -> int:
    """Open rerun's viewer and wait until it is closed; the viewer listens on this host alone."""
    import os
    import subprocess
    import sys

    from tof_core.errors import UsageError

    if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise UsageError("there is no display here", where="toftwin view", todo="pass --save FILE.rrd and open that where there is one")
    command = [sys.executable, "-m", "rerun", "--bind", "127.0.0.1", str(path)]
    return subprocess.run(command, check=False).returncode  # noqa: S603 (our own file)
