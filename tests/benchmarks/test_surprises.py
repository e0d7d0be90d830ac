# SPDX-License-Identifier: Apache-2.0
"""What the benchmark of surprises takes for true: a world as its CAD seen by the same camera, and where a foreign object is."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from benchmarks.gap_check.foreign.record import planned
from benchmarks.surprises.cases import as_cad, draw
from benchmarks.surprises.score import WRONG_M, Things, _box_middle, _named
from tof_core.config import updated
from tof_scene.world.foreign import Foreign
from tof_scene.world.surprises import Surprises

if TYPE_CHECKING:
    from pathlib import Path

SIZE = (80, 60)
NAMES = ("floor", "pipe")


def test_without_surprises_the_world_is_its_cad_edges_included_and_with_one_only_there(tmp_path: Path) -> None:
    case = draw(2, 3, views=3)[1]
    assert case.kind == "foreign"
    session = planned(case.session, tmp_path, SIZE)
    first = {shutter.stop: shutter for shutter in reversed(session.shutters)}

    def true(world: dict[str, object]) -> list[np.ndarray]:
        session.healthy = updated(session.healthy, world)
        return [session.view(first[stop], session.device()).z.reshape(SIZE[::-1]) for stop in sorted(first)]

    nominal = as_cad(session)
    np.testing.assert_array_equal(nominal, true({"world.foreign_m": 0.0}))
    with_box = np.stack(true(case.world))
    np.testing.assert_array_equal(as_cad(session), nominal)
    nearer = nominal - with_box > WRONG_M
    assert nearer.sum() > 100
    assert not (with_box - nominal > WRONG_M).any()


def test_a_box_seen_from_one_side_has_its_middle_behind_that_side() -> None:
    front = np.stack(np.meshgrid([0.3], np.linspace(-0.1, 0.1, 21), np.linspace(0, 0.2, 21), indexing="ij"), -1).reshape(-1, 3)
    top = np.array([[0.0, 0.0, 0.2], [0.1, 0.0, 0.2]])
    np.testing.assert_allclose(_box_middle(np.concatenate([front, top])), [0.15, 0.0, 0.1])


def found(*middles: tuple[float, float, float], moves: bool = False) -> Surprises:
    none = np.zeros((0, 3))
    return Surprises(
        (), (), tuple(Foreign(np.array(m), np.ones(3), (0,) if moves else (0, 1), 99, moves, none, none[:, 0]) for m in middles)
    )


def test_a_named_object_counts_where_it_stands_and_what_moves_is_false_where_nobody_is() -> None:
    true = Things((), np.array([0.0, 0.0, 0.5]))
    assert _named(found((0.05, 0.0, 0.5)), true, NAMES, arm=False) == {"things": 1, "named": 1, "false": 0}
    assert _named(found((0.2, 0.0, 0.5)), true, NAMES, arm=False) == {"things": 1, "named": 0, "false": 1}
    assert _named(found(), true, NAMES, arm=False) == {"things": 1, "named": 0, "false": 0}
    moving = found((0.9, 0.0, 0.5), moves=True)
    assert _named(moving, Things((), None), NAMES, arm=False)["false"] == 1
    assert _named(moving, Things((), None), NAMES, arm=True)["false"] == 0
