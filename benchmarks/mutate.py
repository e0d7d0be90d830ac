# SPDX-License-Identifier: Apache-2.0
"""`python -m benchmarks.mutate --room correction`: small faults put into deciding functions, one at a time; which do the tests find?

A mutant is one changed operator, constant, condition or call. It takes the place of its function in a forked process, which
runs the room's tests until the first failure. A mutant that no test finds is printed with its line; so are the shares found.
Compiled kernels (numba) are left out: each change would be compiled anew for minutes.
"""

from __future__ import annotations

import argparse
import ast
import copy
import hashlib
import inspect
import io
import os
import random
import signal
import sys
import time
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from types import CodeType
from typing import TYPE_CHECKING, Any

from benchmarks.mutated_rooms import ROOMS, Room

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

REPOSITORY = Path(__file__).resolve().parent.parent
SURVIVED, KILLED, LATE = 0, 1, 2
PATIENCE = 4.0
"""A mutant that takes this many times as long as the tests without a fault is found: it does not end."""

SWAPPED: dict[type[ast.AST], tuple[type[ast.AST], ...]] = {
    ast.Lt: (ast.LtE, ast.GtE), ast.LtE: (ast.Lt, ast.Gt), ast.Gt: (ast.GtE, ast.LtE), ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,), ast.NotEq: (ast.Eq,), ast.Is: (ast.IsNot,), ast.IsNot: (ast.Is,), ast.In: (ast.NotIn,), ast.NotIn: (ast.In,),
    ast.Add: (ast.Sub,), ast.Sub: (ast.Add,), ast.Mult: (ast.Div,), ast.Div: (ast.Mult,), ast.And: (ast.Or,), ast.Or: (ast.And,),
    ast.BitAnd: (ast.BitOr,), ast.BitOr: (ast.BitAnd,), ast.FloorDiv: (ast.Mult,), ast.Mod: (ast.Mult,),
}  # fmt: skip
"""Operators and what stands in their place."""
SWAPPED_NAMES = {"min": "max", "max": "min", "any": "all", "all": "any", "minimum": "maximum", "maximum": "minimum"}


@dataclass(frozen=True, slots=True)
class Mutant:
    """One fault: `module` with `tree` in place of its own; where and what, for a reader."""

    module: str
    line: int
    function: str
    what: str
    tree: ast.Module


def mutants(module: str, source: str, functions: Sequence[str]) -> Iterator[Mutant]:
    """All faults of the named functions (all where none is); strings, docstrings and annotations are left alone."""
    tree = ast.parse(source)
    for name, function in _functions(tree, functions):
        for node in _body_nodes(function):
            for what, changed in _changes(node):
                yield Mutant(module, node.lineno, name, what, _with(tree, node, changed))


def _functions(tree: ast.Module, names: Sequence[str]) -> list[tuple[str, ast.FunctionDef]]:
    """Functions and methods with their qualified names."""
    places: list[tuple[str, ast.stmt]] = [("", node) for node in tree.body]
    places += [(f"{node.name}.", inner) for node in tree.body if isinstance(node, ast.ClassDef) for inner in node.body]
    found = [
        (prefix + node.name, node) for prefix, node in places if isinstance(node, ast.FunctionDef) and (not names or node.name in names)
    ]
    if lacking := set(names) - {function.name for _, function in found}:
        message = f"no functions {lacking}"
        raise SystemExit(message)
    return [(name, f) for name, f in found if not any("njit" in ast.unparse(d) for d in f.decorator_list)]


def _body_nodes(function: ast.FunctionDef) -> Iterator[ast.expr | ast.stmt]:
    """Expressions and statements that decide; what is raised, and texts, are not."""
    waiting: list[ast.AST] = list(function.body)
    while waiting:
        node = waiting.pop(0)
        if isinstance(node, ast.Raise | ast.JoinedStr | ast.FunctionDef | ast.Assert) or _is_identity(node):
            continue
        if isinstance(node, ast.expr | ast.stmt):
            yield node
        annotation = node.annotation if isinstance(node, ast.AnnAssign) else None
        waiting = [child for child in ast.iter_child_nodes(node) if child is not annotation] + waiting


