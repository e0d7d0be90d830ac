# SPDX-License-Identifier: Apache-2.0
"""Processor time of a command before it reads its first frame; of one that only prints its settings, all of it."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

from benchmarks.figure import Figure, at_most
from tof_core.cores import ONE_THREAD

BAG = Path(__file__).resolve().parent.parent / "tests" / "data" / "golden" / "bag"
SCENE = "body_section"
ROUNDS = 3
BAR_S, SETTINGS_BAR_S = 0.8, 0.3
UNTIL_FIRST_FRAME = """
import os, resource, sys
from tof_core.bag import BagReader

def stop(*_, **__):
    used = resource.getrusage(resource.RUSAGE_SELF)
    print("used", used.ru_utime + used.ru_stime, flush=True)
    os._exit(0)

BagReader.captures = stop
from toftwin.cli import main
sys.exit(main(sys.argv[1:]))
"""


def run() -> list[Figure]:
    """The least of some rounds each: neighbours on the host only add. The first fills Numba's cache and does not count."""
    figures = [settings()]
    with tempfile.TemporaryDirectory() as folder:
        commands = {
            "label": ["label", str(BAG), "--scene", SCENE, "--out", f"{folder}/label"],
            "inspect": ["inspect", str(BAG), "--scene", SCENE, "--out", f"{folder}/inspect"],
            "correct": ["correct", str(BAG), "--save", f"{folder}/reference"],
        }
        for name, arguments in commands.items():
            seconds = min([before_first_frame(arguments) for _ in range(ROUNDS + 1)][1:])
            figures.append(at_most(f"processor time of toftwin {name} before its first frame is read", seconds, BAR_S, "s"))
    return figures


def before_first_frame(arguments: list[str]) -> float:
    """Processor seconds of the command until it asks the bag for captures."""
    done = subprocess.run(
        [sys.executable, "-c", UNTIL_FIRST_FRAME, *arguments, "--quiet"], env=environment(), check=True, capture_output=True, text=True
    )
    return float(done.stdout.split("used ")[1])


def settings() -> Figure:
    """`toftwin correct --settings`, the whole command."""
    command = [sys.executable, "-m", "toftwin.cli", "correct", str(BAG), "--settings"]
    seconds = []
    for _ in range(ROUNDS + 1):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run(command, env=environment(), check=True, capture_output=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        seconds.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    return at_most("processor time of toftwin correct --settings", min(seconds[1:]), SETTINGS_BAR_S, "s")


def environment() -> dict[str, str]:
    """One thread, as the nodes have."""
    return {**os.environ, **ONE_THREAD}
