# SPDX-License-Identifier: Apache-2.0
"""Set-up runs once, pins what it installs, and turns every failure into one line that says what to do."""

from __future__ import annotations

import re
import time
import tomllib
from pathlib import Path

import pytest

import ros
import set_up
import system
from progress import SetUpError, Steps, explain

LOG = Path("out/set-up.log")


def normal(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def pins(repository: Path) -> dict[str, str]:
    lines = (repository / "constraints.txt").read_text().splitlines()
    return {normal(name): version for name, version in (line.split("==") for line in lines if "==" in line)}


def requirements(repository: Path) -> list[str]:
    project = tomllib.loads((repository / "pyproject.toml").read_text())["project"]
    extras = [requirement for extra in project["optional-dependencies"].values() for requirement in extra]
    return [requirement for requirement in project["dependencies"] + extras if not requirement.startswith("toftwin")]


def test_every_dependency_is_pinned(repository: Path) -> None:
    pinned = pins(repository)
    names = [normal(re.split(r"[\[<>=!~ ]", requirement)[0]) for requirement in requirements(repository)]
    assert [name for name in names if name not in pinned] == []


def test_exact_requirements_agree_with_the_pins(repository: Path) -> None:
    pinned = pins(repository)
    exact = [requirement.split("==") for requirement in requirements(repository) if "==" in requirement]
    assert len(exact) > 10
    for name, version in exact:
        assert pinned[normal(name.split("[")[0])] == version, name


def test_a_finished_set_up_is_not_done_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "bin").mkdir()
    (tmp_path / "bin" / "toftwin").touch()
    monkeypatch.setattr(set_up, "VENV", tmp_path)
    wanted = {"identity": "3.11 here", "content": "abc", "level": "run"}
    assert set_up.is_done(dict(wanted), wanted)
    assert set_up.is_done(wanted | {"level": "dev"}, wanted), "what tests need holds what the commands need"
    assert not set_up.is_done(wanted, wanted | {"level": "dev"})
    assert not set_up.is_done(wanted | {"content": "abd"}, wanted)
    assert not set_up.is_done(wanted | {"identity": "3.12 here"}, wanted)
    assert not set_up.is_done({}, wanted)
    (tmp_path / "bin" / "toftwin").unlink()
    assert not set_up.is_done(dict(wanted), wanted)


def test_set_up_depends_on_the_pins_and_the_project_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "scripts").mkdir()
    (tmp_path / "pyproject.toml").write_text("[project]\nname = 'a'\n\n[tool.ruff]\nline-length = 1\n")
    (tmp_path / "constraints.txt").write_text("numpy==2.0\n")
    monkeypatch.setattr(set_up, "ROOT", tmp_path)
    before = set_up.content()
    (tmp_path / "pyproject.toml").write_text("[project]\nname = 'a'\n\n[tool.ruff]\nline-length = 2\n")
    assert set_up.content() == before
    (tmp_path / "scripts" / "make_pages.py").write_text("print()")
    assert set_up.content() == before
    (tmp_path / "scripts" / "ros.py").write_text("print()")
    assert set_up.content() != before
    before = set_up.content()
    (tmp_path / "constraints.txt").write_text("numpy==2.1\n")
    assert set_up.content() != before


def test_the_scripts_that_count_are_those_that_set_up_imports_or_runs(repository: Path) -> None:
    """From set_up.py along imports and script names; a script forgotten in OWN would change what is installed unseen."""
    scripts = {path.stem: path.read_text() for path in (repository / "scripts").glob("*.py")}
    found, left = set[str](), ["set_up"]
    while left:
        name = left.pop()
        found.add(name)
        used = set(re.findall(r"^(?:import|from) (\w+)", scripts[name], re.MULTILINE)) | set(
            re.findall(r'HERE / "(\w+)\.py"', scripts[name])
        )
        left += [other for other in used & scripts.keys() if other not in found]
    assert {f"{name}.py" for name in found} == set(set_up.OWN)


