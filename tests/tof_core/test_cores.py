# SPDX-License-Identifier: Apache-2.0
"""Work in threads: results in order, exceptions passed on."""

from __future__ import annotations

import time

import pytest

from tof_core import cores


@pytest.fixture(params=[1, 4])
def _cores(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cores, "CORES", request.param)


@pytest.mark.usefixtures("_cores")
def test_results_come_in_the_order_of_the_items() -> None:
    def late(n: int, more: int) -> int:
        time.sleep(0.02 * (n == 0))
        return n + more

    assert cores.in_threads(late, range(5), range(10, 15)) == [10, 12, 14, 16, 18]


@pytest.mark.usefixtures("_cores")
def test_an_exception_of_a_thread_is_raised() -> None:
    with pytest.raises(ZeroDivisionError):
        cores.in_threads(lambda n: 1 / n, [1, 0, 2])
