# SPDX-License-Identifier: Apache-2.0
"""Back to the first picture: closed loops of the virtual robot, from near and far, and figure 11 in 3D and in 2D."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from arm_correction.match import make_matcher
from arm_correction.register import register
from benchmarks.closed_loop import LoopConfig
from benchmarks.figure import Figure, at_least, at_most
from benchmarks.picture import by_ecc, by_features, difference, structural_difference, warped
from benchmarks.stand import Stand, returns
from tof_scene.builtin import builtin_names, make_builtin

if TYPE_CHECKING:
    from benchmarks.stand import Ended
    from tof_core.arrays import Bytes, Float, Mask

NEAR, FAR = (50.0, 3.0), (300.0, 15.0)
SEED = 31
"""Of scenes' views, robots and starts; `bench_correct_long` has another one. Nothing was tuned on either."""


def run() -> list[Figure]:
    """Every figure of this room; more starts are in `bench_correct_long`."""
    near = returns(*NEAR, 12, seed=SEED, stands=6)
    far = returns(*FAR, 12, seed=SEED, stands=6)
    return [*near_figures(near), *far_figures(far), biased(6, 2), *figure_11(1), *speed()]


def _share(ended: list[Ended], mm: float, deg: float) -> float:
    return 100.0 * float(np.mean([e.within(mm, deg) for e in ended]))


def why(ended: list[Ended]) -> str:
    """What a reader wants to know besides the share."""
    done = [e for e in ended if e.done]
    worst = max(done, key=lambda e: e.mm, default=None)
    parts = [f"{len(ended)} starts", f"median {np.median([e.mm for e in ended]):.2f} mm, {np.mean([e.moves for e in ended]):.1f} moves"]
    if worst:
        parts.append(f"worst accepted {worst.mm:.2f} mm {worst.deg:.3f} deg")
    parts.append(f"{sum(e.by_cad for e in ended)} brought near by CAD")
    left = [e for e in ended if not e.done or e.partial]
    reasons = sorted({"partial" if e.done else e.reason.split(":")[0] for e in left})
    return "; ".join([*parts, f"not done or partial {len(left)}" + (f" ({', '.join(reasons)})" if left else "")])


def near_figures(ended: list[Ended]) -> list[Figure]:
    """From 50 mm and 3 degrees."""
    return [
        at_least("return from 50 mm / 3 deg: within 1 mm and 0.1 deg in at most 3 moves", _share(ended, 1.0, 0.1), 95, "%", remark=why(ended)),
        at_least("the same: within 2 mm and 0.2 deg", _share(ended, 2.0, 0.2), 100, "%"),
        at_most("the same: wrong ones accepted", float(sum(e.wrong for e in ended)), 0, ""),
    ]  # fmt: skip


def far_figures(ended: list[Ended], what: str = "") -> list[Figure]:
    """From 300 mm and 15 degrees."""
    name = f"return from 300 mm / 15 deg{what}"
    return [
        at_least(f"{name}: within 1 mm and 0.1 deg", _share(ended, 1.0, 0.1), 98, "%", remark=why(ended)),
        at_most(f"{name}: wrong ones accepted", float(sum(e.wrong for e in ended)), 0, ""),
    ]


def biased(count: int, stands: int, seed: int = SEED) -> Figure:
    """A camera that nobody modelled."""
    ended = returns(*NEAR, count, seed=seed, stands=stands, effects={"wiggling": 1.0, "multipath": 1.0})
    worst = max((e.mm for e in ended if e.done), default=float("nan"))
    return at_most("return to a reference with wiggling and multipath on: worst", worst, 1.5, "mm", remark=why(ended))


def figure_11(views: int, seed: int = SEED) -> list[Figure]:
    """How far the picture is from the first one: untouched, after 2D, after 3D; and another shot from the first pose itself.

    By structure (what is left of a picture without the light that varies slowly) and plain. In another light the shadows themselves
    differ, which no pose of the camera removes: the last column states this difference, and the excess is the part above it.
    """
    cases = [(name, view) for name in builtin_names() for view in range(views)]
    out: list[Figure] = []
    for light, another in (("same light", False), ("another light", True)):
        rows = [_pictures(name, view, seed, another_light=another) for name, view in cases]
        for k, (what, unit) in enumerate((("structure", "% of brightness"), ("plain", "grey values of 255"))):
            none, flat, solid, again = (float(np.mean([r[k][i] for r in rows])) for i in range(4))
            table = f"{unit}: none {none:.2f}, 2D {flat:.2f}, 3D {solid:.2f}, another shot from the first pose {again:.2f}; {len(rows)} scenes and views"
            name = f"figure 11, {light}: {what} difference, 3D over 2D"
            out.append(
                at_most(name, solid / flat, 1 / 3, "", remark=table)
                if what == "structure"
                else Figure(name, solid / flat, "", remark=table)
            )
            out.append(Figure(f"{name}, excess over another shot from the first pose", (solid - again) / (flat - again), ""))
    return out


def _pictures(scene: str, view: int, seed: int, *, another_light: bool) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """By structure and plain, each: none, 2D, 3D, another shot; all over the pixels that the 2D way could fill."""
    stand = Stand(make_builtin(scene), view, seed=seed)
    photo = stand.photograph()
    if another_light:
        stand.robot.drive(stand.robot.T_cell_body)
    again = stand.photograph()
    stand.displace(np.random.default_rng([7, view]), *NEAR)
    now = stand.photograph()
    flat, where = _by_2d(photo, now)
    stand.loop()
    shots = (now, flat, stand.photograph(), again)
    return tuple(structural_difference(photo, s, where) for s in shots), tuple(difference(photo, s, where) for s in shots)


def _by_2d(photo: Bytes, now: Bytes) -> tuple[Bytes, Mask]:
    """The picture of now brought over the first one by features and ECC, and where it has pixels well inside."""
    from scipy import ndimage

    H: Float | None = by_features(photo, now)
    by = by_ecc(photo, now, H)
    H = by if by is not None else H
    flat, where = warped(now, np.eye(3) if H is None else H)
    return flat, np.asarray(ndimage.binary_erosion(where, iterations=16, border_value=0))


def speed() -> list[Figure]:
    """One correction at 400 x 300."""
    stand = Stand(make_builtin("body_section"), 0, seed=SEED, width=400, height=300)
    surface, seconds = stand.first.surface, {}
    for name, size in (("near", NEAR), ("far", FAR)):
        rng, taken = np.random.default_rng(3), []
        trust = stand.config.trust
        config = stand.config if name == "near" else replace(stand.config, trust=replace(trust, min_support=1.0))
        for _ in range(5):
            stand.displace(rng, *size)
            view = stand.look(LoopConfig().captures)
            started = time.process_time()
            register(make_matcher(surface, view, config), np.eye(4))
            taken.append(time.process_time() - started)
        seconds[name] = float(np.median(taken))
    return [
        at_most("one correction, 400x300, near, processor time", 1e3 * seconds["near"], 100, "ms"),
        at_most("one correction, 400x300, from far (the whole search), processor time", 1e3 * seconds["far"], 1000, "ms"),
    ]
