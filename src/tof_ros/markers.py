# SPDX-License-Identifier: Apache-2.0
"""The CAD as RViz and Foxglove draw it: one marker a part, coloured by its state."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from geometry_msgs.msg import Point, PoseStamped
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from tof_ros import messages

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from tof_core.arrays import Float, Ints

MOST_TRIANGLES = 20_000
"""Of one part: what RViz draws fluently, and 1.5 MB of message; finer meshes are drawn coarser."""
GREY, GREEN, ORANGE, RED = (0.6, 0.6, 0.62), (0.25, 0.7, 0.35), (0.95, 0.6, 0.15), (0.85, 0.2, 0.2)
BLUE = (0.3, 0.5, 0.9)
SOLID, THIN = 0.95, 0.45
"""Opacity: of a part on which something was found, and of the others."""

Colour = tuple[float, float, float]


SHADES = 8
"""Steps between green and red: a colour that differs less is not worth a message of all triangles."""


def shade(share: float) -> Colour:
    """Green at 0 over orange at a half to red at 1 and beyond, in `SHADES` steps."""
    at = _step(share) / SHADES
    low, high, part = (GREEN, ORANGE, 2 * at) if at < 0.5 else (ORANGE, RED, 2 * at - 1)
    r, g, b = ((1 - part) * x + part * y for x, y in zip(low, high, strict=True))
    return r, g, b


def same_shade(before: float | None, now: float, red: float) -> bool:
    """Whether two values are drawn in the same colour; `red`: the value that is drawn red."""
    return before is not None and _step(before / red) == _step(now / red)


def _step(share: float) -> int:
    return round(SHADES * min(max(share, 0.0), 1.0))


def part_markers(
    parts: Sequence[tuple[str, Float, Ints]],
    frame: str,
    colours: Mapping[str, Colour],
    *,
    T_frame_cell: Float | None = None,
    space: str = "scene",
    stamp_ns: int = 0,
) -> MarkerArray:
    """One triangle list a part.

    Args:
        parts: name, vertices (N, 3) in metres of the cell, faces (M, 3).
        frame: TF frame of the cell, or another one in which its pose is `T_frame_cell`.
        colours: of the parts on which something is known; the others are grey.
        T_frame_cell: (4, 4) pose of the cell in `frame`; None: that is its own frame.
        space: the markers' namespace; markers of one namespace and number replace each other.
        stamp_ns: 0 draws them wherever the frame is now.
    """
    pose = messages.pose_stamped(np.eye(4) if T_frame_cell is None else T_frame_cell, messages.header(stamp_ns, frame))
    markers = MarkerArray(markers=[_marker(n, part, pose, space) for n, part in enumerate(parts)])
    colour(markers, colours)
    return markers


def colour(markers: MarkerArray, colours: Mapping[str, Colour]) -> None:
    """Colour markers of `part_markers` anew, which takes a thousandth of making them."""
    for marker in markers.markers:
        r, g, b = colours.get(marker.text, GREY)
        marker.color = ColorRGBA(r=r, g=g, b=b, a=SOLID if marker.text in colours else THIN)


def _marker(number: int, part: tuple[str, Float, Ints], pose: PoseStamped, space: str) -> Marker:
    name, vertices, faces = part
    out = Marker(header=pose.header, pose=pose.pose, ns=space, id=number, type=Marker.TRIANGLE_LIST, action=Marker.ADD, text=name)
    out.scale.x = out.scale.y = out.scale.z = 1.0
    corners, index = coarse(vertices, faces)
    points = [Point(x=x, y=y, z=z) for x, y, z in corners.tolist()]  # one message a vertex, which its triangles share
    out.points = [points[i] for i in index.ravel().tolist()]
    return out


def coarse(vertices: Float, faces: Ints, most: int = MOST_TRIANGLES) -> tuple[Float, Ints]:
    """Vertices (N, 3) and faces (T, 3) of at most `most` triangles: vertices are merged on a grid that grows until few enough are left (Rossignac, Borrel 1993)."""
    if len(faces) <= most:
        return np.asarray(vertices, np.float64), faces
    low, size = vertices.min(axis=0), float(np.ptp(vertices, axis=0).max())
    cells = 1024
    while True:
        merged, at = _distinct(np.floor((vertices - low) * (cells / size)).astype(np.int64))
        corners = at[faces]
        a, b, c = corners.T
        corners = corners[(a != b) & (b != c) & (c != a)]
        kept = corners[_distinct(np.sort(corners, axis=1))[0]]
        if len(kept) <= most:
            return np.asarray(vertices[merged], np.float64), kept
        cells //= 2


def _distinct(rows: Ints) -> tuple[Ints, Ints]:
    """The first of each of the distinct rows (N, 3) of numbers from 0 on, in ascending order, and for each row which of them it is.

    As `numpy.unique` along an axis, which compares the rows as structures and takes ten times as long.
    """
    _, number = np.unique(_pairs(rows[:, 0], rows[:, 1]), return_inverse=True)
    _, first, which = np.unique(_pairs(number, rows[:, 2]), return_index=True, return_inverse=True)
    return first, which


def _pairs(one: Ints, other: Ints) -> Ints:
    """One number for each pair (N), in the order of the pairs."""
    return np.asarray(one * (other.max(initial=0) + 1) + other)
