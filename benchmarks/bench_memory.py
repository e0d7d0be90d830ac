# SPDX-License-Identifier: Apache-2.0
"""Memory of label and gap for a long session of a large camera: sixty views of 640x576."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.figure import Figure, at_most
from benchmarks.recorded import recorded
from tof_core.errors import ToftwinError

LONG = True
SCENE = "body_section"
SESSION = {"camera": {"width": 640, "height": 576}, "plan": {"views": 60, "stations": 6, "captures": 2}, "seed": 12}
EFFECTS = {"wiggling": 1.0, "amplitude_bias": 1.0}
BAR_GB = 3.0


def run() -> list[Figure]:
    """The largest resident memory of each command, in a process of its own."""
    bag = str(recorded(SCENE, SESSION, EFFECTS).bag)
    with tempfile.TemporaryDirectory(prefix="toftwin-bench-") as folder:
        return [figure(name, [name, bag, "--scene", SCENE, "--out", str(Path(folder) / name), "--quiet"]) for name in ("label", "gap")]


def figure(name: str, arguments: list[str]) -> Figure:
    """Memory and time of one command."""
    began = time.monotonic()
    with tempfile.TemporaryFile() as words:
        process = subprocess.Popen([sys.executable, "-m", "toftwin.cli", *arguments], stdout=words, stderr=words)
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        words.seek(0)
        if process.returncode:
            raise ToftwinError(words.read().decode().strip()[-200:], where=name)
    remark = f"{time.monotonic() - began:.0f} s on the wall, {used.ru_utime + used.ru_stime:.0f} s of processor"
    return at_most(f"{name}: memory for sixty views of 640x576 in two captures each", used.ru_maxrss / 2**20, BAR_GB, "GB", remark=remark)
