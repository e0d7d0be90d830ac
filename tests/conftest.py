# SPDX-License-Identifier: Apache-2.0
"""What every test may ask for: the shared real data, a ROS domain of its own, repeatable hypothesis runs."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from hypothesis import HealthCheck, settings

from tof_core.cores import one_thread

if TYPE_CHECKING:
    from collections.abc import Iterator

REPOSITORY = Path(__file__).resolve().parent.parent
SHARED_DATA = REPOSITORY.parent / "shared" / "data"

# Two workers on two cores: thread pools would only wait for each other. Set before NumPy or Numba start theirs.
one_thread()
os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
os.environ.setdefault("MPLBACKEND", "Agg")

settings.register_profile(
    "toftwin", deadline=None, derandomize=True, database=None, print_blob=True, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("toftwin")


FIRST = ("benchmarks/gap_check/test_cases.py", "scripts/test_wheel.py", "benchmarks/test_make_model.py", "benchmarks/emerging/")
"""Files that come first, in this order. In a fresh checkout the first diagnosis compiles all kernels for over a minute; the process beside it
meanwhile runs what needs no kernels of the diagnosis, and then loads those instead of compiling them, too."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Then files with a slow test: the last files of both processes are short, and neither waits long for the other."""
    slow = {item.path for item in items if item.get_closest_marker("slow")}

    def turn(item: pytest.Item) -> tuple[int, bool]:
        path = item.path.relative_to(REPOSITORY / "tests").as_posix()
        return next((i for i, first in enumerate(FIRST) if path.startswith(first)), len(FIRST)), item.path not in slow

    items.sort(key=turn)


@pytest.fixture(scope="session")
def repository() -> Path:
    """The root of the checkout."""
    return REPOSITORY


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real captures and CAD that lies beside the checkout; the test is skipped where there is none."""
    if not SHARED_DATA.is_dir():
        pytest.skip("no ../shared/data beside the checkout: the real captures are not here")
    return SHARED_DATA


@pytest.fixture
def no_page(monkeypatch: pytest.MonkeyPatch) -> None:
    """`toftwin gap` writes no report.html: drawing its pictures takes as long as two thirds of a small session's diagnosis."""
    monkeypatch.setattr("tof_gap.tell.report.page.write_page", lambda _d, _content, folder, *_: folder / "report.html")


@pytest.fixture(scope="module")
def ros_domain() -> Iterator[int]:
    """A ROS domain that no other test process on this host uses, set in the environment for the whole module."""
    pytest.importorskip("rclpy", reason="no ROS 2 here: neither sourced nor from pip")
    from tof_ros.environment import private_domain

    with pytest.MonkeyPatch.context() as patch, private_domain(shared=False) as domain:
        patch.setenv("ROS_DOMAIN_ID", str(domain))
        patch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        yield domain


_DRAWN: dict[str, object] = {}
"""State of each test module's generator `RNG` once the module is imported."""


@pytest.fixture(autouse=True)
def _same_numbers_in_any_order(request: pytest.FixtureRequest) -> None:
    """A module's `RNG` starts anew for each test: what a test draws does not depend on which tests this worker ran before."""
    module = getattr(request, "module", None)
    rng = getattr(module, "RNG", None)
    if rng is not None:
        rng.bit_generator.state = _DRAWN.setdefault(request.module.__name__, rng.bit_generator.state)
