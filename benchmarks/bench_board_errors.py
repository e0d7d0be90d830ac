# SPDX-License-Identifier: Apache-2.0
"""What the range error of a real camera before a board depends on: regressions on one half of its frames, judged on the other."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.bench_board import BOARD, DATA, HALVINGS
from benchmarks.figure import Figure

if TYPE_CHECKING:
    from collections.abc import Callable

    from tof_core.arrays import Float
    from tof_core.camera import Camera

LONG = True
FOCAL = 3e-3
"""Relative step of the focal length for differences."""
EVERY, OUTLIER_M, ROUNDS, RIDGE = 8, 0.006, 6, 1e-6
"""Every so-many-th pixel; metres beyond which an error counts linearly; rounds of reweighting; share of the diagonal that is added."""

Table = dict[str, "Float"]


def run() -> list[Figure]:
    """Plane error of the other half for growing sets of observables, mean of ten halves."""
    if not DATA.is_dir():
        return [
            Figure("range error of a Kinect v2 by observables", float("nan"), "", remark="skipped: no ../shared/data beside the checkout")
        ]
    frames = tables()
    apart = [1e3 * float(np.mean(np.abs(t["error"] - np.median(t["error"])) / t["length"])) for t in frames]
    what = "Kinect v2 before a board, regression on one half: plane error of the other half, MAE, "
    rows = [Figure(what + name, _judged(frames, columns), "mm") for name, columns in MODELS.items()]
    righted = [{**t, "error": t["error"] - t["table"]} for t in frames]
    rows += [Figure(f"{what}the table of ray lengths put right, {name}", _judged(righted, MODELS[name]), "mm") for name in RIGHTED]
    between, within = (slope(frames, within=within) for within in (False, True))
    return [
        *rows,
        Figure("Kinect v2 before a board: slope of the error over range, beside ln amplitude, its square and a tilt", between, "mm/m"),
        Figure("Kinect v2 before a board: the same slope within the frames, each with an offset of its own", within, "mm/m"),
        Figure("Kinect v2 before a board: plane error after the median of each frame is removed, MAE", float(np.mean(apart)), "mm"),
    ]


def _columns(*names: str) -> Callable[[Table], Float]:
    return lambda t: np.stack([t[n] for n in names], axis=1)


LIGHT, PLACE = ("one", "log", "log2"), ("across", "down")
WAVES_M = (1.0, 0.33)
"""Periods of range: the longest that a diagnosis tries, and the one that fits best beside it (c0 / 8f at 114 MHz; a Kinect v2 has 120 MHz)."""
FUNDAMENTAL_M, ALIAS_M = 1.249, 0.312
"""c0 / 2f and c0 / 8f at 120 MHz, the highest frequency of a Kinect v2: its own period, and the harmonic that four taps alias."""
PERIODS_M = (*WAVES_M, FUNDAMENTAL_M, ALIAS_M)
LONG_WAVE, SHORT_WAVE, FUNDAMENTAL, ALIAS = ((f"sine {m}", f"cosine {m}") for m in PERIODS_M)
BOW = ("bow xx", "bow xy", "bow yy")
MODELS: dict[str, Callable[[Table], Float]] = {
    "nothing": lambda t: np.zeros((len(t["error"]), 1)),
    "offset and range": _columns("one", "range"),
    "ln amplitude and its square": _columns(*LIGHT),
    "the same and range": _columns(*LIGHT, "range"),
    "ln amplitude, its square, and a wave of 1 m of range": _columns(*LIGHT, *LONG_WAVE),
    "ln amplitude, its square, and a tilt over the image": _columns(*LIGHT, *PLACE),
    "the same and range as well": _columns(*LIGHT, *PLACE, "range"),
    "the same and range squared as well": _columns(*LIGHT, *PLACE, "range", "range2"),
    "ln amplitude, its square, a tilt, and a wave of 1 m of range": _columns(*LIGHT, *PLACE, *LONG_WAVE),
    "the same and a wave of 0.33 m": _columns(*LIGHT, *PLACE, *LONG_WAVE, *SHORT_WAVE),
    "ln amplitude, its square, a tilt, and a wave of 1.249 m of range": _columns(*LIGHT, *PLACE, *FUNDAMENTAL),
    "the same and a wave of 0.312 m": _columns(*LIGHT, *PLACE, *FUNDAMENTAL, *ALIAS),
    "ln amplitude, its square, a tilt, and a bow of the board": _columns(*LIGHT, *PLACE, *BOW),
    "ln amplitude, its square, a tilt, and black squares": _columns(*LIGHT, *PLACE, "black"),
    "black squares and a tilt": _columns("one", *PLACE, "black"),
    "ln amplitude, its square, a tilt, and time": _columns(*LIGHT, *PLACE, "time"),
    "ln amplitude, its square, a tilt, and another focal length": _columns(*LIGHT, *PLACE, "focal"),
    "the same and waves of 1 m and 0.33 m": _columns(*LIGHT, *PLACE, "focal", *LONG_WAVE, *SHORT_WAVE),
    "a tilt and a wave of 1 m, no amplitude": _columns("one", *PLACE, *LONG_WAVE),
    "ln amplitude, its square, and a tilt by the inverse of range": _columns(*LIGHT, "across/range", "down/range"),
    "ln amplitude, its square, and light that spreads in the lens": _columns(*LIGHT, "range", "veil 4", "veil 30", "veil 100", "veil 400"),
}
RIGHTED = (
    "nothing",
    "offset and range",
    "ln amplitude and its square",
    "ln amplitude, its square, and a tilt over the image",
    "the same and range",
    "ln amplitude, its square, and a wave of 1 m of range",
)
"""Models that are judged again with the table of ray lengths put right (`z_conversion`), which has no coefficient to be fitted."""


def tables() -> list[Table]:
    """Per frame the error along the ray and the observables of its pixels, each (n,)."""
    from tof_core.board.spec import Board
    from tof_core.options import BagOptions
    from tof_scene.raycast import Raycaster
    from tof_scene.render import render
    from tof_sensor.effects.lens_scatter import blurred
    from tof_sensor.effects.z_conversion import ZConversion
    from tof_sensor.frame import LIGHT_M_PER_S
    from tof_sensor.known import ideal_frames
    from toftwin.boarded import board_session, read_captures

    captures, board = read_captures(DATA / "bag", BagOptions()), Board.parse(BOARD)
    session = board_session(captures, board)
    camera = replace(session.camera, fx=session.camera.fx * (1 + FOCAL), fy=session.camera.fy * (1 + FOCAL))
    longer = board_session([replace(c, camera=camera) for c in captures], board)
    caster = Raycaster(session.scene)
    renderings = [render(caster, v.camera, v.robot.T_cell_camera) for v in session.views if v.robot is not None]
    out = []
    for k, (view, frame) in enumerate(zip(session.views, ideal_frames(session.views, renderings, caster), strict=True)):
        seen = np.flatnonzero(np.isfinite(view.depth) & frame.valid)[::EVERY]
        h, w = view.depth.shape
        row, column = np.divmod(seen, w)
        r, A = frame.radial.ravel()[seen], np.maximum(frame.amplitude.ravel()[seen], 1.0)
        table: Table = {"error": ((view.depth - frame.depth) * frame.length).ravel()[seen], "length": frame.length.ravel()[seen]}
        table |= {"one": np.ones(len(seen)), "range": r, "range2": r**2, "log": np.log(A / 5e3), "log2": np.log(A / 5e3) ** 2}
        for period in PERIODS_M:
            table |= {f"sine {period}": np.sin(2 * np.pi * r / period), f"cosine {period}": np.cos(2 * np.pi * r / period)}
        table |= {"table": (ZConversion(table="rows").bias(frame) * frame.length).ravel()[seen]}
        table |= {"across": 2 * column / w - 1, "down": 2 * row / h - 1}
        moved = plane_depth(longer.poses[k].T_board_camera, camera) - plane_depth(session.poses[k].T_board_camera, session.camera)
        table |= {"focal": (moved / FOCAL * frame.length).ravel()[seen]}
        on_board = (
            frame.points.reshape(-1, 3)[seen] @ session.poses[k].T_board_camera[:2, :3].T + session.poses[k].T_board_camera[:2, 3]
        ) / 0.1
        steep = 1.0 / np.cos(frame.rendering.incidence.ravel()[seen].astype(np.float64))
        x, y = on_board.T
        table |= {"bow xx": x * x * steep, "bow xy": x * y * steep, "bow yy": y * y * steep}
        table |= {
            "black": frame.rendering.part.ravel()[seen].astype(np.float64),
            "time": np.full(len(seen), 1e-10 * (view.stamp_ns - session.views[0].stamp_ns)),
        }
        table |= {"across/range": table["across"] / r, "down/range": table["down"] / r}
        wave = 4e6 * np.pi * 80.0 / LIGHT_M_PER_S
        measured = np.nan_to_num(np.where(np.isfinite(view.depth), view.depth, np.nanmedian(view.depth)) * frame.length)
        light = np.nan_to_num(frame.amplitude) * np.stack([np.cos(wave * measured), np.sin(wave * measured)])
        for width in (4, 30, 100, 400):
            re, im = blurred(light, float(width)).reshape(2, -1)[:, seen]
            table[f"veil {width}"] = (im * np.cos(wave * r) - re * np.sin(wave * r)) / A / wave
        out.append(table)
    return out


def plane_depth(T_board_camera: Float, camera: Camera) -> Float:
    """(H, W) depth of the board's plane."""
    normal = T_board_camera[2, :3]
    return np.asarray(-T_board_camera[2, 3] / (camera.rays() @ normal))


