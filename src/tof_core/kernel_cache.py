# SPDX-License-Identifier: Apache-2.0
"""Numba's cache of compiled kernels, renewed when a module that a kernel imports has changed.

Numba's stamp of a cached kernel covers its own source file alone. Functions and constants of other modules are compiled into the
kernel: after an edit there, the cache would return the old kernel. These locators' stamp covers the file and all project modules
that it imports, directly or not. `tof_core` names the locators in the environment, which Numba reads at import.
"""

from __future__ import annotations

import hashlib
import re
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from numba.core.caching import InTreeCacheLocator, UserProvidedCacheLocator, UserWideCacheLocator

if TYPE_CHECKING:
    from collections.abc import Iterator

IMPORT = re.compile(r"^(?:from ([\w.]+) import (\([^)]*\)|.*)|import ([\w.]+))", re.MULTILINE)
"""Imports at the beginning of a line; imports for type checkers are indented."""
PROJECT = re.compile(r"(tof_\w+|arm_correction|toftwin)$")
"""Top packages whose modules are followed."""


class _Stamped:
    """A locator for project modules, stamped with all that they import; other files are left to Numba's locators."""

    _py_file: str

    def get_source_stamp(self) -> str:
        """Digest of the file and of all project modules that it imports."""
        return stamp(Path(self._py_file))

    @classmethod
    def from_function(cls, function: Any, file: str) -> Any:
        """The locator of a project file, None for other files."""
        return super().from_function(function, file) if root_of(Path(file)) is not None else None  # type: ignore[misc]


class InGivenFolder(_Stamped, UserProvidedCacheLocator):
    """Cache in the folder that NUMBA_CACHE_DIR names."""


class BesideSource(_Stamped, InTreeCacheLocator):
    """Cache in `__pycache__`."""


class InUserFolder(_Stamped, UserWideCacheLocator):
    """Cache in the user's folder, where the source's folder cannot be written."""


def stamp(file: Path) -> str:
    """Digest of a module's source and of all project modules that it imports."""
    digest, root = hashlib.sha256(), root_of(file)
    for path in sorted(_behind(file, root) if root else {file}):
        digest.update(_read(path))
    return digest.hexdigest()


def root_of(file: Path) -> Path | None:
    """Folder that holds the project package of a file; None for other files."""
    return next((p.parent for p in file.parents if PROJECT.match(p.name) and (p / "__init__.py").exists()), None)


def _behind(file: Path, root: Path) -> set[Path]:
    """The file and all project modules that it imports, directly or not."""
    found, open_ = {file}, [file]
    while open_:
        new = set(_imported(open_.pop(), root)) - found
        found |= new
        open_ += new
    return found


@cache
def _imported(file: Path, root: Path) -> tuple[Path, ...]:
    """Project modules that a file imports."""
    return tuple(path for name in _names(_read(file).decode()) if (path := _source(root, name)) is not None)


def _names(source: str) -> Iterator[str]:
    """Names of modules that a source imports; a name imported from a package may be a module, too."""
    for module, names, plain in IMPORT.findall(source):
        if PROJECT.match((module or plain).split(".")[0]):
            yield module or plain
            yield from (f"{module}.{name}" for name in re.findall(r"\w+", names) if module)


def _source(root: Path, name: str) -> Path | None:
    path = root.joinpath(*name.split("."))
    return next((p for p in (path.with_suffix(".py"), path / "__init__.py") if p.is_file()), None)


@cache
def _read(path: Path) -> bytes:
    return path.read_bytes()
