# SPDX-License-Identifier: Apache-2.0
"""One edge over time: samples in any order, in blocks that divide, found again at their stamps and between."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tof_core.edge import BLOCK, Edge
from tof_core.errors import TransformError

MS = 1_000_000


@given(st.permutations(range(700)))
@settings(max_examples=20)
def test_samples_in_any_order_are_found_again(order: list[int]) -> None:
    """More samples than a block holds: each stamp is exact, each middle between two is their mean."""
    edge = Edge("a", static=False)
    for i in order:
        edge.put(i * MS, (float(i), 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
    assert len(edge) == 700
    assert [edge.at(i * MS, MS)[0] for i in range(700)] == list(range(700))
    assert [edge.at(i * MS + MS // 2, MS)[0] for i in range(699)] == [i + 0.5 for i in range(699)]
    assert (edge.newest, edge.reached) == (699 * MS, 698 * MS)
    for stamp, says in ((-MS, "starts 1 ms after"), (700 * MS, "ends 1 ms before")):
        with pytest.raises(TransformError, match=says):
            edge.at(stamp, MS)


def test_stamps_sent_again_replace_theirs_wherever_they_lie() -> None:
    edge = Edge("a", static=False)
    for x in (1.0, 2.0):
        for i in range(BLOCK):
            edge.put((i + BLOCK // 2) % BLOCK * MS, (x, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
    assert len(edge) == BLOCK
    assert {edge.at(i * MS, MS)[0] for i in range(BLOCK)} == {2.0}
    edge.put((BLOCK - 1) * MS, (3.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
    assert len(edge) == BLOCK