def _is_identity(node: ast.AST) -> bool:
    """`np.eye(n)`: another n either fails at once or, where a part of it is read, is the same."""
    return isinstance(node, ast.Call) and ast.unparse(node.func) == "np.eye"


def _changes(node: ast.expr | ast.stmt) -> Iterator[tuple[str, ast.AST]]:
    """What may stand in a node's place, and a word for it."""
    match node:
        case ast.Compare(ops=ops):
            for i, op in enumerate(ops):
                yield from (_other(node, ops=[*ops[:i], new(), *ops[i + 1 :]]) for new in SWAPPED.get(type(op), ()))
        case ast.BinOp(op=operator) | ast.BoolOp(op=operator) | ast.AugAssign(op=operator):
            yield from (_other(node, op=new()) for new in SWAPPED.get(type(operator), ()))
        case ast.UnaryOp(op=ast.Not() | ast.USub(), operand=operand):
            yield ast.unparse(operand), operand
        case ast.Constant(value=bool() as value):
            yield str(not value), ast.Constant(not value)
        case ast.Constant(value=int() | float() as number):
            yield from ((f"{number} -> {new}", ast.Constant(new)) for new in ((number + 1, number * 2) if number else (1,)))
        case ast.If(test=test) | ast.IfExp(test=test):
            for value in (True, False):
                yield f"if {value} (for {ast.unparse(test)[:60]})", _other(node, test=ast.Constant(value))[1]
        case ast.Call(func=ast.Name(id=name)) if name in SWAPPED_NAMES:
            yield f"{SWAPPED_NAMES[name]} for {name}", _other(node, func=ast.Name(SWAPPED_NAMES[name], ast.Load()))[1]
        case ast.Call(func=ast.Attribute(attr=name, value=owner)) if name in SWAPPED_NAMES:
            yield f"{SWAPPED_NAMES[name]} for {name}", _other(node, func=ast.Attribute(owner, SWAPPED_NAMES[name], ast.Load()))[1]
        case ast.Call(func=ast.Name(id="abs") | ast.Attribute(attr="abs" | "inverse"), args=[only]):
            yield f"no {ast.unparse(node.func)}", only


def _other(node: ast.AST, **fields: object) -> tuple[str, ast.AST]:
    """A copy of a node with other fields, and how it reads."""
    out = copy.copy(node)
    for name, value in fields.items():
        setattr(out, name, value)
    return ast.unparse(out), out


def _with(tree: ast.Module, node: ast.AST, changed: ast.AST) -> ast.Module:
    """A copy of the tree with one node replaced."""

    class Replace(ast.NodeTransformer):
        def visit(self, at: ast.AST) -> ast.AST:
            if at is node:
                return ast.copy_location(changed, node)
            return self.generic_visit(_shallow(at))

    out = Replace().visit(tree)
    assert isinstance(out, ast.Module)
    return ast.fix_missing_locations(out)


def _shallow(node: ast.AST) -> ast.AST:
    """A copy of one node that shares its children, whose lists are its own."""
    out = copy.copy(node)
    for name, value in ast.iter_fields(node):
        if isinstance(value, list):
            setattr(out, name, list(value))
    return out


def put_in_place(mutant: Mutant) -> None:
    """Give the function in the loaded module the code of the mutant; whoever imported it calls that from now on."""
    code = next(c for c in _codes(compile(mutant.tree, str(source_of(mutant.module)), "exec")) if c.co_qualname == mutant.function)
    at: Any = sys.modules[mutant.module]
    for name in mutant.function.split("."):
        at = vars(at)[name]
    at = at.fget if isinstance(at, property) else getattr(at, "__func__", at)
    inspect.unwrap(at).__code__ = code


def _codes(code: CodeType) -> Iterator[CodeType]:
    yield code
    for inner in code.co_consts:
        if isinstance(inner, CodeType):
            yield from _codes(inner)


