# SPDX-License-Identifier: Apache-2.0
"""Known errors grafted onto real frames before a board: each must be named, and nothing else that the frames as they are do not show."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from tof_core.arrays import Float
    from tof_core.board.spec import Board
    from tof_core.capture import Capture

WIGGLE_COUNTS = np.array([15, 4, -10, -20, -21, 14, 9, 16, 15], float)
"""Range error at eight equal steps of the table, and again at its end, in counts: the look-up table of a TI evaluation kit (CalculusCDK, 36 MHz)."""
TURN_COUNTS, TABLE_COUNTS, TURN_M = 4096, 1024, 299_792_458.0 / (2 * 36e6)
"""Counts of a whole turn of the phase (12 bits) and of the table, which repeats four times a turn, as four taps alias; metres of a turn."""
WARM_UP_M, WARM_UP_K = 0.010, 12.0
LATE_NS = 30_000_000
CODE_M = 1e-3
"""Metres between depth codes of the camera: its errors come before it writes a code, so grafts are rounded to codes again."""


def wiggled(capture: Capture, _: float) -> Capture:
    """Range errors of the look-up table."""
    length = capture.camera.ray_length()
    r = capture.depth * length
    count_m = TURN_M / TURN_COUNTS
    at = np.mod(r / count_m, TABLE_COUNTS) / TABLE_COUNTS * (len(WIGGLE_COUNTS) - 1)
    error = np.interp(at, np.arange(len(WIGGLE_COUNTS)), WIGGLE_COUNTS) * count_m
    return replace(capture, depth=((r + error) / length).astype(np.float32))


def radial(capture: Capture, _: float) -> Capture:
    """Distance along the ray in the place of depth."""
    return replace(capture, depth=(capture.depth * capture.camera.ray_length()).astype(np.float32))


def without_lens(capture: Capture, _: float) -> Capture:
    """A CameraInfo without distortion."""
    return replace(capture, camera=replace(capture.camera, distortion=()))


def warmed(capture: Capture, share: float) -> Capture:
    """A drift of 10 mm over the frames, with a thermometer."""
    length: Float = capture.camera.ray_length()
    return replace(capture, depth=(capture.depth + share * WARM_UP_M / length).astype(np.float32), temperature=30.0 + share * WARM_UP_K)


def late(capture: Capture, _: float) -> Capture:
    """Stamps that are 30 ms late: nothing moves, so nothing may be named."""
    return replace(capture, stamp_ns=capture.stamp_ns + LATE_NS)


GRAFTS: dict[str, tuple[Callable[[Capture, float], Capture], str]] = {
    "distance along the ray given as depth": (radial, "radial_depth"),
    "lens coefficients withheld": (without_lens, "intrinsics"),
    "range errors of a published look-up table": (wiggled, "wiggling"),
    "warm-up of 10 mm": (warmed, "temperature_drift"),
    "stamps 30 ms late": (late, ""),
}
NEVER = {"temperature_drift", "motion", "time_sync"}
"""Effects that the frames as they are cannot show."""


def grafted(captures: Sequence[Capture], graft: Callable[[Capture, float], Capture]) -> list[Capture]:
    """The captures with an error, in the camera's depth codes; its size may grow from the first (0) to the last (1)."""
    wrong = [graft(c, k / max(len(captures) - 1, 1)) for k, c in enumerate(captures)]
    return [replace(c, depth=(CODE_M * np.rint(c.depth / CODE_M)).astype(np.float32)) for c in wrong]


def names(captures: Sequence[Capture], board: Board) -> set[str]:
    """Effects that the diagnosis names, ties apart."""
    from tof_scene.raycast import Raycaster
    from toftwin.boarded import board_session
    from toftwin.diagnosis import GapPipelineConfig, diagnose_before_board

    session = board_session(captures, board)
    found = diagnose_before_board(session, session.views, Raycaster(session.scene), GapPipelineConfig())
    return {name for verdict in found.verdict for name in verdict.split("|")} - {"none"}


def judged(captures: Sequence[Capture], board: Board) -> tuple[int, int, str]:
    """How many grafts are answered rightly, of how many, and the answers."""
    plain = names(captures, board)
    print(f"as they are: {', '.join(sorted(plain))}", flush=True)
    right, answers = int(not plain & NEVER), [f"as they are {'+'.join(sorted(plain))}"]
    for what, (graft, effect) in GRAFTS.items():
        new = names(grafted(captures, graft), board) - plain
        right += new == ({effect} if effect else set())
        answers.append(f"{what}: {'+'.join(sorted(new)) or 'nothing new'}")
        print(answers[-1], flush=True)
    return right, len(GRAFTS) + 1, "; ".join(answers)
