# SPDX-License-Identifier: Apache-2.0
"""What an extra of toftwin needs, and the line that installs it into the environment that runs now."""

from __future__ import annotations

import shlex
import sys
from importlib.metadata import PackageNotFoundError, requires
from typing import Any

from tof_core.errors import UsageError


def install_line(extra: str) -> str:
    """A command line that installs an extra from any folder: toftwin is on no index, its requirements are."""
    try:
        stated = requires("toftwin") or []
    except PackageNotFoundError:
        stated = []
    packages = [r.partition(";")[0].strip() for r in stated if r.replace('"', "'").endswith(f"extra == '{extra}'")]
    return shlex.join([sys.executable, "-m", "pip", "install", *(packages or [f"toftwin[{extra}]"])])


def trainer(where: str) -> Any:
    """The function `tof_infer.train.train`; if a package is missing, a UsageError with the line that installs it."""
    try:
        from tof_infer.train import train
    except ModuleNotFoundError as error:
        if error.name not in {"torch", "onnx"}:
            raise
        raise UsageError(f"needs {error.name}, which is not installed", where=where, todo=install_line("train")) from None
    return train
