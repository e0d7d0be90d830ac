# SPDX-License-Identifier: Apache-2.0
"""Commands in the documentation are run, in a folder that holds what they name; the few that are only parsed are listed with the test that runs their like."""

from __future__ import annotations

import re
import shlex
import shutil
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from tests.tof_infer.made import write_dataset
from tof_scene.builtin import write_builtin
from tof_sensor.effects.range_offset import RangeOffset
from tof_sensor.model import SensorModel, save_model
from toftwin import cli
from toftwin.graph import NODES

if TYPE_CHECKING:
    from collections.abc import Iterator

REPOSITORY = Path(__file__).resolve().parents[2]
GOLDEN = REPOSITORY / "tests" / "data" / "golden" / "bag"
PAGES = [
    "README.md",
    "CONTRIBUTING.md",
    "docker/README.md",
    "ros_ws/README.md",
    *(str(p.relative_to(REPOSITORY)) for p in (REPOSITORY / "docs").rglob("*.md")),
]
TOOLS = ("toftwin", "make", "docker", "ros2", "python", "rosdep", "source", ".", "cd", "DATA=$PWD/data")

PARSED_ONLY = {
    r"node ": ("runs until it is stopped", "tests/tof_ros/test_nodes.py"),
    r"doctor --live": ("listens for seconds to a robot that is not there", "tests/toftwin/test_doctor.py"),
    r"replay .*--against": ("a second replay", "tests/toftwin/test_replay.py"),
    r"label 'bags": ("several bags", "tests/toftwin/test_batch.py"),
    r"label monday": ("as the one of session/bag", "tests/docs/test_commands.py"),
    r"demo": ("half a minute", "tests/toftwin/test_demo.py"),
    r"gap ": ("minutes", "tests/tof_gap/test_diagnose.py"),
    r"train ": ("hours", "tests/toftwin/test_infer_commands.py"),
    r"infer ": ("needs the network of the line before", "tests/toftwin/test_infer_commands.py"),
    r"evaluate ": ("minutes", "tests/toftwin/test_infer_commands.py"),
    r"(correct|inspect) ": ("half a minute", "tests/toftwin/test_correct_inspect.py"),
    r"simulate .*--out": ("minutes at this size", "tests/tof_virtual/test_simulate.py"),
    r"view out/session .*--gap": ("opens a window", "tests/toftwin/test_view.py"),
}
"""Lines of `toftwin` that are not run here: why, and the test that runs such a call."""
ELSEWHERE = {
    r"docker ": "no container engine here; tests/docker holds files and calls together",
    r"DATA=": "as docker",
    r"ros2 (bag|service)": "needs a ROS installation",
    r"(source|\.|cd|rosdep|python -m colcon) ": "needs a ROS installation; what ran where is said in ros_ws/README.md",
}
"""Lines of other tools that cannot be run here."""


def lines(page: str) -> Iterator[str]:
    """Each command of a page: lines of code that begin with a tool, continued ones joined, comments gone."""
    text = (REPOSITORY / page).read_text().replace("\\\n", " ")
    for line in re.findall(r"^ {4}(?:\$ )?(\S.*)$", text, re.MULTILINE) + re.findall(r"^```sh\n(.*?)^```", text, re.MULTILINE | re.DOTALL):
        for single in line.splitlines():
            words = single.removeprefix(".venv/bin/").split()
            if words and words[0] in TOOLS:
                yield re.sub(r"\s+# .*", "", single.removeprefix(".venv/bin/")).strip()


COMMANDS = {line: page for page in PAGES for line in lines(page)}
OURS = [line for line in COMMANDS if line.startswith("toftwin ")]


def pattern_of(line: str) -> str | None:
    """Which of PARSED_ONLY a line is."""
    return next((p for p in PARSED_ONLY if re.match(p, line.removeprefix("toftwin "))), None)


RUN = [line for line in OURS if pattern_of(line) is None]


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """session/bag, ideal/bag, sensor.yaml and cell/scene.yaml, as the pages call them."""
    folder = tmp_path_factory.mktemp("docs")
    for name in ("session", "ideal"):
        shutil.copytree(GOLDEN, folder / name / "bag")
    save_model(SensorModel((RangeOffset(0.01),), gain=100.0), folder / "sensor.yaml")
    write_builtin("body_section", folder / "cell")
    return folder


