# SPDX-License-Identifier: Apache-2.0
"""The generated pages are up to date, and what they say beside the code's own words is true of the code."""

from __future__ import annotations

import inspect
import re
import shlex
from importlib import import_module

import pytest

from tof_core.config import table
from toftwin import cli
from toftwin.graph import NODES

pytest.importorskip("rclpy", reason="no ROS 2 here: the nodes cannot be asked")
make_docs = import_module("make_docs")
node_pages = import_module("node_pages")


@pytest.mark.parametrize("name", ["commands.md", "limits.md", "nodes/README.md", *(f"nodes/{node}.md" for node in NODES)])
def test_the_page_is_what_the_code_says(name: str) -> None:
    assert (make_docs.DOCS / name).read_text() == make_docs.pages()[name], "run .venv/bin/python scripts/make_docs.py"


@pytest.mark.parametrize("name", node_pages.NODE_TEXTS)
def test_every_output_is_described_and_no_other(name: str) -> None:
    assert set(node_pages.NODE_TEXTS[name].outputs) == set(import_module(NODES[name]).OUTPUTS)


@pytest.mark.parametrize("name", node_pages.NODE_TEXTS)
def test_values_of_the_diagnostics_are_in_the_nodes_source(name: str) -> None:
    source = inspect.getsource(import_module(NODES[name])) + inspect.getsource(import_module("tof_ros.views"))
    assert all(re.search(rf"[\"']{key.partition('.')[0]}", source) for key in node_pages.NODE_TEXTS[name].figures)


def test_values_that_all_nodes_count_are_described() -> None:
    tally = import_module("tof_ros.diagnostics").Tally()
    tally.skip("REASON")
    assert list(tally.values()) == list(node_pages.TALLY)


@pytest.mark.parametrize("name", node_pages.INPUTS)
def test_parameters_that_a_page_names_exist(name: str) -> None:
    known = {info.name for info in table(import_module(NODES[name]).CONFIG)}
    page = make_docs.node_page(name).partition("## Parameters")[0]
    named = set(re.findall(r"`((?:input|live|infer|preproc|align|label)\.[a-z_.]+)`", page)) | set(re.findall(r"-p ([a-z_.0-9]+):=", page))
    assert named
    assert named <= known


@pytest.mark.parametrize("name", cli.command_names())
def test_every_flag_of_a_command_is_listed(name: str) -> None:
    page = "\n".join(make_docs.command_parts(name))
    for action in make_docs.subparser(name)._actions:
        flags = [f for f in action.option_strings if f.startswith("--")]
        assert action.dest in make_docs.COMMON or not flags or flags[0] in page or "as for `doctor`" in page


@pytest.mark.parametrize("name", cli.command_names())
def test_the_examples_are_calls_that_the_parser_takes(name: str) -> None:
    for line in cli.load_command(name).EXAMPLE.splitlines():
        words = shlex.split(line)
        assert words[:2] == ["toftwin", name]
        make_docs.subparser(name).parse_args(words[2:])
