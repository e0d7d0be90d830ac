# SPDX-License-Identifier: Apache-2.0
"""Domains of our own: never one that another toftwin holds, the user's where one is named."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from tof_core.errors import UsageError

pytest.importorskip("rclpy", reason="no ROS 2 here")

from tof_ros.environment import TRANSPORT_CHOICES, named_domain, private_domain, ros_context

SHARED = Path("/dev/shm")  # noqa: S108 - where Linux has it


def test_two_private_domains_at_a_time_differ(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    with private_domain() as one, private_domain() as other:
        assert one != other
        assert {one, other} <= set(range(1, 102))


def test_the_users_domain_is_used(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "42")
    with private_domain() as domain:
        assert domain == named_domain() == 42


def test_a_domain_that_is_no_number_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "spot")
    with pytest.raises(UsageError, match="ROS_DOMAIN_ID: 'spot' is no number"):
        named_domain()


@pytest.mark.skipif(not SHARED.is_dir() or any(name in os.environ for name in TRANSPORT_CHOICES), reason="another transport was chosen")
def test_what_a_process_shares_with_others_holds_several_images() -> None:
    before = set(SHARED.glob("fastrtps_*"))
    with private_domain(shared=False) as domain, ros_context(domain=domain) as context:
        import rclpy

        node = rclpy.create_node("sender", context=context)
        largest = max(path.stat().st_size for path in set(SHARED.glob("fastrtps_*")) - before)
        node.destroy_node()
    assert largest >= 3 * 1280 * 960 * 2