@pytest.mark.parametrize(
    ("output", "said"),
    [
        ("WARNING: Retrying ... Temporary failure in name resolution\nERROR: No matching distribution found for numpy", "no network"),
        ("Err:1 http://mirror bookworm\n  Temporary failure resolving 'mirror'\nE: Unable to locate package g++", "no network"),
        ("ERROR: No matching distribution found for open3d>=0.19", "open3d>=0.19 is not on pip's index"),
        ("ERROR: Could not install packages: [Errno 28] No space left on device", "the disk is full"),
        ("a\nCMake Error at CMakeLists.txt:5\nb", "CMake Error at CMakeLists.txt:5"),
        ("", "failed without a word"),
    ],
)
def test_a_failure_is_one_line_that_says_what_to_do(output: str, said: str) -> None:
    line = explain(output, "packages", LOG)
    assert line.startswith("packages: ")
    assert said in line
    assert "\n" not in line


def test_a_failing_command_stops_its_step(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    steps = Steps(total=1, log=tmp_path / "out" / "log", cwd=tmp_path)
    with pytest.raises(SetUpError, match="packages: some error; see"), steps.step("packages"):
        steps.run(["sh", "-c", "echo some error; exit 3"])
    assert (tmp_path / "out" / "log").read_text() == "some error\n"
    assert re.search(r"\[1/1\] packages: 0 s  stopped\n$", capsys.readouterr().out)


def test_a_command_beside_other_steps_is_waited_for_and_its_failure_is_raised(tmp_path: Path) -> None:
    steps = Steps(total=2, log=tmp_path / "out" / "log", cwd=tmp_path)
    with steps.beside(["sh", "-c", "while [ ! -e begun ]; do sleep 0.01; done; echo done > done"]) as finished:
        with steps.step("another step"):
            (tmp_path / "begun").touch()
        finished()
        assert (tmp_path / "done").read_text() == "done\n"
    with (
        steps.beside(["sh", "-c", "echo some error; exit 3"]) as finished,
        pytest.raises(SetUpError, match="kernels: some error; see"),
        steps.step("kernels"),
    ):
        finished()


def test_a_command_beside_a_step_that_fails_is_ended(tmp_path: Path) -> None:
    steps = Steps(total=1, log=tmp_path / "out" / "log", cwd=tmp_path)
    began = time.monotonic()
    with pytest.raises(SetUpError, match="packages"), steps.beside(["sleep", "60"]), steps.step("packages"):
        steps.run(["false"])
    assert time.monotonic() - began < 30.0


def test_another_ros_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DISTRO", "humble")
    monkeypatch.setenv("AMENT_PREFIX_PATH", "/opt/ros/humble")
    with pytest.raises(SetUpError, match="ROS humble is sourced here and toftwin needs Jazzy or none"):
        ros.source()


def test_without_a_sourced_ros_it_comes_from_pip(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ROS_DISTRO", raising=False)
    assert ros.source() == "pip"


def test_missing_libraries_are_named_as_one_line_to_type(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(system, "LIBRARIES", {"libthere-is-none.so.1": "libnone1"})
    monkeypatch.setattr(system, "privilege", lambda: None)
    with pytest.raises(SetUpError, match=r"type: sudo apt-get install -y --no-install-recommends libnone1"):
        system.ensure(Steps(total=1, log=tmp_path / "log", cwd=tmp_path), build_tools=False)


def test_a_library_that_is_there_is_found() -> None:
    assert system.loads("libc.so.6")
    assert not system.loads("libthere-is-none.so.1")


def test_sudo_is_announced_with_the_way_to_refuse_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    steps, ran = Steps(1, tmp_path / "log", tmp_path), list[list[str]]()

    def run(command: list[str], *, quiet_failure: bool = False) -> bool:
        assert "to refuse" in capsys.readouterr().out or ran, "the line comes first"
        ran.append(command)
        return True

    monkeypatch.setattr(steps, "run", run)
    assert system.apt_install(steps, ["sudo", "-n"], ["libgl1"])
    assert [command[:3] for command in ran] == [["sudo", "-n", "apt-get"]] * 2
    ran.clear()
    monkeypatch.setattr(steps, "run", lambda command, quiet_failure=False: True)
    system.apt_install(steps, [], ["libgl1"])
    assert capsys.readouterr().out == "", "root needs no leave"


def test_sudo_can_be_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.geteuid", lambda: 1000)
    monkeypatch.setattr("shutil.which", lambda name: f"/usr/bin/{name}")
    monkeypatch.setattr("subprocess.run", lambda *a, **k: type("Done", (), {"returncode": 0}))
    assert system.privilege() == ["sudo", "-n"]
    monkeypatch.setenv(system.NO_SUDO, "1")
    assert system.privilege() is None
