# SPDX-License-Identifier: Apache-2.0
"""A diagnosis in a process of its own: the node continues, memory is freed afterwards, and a cancellation takes effect at once."""

from __future__ import annotations

from dataclasses import dataclass
from multiprocessing import get_context
from typing import TYPE_CHECKING, Any

from tof_core.errors import RefusedError, ToftwinError

if TYPE_CHECKING:
    from collections.abc import Callable
    from multiprocessing.connection import Connection

    from tof_align.config import AlignConfig
    from tof_core.capture import View
    from tof_gap.config import GapConfig

PERIOD_S = 0.2
"""Period at which a cancellation is checked."""
NICENESS = 5
"""On a busy host, the graph's frames have priority."""


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """Views and settings of a diagnosis; scene, sensor: files (sensor may be empty); out: folder of the report (empty: none)."""

    views: tuple[View, ...]
    scene: str
    config: GapConfig
    align: AlignConfig
    sensor: str
    left_out: frozenset[str]
    out: str


def diagnose_beside(task: Task, progress: Callable[[str], None], check: Callable[[], None]) -> dict[str, Any]:
    """Diagnose; gives the content of gap.json.

    Args:
        task: the session.
        progress: called with the name of each step.
        check: called a few times a second; what it raises ends the diagnosis.

    Raises:
        RefusedError: as `diagnose`, or the process died.
    """
    # Spawned, since the threads that Embree, Numba and DDS have started here do not survive a fork.
    context = get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_serve, args=(theirs,), daemon=True)
    process.start()
    theirs.close()
    try:
        ours.send(task)
        while True:
            while not ours.poll(PERIOD_S):
                check()
            kind, content = ours.recv()
            if kind == "step":
                progress(content)
            elif kind == "refused":
                what, where, todo = content
                raise RefusedError(what, where=where, todo=todo)
            else:
                return dict(content)
    except (EOFError, OSError):
        process.join()
        raise RefusedError(
            f"the process of the diagnosis ended with {process.exitcode}", where="gap", todo="see dmesg where memory ran out (-9)"
        ) from None
    finally:
        ours.close()
        process.terminate()
        process.join()


def _serve(line: Connection[Any, Any]) -> None:
    """The other process: one task."""
    import os

    from tof_core.cores import one_thread

    os.nice(NICENESS)
    one_thread()  # Before NumPy is imported, with the task.
    task: Task = line.recv()
    try:
        line.send(("done", _content(task, lambda step: line.send(("step", step)))))
    except ToftwinError as error:
        line.send(("refused", (error.what, str(error.where), error.todo)))


def _content(task: Task, progress: Callable[[str], None]) -> dict[str, Any]:
    from pathlib import Path

    from tof_gap.advice import advise
    from tof_gap.session import diagnose_session
    from tof_gap.tell.kept import kept
    from tof_gap.tell.page import write_page
    from tof_gap.tell.report import region_maps, report, write
    from tof_scene.builtin import open_scene
    from tof_scene.raycast import Raycaster
    from tof_sensor.model import load_model

    known = load_model(Path(task.sensor)) if task.sensor else None
    caster = Raycaster(open_scene(task.scene))
    found = diagnose_session(task.views, caster, task.config, task.align, known=known, left_out=task.left_out, progress=progress)
    progress("advice and report")
    advice = advise(found, caster)
    if not task.out:
        return report(found, caster, region_maps(found, caster), advice, kept(found, known))
    content = write(found, caster, Path(task.out), advice, kept(found, known))
    return content | {"page": str(write_page(found, content, Path(task.out), "live"))}
