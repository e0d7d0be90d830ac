# SPDX-License-Identifier: Apache-2.0
"""Test processes never share a ROS domain, and tf2_msgs is what every ROS peer has."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from rosbags.typesys import Stores, get_typestore

from tof_ros.environment import DOMAINS, private_domain


def test_two_reservations_never_share_a_domain() -> None:
    with private_domain(shared=False) as first, private_domain(shared=False) as second:
        assert first != second
        assert {first, second} <= set(DOMAINS)
    with private_domain(shared=False) as again:
        assert again in DOMAINS


@pytest.mark.dds
def test_a_tf_message_comes_back_over_dds(ros_domain: int, repository: Path) -> None:
    assert os.environ["ROS_DOMAIN_ID"] == str(ros_domain)
    check = [sys.executable, str(repository / "scripts" / "check_tf.py")]
    answer = subprocess.run(check, check=False, capture_output=True, text=True, timeout=60)
    assert answer.returncode == 0, answer.stderr


def test_tf_message_has_the_type_hash_of_jazzys_tf2_msgs() -> None:
    prefixes = [*filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)), sys.prefix]
    descriptions = [Path(prefix) / "share" / "tf2_msgs" / "msg" / "TFMessage.json" for prefix in prefixes]
    description = next(path for path in descriptions if path.exists())
    hashes = {entry["type_name"]: entry["hash_string"] for entry in json.loads(description.read_text())["type_hashes"]}
    assert hashes["tf2_msgs/msg/TFMessage"] == get_typestore(Stores.ROS2_JAZZY).hash_rihs01("tf2_msgs/msg/TFMessage")


def test_only_interface_packages_whose_definitions_changed_are_built(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    import build_interfaces

    ran: list[str] = []

    def build(name: str) -> None:
        ran.append(name)
        build_interfaces.built(name).parent.mkdir(parents=True, exist_ok=True)
        build_interfaces.built(name).write_text(build_interfaces.digest(name), encoding="ascii")

    source = tmp_path / "source"
    source.mkdir()
    (source / "Dwell.msg").write_text("uint32 captures\n")
    monkeypatch.setattr(build_interfaces, "PREFIX", tmp_path)
    monkeypatch.setattr(build_interfaces, "SOURCES", build_interfaces.SOURCES | {"toftwin_msgs": source})
    monkeypatch.setattr(build_interfaces, "build_and_install", build)
    monkeypatch.setattr(sys, "argv", ["build_interfaces.py"])
    assert build_interfaces.main() == 0
    (source / "Dwell.msg").write_text("uint32 captures\nuint32 station\n")
    assert build_interfaces.main() == 0
    assert build_interfaces.main() == 0
    assert ran == ["tf2_msgs", "bond", "toftwin_msgs", "toftwin_msgs"]
