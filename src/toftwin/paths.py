# SPDX-License-Identifier: Apache-2.0
"""Paths of a call, checked before anything heavy is imported: inputs that are not there, outputs that cannot be written."""

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
INPUTS = {
    "scene": "name a scene.yaml, its folder, or a built-in scene",
    "config": "name a YAML file; --settings prints one",
    "sensor": "name a sensor.yaml that toftwin gap wrote",
    "reference": "name what toftwin correct --save or the node's capture_reference wrote, or for inspect a bag of the complete cell",
    "truth": "name the .npz that lies beside a virtual session",
    "gap": "name a folder that toftwin gap wrote",
    "what": "name a bag, a dataset, or a folder that label or gap wrote",
}
"""Arguments that name a file or folder to read, and what to name."""
WRITTEN = {"truth": "simulate"}
"""Arguments that are an output in one command."""
PATTERN = frozenset("*?[")


def check_paths(args: argparse.Namespace) -> None:
    """Check the paths of a parsed command line; what a file holds is checked when it is read.

    Raises:
        UsageError: an input does not exist, or the output's folder cannot be written.
    """
    for bag in _paths(getattr(args, "bag", None)):
        if not Path(bag).exists() and not PATTERN & set(bag):
            raise NoBagError("does not exist", where=bag, todo="name a bag's folder, .mcap or .db3 file")
    for dataset in getattr(args, "datasets", None) or ():
        if not Path(dataset).exists():
            raise UsageError("does not exist", where=dataset, todo="make a dataset with: toftwin label BAG --scene SCENE --out DATASET")
    for name, todo in INPUTS.items():
        for value in _paths(getattr(args, name, None)):
            if value and WRITTEN.get(name) != args.command and not _is_there(name, value):
                raise UsageError("does not exist", where=value, todo=todo)
    out = getattr(args, "out", None)
    if isinstance(out, Path):
        _check_writable(out)


def _paths(value: object) -> Iterator[str]:
    if isinstance(value, str | Path):
        yield str(value)
    elif isinstance(value, list):
        yield from (str(v) for v in value)


def _is_there(name: str, value: str) -> bool:
    """Whether an input exists; references and truths are named without or with the ending of one of their files."""
    if name == "scene" and value in BUILT_IN:
        return True
    path = Path(value)
    return path.exists() or any(
        path.with_name(path.name + ending).exists() for ending in (".json", ".npz") if name in ("reference", "truth")
    )


def _check_writable(out: Path) -> None:
    """Refuse an output below a file, or in a folder that this user cannot write; nothing is made."""
    above = next((p for p in (out, *out.absolute().parents) if p.exists()), Path("/"))
    if above is not out and not above.is_dir():
        raise UsageError(f"cannot be written: {above} is a file", where=out, todo="name a folder that can be made")
    if not os.access(above, os.W_OK):
        raise UsageError(f"cannot be written: no permission in {above}", where=out, todo="name a folder that this user may write")
