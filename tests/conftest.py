# SPDX-License-Identifier: Apache-2.0
"""What every test may ask for: the shared real data, a ROS domain of its own, repeatable hypothesis runs."""

from __future__ import annotations

import fcntl
import os
import tempfile
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from hypothesis import HealthCheck, settings

if TYPE_CHECKING:
    from collections.abc import Iterator

REPOSITORY = Path(__file__).resolve().parent.parent
SHARED_DATA = REPOSITORY.parent / "shared" / "data"

# Two workers on two cores: thread pools would only wait for each other. Set before NumPy or Numba start theirs.
for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(variable, "1")
os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
os.environ.setdefault("MPLBACKEND", "Agg")

settings.register_profile(
    "toftwin", deadline=None, derandomize=True, database=None, print_blob=True, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("toftwin")

# DDS derives its ports from the domain; up to 101 they stay below Linux's range of ephemeral ports. 0 is everybody's default.
ROS_DOMAINS = range(1, 102)


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


@pytest.fixture(scope="module")
def ros_domain() -> Iterator[int]:
    """A ROS domain that no other test process on this host uses, set in the environment for the whole module."""
    pytest.importorskip("rclpy", reason="no ROS 2 here: neither sourced nor from pip")
    with reserved_ros_domain() as domain, pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_DOMAIN_ID", str(domain))
        patch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        yield domain


@contextmanager
def reserved_ros_domain() -> Iterator[int]:
    """Hold one ROS domain until the block ends; the lock goes with the process, so a killed run leaves nothing behind."""
    for domain in ROS_DOMAINS:
        with (Path(tempfile.gettempdir()) / f"toftwin-ros-domain-{domain}.lock").open("w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                continue
            yield domain
            return
    pytest.fail(f"all {len(ROS_DOMAINS)} ROS domains of this host are in use by other test runs")
