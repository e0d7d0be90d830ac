# SPDX-License-Identifier: Apache-2.0
"""What running nodes share: the dwells that one thread adds to while another reads."""

from __future__ import annotations

import sys
from dataclasses import replace
from threading import Thread

import pytest

from tests.tof_sim_label import made
from tof_core.errors import RefusedError
from tof_core.live import Dwells


def test_a_running_view_takes_the_place_of_an_earlier_one_of_its_dwell() -> None:
    dwells = Dwells(2)
    with pytest.raises(RefusedError, match="no view has come yet"):
        dwells.all()
    views = [replace(made.view(0), stamp_ns=stamp, dwell_ns=dwell) for stamp, dwell in ((1, 1), (2, 1), (3, 3), (4, 4))]
    kept = []
    for view in views:
        dwells.add(view)
        kept.append([v.stamp_ns for v in dwells.all()])
    assert kept == [[1], [2], [2, 3], [3, 4]]
    assert (dwells.at(4), dwells.at(1)) == (views[-1], None)


def test_a_reader_always_sees_a_view_while_another_thread_adds() -> None:
    dwells, view = Dwells(2), made.view(0)
    dwells.add(view)

    def add_often() -> None:
        for _ in range(50_000):
            dwells.add(view)

    usual = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        writer = Thread(target=add_often)
        writer.start()
        while writer.is_alive():
            assert dwells.all() == (view,)
    finally:
        sys.setswitchinterval(usual)
        writer.join()
