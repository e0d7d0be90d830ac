# SPDX-License-Identifier: Apache-2.0
"""What CONTRIBUTING.md promises of the code itself: the size of files and functions, import contracts, and types."""

from __future__ import annotations

import ast
import tomllib
from graphlib import TopologicalSorter
from pathlib import Path

import grimp

from tests.conftest import FIRST

SOURCE = Path(__file__).parents[1] / "src"
SOURCES = sorted(SOURCE.rglob("*.py"))
FILE_LINES, FUNCTION_LINES = 300, 60


def functions(path: Path) -> list[ast.FunctionDef | ast.AsyncFunctionDef]:
    return [n for n in ast.walk(ast.parse(path.read_text())) if isinstance(n, ast.FunctionDef | ast.AsyncFunctionDef)]


def test_files_and_functions_stay_small() -> None:
    lines = {str(path): len(path.read_text().splitlines()) for path in SOURCES}
    assert len(lines) > 300
    assert {path: n for path, n in lines.items() if n > FILE_LINES} == {}
    sizes = {f"{path}: {f.name}": (f.end_lineno or 0) - f.lineno + 1 for path in SOURCES for f in functions(path)}
    assert {name: n for name, n in sizes.items() if n > FUNCTION_LINES} == {}


def test_files_that_come_first_are_there() -> None:
    for first in FIRST:
        assert (SOURCE.parent / "tests" / first).exists(), f"{first} of tests/conftest.py"


def test_every_room_is_under_the_import_contracts() -> None:
    pyproject = tomllib.loads((SOURCE.parent / "pyproject.toml").read_text())
    rooms = {path.parent.name for path in SOURCE.glob("*/__init__.py")}
    assert set(pyproject["tool"]["importlinter"]["root_packages"]) == rooms
    assert rooms <= set(pyproject["tool"]["ruff"]["lint"]["isort"]["known-first-party"])


def test_no_files_import_each_other_in_a_circle() -> None:
    """Imports for types count too. An effect alone may name the session that it reads, and the session names its noise."""
    rooms = tomllib.loads((SOURCE.parent / "pyproject.toml").read_text())["tool"]["importlinter"]["root_packages"]
    graph = grimp.build_graph(*rooms, cache_dir=None)
    imports = {m: graph.find_modules_directly_imported_by(m) for m in graph.modules}
    for module, imported in imports.items():
        if ".effect" in module:
            imported -= {"tof_sensor.session", "tof_virtual.session"}
    imports["tof_sensor.effect"].remove("tof_sensor.effects.photon_law")
    assert len(list(TopologicalSorter(imports).static_order())) > 300  # A circle raises.


def test_every_argument_and_result_has_a_type() -> None:
    untyped = []
    for path in SOURCES:
        for f in functions(path):
            a = f.args
            given = [*a.posonlyargs, *a.args, *a.kwonlyargs, *(x for x in (a.vararg, a.kwarg) if x is not None)]
            without = [x.arg for x in given if x.annotation is None and x.arg not in ("self", "cls")]
            if without or (f.returns is None and f.name != "__init__"):
                untyped.append(f"{path}:{f.lineno} {f.name}({', '.join(without)})")
    assert untyped == []


def test_every_order_of_values_is_the_same_on_every_processor() -> None:
    """NumPy's default `argsort` puts equal values in an order that depends on the vector instructions of the processor."""
    bare = []
    for path in SOURCES:
        for call in (n for n in ast.walk(ast.parse(path.read_text())) if isinstance(n, ast.Call)):
            stable = any(k.arg == "kind" and ast.unparse(k.value) == "'stable'" for k in call.keywords)
            if ast.unparse(call.func) in ("np.argsort", "np.argpartition") and not stable:
                bare.append(f"{path.relative_to(SOURCE)}: {ast.unparse(call)}")
    assert bare == [
        "tof_gap/solve/hypotheses/levels.py: np.argsort(means, kind='mergesort')",  # compiled: Numba's name of the stable one
        "tof_preproc/noise.py: np.argsort(brightness[usable])",  # equal values share a bin there
        "tof_sensor/interreflection.py: np.argsort(receiver)",  # compiled: Numba's own sort, the same everywhere
    ]
