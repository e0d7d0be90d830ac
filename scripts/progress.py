# SPDX-License-Identifier: Apache-2.0
"""Steps of a set-up: what runs now, for how long, and one line when it fails."""

from __future__ import annotations

import contextlib
import os
import re
import subprocess
import sys
import threading
import time
from collections import deque
from typing import IO, TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from pathlib import Path

NO_NETWORK = re.compile(
    r"name resolution|failure resolving|resolve host|Could not connect|Failed to establish|Network is unreachable|NewConnectionError|ProxyError|ReadTimeout|Connection (refused|timed out|reset)",
    re.IGNORECASE,
)
NOT_FOUND = re.compile(r"No matching distribution found for (\S+)")
PACKAGE = re.compile(r"[\w.-]*")
DISK_FULL = re.compile(r"No space left on device")
HEARTBEAT_S = 15.0
CLEAR = "\r\033[K"
"""To the start of a terminal's line, and the line away."""


class SetUpError(Exception):
    """A set-up step that cannot go on; the message is the one line the user reads."""


class Steps:
    """Runs the commands of each step, shows where they are and keeps their output in a log."""

    def __init__(self, total: int, log: Path, cwd: Path) -> None:
        self.total = total
        self.cwd = cwd
        self.log = log
        self.number = 0
        self.name = ""
        self.remark = ""
        self.latest = ""
        self.tail: deque[str] = deque(maxlen=200)
        self.started = time.monotonic()
        self.is_terminal = sys.stdout.isatty()
        log.parent.mkdir(parents=True, exist_ok=True)
        log.write_text("", encoding="utf-8")

    @contextlib.contextmanager
    def step(self, name: str) -> Iterator[None]:
        """Announce a step, keep saying that it lives, and close its line with the time it took."""
        self.number, self.name, self.remark, self.latest = self.number + 1, name, "", ""
        self.started = time.monotonic()
        self.tail.clear()
        over = threading.Event()
        ticker = threading.Thread(target=self._tick, args=(over,), daemon=True)
        self._show("...")
        ticker.start()
        try:
            yield
        except BaseException:
            self.remark = "stopped"
            raise
        finally:
            over.set()
            ticker.join()
            self._close()

    def _close(self) -> None:
        self._show(f"{time.monotonic() - self.started:.0f} s{'  ' + self.remark if self.remark else ''}", last=True)

    def note(self, remark: str) -> None:
        """Say something beside the finished step."""
        self.remark = remark

    def announce(self, line: str) -> None:
        """A line of its own, at once."""
        sys.stdout.write(f"{CLEAR if self.is_terminal else ''}{line}\n")
        sys.stdout.flush()

    def run(self, command: Sequence[str], *, quiet_failure: bool = False, environment: Mapping[str, str] | None = None) -> bool:
        """Run one command of the step, in child_environment() unless another is given; its failure is a SetUpError unless `quiet_failure`."""
        with (
            self.log.open("a", encoding="utf-8") as log,
            subprocess.Popen(
                command, cwd=self.cwd, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL,
                text=True, errors="replace", env=environment or child_environment(),
            ) as process,
        ):  # fmt: skip
            self._follow(process.stdout, log)
        if process.returncode == 0:
            return True
        if quiet_failure:
            return False
        raise SetUpError(explain("\n".join(self.tail), self.name, self.log))

    @contextlib.contextmanager
    def beside(self, command: Sequence[str]) -> Iterator[Callable[[], None]]:
        """Run a command while the steps inside go on; what is yielded waits for it, and its failure is a SetUpError."""
        log = self.log.with_name(f"{self.log.stem}-beside.log")
        with (
            log.open("w", encoding="utf-8") as out,
            subprocess.Popen(
                command, cwd=self.cwd, stdout=out, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL, env=child_environment(),
            ) as process,
        ):  # fmt: skip

            def wait() -> None:
                if process.wait() != 0:
                    raise SetUpError(explain(log.read_text(encoding="utf-8", errors="replace"), self.name, log))

            try:
                yield wait
            except BaseException:
                process.terminate()
                raise

    def _follow(self, lines: IO[str] | None, log: IO[str]) -> None:
        collected = 0
        for line in lines or ():
            log.write(line)
            self.tail.append(line.rstrip())
            words = line.split()
            if words[:1] == ["Collecting"]:
                collected += 1
                self.latest = f"{collected} collected, {PACKAGE.findall(words[1])[0]}"
            elif words[:2] == ["Installing", "collected"]:
                self.latest = f"unpacking {line.count(',') + 1} packages"
            elif words[:1] in (["Downloading"], ["Downloaded"], ["Prepared"], ["Installed"]):  # uv's words
                self.latest = " ".join(words)

    def _tick(self, over: threading.Event) -> None:
        while not over.wait(1.0 if self.is_terminal else HEARTBEAT_S):
            self._show(f"{time.monotonic() - self.started:.0f} s  {self.latest}")

    def _show(self, state: str, *, last: bool = False) -> None:
        line = f"[{self.number}/{self.total}] {self.name}: {state}"
        end = "\n" if last or not self.is_terminal else ""
        sys.stdout.write(f"{CLEAR}{line if last else line[:100]}{end}" if self.is_terminal else line + end)
        sys.stdout.flush()


def child_environment() -> dict[str, str]:
    """The environment without what a user's settings of pip and uv would turn against a virtual environment."""
    of_pip, of_uv = {"PIP_USER", "PIP_TARGET", "PIP_PREFIX", "PIP_REQUIRE_VIRTUALENV"}, {"UV_PYTHON", "UV_SYSTEM_PYTHON"}
    unwanted = of_pip | of_uv | {"PYTHONHOME", "VIRTUAL_ENV"}
    kept = {key: value for key, value in os.environ.items() if key not in unwanted}
    return kept | {"DEBIAN_FRONTEND": "noninteractive", "PYTHONUNBUFFERED": "1"}


def explain(output: str, name: str, log: Path) -> str:
    """One line from a failed command's output: what, where, what to do."""
    again = "what is installed is kept, run the same make again"
    if NO_NETWORK.search(output):
        return f"{name}: no network: pip or apt could not reach its index; check the connection or https_proxy, {again}"
    if DISK_FULL.search(output):
        return f"{name}: the disk is full; make room, {again}"
    if missing := NOT_FOUND.search(output):
        return f"{name}: {missing[1]} is not on pip's index for this Python and machine (PIP_INDEX_URL set to a partial mirror?); see {log}"
    errors = [line for line in output.splitlines() if re.search(r"error", line, re.IGNORECASE)] or output.splitlines()[-1:]
    return f"{name}: {errors[-1].strip() if errors else 'failed without a word'}; see {log}"
