# SPDX-License-Identifier: Apache-2.0
"""Paths of a command line, checked before heavy imports: inputs that do not exist, outputs that cannot be written."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from tof_core.errors import NoBagError, UsageError

if TYPE_CHECKING:
    import argparse
    from collections.abc import Iterator

BUILT_IN = ("body_section", "housing", "pipework")
"""Scenes that have a name instead of a file (`tof_scene.builtin`, which is heavier than this check)."""
SENSOR, NETWORK = "name a sensor.yaml that toftwin gap wrote", "name the .onnx file that toftwin train wrote"
INPUTS = {
    "scene": "name a scene.yaml, its folder, or a built-in scene",
    "config": "name a YAML file; --settings prints one",
    "sensor": SENSOR,
    "sensor.model": SENSOR,
    "reference": "name what toftwin correct --save or the node's capture_reference wrote, or for inspect a bag of the complete cell",
    "truth": "name the .npz that lies beside a virtual session",
    "gap": "name a folder that toftwin gap wrote",
    "what": "name a bag, a dataset, or a folder that label or gap wrote",
    "against": "name a simulator's bag, or for replay what --record wrote",
    "model": NETWORK,
    "infer.model": NETWORK,
    "params_file": "name a ROS parameter file; --list-params prints one",
}
"""Arguments that name a file or folder to read, and what to name."""
DATASETS = ("datasets", "unseen")
"""Arguments that name datasets."""
OUTPUTS = ("out", "save", "record", "history", "truth")
"""Arguments that name a file or folder to write."""
WRITTEN = {"truth": "simulate"}
"""Arguments that are an output in the commands listed, and an input in all others."""
FRESH = {"infer": "out", "replay": "record", "sensor": "out", "simulate": "out"}
"""Outputs by command that must not exist: a bag is never overwritten."""
DEFAULT_NETWORK = "default"
"""The network in the package (`tof_infer.config.InferConfig.model`)."""
PATTERN = frozenset("*?[")


def check_paths(args: argparse.Namespace) -> None:
    """Check the paths of a parsed command line; the content of files is checked when they are read.

    Raises:
        UsageError: an input does not exist, or the output's folder cannot be written.
    """
    given = vars(args)
    for bag in _paths(given.get("bag")):
        if not Path(bag).exists() and not PATTERN & set(bag):
            raise NoBagError("does not exist", where=bag, todo="name a bag's folder, .mcap or .db3 file")
    for dataset in (d for name in DATASETS for d in _paths(given.get(name))):
        if not Path(dataset).exists():
            raise UsageError("does not exist", where=dataset, todo="make a dataset with: toftwin label BAG --scene SCENE --out DATASET")
    for name, todo in INPUTS.items():
        for value in _paths(given.get(name)):
            if value and WRITTEN.get(name) != args.command and not _is_there(name, value):
                raise UsageError("does not exist", where=value, todo=todo)
    for name in OUTPUTS:
        out = given.get(name)
        if isinstance(out, Path) and WRITTEN.get(name, args.command) == args.command:
            _check_writable(out, fresh=FRESH.get(args.command) == name)


def session_name(bag: str | Path) -> str:
    """The name of a bag in a page's title; a bag that is called `bag` with its folder, as in `monday/bag`."""
    path = Path(bag).absolute()
    return f"{path.parent.name}/{path.name}" if path.name == "bag" else path.name


def _paths(value: object) -> Iterator[str]:
    if isinstance(value, str | Path):
        yield str(value)
    elif isinstance(value, list):
        yield from (str(v) for v in value)


def _is_there(name: str, value: str) -> bool:
    """Whether an input exists; references and truths may be given without the ending of their files."""
    if (name == "scene" and value in BUILT_IN) or (name.endswith("model") and value == DEFAULT_NETWORK):
        return True
    path = Path(value)
    return path.exists() or any(
        path.with_name(path.name + ending).exists() for ending in (".json", ".npz") if name in ("reference", "truth")
    )


def _check_writable(out: Path, *, fresh: bool) -> None:
    """Refuse an output below a file, in a folder without write permission, or that must not exist; nothing is created."""
    if fresh and out.exists():
        raise UsageError("exists already", where=out, todo="name another folder or remove it")
    above = next((p for p in (out, *out.absolute().parents) if p.exists()), Path("/"))
    if above is not out and not above.is_dir():
        raise UsageError(f"cannot be written: {above} is a file", where=out, todo="name a folder that can be made")
    if not os.access(above, os.W_OK):
        raise UsageError(f"cannot be written: no permission in {above}", where=out, todo="name a folder that this user may write")
