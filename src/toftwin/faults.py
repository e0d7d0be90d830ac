# SPDX-License-Identifier: Apache-2.0
"""An error as one line of text and an exit code."""

from __future__ import annotations

import errno
import os
import tempfile
import traceback

from tof_core.errors import ToftwinError

EXIT_BUG = 70
EXIT_INTERRUPTED = 130


def explain(error: BaseException) -> tuple[str, int]:
    """An error as one line, and its exit code."""
    if isinstance(error, ToftwinError):
        return str(error), error.exit_code
    if isinstance(error, KeyboardInterrupt):
        return "stopped; what was finished is kept", EXIT_INTERRUPTED
    if isinstance(error, OSError) and error.errno is not None:
        return _os_error(error), 1
    path = _write_traceback(error)
    return f"a fault in toftwin itself ({type(error).__name__}: {error}); the traceback is in {path}", EXIT_BUG


def _os_error(error: OSError) -> str:
    where = error.filename or "a file"
    if error.errno == errno.ENOSPC:
        return f"{where}: the disk is full; make room and run the same command again, what was finished is kept"
    return f"{where}: {error.strerror}"


def _write_traceback(error: BaseException) -> str:
    try:
        handle, path = tempfile.mkstemp(prefix="toftwin-", suffix=".log")
        with os.fdopen(handle, "w", encoding="utf-8") as log:
            log.write("".join(traceback.format_exception(error)))
    except OSError:
        return "nowhere (no temporary folder); run again with --debug"
    return path
