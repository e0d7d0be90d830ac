# SPDX-License-Identifier: Apache-2.0
"""Find for each effect the physical size that causes the error stated by its strength."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_virtual.effect import UNIT_M, rms
from tof_virtual.pipeline import expose

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from tof_core.arrays import Float
    from tof_virtual.effect import Effect, Moment
    from tof_virtual.session import Session

ROUNDS = 5
CLOSE = 0.02
"""Relative error of the RMS at which the search stops."""
MOST_CAPTURES = 12
NOTHING_M = 1e-7
"""A smaller change of a pixel's depth counts as none."""


def calibrate(session: Session) -> None:
    """Set the size of every effect whose strength is stated as an error: alone, on captures spread over the session."""
    indices = np.unique(np.linspace(0, len(session.shutters) - 1, min(MOST_CAPTURES, len(session.shutters))).astype(int)).tolist()
    bare: list[tuple[Moment, Float]] = []
    for effect in session.effects:
        if effect.natural:
            continue
        if effect.geometric or effect.tap_interval_s():
            _solve(effect, _geometric(session, effect, indices))
        else:
            bare = bare or _bare(session, indices)
            _solve(effect, _measured(bare, effect))
    if any(e.geometric for e in session.effects):
        session.forget()


def resize(session: Session, sizes: Mapping[str, float]) -> None:
    """Give the effects the sizes, by name, that they have in another session of the same camera (`Truth.meta`)."""
    for effect in session.effects:
        effect.size = sizes[effect.name]
        effect.prepare(session)
    if any(e.geometric for e in session.effects):
        session.forget()


def _solve(effect: Effect, error: Callable[[], Float]) -> None:
    """Secant steps on the size; the error is nearly proportional to it."""
    wanted = UNIT_M * effect.strength
    tried: list[tuple[float, float]] = [(0.0, 0.0)]
    for _ in range(ROUNDS):
        made = rms(error(), local=effect.local)
        effect.rms_m = made
        if made <= 0 or abs(made / wanted - 1) < CLOSE:
            return
        (size0, made0), size1 = tried[-1], effect.size
        slope = (made - made0) / (size1 - size0) if size1 != size0 else 0.0
        step = size1 + (wanted - made) / slope if slope > 0 else size1 * wanted / made
        tried.append((size1, made))
        effect.size = float(np.clip(step, 0.2 * size1, min(5 * size1, effect.limit * max(1.0, effect.strength))))
        if effect.size == size1:
            return


def _bare(session: Session, indices: Sequence[int]) -> list[tuple[Moment, Float]]:
    """Captures without effects, and the noise-free depth (P,) of each."""
    moments = [session.moment(i, ()) for i in indices]
    return [(m, expose(m, ()).depth) for m in moments]


def _measured(bare: Sequence[tuple[Moment, Float]], effect: Effect) -> Callable[[], Float]:
    """Error of a noise-free camera with this effect alone."""

    def error() -> Float:
        for m, _ in bare:
            m.lights.clear()
        return np.concatenate([expose(m, (effect,)).depth - depth for m, depth in bare])

    return error


def _geometric(session: Session, effect: Effect, indices: Sequence[int]) -> Callable[[], Float]:
    """The same for effects that change the geometry, away from edges and from pixels that crossed an edge."""
    few = indices[:: max(len(indices) // (3 if effect.tap_interval_s() else 6), 1)]

    def error() -> Float:
        session.forget()
        change = np.concatenate([_inside(session, i, (effect,)) - _inside(session, i, ()) for i in few])
        size = np.abs(change)
        usual = np.median(size[size > NOTHING_M]) if (size > NOTHING_M).any() else np.inf
        return np.where(size > 8 * usual, np.nan, change)

    return error


def _inside(session: Session, index: int, effects: Sequence[Effect]) -> Float:
    """True depth (P,), or the depth measured by moving taps; NaN at edges."""
    shutter = session.shutters[index]
    sight = session.sight(shutter, effects, subsamples=1)
    moves = any(e.tap_interval_s() for e in effects)
    depth = expose(session.moment(index, effects, subsamples=1), effects).depth if moves else sight.z.copy()
    depth[sight.edge] = np.nan
    return depth