@pytest.mark.parametrize("line", RUN)
def test_a_command_runs(line: str, place: Path, ros_domain: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """In the order of the pages, so that a later one finds what an earlier one wrote."""
    monkeypatch.chdir(place)
    if line.startswith("toftwin view"):
        pytest.importorskip("rerun", reason="needs the extra `view`")
    assert cli.main(shlex.split(line)[1:]) == 0, f"{COMMANDS[line]}: {line}"


@pytest.mark.parametrize("line", [line for line in OURS if line not in RUN])
def test_a_command_that_is_not_run_is_one_that_the_parser_takes(line: str) -> None:
    words = shlex.split(line)
    parser = cli.build_parser(words[1])
    assert parser.parse_args(words[1:]).command == words[1]


def test_what_is_not_run_here_is_run_by_the_test_that_is_named() -> None:
    for pattern, (_, test) in PARSED_ONLY.items():
        assert any(pattern_of(line) == pattern for line in OURS), f"no page has {pattern} any more"
        assert re.search(r"toftwin|" + pattern.split()[0].strip("()|"), (REPOSITORY / test).read_text()), test


def test_most_kinds_of_command_run() -> None:
    assert {shlex.split(line)[1] for line in RUN} >= {"doctor", "label", "replay", "simulate", "view"}


WITHOUT_SETTINGS = re.findall(r"`(\w+)`", re.findall(r"all but (.*?) have", (REPOSITORY / "README.md").read_text(), re.DOTALL)[0])
"""Commands that README.md excepts."""


@pytest.mark.parametrize("name", cli.command_names())
def test_a_command_has_the_settings_that_the_readme_says(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main([name, "--help"]) == 0
    shown = capsys.readouterr().out
    flags = ["--settings", "--config FILE", "--set KEY=VALUE"]
    assert [flag for flag in flags if flag in shown] == ([] if name in WITHOUT_SETTINGS else flags)
    if name == "node":
        assert all(flag in shown for flag in ("--list-params", "--params-file", "--param "))
    if name not in WITHOUT_SETTINGS:
        assert cli.main([name, "--settings"]) == 0
        assert re.match(r"[\w.]+ = ", capsys.readouterr().out)


@pytest.mark.parametrize("line", [line for line in COMMANDS if line not in OURS])
def test_lines_of_other_tools_name_what_exists(line: str) -> None:
    if any(re.match(p, line) for p in ELSEWHERE):
        return
    words = shlex.split(line)
    match words[:2]:
        case ["make", verb]:
            assert re.search(rf"^{verb}:", (REPOSITORY / "Makefile").read_text(), re.MULTILINE)
        case ["ros2", "run"]:
            assert words[2] == "toftwin"
            assert words[3] in {*NODES, "toftwin"}
        case ["ros2", "launch"]:
            launch = (REPOSITORY / "ros_ws" / "src" / words[2] / "launch" / words[3]).read_text()
            given = [word.partition(":=")[0] for word in words[4:] if ":=" in word]
            assert all(f'"{name}"' in launch for name in given)
        case ["python", "-m"]:
            assert find_spec(words[2]) is not None
        case _:
            pytest.fail(f"{COMMANDS[line]}: nobody checks this line")


def test_python_in_the_pages_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """docs/dataset.md reads out/session/dataset.zarr; here one of four stations, so that each set of the split has one."""
    pytest.importorskip("torch", reason="needs the extra `train`")
    (tmp_path / "out" / "session").mkdir(parents=True)
    write_dataset(tmp_path / "out" / "session" / "dataset.zarr")
    monkeypatch.chdir(tmp_path)
    (code,) = re.findall(r"^```python\n(.*?)^```", (REPOSITORY / "docs" / "dataset.md").read_text(), re.MULTILINE | re.DOTALL)
    exec(compile(code, "docs/dataset.md", "exec"), {})  # noqa: S102 (our own page)
