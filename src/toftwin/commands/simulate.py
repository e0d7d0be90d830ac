# SPDX-License-Identifier: Apache-2.0
"""`toftwin simulate`: a virtual robot records a session of a scene, with the effects that are switched on."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from tof_core.errors import UsageError

if TYPE_CHECKING:
    import argparse

    from tof_scene.scene import Scene
    from tof_virtual.body import Body
    from tof_virtual.config import VirtualConfig
    from tof_virtual.record import Sensor
    from tof_virtual.truth import Truth

NAME = "simulate"
HELP = "record a bag with a virtual robot and a virtual time-of-flight camera"
ABOUT = (
    "The robot drives from station to station and looks at the scene. The camera is simulated exposure by exposure, with "
    "the effects that are switched on. True poses and depths are written to BAG.truth.npz and BAG.truth.json beside the "
    "bag."
)
EXAMPLE = "toftwin simulate --scene body_section --out out/session --effect wiggling=1 --effect multipath=1 --views 20"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the flags."""
    from toftwin.options import add_config_arguments

    parser.add_argument("--scene", metavar="SCENE", help="scene.yaml, its folder, or the name of a built-in scene")
    parser.add_argument("--out", type=Path, metavar="BAG", help="folder of the bag to write; it must not exist")
    parser.add_argument(
        "--effect",
        action="append",
        default=[],
        metavar="NAME=STRENGTH",
        help="switch an effect on; a strength of 1 is about 3 mm RMS; may be repeated",
    )
    parser.add_argument(
        "--sensor", type=Path, metavar="FILE", help="sensor.yaml of `toftwin gap`, whose effects are added to the virtual camera"
    )
    parser.add_argument("--truth", type=Path, metavar="STEM", help="truth files to write, without .npz and .json (default: BAG.truth)")
    parser.add_argument("--views", type=int, metavar="N", help="number of views in the session")
    parser.add_argument("--stations", type=int, metavar="N", help="number of places at which the base stops")
    parser.add_argument("--captures", type=int, metavar="N", help="captures of each view")
    parser.add_argument("--size", metavar="WxH", help="columns and rows of the camera, for instance 400x300")
    parser.add_argument("--seed", type=int, metavar="N", help="seed of all random numbers")
    parser.add_argument("--capture-moving", action="store_true", help="capture while the hand moves")
    parser.add_argument("--json", action="store_true", help="print what was recorded as JSON")
    add_config_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Record; prints what was written."""
    from tof_virtual.config import VirtualConfig
    from toftwin.options import load_config, settings_text

    if args.settings:
        print(settings_text(VirtualConfig))
        return 0
    if not args.scene or not args.out:
        raise UsageError("needs --scene and --out", where="simulate", todo=f"for instance: {EXAMPLE}")
    config = _with_flags(load_config(VirtualConfig, args), args)
    effects = parse_effects(args.effect)

    from tof_virtual.effects import make_effects
    from tof_virtual.record import record

    make_effects(effects, config)  # a wrong name is refused before anything is written
    scene = open_scene(args.scene, args.out)
    truth = record(bodies_of(scene), args.out, config, effects=effects, truth_path=args.truth, sensor=_sensor(args.sensor, scene))
    _report(args, scene, truth)
    return 0


def _sensor(path: Path | None, scene: Scene) -> Sensor | None:
    if path is None:
        return None
    from tof_sensor.model import load_model
    from toftwin.sensed import modelled

    return modelled(load_model(path), scene)


def parse_effects(pairs: list[str]) -> dict[str, float]:
    """`name=strength` texts (`name` alone is a strength of 1)."""
    out: dict[str, float] = {}
    for pair in pairs:
        name, _, text = pair.partition("=")
        try:
            out[name] = float(text or 1.0)
        except ValueError:
            raise UsageError(f"'{pair}' is not NAME=STRENGTH", where="--effect") from None
    return out


def open_scene(name: str, out: Path) -> Scene:
    """A scene by path, or a built-in one by name; the files of a built-in scene are written to `<out>.scene`."""
    from tof_scene.builtin import builtin_names, write_builtin
    from tof_scene.scene_file import load_scene

    if name in builtin_names():
        return load_scene(write_builtin(name, out.with_name(out.name + ".scene")))
    path = Path(name)
    if not path.exists():
        raise UsageError("is neither a scene file nor a built-in scene", where=name, todo=f"built in are {', '.join(builtin_names())}")
    return load_scene(path)


def bodies_of(scene: Scene) -> list[Body]:
    """The scene's parts, as bodies of the virtual robot."""
    from tof_virtual.body import Body

    return [Body(p.name, p.vertices, p.faces, p.material.albedo, p.material.roughness, p.inspect) for p in scene.parts]


def _with_flags(config: VirtualConfig, args: argparse.Namespace) -> VirtualConfig:
    from tof_core.config import flatten, from_mapping

    values: dict[str, Any] = flatten(config)
    given = {"plan.views": args.views, "plan.stations": args.stations, "plan.captures": args.captures, "seed": args.seed}
    values.update({key: value for key, value in given.items() if value is not None})
    if args.capture_moving:
        values["plan.capture_moving"] = True
    if args.size:
        width, _, height = args.size.lower().partition("x")
        if not (width.isdigit() and height.isdigit()):
            raise UsageError(f"'{args.size}' is not WIDTHxHEIGHT", where="--size")
        values.update({"camera.width": int(width), "camera.height": int(height)})
    return from_mapping(type(config), values, where="simulate")


def _report(args: argparse.Namespace, scene: Scene, truth: Truth) -> None:
    import json

    meta = truth.meta()
    if args.json:
        summary = {"bag": str(args.out), "scene": str(scene.folder), "views": len(truth), "effects": meta["effects"]}
        print(json.dumps(summary, indent=1))
        return
    print(f"recorded {len(truth)} views to {args.out} (scene: {scene.folder})")
    for name, effect in meta["effects"].items():
        error = f"{effect['rms_mm']:.2f} mm RMS over the pixels it affects, " if effect["kind"] != "loss" else ""
        print(f"  {name}: {error}{effect['size']:.4g} {effect['unit']}")
