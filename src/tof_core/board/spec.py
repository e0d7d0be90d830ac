# SPDX-License-Identifier: Apache-2.0
"""A calibration board: pattern, sizes and corners."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tof_core.errors import UsageError

if TYPE_CHECKING:
    from tof_core.arrays import Float

CHECKER, CHARUCO, APRILTAG = "checker", "charuco", "apriltag"
FORMS = "5x7x0.030 (inner corners x inner corners x square in metres), charuco:6x8x0.030x0.022 or apriltag:4x6x0.040x0.010"
"""What `--board` takes: a ChArUco board by its squares, square and marker side; an AprilTag grid by its tags, tag side and gap."""

USUAL_VIEWS = 10
"""Views before a board with which errors over range, which show between views alone, differ from the spread of the views."""


@dataclass(frozen=True, slots=True)
class Board:
    """A flat board.

    columns, rows: inner corners of a checkerboard, squares of a ChArUco board, tags of an AprilTag grid; size_m: side of a square or tag;
    second_m: side of a ChArUco marker, or the gap between AprilTags.

    The board's frame: x along a row, y down a column, z away from the camera, so that the printed side faces -z. The origin is the
    first inner corner (checkerboard), else the board's corner.
    """

    kind: str
    columns: int
    rows: int
    size_m: float
    second_m: float = 0.0

    @classmethod
    def parse(cls, text: str) -> Board:
        """The board of a command line.

        Raises:
            UsageError: the text is no board.
        """
        kind, _, rest = text.rpartition(":")
        number = r"(\d*\.?\d+)"
        pattern = rf"(\d+)x(\d+)x{number}" + ("" if kind in ("", CHECKER) else f"x{number}")
        found = re.fullmatch(pattern, rest)
        if kind not in ("", CHECKER, CHARUCO, APRILTAG) or found is None:
            raise UsageError(f"'{text}' is no board", where="--board", todo=f"say {FORMS}")
        columns, rows, *sizes = found.groups()
        board = cls(kind or CHECKER, int(columns), int(rows), *map(float, sizes))
        if min(board.columns, board.rows) < 2 or not 1e-3 <= board.size_m <= 2.0 or (kind == CHARUCO and board.second_m >= board.size_m):
            raise UsageError(f"'{text}' is no board that can be seen", where="--board", todo=f"sizes are metres: {FORMS}")
        return board

    @property
    def corners(self) -> Float:
        """(rows * columns, 3) metres: inner corners of a checkerboard, row by row."""
        y, x = np.mgrid[: self.rows, : self.columns].reshape(2, -1) * self.size_m
        return np.stack([x, y, np.zeros_like(x)], axis=1)

    @property
    def squares(self) -> tuple[Float, Float]:
        """(n, 2) metres, lower corner of each square, and (n,) 1 where column plus row is odd; an AprilTag grid counts as one square."""
        if self.kind == APRILTAG:
            return np.array([[0.0, 0.0]]), np.zeros(1)
        extra, start = (1, -1) if self.kind == CHECKER else (0, 0)
        row, column = np.mgrid[: self.rows + extra, : self.columns + extra].reshape(2, -1)
        return np.stack([column + start, row + start], axis=1) * self.size_m, (row + column) % 2.0

    @property
    def extent(self) -> Float:
        """(2,) metres: side of one of `squares`."""
        if self.kind != APRILTAG:
            return np.full(2, self.size_m)
        return np.array([self.columns, self.rows]) * (self.size_m + self.second_m) - self.second_m