def slope(tables: list[Table], *, within: bool) -> float:
    """Millimetres per metre of range over all frames, beside light and tilt; `within`: each frame has an offset of its own."""
    columns = _columns(*LIGHT[1:], *PLACE, "range")
    offsets = np.eye(len(tables)) if within else np.ones((len(tables), 1))
    X = np.concatenate(
        [np.concatenate([columns(t), np.tile(row, (len(t["range"]), 1))], axis=1) for t, row in zip(tables, offsets, strict=True)]
    )
    return 1e3 * float(robust(X, np.concatenate([t["error"] for t in tables]))[4])


def _judged(tables: list[Table], columns: Callable[[Table], Float]) -> float:
    """Mean in mm, over ten halves, of the mean over frames of the mean absolute error along z."""
    rng, errors = np.random.default_rng(0), []
    for _ in range(HALVINGS):
        order = rng.permutation(len(tables))
        one, other = order[: len(order) // 2], order[len(order) // 2 :]
        for fit, judge in ((one, other), (other, one)):
            beta = robust(np.concatenate([columns(tables[i]) for i in fit]), np.concatenate([tables[i]["error"] for i in fit]))
            errors += [np.mean([np.mean(np.abs(t["error"] - columns(t) @ beta) / t["length"]) for t in (tables[i] for i in judge)])]
    return 1e3 * float(np.mean(errors))


def robust(X: Float, y: Float) -> Float:
    """Least squares in which errors beyond `OUTLIER_M` count linearly."""
    scale = np.sqrt((X**2).mean(axis=0)) + 1e-12
    X, weight = X / scale, np.ones(len(y))
    beta: Float = np.zeros(X.shape[1])
    for _ in range(ROUNDS):
        gram = (X * weight[:, None]).T @ X + RIDGE * len(y) * np.eye(X.shape[1])
        beta = np.asarray(np.linalg.solve(gram, (X * weight[:, None]).T @ y), np.float64)
        weight = np.asarray(1.0 / np.maximum(1.0, np.abs(y - X @ beta) / OUTLIER_M))
    return np.asarray(beta / scale)
