# SPDX-License-Identifier: Apache-2.0
"""What an extra of toftwin needs, and the line that installs it into the environment that runs now."""

from __future__ import annotations

import shlex
import sys
from importlib.metadata import PackageNotFoundError, requires


def install_line(extra: str) -> str:
    """A command line that works from any folder: toftwin itself is on no index, its requirements are."""
    try:
        stated = requires("toftwin") or []
    except PackageNotFoundError:
        stated = []
    packages = [r.partition(";")[0].strip() for r in stated if r.replace('"', "'").endswith(f"extra == '{extra}'")]
    return shlex.join([sys.executable, "-m", "pip", "install", *(packages or [f"toftwin[{extra}]"])])
