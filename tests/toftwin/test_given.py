# SPDX-License-Identifier: Apache-2.0
"""Misspelt parameters, and parameter files that address no node, are named with the nearest name and what to write."""

from __future__ import annotations

import os
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

from tof_core.errors import UsageError
from toftwin.given import Addressed, Section, ignored, refuse_unknown, sections_of

if TYPE_CHECKING:
    from pathlib import Path

PREPROC = Addressed("/spot/preproc", ("preproc.sor.enable", "live.reliable", "live.need_tf"))
LABEL = Addressed("/spot/sim_label", ("live.scene", "live.initial_pose"))


def test_a_param_of_an_unknown_name_is_refused_with_the_nearest() -> None:
    refuse_unknown({"live.initial_pose": "", "use_sim_time": True, "qos_overrides./tf.subscription.depth": 5}, LABEL)
    with pytest.raises(UsageError, match=r"sim_label has no parameter 'live.initial_pos'; did you mean live.initial_pose"):
        refuse_unknown({"live.initial_pos": ""}, LABEL)


@pytest.mark.parametrize(
    ("pattern", "addressed"),
    [
        ("/**", True),
        ("/**/preproc", True),
        ("/spot/preproc", True),
        ("/*/preproc", True),
        ("/spot/**", True),
        ("/preproc", False),
        ("/*", False),
        ("/*/*/preproc", False),
        ("/spot/preproc/more", False),
    ],
)
def test_patterns_of_ros(pattern: str, *, addressed: bool) -> None:
    assert Section("file", pattern, ()).addresses("/spot/preproc") is addressed


def test_files_and_single_parameters_are_read_as_ros_reads_them(tmp_path: Path) -> None:
    file = tmp_path / "robot.yaml"
    file.write_text(
        "spot:\n  preproc:\n    ros__parameters: {preproc: {sor: {enabled: false}}, live.reliable: true}\n/**:\n  ros__parameters: {a: 1}\n"
    )
    args = ["-r", "__ns:=/spot", "--params-file", str(file), "-p", "live.scene:=a:b", "-p", "preproc:live.need_tf:=false"]
    assert sections_of(args) == [
        Section(str(file), "/spot/preproc", ("preproc.sor.enabled", "live.reliable")),
        Section(str(file), "/**", ("a",)),
        Section("-p", "/**", ("live.scene",)),
        Section("-p", "/**/preproc", ("live.need_tf",)),
    ]


def test_an_unknown_name_in_a_file_is_reported_by_the_node_that_it_was_meant_for() -> None:
    found = ignored([Section("bad.yaml", "/**/preproc", ("preproc.sor.enabled", "live.reliable"))], [PREPROC, LABEL])
    assert found == {
        "/spot/preproc": [
            "parameters that this node does not have are ignored: 'preproc.sor.enabled' (bad.yaml; did you mean preproc.sor.enable?)"
        ],
        "/spot/sim_label": [],
    }


def test_a_name_for_all_nodes_that_one_of_them_has_is_none_to_report() -> None:
    assert ignored([Section("all.yaml", "/**", ("live.scene",))], [PREPROC, LABEL]) == {"/spot/preproc": [], "/spot/sim_label": []}
    assert "'live.scene'" in ignored([Section("all.yaml", "/**", ("live.scene",))], [PREPROC])["/spot/preproc"][0]


def test_in_a_launch_other_processes_may_have_what_this_one_lacks() -> None:
    elsewhere = ("preproc", "sim_label", "infer")
    assert ignored([Section("all.yaml", "/**", ("live.scene",))], [PREPROC], elsewhere) == {"/spot/preproc": []}
    assert ignored([Section("label.yaml", "/**/sim_label", ("live.scene",))], [PREPROC], elsewhere) == {"/spot/preproc": []}
    misspelt = ignored([Section("all.yaml", "/**", ("live.need_ft",))], [PREPROC], elsewhere)
    assert "'live.need_ft' (all.yaml; did you mean live.need_tf" in misspelt["/spot/preproc"][0]
    given = ignored([Section("-p", "/**", ("live.scene",))], [PREPROC], elsewhere)
    assert "'live.scene' (-p; did you mean" in given["/spot/preproc"][0]


@pytest.mark.parametrize("elsewhere", [(), ("preproc", "sim_label")])
def test_a_file_that_addresses_no_node_is_named_with_what_to_write(elsewhere: tuple[str, ...]) -> None:
    (line,) = ignored([Section("bad2.yaml", "/preproc", ("preproc.sor.enable",))], [PREPROC], elsewhere)["/spot/preproc"]
    assert line == (
        "a parameter file addresses no node that runs: bad2.yaml is for /preproc, the nodes here are /spot/preproc; "
        "name it /**/preproc, which fits every namespace"
    )


@pytest.mark.dds
def test_a_running_node_reports_what_was_given_in_vain(tmp_path: Path, ros_domain: int) -> None:
    pytest.importorskip("rclpy", reason="no ROS 2 here")
    from tests.tof_ros.peers import Observer, wait_for
    from tof_ros.environment import ros_context
    from tof_ros.spin import spinning
    from toftwin.graph import GraphSpec, graph_process

    misspelt, lost = tmp_path / "misspelt.yaml", tmp_path / "lost.yaml"
    misspelt.write_text("/**/sim_label:\n  ros__parameters:\n    live.initial_pos: 'odom: 0 0 0'\n")
    lost.write_text("/sim_label:\n  ros__parameters:\n    live.scene: cell\n")
    spec = GraphSpec(("sim_label",), namespace="spot", params_files=(str(misspelt), str(lost)))
    with ros_context(domain=ros_domain) as context:
        observer = Observer(context)
        with spinning([observer.node]), graph_process(spec, ros_domain):
            wait_for(lambda: any("'live.initial_pos' (" in line for line in observer.log), what="for the misspelt name")
            wait_for(lambda: any(f"addresses no node that runs: {lost}" in line for line in observer.log), what="for the lost file")
            status = observer.status("spot/sim_label", lambda s: s.level == b"\x02")  # it has no scene, and says so, too
            assert "no scene given" in status.message


@pytest.mark.dds
def test_a_misspelt_param_ends_the_command_at_once(ros_domain: int) -> None:
    pytest.importorskip("rclpy", reason="no ROS 2 here")
    command = [sys.executable, "-m", "toftwin.cli", "node", "sim_label", "--param", "sim_label.live.initial_pos=odom: 0 0 0"]
    ended = subprocess.run(
        command, check=False, env={**os.environ, "ROS_DOMAIN_ID": str(ros_domain)}, capture_output=True, text=True, timeout=60
    )
    assert ended.returncode == 2
    assert "--param: sim_label has no parameter 'live.initial_pos'; did you mean live.initial_pose" in ended.stderr
