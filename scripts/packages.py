# SPDX-License-Identifier: Apache-2.0
"""Packages by uv, which takes a sixth of pip's processor time; by pip where uv has no wheel or fails."""

from __future__ import annotations

import ast
import subprocess
from typing import TYPE_CHECKING

from progress import child_environment

if TYPE_CHECKING:
    from pathlib import Path

    from progress import Steps

CACHE = "uv-cache"
"""Folder in .venv of what uv unpacked: .venv gets hard links to it, so nothing is written twice. set_up.py removes it at the end.

It is not uv's usual one, since build_interfaces.py changes installed files in place, and another environment would be linked to the changed ones.
"""
UV_OPTIONS = ("--compile-bytecode", "--index-strategy", "unsafe-best-match")
"""What pip does without being asked: compile modules, and take the best version of all indexes."""
UV_NAMES = {
    "index-url": "UV_DEFAULT_INDEX",
    "extra-index-url": "UV_INDEX",
    "find-links": "UV_FIND_LINKS",
    "trusted-host": "UV_INSECURE_HOST",
    "cert": "SSL_CERT_FILE",
    "proxy": "ALL_PROXY",
    "no-index": "UV_OFFLINE",
}
"""Environment variable of uv for a setting of pip. uv reads neither pip.conf nor PIP_INDEX_URL."""
PIP_SECTIONS = ("global", "install", ":env:")
"""Where `pip config list` found a setting; the last of them holds."""


def pip_command(python: Path) -> list[str]:
    """Start of a pip command line."""
    return [str(python), "-m", "pip", "install", "--disable-pip-version-check"]


def ensure_uv(steps: Steps, python: Path) -> None:
    """Install uv by its hash; without it pip does everything."""
    steps.run(
        [*pip_command(python), "--no-deps", "--only-binary", ":all:", "--require-hashes", "-r", "requirements/uv.txt"], quiet_failure=True
    )


def install(steps: Steps, python: Path, *what: str, quiet_failure: bool = False) -> bool:
    """Install with uv, else with pip: it asks again, and its last words explain a failure. The words of `what` mean the same to both."""
    uv = python.with_name("uv")
    if uv.exists():
        command = [str(uv), "pip", "install", "--python", str(python), *UV_OPTIONS, *what]
        if steps.run(command, quiet_failure=True, environment=uv_environment(python)):
            return True
    return steps.run([*pip_command(python), *what], quiet_failure=quiet_failure)


def uv_environment(python: Path) -> dict[str, str]:
    """The environment in which uv asks where pip would, unless uv's own variables say otherwise."""
    asked = subprocess.run(
        [str(python), "-m", "pip", "config", "list"], check=False, capture_output=True, text=True, env=child_environment()
    )
    return settings(asked.stdout) | child_environment() | {"UV_CACHE_DIR": str(python.parent.parent / CACHE)}


def settings(listed: str) -> dict[str, str]:
    """uv's environment variables for the lines of `pip config list`, each `section.name='value'`."""
    found = dict(line.split("=", 1) for line in listed.splitlines() if "=" in line)
    made: dict[str, str] = {}
    for section in PIP_SECTIONS:
        for name, variable in UV_NAMES.items():
            if value := found.get(f"{section}.{name}"):
                words = str(ast.literal_eval(value)).split()
                made[variable] = ("," if name == "find-links" else " ").join(words)
    return made
