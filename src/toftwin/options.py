# SPDX-License-Identifier: Apache-2.0
"""Flags that several commands share: bag, scene, configuration; all made from the typed tables."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any, TypeVar

from tof_core import config
from tof_core.errors import ConfigError, UsageError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from tof_core.placement import Placement

C = TypeVar("C")


def at_least(low: int) -> Callable[[str], int]:
    """The `type` of a flag whose value is a whole number, `low` or more."""

    def count(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            value = low - 1
        if value < low:
            raise argparse.ArgumentTypeError(f"'{text}' is not a whole number, {low} or more")
        return value

    return count


def positive(text: str) -> float:
    """The `type` of a flag whose value is a number above 0."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"'{text}' is not a number above 0")
    return value


class _ShowSettings(argparse.Action):
    """Print every setting of the command and stop, as --help does."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        print(settings_text(resolve_name(self.const)))
        parser.exit()


def add_config_arguments(parser: argparse.ArgumentParser, settings: str = "") -> None:
    """`--config FILE.yaml`, `--set key=value` and `--settings`, which shows the class `settings` (`module:class`, loaded only then)."""
    group = parser.add_argument_group("configuration")
    group.add_argument("--config", type=Path, metavar="FILE", help="YAML file with settings; --set overrides it")
    group.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="change one setting, for instance preproc.iqr.enable=false; may be repeated",
    )
    shown = "print each setting with its default, unit and bounds, and stop"
    if not settings:
        group.add_argument("--settings", action="store_true", help=shown)
    else:
        group.add_argument("--settings", action=_ShowSettings, nargs=0, const=settings, help=shown)


def add_bag(parser: argparse.ArgumentParser) -> None:
    """The positional argument BAG."""
    parser.add_argument("bag", metavar="BAG", help="folder of the bag, or its .mcap or .db3 file")


def add_scene(parser: argparse.ArgumentParser, *, required: bool = False, use: str = "") -> None:
    """`--scene`; `use`: purpose in the command."""
    what = "the CAD of the cell: scene.yaml, its folder, or the name of a built-in scene"
    parser.add_argument("--scene", type=Path, required=required, metavar="SCENE", help=what + (f"; {use}" if use else ""))


def add_scene_arguments(parser: argparse.ArgumentParser) -> None:
    """`--scene`, or `--board` in its place."""
    add_scene(parser)
    parser.add_argument(
        "--board",
        metavar="BOARD",
        help="no CAD and no robot: a calibration board, found in the amplitude image. 5x7x0.030 (inner corners x inner corners x square in "
        "metres), charuco:6x8x0.030x0.022 (squares, square, marker) or apriltag:4x6x0.040x0.010 (tags, tag, gap)",
    )
    parser.add_argument(
        "--calibrate", action="store_true", help="with --board: fit the lens to the board's corners instead of CameraInfo's"
    )


def add_sensor(parser: argparse.ArgumentParser, use: str) -> None:
    """`--sensor`: known effects of the camera; use: the step before which they are removed."""
    parser.add_argument(
        "--sensor", type=Path, metavar="FILE", help=f"sensor.yaml of this camera (toftwin gap): its effects are removed before {use}"
    )


def add_bag_arguments(parser: argparse.ArgumentParser, section: str = "input") -> None:
    """A flag for every row of `BagOptions` (`--depth-topic`, `--cell-frame`, ...), and `--initial-pose`."""
    from tof_core.options import BagOptions

    group = parser.add_argument_group("the bag")
    for info in config.table(BagOptions):
        flag, dest = "--" + info.name.replace("_", "-"), f"{section}.{info.name}"
        text = f"{info.text} (default: {_value(info.default)}{_unit(info)})" if info.default not in ("", False) else info.text
        if info.kind is bool:
            group.add_argument(flag, dest=dest, action="store_const", const=True, help=text)
        else:
            group.add_argument(
                flag,
                dest=dest,
                type=info.kind,
                choices=info.choices or None,
                metavar=None if info.choices else info.kind.__name__.upper(),
                help=text,
            )
    group.add_argument(
        "--initial-pose",
        metavar="POSE",
        help=(
            "rough pose of the cell, for a robot whose TF does not know it: 'x y z qx qy qz qw' (metres, quaternion) in the camera's frame, "
            "or 'FRAME: x y z qx qy qz qw' in a frame of TF"
        ),
    )


def load_config(cls: type[C], args: argparse.Namespace) -> C:
    """Defaults, overlaid by `--config`, flags and `--set` in this order; unknown keys and bad values are refused."""
    from tof_core.yamlio import load_yaml

    values: dict[str, Any] = {}
    if args.config is not None:
        values.update(config.flatten_mapping(load_yaml(args.config)))
    values.update({name: value for name, value in vars(args).items() if "." in name and value is not None})
    values.update(parse_settings(cls, args.set))
    return config.from_mapping(cls, values, where=str(args.config or "--set"))


def parse_settings(cls: type[Any], pairs: Iterable[str]) -> dict[str, bool | int | float | str]:
    """`key=value` texts to values of the kinds that the table gives them."""
    known = {info.name: info for info in config.table(cls)}
    out: dict[str, bool | int | float | str] = {}
    for pair in pairs:
        key, equals, text = pair.partition("=")
        if not equals:
            raise UsageError(f"'{pair}' is not KEY=VALUE", where="--set")
        if key not in known:
            raise ConfigError(f"unknown key '{key}'", where="--set", todo=f"did you mean {nearest(key, known)}? --settings lists them")
        out[key] = _parse(known[key].kind, text, key)
    return out


def nearest(key: str, known: Iterable[str]) -> str:
    """The known names that are most like one that is not known, in words."""
    from difflib import get_close_matches

    names = list(known)
    near = get_close_matches(key[:80], names, n=3, cutoff=0.4) or [n for n in names if n.rpartition(".")[2] == key.rpartition(".")[2]]
    return " or ".join(near or names[:3])


def _parse(kind: type, text: str, key: str) -> bool | int | float | str:
    if kind is bool:
        truth = {"true": True, "yes": True, "on": True, "1": True, "false": False, "no": False, "off": False, "0": False}
        if text.lower() not in truth:
            raise ConfigError(f"'{text}' is neither true nor false", where=f"--set {key}")
        return truth[text.lower()]
    if kind is str:
        return text
    try:
        return int(text) if kind is int else float(text)
    except ValueError:
        raise ConfigError(f"'{text}' is no {kind.__name__}", where=f"--set {key}") from None


def settings_text(cls: type[Any]) -> str:
    """Every setting of a configuration class, one line each."""
    return "\n".join(f"{info.name} = {_value(info.default)}{_bounds(info)}  {info.meaning}{_reason(info)}" for info in config.table(cls))


def _reason(info: config.ParamInfo) -> str:
    return f" (reason: {info.why})" if info.why else ""


def _value(value: float | str) -> str:
    return str(value).lower() if isinstance(value, bool) else repr(value) if isinstance(value, str) else f"{value:g}"


def _unit(info: config.ParamInfo) -> str:
    return f" {info.unit}" if info.unit else ""


def parse_placement(text: str | None, camera_frame: str) -> Placement | None:
    """A placement of the cell from `--initial-pose`: in the camera's frame, or in the frame before a colon."""
    from tof_core import placement

    return placement.parse_placement(text or "", camera_frame)


def _bounds(info: config.ParamInfo) -> str:
    unit = _unit(info)
    if info.choices:
        return f"{unit} [{' | '.join(info.choices)}]"
    if info.low is None and info.high is None:
        return unit
    low = "" if info.low is None else f"{info.low:g}"
    high = "" if info.high is None else f"{info.high:g}"
    return f"{unit} [{low} .. {high}]"
