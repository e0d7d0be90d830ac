# SPDX-License-Identifier: Apache-2.0
"""Domains of our own: never one that another toftwin holds, the user's where one is named."""

from __future__ import annotations

import os
import subprocess
import sys
from contextlib import ExitStack, suppress
from pathlib import Path
from socket import AF_INET, SOCK_DGRAM, socket

import pytest

from tof_core.errors import UsageError

pytest.importorskip("rclpy", reason="no ROS 2 here")

from tof_ros.environment import PARTICIPANTS, TRANSPORT_CHOICES, named_domain, private_domain, profile_variable, ros_context

SHARED = Path("/dev/shm")  # noqa: S108 - where Linux has it
SEGMENTS = "fast*_*"
"""What Fast DDS calls its files there: `fastrtps_` up to version 2, `fastdds_` from 3 on."""


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
    before = set(SHARED.glob(SEGMENTS))
    with private_domain(shared=False) as domain, ros_context(domain=domain) as context:
        import rclpy

        node = rclpy.create_node("sender", context=context)
        largest = max(size(path) for path in set(SHARED.glob(SEGMENTS)) - before)
        node.destroy_node()
    assert largest >= 3 * 1280 * 960 * 2


def size(segment: Path) -> int:
    """Bytes of a shared segment; 0 for one that another process removed meanwhile."""
    try:
        return segment.stat().st_size
    except FileNotFoundError:
        return 0


PORTS = """
from tof_ros.environment import ros_context
with ros_context(alone={alone}) as context:
    import os, rclpy
    node = rclpy.create_node("alone", context=context)
    held = {{os.readlink(f"/proc/self/fd/{{fd}}") for fd in os.listdir("/proc/self/fd") if os.path.exists(f"/proc/self/fd/{{fd}}")}}
    rows = [line.split() for line in open("/proc/self/net/udp").readlines()[1:]]
    print(os.getpid(), *(int(row[1].rpartition(":")[2], 16) for row in rows if f"socket:[{{row[9]}}]" in held))
"""


def unused_domain(stack: ExitStack) -> int:
    """A domain that no toftwin holds and in which nobody has the first participant's port: a node that was just closed may still."""
    while True:
        domain = stack.enter_context(private_domain(shared=False))
        with socket(AF_INET, SOCK_DGRAM) as first, suppress(OSError):
            first.bind(("", 7410 + 250 * domain))
            return domain


@pytest.mark.skipif(
    not Path("/proc/net/udp").exists() or any(name in os.environ for name in TRANSPORT_CHOICES), reason="another transport was chosen"
)
@pytest.mark.parametrize("alone", [True, False])
def test_a_node_s_successor_has_other_ports_than_the_one_that_was_killed(alone: bool) -> None:  # noqa: FBT001
    """RTPS: the unicast port of discovery is 7410 + 250 domain + 2 participant."""
    with ExitStack() as stack:
        domain = unused_domain(stack)
        environment = {**os.environ, "ROS_DOMAIN_ID": str(domain)}
        done = subprocess.run(
            [sys.executable, "-c", PORTS.format(alone=alone)], env=environment, capture_output=True, text=True, check=True
        )
    pid, *ports = (int(word) for word in done.stdout.split())
    assert 7410 + 250 * domain + (2 * (pid % PARTICIPANTS) if alone else 0) in ports


REACHES = {
    "nothing is said": ({}, "LOCALHOST", "domain 0, this host alone"),
    "the network": ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET", "ROS_DOMAIN_ID": "7"}, "SUBNET", "domain 7, the local network"),
    "one peer": ({"ROS_STATIC_PEERS": "192.168.80.3"}, None, "domain 0, the local network and 192.168.80.3"),
    "one peer and this host": (
        {"ROS_STATIC_PEERS": "192.168.80.3", "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"},
        "LOCALHOST",
        "domain 0, this host and 192.168.80.3",
    ),
    "a server": ({"ROS_DISCOVERY_SERVER": "10.0.0.1:11811"}, None, "domain 0, discovery server 10.0.0.1:11811"),
    "the old variable": ({"ROS_LOCALHOST_ONLY": "1"}, None, "domain 0, this host alone"),
}


@pytest.mark.parametrize("case", REACHES)
def test_the_user_s_variables_win_and_their_meaning_is_logged(case: str, monkeypatch: pytest.MonkeyPatch) -> None:
    from tof_ros.environment import REACH_CHOICES, keep_to_this_host, reach

    given, asked, said = REACHES[case]
    for name in (*REACH_CHOICES, *TRANSPORT_CHOICES, "ROS_DOMAIN_ID"):
        monkeypatch.setenv(name, "")  # so that what is set below is undone
        monkeypatch.delenv(name)
    for name, value in given.items():
        monkeypatch.setenv(name, value)
    keep_to_this_host()
    assert os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE") == asked
    assert reach(os.environ) == said
    assert (profile_variable() in os.environ) == (asked == "LOCALHOST" and "ROS_STATIC_PEERS" not in given)


@pytest.mark.parametrize(
    ("version", "variable"),
    [("7.1.6", "FASTRTPS"), ("7.1.9", "FASTRTPS"), ("9.1.2", "FASTDDS"), ("10.0.1", "FASTDDS"), ("of unknown version", "FASTRTPS")],
)
def test_the_profile_is_named_as_the_installed_fast_dds_reads_it(version: str, variable: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tof_ros.environment.rclpy_version", lambda: version)
    assert profile_variable() == f"{variable}_DEFAULT_PROFILES_FILE"


def test_ros2_run_reaches_as_far_as_every_node(monkeypatch: pytest.MonkeyPatch) -> None:
    from tof_ros.environment import REACH_CHOICES
    from toftwin.executables import called

    for name in (*REACH_CHOICES, *TRANSPORT_CHOICES):
        monkeypatch.setenv(name, "")
        monkeypatch.delenv(name)
    assert not called(("preproc",), []).safe
    with ros_context(domain=named_domain(), safe=False):
        assert not {*REACH_CHOICES, *TRANSPORT_CHOICES} & os.environ.keys()
