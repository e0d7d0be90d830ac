# SPDX-License-Identifier: Apache-2.0
"""Starting rclpy: from the command line nothing leaves this host unless the user's environment asks for it."""

from __future__ import annotations

import os
import socket
from contextlib import ExitStack, contextmanager
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tof_core.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from rclpy.context import Context
    from rclpy.parameter import Parameter

DOMAINS = range(1, 102)
"""Up to 101 a domain's ports lie below Linux's range of ephemeral ports; 0 is everybody's default."""

REACH = "ROS_AUTOMATIC_DISCOVERY_RANGE"
REACH_CHOICES = (REACH, "ROS_LOCALHOST_ONLY", "ROS_STATIC_PEERS", "ROS_DISCOVERY_SERVER", "CYCLONEDDS_URI", "ZENOH_SESSION_CONFIG_URI")
"""A user who sets one of these has chosen the discovery range."""
TRANSPORT_CHOICES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE", "FASTDDS_BUILTIN_TRANSPORTS")
"""A user who sets one of these has chosen the transports."""
PROFILE = str(Path(__file__).with_name("this_host.xml"))
DISTRIBUTIONS = ("ros-rclpy", "rclpy")
"""Under which names the wheels and a ROS installation list rclpy."""
KILTED = 9
"""First number of rclpy's version from Kilted on, whose Fast DDS 3 has renamed the variable of its profiles."""
PARTICIPANT = "TOFTWIN_PARTICIPANT"
"""The number that `PROFILE` gives to the participant of a process. `ANY_PARTICIPANT` is the lowest that is free on this host, which after a
kill -9 is that of the dead process, and its ports: the others write into the shared memory of the dead for up to 3 s."""
ANY_PARTICIPANT = "-1"
PARTICIPANTS = 100
"""So many numbers are looked for on this host (`maxInitialPeersRange` of `PROFILE`)."""


@contextmanager
def ros_context(args: Sequence[str] = (), *, domain: int | None = None, safe: bool = True, alone: bool = False) -> Iterator[Context]:
    """An rclpy context of its own, shut down at the end; `args` as after `--ros-args`.

    With `safe` discovery stays on this host unless the environment says otherwise; without, it reaches as far as any node's. With `alone`,
    where this process makes no other context, others match it at once also if it follows one that was killed.
    """
    if safe:
        keep_to_this_host()
    os.environ[PARTICIPANT] = str(os.getpid() % PARTICIPANTS) if alone else ANY_PARTICIPANT
    import rclpy

    context = rclpy.Context()
    ros_args = ["toftwin", "--ros-args", *args] if args else None
    rclpy.init(args=ros_args, context=context, domain_id=domain, signal_handler_options=rclpy.SignalHandlerOptions.NO)
    try:
        yield context
    finally:
        context.try_shutdown()


def keep_to_this_host() -> None:
    """Neither discover nor listen beyond this host, unless the environment asks for it.

    Discovery alone does not close the ports: Fast DDS binds them on every interface and then ignores who calls. Another middleware ignores the profile.
    """
    if not any(os.environ.get(name) for name in REACH_CHOICES):
        os.environ[REACH] = "LOCALHOST"
    others = any(os.environ.get(name) for name in ("ROS_STATIC_PEERS", "ROS_DISCOVERY_SERVER"))
    if os.environ.get(REACH) == "LOCALHOST" and not others and not any(name in os.environ for name in TRANSPORT_CHOICES):
        os.environ[profile_variable()] = PROFILE


def rclpy_version() -> str:
    """The version of the rclpy that is installed, as its package says."""
    for name in DISTRIBUTIONS:
        try:
            return metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return "of unknown version"


def profile_variable() -> str:
    """The environment variable that names the profiles of the Fast DDS that belongs to this rclpy; the newer one warns of the older name."""
    major = rclpy_version().partition(".")[0]
    return "FASTDDS_DEFAULT_PROFILES_FILE" if major.isdigit() and int(major) >= KILTED else "FASTRTPS_DEFAULT_PROFILES_FILE"


def reach(environment: Mapping[str, str]) -> str:
    """Who is heard, in a few words: the domain and how far discovery reaches, as the environment says."""
    domain = f"domain {environment.get('ROS_DOMAIN_ID') or '0'}"
    if server := environment.get("ROS_DISCOVERY_SERVER"):
        return f"{domain}, discovery server {server}"
    peers = f" and {peers}" if (peers := environment.get("ROS_STATIC_PEERS")) else ""
    asked = environment.get(REACH) or ("LOCALHOST" if environment.get("ROS_LOCALHOST_ONLY") == "1" else "SUBNET")
    words = {"LOCALHOST": "this host", "SUBNET": "the local network", "OFF": "nobody by discovery"}
    return f"{domain}, {words.get(asked, asked)}{peers}{' alone' if asked == 'LOCALHOST' and not peers else ''}"


def named_domain() -> int:
    """The ROS domain that the environment names, 0 where it names none."""
    named = os.environ.get("ROS_DOMAIN_ID") or "0"
    if not named.isdigit():
        raise UsageError(f"'{named}' is no number", where="ROS_DOMAIN_ID")
    return int(named)


@contextmanager
def private_domain(*, shared: bool = True) -> Iterator[int]:
    """A ROS domain that no other toftwin of this host holds; the environment's where it names one, unless that may not be `shared`.

    A domain is held by an abstract Unix socket. It has no file that another user could replace by a link, every user and
    container of the network namespace sees it, as they see DDS, and it ends with the process.
    """
    if shared and os.environ.get("ROS_DOMAIN_ID"):
        yield named_domain()
        return
    for domain in DOMAINS:
        with ExitStack() as stack:
            try:
                stack.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)).bind(f"\0toftwin-ros-domain-{domain}")
            except OSError:  # held
                continue
            yield domain
            return
    raise UsageError(f"all {len(DOMAINS)} ROS domains of this host are in use", where="ROS_DOMAIN_ID", todo="set it to one you may share")


def parameter_overrides(values: Mapping[str, Any]) -> list[Parameter]:
    """Start values of a node's parameters."""
    from rclpy.parameter import Parameter

    return [Parameter(name, value=value) for name, value in values.items()]
