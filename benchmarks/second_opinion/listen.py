# SPDX-License-Identifier: Apache-2.0
"""The linear system that a diagnosis chose its effects from, taken down while it runs."""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING
from unittest import mock

import numpy as np

from tof_core.stats import touched

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from typing import Any

    from tof_core.arrays import Float
    from tof_gap.config import GapConfig
    from tof_gap.solve.hypotheses.candidate import Candidate
    from tof_gap.solve.hypotheses.columns import ColumnStore, Design
    from tof_gap.solve.solution import Joint


@dataclass(frozen=True, slots=True, eq=False)
class Heard:
    """What the last selection of a session was made from, and what it chose.

    design: all hypotheses on one linear system; members: those chosen; touched (candidates,): share of the drawn pixels that each
    touches; config: the settings it used.
    """

    design: Design
    members: tuple[int, ...]
    touched: Float
    config: GapConfig


@contextmanager
def listening() -> Iterator[list[Heard]]:
    """While open, every selection that a diagnosis settles on is appended; the last one of the chain that it went on with stands at the end.

    The diagnosis is wrapped and not repeated, so that both judges have the same evidence to the last bit.
    """
    from tof_gap import diagnose
    from tof_gap.solve import joint
    from tof_gap.solve.hypotheses.columns import build
    from tof_gap.solve.settle import settled
    from tof_gap.solve.stray import solve_agreeing

    heard: list[tuple[Joint, Heard]] = []
    out: list[Heard] = []
    shares: list[Float] = []

    def built(store: ColumnStore, tested: Sequence[Candidate], *args: Any) -> Design:
        design = build(store, tested, *args)
        shares[:] = [touched_shares(store, tested)]
        return design

    def settling(found: Joint, config: GapConfig) -> Joint:
        heard.append((found, Heard(found.design, found.selection.chosen.members, shares[-1], config)))
        return settled(found, config)

    def agreeing(*args: object, **named: object) -> object:
        result = solve_agreeing(*args, **named)  # type: ignore[arg-type]
        out.extend(h for found, h in heard if found.chain is result[0].chain)
        heard.clear()
        return result

    with (
        mock.patch.object(joint, "build", built),
        mock.patch.object(joint, "settled", settling),
        mock.patch.object(diagnose, "solve_agreeing", agreeing),
    ):
        yield out


def touched_shares(store: ColumnStore, tested: Sequence[Candidate]) -> Float:
    """(candidates,) share of the drawn pixels that the columns of each touch; 1 where it has none."""
    sizes = (np.concatenate([np.linalg.norm(c, axis=1) for c in columns]) for columns in store.of(tested))
    return np.array([float(touched(size).mean()) if size.any() else 1.0 for size in sizes])
