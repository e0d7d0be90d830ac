# SPDX-License-Identifier: Apache-2.0
"""Work in another process: its steps and its result come back, its refusal too, and it ends where the caller wants."""

from __future__ import annotations

import os
import time
from typing import TYPE_CHECKING

import pytest

from tof_core.beside import beside
from tof_core.errors import RefusedError, TransformError

if TYPE_CHECKING:
    from collections.abc import Callable

HOUR_S = 3600.0


class Stop(Exception):  # noqa: N818  (no error: the caller wants the end)
    """The caller wants no more."""


def pid_of(task: str, progress: Callable[[str], None]) -> tuple[str, int]:
    progress("first")
    progress("second")
    return task, os.getpid()


def refuses(task: str, progress: Callable[[str], None]) -> None:
    del progress
    raise TransformError("no way", where=task, todo="another one")


def dies(task: str, progress: Callable[[str], None]) -> None:
    del task, progress
    os._exit(7)


def lasts(task: str, progress: Callable[[str], None]) -> None:
    progress(task)
    time.sleep(HOUR_S)


def test_steps_and_result_come_from_another_process() -> None:
    steps: list[str] = []
    task, pid = beside(pid_of, "views", steps.append, name="the work")
    assert (task, steps) == ("views", ["first", "second"])
    assert pid != os.getpid()


def test_its_refusal_is_raised_here() -> None:
    with pytest.raises(RefusedError, match=r"^here: no way; another one$"):
        beside(refuses, "here", print, name="the work")


def test_a_process_that_dies_is_reported() -> None:
    with pytest.raises(RefusedError, match=r"^the work: its process ended with 7"):
        beside(dies, "", print, name="the work")


def test_what_the_caller_s_check_raises_ends_it_at_once() -> None:
    steps: list[str] = []

    def check() -> None:
        if steps:
            raise Stop

    with pytest.raises(Stop):
        beside(lasts, "an hour", steps.append, check, name="the work")
