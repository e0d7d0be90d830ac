# SPDX-License-Identifier: Apache-2.0
"""The size at which a cause makes the error that its strength asks for: re-rendered with and without it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from benchmarks.emerging.causes import CAUSES, applied
from tof_virtual.effect import UNIT_M, rms

if TYPE_CHECKING:
    from collections.abc import Mapping

    from benchmarks.emerging.causes import Cause
    from benchmarks.emerging.device import Device
    from benchmarks.emerging.session import EmergingSession
    from tof_core.arrays import Float

GOALS = {"bias": UNIT_M, "noise": UNIT_M, "loss": 0.1, "wrap": 0.1}
"""What a strength of 1 is, of each metric: metres RMS over affected pixels, or a share of pixels (`wrap`: wrapped or lost)."""
ROUNDS = 5
CLOSE = 0.05
"""Relative error at which the search stops."""
CAPTURES = 5
"""Captures on which the error is measured, spread over the session."""
PRESENT = 0.5
"""Least share of the asked error that a cause must reach; a session in which physics allows less does not show the cause."""
OUTLIER_M = 0.1
"""A change of more is another surface or another turn, and no part of a bias's RMS."""
WRAPPED_M = 0.15
"""A change of at least this is a wrong turn."""


def calibrate(session: EmergingSession, strengths: Mapping[str, float]) -> dict[str, float]:
    """Give the session's causes the sizes of their strengths; each alone on the healthy device.

    Returns the error that each reached, in its metric's unit: less than asked for where physics allows no more up to `Cause.limit`
    (NaN where the metric is the size itself).
    """
    reached = {}
    session.sizes = {}
    sizes = {}
    for name, strength in strengths.items():
        cause = CAUSES[name]
        if cause.metric == "size":
            sizes[name], reached[name] = cause.start * strength, float("nan")
            continue
        sizes[name], reached[name] = _solved(session, name, strength)
    session.sizes = sizes
    return reached


def absent(strengths: Mapping[str, float], reached: Mapping[str, float]) -> tuple[str, ...]:
    """Causes that reached less than PRESENT of what their strengths ask for; those whose size is the metric reach it always."""
    return tuple(c for c, strength in strengths.items() if reached[c] < PRESENT * GOALS.get(CAUSES[c].metric, 0.0) * strength)


def _solved(session: EmergingSession, name: str, strength: float) -> tuple[float, float]:
    """Secant steps in the logarithm of the size."""
    cause = CAUSES[name]
    goal = GOALS[cause.metric] * strength
    plain = _frames(session, cause, session.healthy)
    size, tried = min(cause.start * strength, cause.limit), [(0.0, 0.0)]
    made = 0.0
    for _ in range(ROUNDS):
        made = error(session, name, size, plain)
        if abs(made / goal - 1) < CLOSE or (size >= cause.limit and made < goal):
            break
        before = tried[-1]
        tried.append((size, made))
        if made <= 0:
            size = min(3 * size, cause.limit)
            continue
        power = np.log(made / before[1]) / np.log(size / before[0]) if before[1] > 0 and size != before[0] else 1.0
        size = float(np.clip(size * (goal / made) ** (1 / np.clip(power, 0.4, 4.0)), size / 5, min(5 * size, cause.limit)))
    return size, made


def error(session: EmergingSession, name: str, size: float, plain: list[tuple[Float, Float]] | None = None) -> float:
    """What a cause alone does to the healthy device, in its metric's unit (metres, or a share of pixels).

    `plain` are the healthy device's frames, where they are known.
    """
    cause = CAUSES[name]
    frames = _frames(session, cause, applied(session.healthy, {name: size}))
    changes = [
        _change(cause, with_it, without) for with_it, without in zip(frames, plain or _frames(session, cause, session.healthy), strict=True)
    ]
    change = np.concatenate(changes)
    if cause.metric in ("loss", "wrap"):
        return float(change.mean())
    if cause.metric == "noise":
        return float(np.sqrt(max(float(np.nanmean(change)), 0.0)))
    return rms(np.where(np.abs(change) > OUTLIER_M, np.nan, change), local=cause.local)


def _frames(session: EmergingSession, cause: Cause, device: Device) -> list[tuple[Float, Float]]:
    """Mean frames (P,) of some captures, and noisy ones where the metric needs them."""
    n = len(session.shutters)
    indices = np.unique(np.linspace(0, n - 1, min(n, CAPTURES)).round()).astype(int).tolist()
    mean = [np.zeros(0) if cause.metric in ("loss", "wrap") else session.exposed(i, device).depth for i in indices]
    needed = cause.metric in ("loss", "wrap", "noise")
    noisy = [session.exposed(i, device, noise=True).depth if needed else np.zeros(0) for i in indices]
    return list(zip(mean, noisy, strict=True))


def _change(cause: Cause, with_it: tuple[Float, Float], without: tuple[Float, Float]) -> Float:
    """Per pixel: metres of bias, square metres of noise, or whether a pixel is lost or wrapped.

    Firmware drops most of the pixels that it unwraps wrongly: these are lost, and count as wrapped ones.
    """
    if cause.metric in ("bias", "size"):
        return np.asarray(with_it[0] - without[0])
    seen = np.isfinite(without[1])
    if cause.metric == "loss":
        return np.asarray(np.isnan(with_it[1][seen]), float)
    if cause.metric == "wrap":
        return np.asarray(~(np.abs(with_it[1] - without[1])[seen] <= WRAPPED_M), float)
    noise, usual = with_it[1] - with_it[0], without[1] - without[0]
    noise[np.abs(noise) > OUTLIER_M] = np.nan
    usual[np.abs(usual) > OUTLIER_M] = np.nan
    return np.asarray(noise**2 - np.nanmean(usual**2))
