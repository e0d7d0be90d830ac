# SPDX-License-Identifier: Apache-2.0
"""A STEP file (ISO 10303-21, AP214) of a box in millimetres, written entity by entity, since nothing here exports STEP."""

from __future__ import annotations

from itertools import count
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

CORNERS = [(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)]
SIDES = ((0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5))
"""Corners of each side, counter-clockwise from outside."""
HEADER = "ISO-10303-21;\nHEADER;\nFILE_DESCRIPTION((''),'2;1');\nFILE_NAME('','',(''),(''),'','','');\nFILE_SCHEMA(('AUTOMOTIVE_DESIGN'));\nENDSEC;\nDATA;\n"


class _Writer:
    """Numbers entities as they come."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self._number = count(1)

    def __call__(self, kind: str, *arguments: str) -> str:
        return self.raw(f"{kind}({','.join(arguments)})")

    def raw(self, text: str) -> str:
        name = f"#{next(self._number)}"
        self.lines.append(f"{name}={text};")
        return name


def _list(values: Iterable[object]) -> str:
    return "(" + ",".join(str(v) for v in values) + ")"


def box_step(size_mm: tuple[float, float, float]) -> str:
    """The text of the file; the box has a corner at the origin."""
    add = _Writer()
    at = [tuple(float(s * c) for s, c in zip(size_mm, corner, strict=True)) for corner in CORNERS]
    points = [add("CARTESIAN_POINT", "''", _list(p)) for p in at]
    vertices = [add("VERTEX_POINT", "''", p) for p in points]
    edges: dict[tuple[int, int], str] = {}
    faces = []
    for side in SIDES:
        around = zip(side, (*side[1:], side[0]), strict=True)
        loop = add("EDGE_LOOP", "''", _list(_edge(add, edges, at, points, vertices, a, b) for a, b in around))
        bound = add("FACE_OUTER_BOUND", "''", loop, ".T.")
        faces.append(add("ADVANCED_FACE", "''", _list([bound]), _plane(add, at, points, side), ".T."))
    _product(add, add("MANIFOLD_SOLID_BREP", "'box'", add("CLOSED_SHELL", "''", _list(faces))))
    return HEADER + "\n".join(add.lines) + "\nENDSEC;\nEND-ISO-10303-21;\n"


def _edge(
    add: _Writer, edges: dict[tuple[int, int], str], at: list[tuple[float, ...]], points: list[str], vertices: list[str], a: int, b: int
) -> str:
    if (b, a) in edges:
        return add("ORIENTED_EDGE", "''", "*", "*", edges[b, a], ".F.")
    along = [q - p for p, q in zip(at[a], at[b], strict=True)]
    line = add("LINE", "''", points[a], add("VECTOR", "''", add("DIRECTION", "''", _list(along)), "1."))
    edges[a, b] = add("EDGE_CURVE", "''", vertices[a], vertices[b], line, ".T.")
    return add("ORIENTED_EDGE", "''", "*", "*", edges[a, b], ".T.")


def _plane(add: _Writer, at: list[tuple[float, ...]], points: list[str], side: tuple[int, ...]) -> str:
    one, two = (tuple(q - p for p, q in zip(at[side[0]], at[side[k]], strict=True)) for k in (1, 3))
    normal = (one[1] * two[2] - one[2] * two[1], one[2] * two[0] - one[0] * two[2], one[0] * two[1] - one[1] * two[0])
    axes = [add("DIRECTION", "''", _list(d)) for d in (normal, one)]
    return add("PLANE", "''", add("AXIS2_PLACEMENT_3D", "''", points[side[0]], *axes))


def _product(add: _Writer, solid: str) -> None:
    """What ties a solid to a product, and the units (millimetre, radian)."""
    length = add.raw("(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.))")
    angle = add.raw("(NAMED_UNIT(*)PLANE_ANGLE_UNIT()SI_UNIT($,.RADIAN.))")
    solid_angle = add.raw("(NAMED_UNIT(*)SI_UNIT($,.STERADIAN.)SOLID_ANGLE_UNIT())")
    exact = add("UNCERTAINTY_MEASURE_WITH_UNIT", "LENGTH_MEASURE(1.E-07)", length, "''", "''")
    context = add.raw(
        f"(GEOMETRIC_REPRESENTATION_CONTEXT(3)GLOBAL_UNCERTAINTY_ASSIGNED_CONTEXT(({exact}))"
        f"GLOBAL_UNIT_ASSIGNED_CONTEXT(({length},{angle},{solid_angle}))REPRESENTATION_CONTEXT('',''))"
    )
    shape = add("ADVANCED_BREP_SHAPE_REPRESENTATION", "''", _list([solid]), context)
    application = add("APPLICATION_CONTEXT", "''")
    product = add("PRODUCT", "'box'", "'box'", "''", _list([add("PRODUCT_CONTEXT", "''", application, "'mechanical'")]))
    formation = add("PRODUCT_DEFINITION_FORMATION", "''", "''", product)
    definition = add("PRODUCT_DEFINITION", "''", "''", formation, add("PRODUCT_DEFINITION_CONTEXT", "''", application, "'design'"))
    add("SHAPE_DEFINITION_REPRESENTATION", add("PRODUCT_DEFINITION_SHAPE", "''", "''", definition), shape)
