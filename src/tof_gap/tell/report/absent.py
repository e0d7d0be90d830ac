# SPDX-License-Identifier: Apache-2.0
"""Effects that a session tested and does not show, and how large each of them could still be."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tof_gap.solved import ANY_PART
from tof_gap.tell.report.phrases import spaced
from tof_sensor.registry import VOCABULARY

if TYPE_CHECKING:
    from collections.abc import Container, Mapping, Sequence

    from tof_gap.solved import Bound
    from tof_gap.tell.account import Account

ANY_SIZE_MM = 20.0
"""Bounds beyond mean that poses or a named effect make the same error at any size: no bias of a camera is larger."""


def absent(found: Account, bounds: Mapping[str, Bound], apart: Container[str]) -> dict[str, Bound | None]:
    """For each tested effect that neither the verdict nor the report's list of small effects has, what it stays below.

    None for effects that show in noise, loss or edges, and for those that the solution states itself (hand-eye, a calibrated lens).

    Args:
        found: what was read off the solution.
        bounds: of the effects that were fitted and not chosen.
        apart: names of effects that were not testable, not asked for, or fitted and rejected.
    """
    shown = {*found.solved.small, *(f.name for f in found.findings)}
    for cause in found.causes:
        shown |= {cause.named.name, *cause.named.ties}
    return {name: bounds.get(name) for name in VOCABULARY if name not in shown and name not in apart}


def absent_words(bounds: Mapping[str, Bound | None], parts: Sequence[str], least_mm: float) -> list[str]:
    """Lines on the effects that were not found: those that could hide more than `least_mm`, those below it, and those without a bound."""
    mm = {name: 1e3 * bound.below_m for name, bound in bounds.items() if bound is not None}
    below = [spaced(name) for name in mm if mm[name] <= least_mm]
    others = [spaced(name) for name, bound in bounds.items() if bound is None]
    free = [spaced(name) for name in mm if mm[name] > ANY_SIZE_MM]
    larger = sorted((name for name in mm if least_mm < mm[name] <= ANY_SIZE_MM), key=lambda name: -mm[name])
    lines = []
    if free:
        lines.append(
            f"not testable in these views: {', '.join(free)} (poses or the named effects make the same error, whatever its size; views from other "
            "distances, angles and times tell them apart)"
        )
    if larger:
        most = ", ".join(f"{spaced(name)} (up to {mm[name]:.1f} mm{_where(bounds[name], parts)})" for name in larger)
        lines.append(f"not found, but could hide behind noise, poses or the named effects: {most}")
    if below:
        lines.append(f"tested and not found, each below {least_mm:g} mm RMS: {', '.join(below)}")
    if others:
        lines.append(f"tested and not found: {', '.join(others)}")
    return lines


def _where(bound: Bound | None, parts: Sequence[str]) -> str:
    return f" on {parts[bound.part]}" if bound is not None and bound.part != ANY_PART else ""
