# SPDX-License-Identifier: Apache-2.0
"""Fill Numba's cache with the kernels of filters, ray casting, alignment, labels, diagnosis, inference and the virtual robot, so that no first run compiles them.

`compile_kernels.py [run | dev]` compiles in two processes; `dev` adds the emerging camera of benchmarks and tests. `compile_kernels.py NAME...` compiles
these groups alone.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).resolve().parent.parent
IN_PARALLEL = {"run": (("filters", "robot"), ("diagnosis",)), "dev": (("filters", "robot", "emerging"), ("diagnosis",))}
"""By level of set-up: the groups of each process. The two take about equally long."""

SMALL = {"camera.width": 32, "camera.height": 24, "plan.views": 1, "plan.stations": 1}


def filters() -> None:
    """Preprocessing, and keeping raw depth where a network is unsure."""
    from tof_infer.session import Session
    from tof_preproc import preprocessor

    preprocessor.warm_up()
    Session()


def diagnosis() -> None:
    """Ray casting, alignment, labels, diagnosis."""
    from tof_gap import warm_up
    from tof_scene.builtin import open_scene
    from tof_scene.raycast import Raycaster
    from tof_sim_label import stream

    stream.warm_up(Raycaster(open_scene("body_section")))
    warm_up.warm_up()


def robot() -> None:
    """The virtual robot: a session of one view, whose light takes every path and whose hand moves."""
    from tof_core.config import from_mapping
    from tof_scene.builtin import open_scene
    from tof_virtual.config import VirtualConfig
    from tof_virtual.record import record
    from toftwin.commands.simulate import bodies_of

    small = SMALL | {"plan.capture_moving": True}
    with TemporaryDirectory() as folder:
        record(
            bodies_of(open_scene("body_section")),
            Path(folder) / "bag",
            from_mapping(VirtualConfig, small),
            effects={"multipath": 1.0, "motion": 1.0},
        )


def emerging() -> None:
    """The emerging camera of benchmarks and tests."""
    from benchmarks.emerging.device import Device
    from benchmarks.emerging.session import EmergingSession
    from tof_core.config import from_mapping, updated
    from tof_scene.builtin import open_scene
    from tof_virtual.config import VirtualConfig
    from toftwin.commands.simulate import bodies_of

    small = from_mapping(VirtualConfig, SMALL)
    device = updated(Device(), {"lamp.flood_share": 1.0, "firmware.filter": True})
    EmergingSession(bodies_of(open_scene("body_section")), small, device, {}).exposed(0, device, noise=True)


GROUPS = {group.__name__: group for group in (filters, diagnosis, robot, emerging)}


def main() -> int:
    """Compile; 0 unless a process fails."""
    names = sys.argv[1:] or ["run"]
    if names[0] not in IN_PARALLEL:
        sys.path.insert(0, str(ROOT))
        for name in names:
            GROUPS[name]()
        return 0
    running = [subprocess.Popen([sys.executable, __file__, *groups]) for groups in IN_PARALLEL[names[0]]]
    return max(process.wait() for process in running)


if __name__ == "__main__":
    sys.exit(main())
