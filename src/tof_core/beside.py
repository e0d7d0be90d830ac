# SPDX-License-Identifier: Apache-2.0
"""Long work in a process of its own: the node continues, memory is freed afterwards, and a cancellation takes effect at once.

In a thread of the node it would take several times as long beside nodes that compute, and so would they: each of its many short calls
(rays, small matrices) waits for the interpreter lock.
"""

from __future__ import annotations

from multiprocessing import get_context
from typing import TYPE_CHECKING, Any, TypeVar

from tof_core.errors import RefusedError, ToftwinError

if TYPE_CHECKING:
    from collections.abc import Callable
    from multiprocessing.connection import Connection

    T = TypeVar("T")
    R = TypeVar("R")

PERIOD_S = 0.2
"""Period at which a cancellation is checked."""


def beside(
    work: Callable[[T, Callable[[str], None]], R],
    task: T,
    progress: Callable[[str], None],
    check: Callable[[], None] = lambda: None,
    *,
    name: str,
    niceness: int = 0,
) -> R:
    """What `work` returns of `task`.

    Args:
        work: a function of a module, called with the task and with what it calls with the name of each step.
        task: its input; it and the result are sent between the processes.
        progress: called here with the name of each step.
        check: called a few times a second; what it raises ends the work.
        name: of the work, for the message where its process dies.
        niceness: of its process: larger gives way to others.

    Raises:
        RefusedError: whatever `ToftwinError` the work raised, or its process died.
    """
    # Spawned, since the threads that Embree, Numba and DDS have started here do not survive a fork.
    context = get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_serve, args=(theirs, niceness), daemon=True)
    process.start()
    theirs.close()
    try:
        ours.send((work, task))
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
                done: R = content
                return done
    except (EOFError, OSError):
        process.join()
        raise RefusedError(
            f"its process ended with {process.exitcode}",
            where=name,
            todo="see dmesg where memory ran out (-9), or the traceback in the log",
        ) from None
    finally:
        ours.close()
        process.terminate()
        process.join()


def _serve(line: Connection[Any, Any], niceness: int) -> None:
    """The other process: one task."""
    import os

    from tof_core.cores import one_thread

    os.nice(niceness)
    one_thread()  # Before NumPy is imported, with the task.
    work, task = line.recv()
    try:
        line.send(("done", work(task, lambda step: line.send(("step", step)))))
    except ToftwinError as error:
        line.send(("refused", (error.what, str(error.where), error.todo)))