def source_of(module: str) -> Path:
    """The file of a module under src/."""
    return REPOSITORY / "src" / Path(*module.split(".")).with_suffix(".py")


def run_tests(room: Room, mutant: Mutant | None, limit_s: float) -> int:
    """Run a room's tests in a forked process; SURVIVED where all passed."""
    child = os.fork()
    if child == 0:
        os.setsid()
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        signal.alarm(max(int(limit_s), 1))
        with Path(os.devnull).open("w") as nowhere, redirect_stdout(nowhere), redirect_stderr(io.StringIO()):
            os._exit(_child(room, mutant))
    _, status = os.waitpid(child, 0)
    if os.WIFSIGNALED(status):
        return LATE if os.WTERMSIG(status) == signal.SIGALRM else KILLED
    return SURVIVED if os.WEXITSTATUS(status) == 0 else KILLED


def _child(room: Room, mutant: Mutant | None) -> int:
    import pytest

    if mutant is not None:
        for name in [n for n in sys.modules if n.partition(".")[0] == "tests"]:
            del sys.modules[name]  # what tests keep between calls was made without the fault
        put_in_place(mutant)
    flags = ["-x", "-q", "--no-header", "-p", "no:cacheprovider", "-p", "no:xdist", "--timeout=0", "-W", "ignore"]
    return int(pytest.main([*flags, *room.tests]))


def of_room(room: Room) -> list[Mutant]:
    """All mutants of a room."""
    return [m for module, functions in room.functions.items() for m in mutants(module, source_of(module).read_text(), functions)]


def _without_a_fault(room: Room) -> None:
    with Path(os.devnull).open("w") as nowhere, redirect_stdout(nowhere), redirect_stderr(nowhere):
        _child(room, None)


def mutate(name: str, most: int, seconds: float) -> tuple[int, int]:
    """Try the mutants of a room (a repeatable sample of at most `most`, ended after `seconds`); prints survivors and the share found."""
    room = ROOMS[name]
    every = of_room(room)
    order = random.Random(hashlib.sha256(name.encode()).digest())
    chosen = order.sample(every, min(most or len(every), len(every)))
    _without_a_fault(room)  # whatever is loaded and compiled is there for every fork
    start = time.monotonic()
    if run_tests(room, None, 600.0) != SURVIVED:
        message = f"{name}: the tests fail without any fault: {' '.join(room.tests)}"
        raise SystemExit(message)
    limit_s = PATIENCE * (time.monotonic() - start) + 10.0
    tried, survived = 0, 0
    for m in chosen:
        if seconds and time.monotonic() - start > seconds:
            break
        tried += 1
        if run_tests(room, m, limit_s) == SURVIVED:
            survived += 1
            print(f"  survives: {m.module}:{m.line} {m.function}: {' '.join(m.what.split())[:110]}", flush=True)
    killed = tried - survived
    sample = "" if tried == len(every) else f" (sample of {len(every)})"
    bar = "" if 100 * killed >= room.bar * tried else f"  BELOW the bar of {room.bar:.0f} %"
    print(f"{name}: {killed} of {tried}{sample} mutants found, {100 * killed / max(tried, 1):.1f} %{bar}", flush=True)
    return killed, tried


def main() -> int:
    """Try one room, or all; exit code 1 below a bar."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.mutate", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--room", choices=[*ROOMS, "all"], default="all")
    parser.add_argument("--most", type=int, default=0, help="a sample of at most so many mutants a room (default: all)")
    parser.add_argument("--seconds", type=float, default=0.0, help="end a room after so long (default: never)")
    args = parser.parse_args()
    sys.path[:0] = [str(REPOSITORY), str(REPOSITORY / "src"), str(REPOSITORY / "scripts")]
    os.chdir(REPOSITORY)
    below = [name for name in (ROOMS if args.room == "all" else [args.room]) if _below(name, args.most, args.seconds)]
    return int(bool(below))


def _below(name: str, most: int, seconds: float) -> bool:
    killed, tried = mutate(name, most, seconds)
    return 100 * killed < ROOMS[name].bar * tried


if __name__ == "__main__":
    sys.exit(main())
