# SPDX-License-Identifier: Apache-2.0
"""Domains of our own: never one that another toftwin holds, the user's where one is named."""

from __future__ import annotations

import pytest

from tof_core.errors import UsageError

pytest.importorskip("rclpy", reason="no ROS 2 here")

from tof_ros.environment import named_domain, private_domain


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
