# SPDX-License-Identifier: Apache-2.0
"""Small faults for `benchmarks.mutate`: one operator, constant, condition or call of a function is changed at a time."""

from __future__ import annotations

import ast
import copy
import inspect
import sys
from dataclasses import dataclass
from pathlib import Path
from types import CodeType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

REPOSITORY = Path(__file__).resolve().parent.parent

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
    """One fault: `changed` in the place of `node` of a module's tree; where and what, for a reader; lines of the statement that it changes."""

    module: str
    line: int
    function: str
    what: str
    lines: range
    tree: ast.Module
    node: ast.AST
    changed: ast.AST


def mutants(module: str, source: str, functions: Sequence[str]) -> Iterator[Mutant]:
    """All faults of the named functions (all where none is); strings, docstrings and annotations are left alone."""
    tree = ast.parse(source)
    for name, function in _functions(tree, functions):
        for node, lines in _body_nodes(function):
            for what, changed in dict(_changes(node)).items():
                yield Mutant(module, node.lineno, name, what, lines, tree, node, changed)


def _functions(tree: ast.Module, names: Sequence[str]) -> list[tuple[str, ast.FunctionDef]]:
    """Functions and methods with their qualified names; compiled kernels (numba) are left out."""
    places: list[tuple[str, ast.stmt]] = [("", node) for node in tree.body]
    places += [(f"{node.name}.", inner) for node in tree.body if isinstance(node, ast.ClassDef) for inner in node.body]
    found = [
        (prefix + node.name, node) for prefix, node in places if isinstance(node, ast.FunctionDef) and (not names or node.name in names)
    ]
    if lacking := set(names) - {function.name for _, function in found}:
        message = f"no functions {lacking}"
        raise SystemExit(message)
    return [(name, f) for name, f in found if not any("njit" in ast.unparse(d) for d in f.decorator_list)]


def _body_nodes(function: ast.FunctionDef) -> Iterator[tuple[ast.expr | ast.stmt, range]]:
    """Expressions and statements that decide, inner functions' too, with the lines of their statement; what is raised, and texts, are not."""
    waiting: list[tuple[ast.AST, range]] = [(node, _lines(node)) for node in function.body]
    while waiting:
        node, lines = waiting.pop(0)
        if isinstance(node, ast.Raise | ast.JoinedStr | ast.Assert | ast.arguments) or _decides_nothing(node):
            continue
        if isinstance(node, ast.stmt):
            lines = _lines(node)
        if isinstance(node, ast.expr | ast.stmt):
            yield node, lines
        annotations = {getattr(node, "annotation", None), getattr(node, "returns", None)}
        waiting = [(child, lines) for child in ast.iter_child_nodes(node) if child not in annotations] + waiting


def _lines(statement: ast.stmt) -> range:
    """The lines of a statement, of one that contains others those of its head."""
    body = getattr(statement, "body", None)
    end = statement.end_lineno or statement.lineno
    return range(statement.lineno, max(body[0].lineno - 1, statement.lineno) + 1 if body else end + 1)


def _decides_nothing(node: ast.AST) -> bool:
    """`np.eye(n)`: another n either fails at once or, where a part of it is read, is the same. `strict` of `zip` asserts equal lengths."""
    strict = isinstance(node, ast.keyword) and node.arg == "strict"
    return strict or (isinstance(node, ast.Call) and ast.unparse(node.func) == "np.eye")


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
    changed = compile(_with(mutant.tree, mutant.node, mutant.changed), str(source_of(mutant.module)), "exec")
    code = next(c for c in _codes(changed) if c.co_qualname == mutant.function)
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
