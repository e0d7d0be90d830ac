# SPDX-License-Identifier: Apache-2.0
"""The ROS packages: what they name exists, what is generated is up to date, and an executable takes ROS's arguments."""

from __future__ import annotations

import json
import re
import runpy
import signal
import subprocess
import sys
import time
import tomllib
from importlib import import_module
from itertools import pairwise
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree as ET

import pytest
import yaml

from tof_core.config import table
from tof_core.errors import UsageError
from toftwin.executables import called, called_together
from toftwin.graph import DONE, NODES

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

PACKAGES = ("toftwin", "toftwin_bringup")


@pytest.fixture
def packages(repository: Path) -> Path:
    return repository / "ros_ws" / "src"


def set_up(folder: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """What a package's setup.py tells setuptools."""
    told: dict[str, Any] = {}
    monkeypatch.chdir(folder)
    monkeypatch.setattr("setuptools.setup", lambda **given: told.update(given))
    runpy.run_path(str(folder / "setup.py"))
    return told


@pytest.mark.parametrize("name", PACKAGES)
def test_package_xml_and_setup_py_agree(name: str, packages: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    root = ET.parse(packages / name / "package.xml").getroot()  # noqa: S314  (our own file)
    told = set_up(packages / name, monkeypatch)
    assert (root.findtext("name"), root.findtext("version")) == (told["name"], told["version"]) == (name, told["version"])
    assert root.findtext("export/build_type") == "ament_python"
    assert (packages / name / "resource" / name).is_file()
    assert f"$base/lib/{name}" in (packages / name / "setup.cfg").read_text()


@pytest.mark.parametrize("name", PACKAGES)
def test_every_file_that_is_installed_exists(name: str, packages: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told = set_up(packages / name, monkeypatch)
    listed = [file for _, files in told["data_files"] for file in files]
    assert len(listed) >= 2
    assert all((packages / name / file).is_file() for file in listed)


def test_every_room_is_installed_with_its_data(packages: Path, repository: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told = set_up(packages / "toftwin", monkeypatch)
    assert {p.name for p in (repository / "src").iterdir() if (p / "__init__.py").exists()} <= set(told["packages"])
    assert (packages / "toftwin" / told["package_dir"][""]).resolve() == repository / "src"
    assert ".." not in told["package_dir"][""], "colcon build --symlink-install takes no path that leaves the package"
    assert {"*.onnx", "*.j2", "templates/*", "models/*"} <= set(told["package_data"][""])


def test_every_node_has_an_executable_that_can_be_imported(packages: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scripts = dict(re.split(r"\s*=\s*", line) for line in set_up(packages / "toftwin", monkeypatch)["entry_points"]["console_scripts"])
    assert set(scripts) == {"toftwin", "graph", *NODES}
    for target in scripts.values():
        module, _, function = target.partition(":")
        assert callable(getattr(import_module(module), function))


def test_ros_packages_that_the_code_imports_are_depended_on(packages: Path, repository: Path) -> None:
    depends = {e.text for e in ET.parse(packages / "toftwin" / "package.xml").getroot().iter("exec_depend")}  # noqa: S314
    sources = "\n".join(p.read_text() for p in (repository / "src").rglob("*.py"))
    imported = set(re.findall(r"^\s*(?:from|import) (rclpy|\w+_msgs|\w+_interfaces|std_srvs)\b", sources, re.MULTILINE))
    assert {"rclpy", "sensor_msgs"} <= imported <= depends


ROSDEP_NAMES = {"opencv-python-headless": "python3-opencv", "pillow": "python3-pil", "pyyaml": "python3-yaml"}
"""Keys of rosdep's own lists that are not `python3-NAME`."""


def test_every_python_dependency_has_a_key_that_rosdep_or_our_list_knows(packages: Path, repository: Path) -> None:
    depends = {e.text for e in ET.parse(packages / "toftwin" / "package.xml").getroot().iter("exec_depend")}  # noqa: S314
    own = yaml.safe_load((packages.parent / "rosdep.yaml").read_text())
    project = tomllib.loads((repository / "pyproject.toml").read_text())["project"]
    names = {re.split(r"[<>=\[ ]", line)[0] for line in project["dependencies"]}
    ours = {entry["ubuntu"]["pip"]["packages"][0]: key for key, entry in own.items()}
    assert set(ours) <= names
    assert all(entry["debian"] == entry["ubuntu"] for entry in own.values())
    wanted = {ours.get(name) or ROSDEP_NAMES.get(name) or f"python3-{name.replace('_', '-')}" for name in names}
    assert wanted <= depends
    assert {key for key in depends if key and key.startswith(("python3-", "toftwin-"))} == wanted


@pytest.mark.parametrize("name", [*PACKAGES, "toftwin_msgs"])
def test_the_changelog_is_one_that_bloom_reads(name: str, packages: Path) -> None:
    """REP 132: title of the package, then versions or Forthcoming, underlined, with bullets."""
    lines = (packages / name / "CHANGELOG.rst").read_text().splitlines()
    title = f"Changelog for package {name}"
    assert lines[:3] == ["^" * len(title), title, "^" * len(title)]
    version = ET.parse(packages / name / "package.xml").getroot().findtext("version")  # noqa: S314
    heads = [line for line, under in pairwise(lines) if under and set(under) == {"-"} and len(under) == len(line)]
    assert heads[0] == "Forthcoming" or heads[0].startswith(f"{version} (")
    assert [line for line in lines if line.startswith("* ")]


@pytest.mark.parametrize("name", [*PACKAGES, "toftwin_msgs"])
def test_every_package_declares_its_quality(name: str, packages: Path, repository: Path) -> None:
    """REP 2004: the level that is claimed, and what holds of each of its seven requirements."""
    text = (packages / name / "QUALITY_DECLARATION.md").read_text()
    assert text.startswith(f"# Quality declaration of `{name}` (REP 2004)\n")
    assert "**Quality Level 4**" in text
    assert [line[2:4] for line in text.splitlines() if line[2:3].isdigit()] == [f"{n} " for n in range(1, 8)]
    assert f"src/{name}/QUALITY_DECLARATION.md" in (repository / "ros_ws" / "README.md").read_text()


def test_the_parameter_file_is_what_the_configuration_says() -> None:
    make_params = import_module("make_params")
    assert make_params.FILE.read_text() == make_params.text(), "run .venv/bin/python scripts/make_params.py"


def test_the_parameter_file_holds_every_parameter_of_every_node_at_its_default() -> None:
    written = yaml.safe_load(import_module("make_params").FILE.read_text())
    for name, module in NODES.items():
        rows = {info.name: info.default for info in table(import_module(module).CONFIG)}
        assert written[f"/**/{name}"]["ros__parameters"] == rows


def topics_of(value: Any) -> Iterator[str]:
    """Every topic that a view names."""
    if isinstance(value, dict):
        for key, inner in value.items():
            if key in ("Value", "imageTopic", "topicPath", "topicToRender"):
                yield inner.lstrip("/")
            elif key == "topics":
                yield from (topic.lstrip("/") for topic in inner)
            else:
                yield from topics_of(inner)
    elif isinstance(value, list):
        for inner in value:
            yield from topics_of(inner)


def test_every_definition_of_toftwin_msgs_is_built(packages: Path) -> None:
    folder = packages / "toftwin_msgs"
    listed = set(re.findall(r'"((?:msg|action)/\w+\.(?:msg|action))"', (folder / "CMakeLists.txt").read_text()))
    assert listed == {str(path.relative_to(folder)) for kind in ("msg", "action") for path in (folder / kind).iterdir()}
    depends = {e.text for e in ET.parse(folder / "package.xml").getroot().iter("depend")}  # noqa: S314
    used = {found for path in folder.glob("*/*.*") for found in re.findall(r"^(\w+)/\w+(?:\[\])? ", path.read_text(), re.MULTILINE)}
    assert used - {"toftwin_msgs"} <= depends
    assert set(re.findall(r"find_package\((\w+) REQUIRED\)", (folder / "CMakeLists.txt").read_text())) >= used - {"toftwin_msgs"}


def test_every_typed_topic_and_action_of_a_node_is_defined(packages: Path) -> None:
    modules = [import_module(module) for module in NODES.values()]
    messages = {path.stem for path in (packages / "toftwin_msgs" / "msg").iterdir()}
    actions = {path.stem for path in (packages / "toftwin_msgs" / "action").iterdir()}
    named = {name for module in modules for name in getattr(module, "TYPED", {}).values()}
    assert named == {"Dwell", "InspectionVerdict", "CorrectionProposal", "GapReport"} <= messages
    assert {name for module in modules for name in getattr(module, "ACTIONS", {}).values()} == actions


@pytest.mark.parametrize("view", ["rviz/graph.rviz", "foxglove/graph.json"])
def test_views_show_topics_of_the_contract(view: str, packages: Path) -> None:
    text = (packages / "toftwin_bringup" / view).read_text()
    shown = set(topics_of(json.loads(text) if view.endswith("json") else yaml.safe_load(text)))
    published = {f"{DONE[name].partition('/')[0]}/{topic}" for name, module in NODES.items() for topic in import_module(module).OUTPUTS}
    latched = {topic for module in NODES.values() for topic in getattr(import_module(module), "SHARED", {})}
    promised = {"depth/hand/image", "diagnostics", "initialpose"}
    assert shown <= published | latched | promised
    assert {"scene/markers", "inspect/markers", "label/path"} <= shown
    assert {"depth/hand/image", "preproc/depth", "label/depth", "gap/residual", "correction/pose"} <= shown


def test_the_readme_s_command_puts_foxglove_s_topics_into_a_namespace(repository: Path, tmp_path: Path) -> None:
    layout = "ros_ws/src/toftwin_bringup/foxglove/graph.json"
    (command,) = re.findall(rf"sed '.*' {layout} > spot\.json", (repository / "ros_ws" / "README.md").read_text())
    subprocess.run(["bash", "-c", command.replace("> spot.json", f"> {tmp_path}/spot.json")], cwd=repository, check=True)
    plain, made = ((root / name).read_text() for root, name in ((repository, layout), (tmp_path, "spot.json")))
    absolute = re.findall(r'"(/[^"]*)"', plain)
    assert "/initialpose" in absolute
    assert re.findall(r'"(/[^"]*)"', made) == [topic if topic == "/diagnostics" else f"/spot{topic}" for topic in absolute]
    assert json.loads(made).keys() == json.loads(plain).keys()


def test_ros_arguments_are_handed_on_as_they_came() -> None:
    call = called(("preproc",), ["--ros-args", "-r", "__ns:=/spot", "--ros-args", "--params-file", "p.yaml"])
    assert call.nodes == ("preproc",)
    assert call.ros_args() == ["-r", "__ns:=/spot", "--params-file", "p.yaml"]


def test_the_names_of_nodes_that_run_together_come_before_the_arguments_of_ros() -> None:
    call = called_together(["preproc", "infer", "--ros-args", "--log-level", "info", "--ros-args", "-r", "__ns:=/spot"])
    assert call.nodes == ("preproc", "infer")
    assert call.ros_args() == ["--log-level", "info", "-r", "__ns:=/spot"]
    with pytest.raises(UsageError, match="no node named"):
        called_together(["--ros-args", "-r", "__ns:=/spot"])
    with pytest.raises(UsageError, match="'depth' is no node"):
        called_together(["depth"])


@pytest.mark.dds
def test_the_executable_takes_namespace_and_parameter_file_as_ros_gives_them(ros_domain: int, tmp_path: Path) -> None:
    from tof_ros.environment import ros_context
    from tof_ros.spin import spinning

    file = tmp_path / "graph.yaml"
    file.write_text(import_module("make_params").text().replace("preproc.sor.enable: true", "preproc.sor.enable: false"))
    code = "import sys; from toftwin.executables import preproc; sys.exit(preproc())"
    process = subprocess.Popen([sys.executable, "-c", code, "--ros-args", "-r", "__ns:=/spot", "--params-file", str(file)])
    try:
        with ros_context() as context:
            import rclpy
            from rcl_interfaces.srv import GetParameters

            node = rclpy.create_node("asker", context=context)
            client = node.create_client(GetParameters, "/spot/preproc/get_parameters")
            with spinning([node]):
                assert client.wait_for_service(60.0)
                answer = client.call(GetParameters.Request(names=["preproc.sor.enable", "preproc.sigma3.enable"]), timeout_sec=20.0)
        assert [v.bool_value for v in answer.values] == [False, True]
    finally:
        process.send_signal(signal.SIGTERM)
        time.sleep(0.1)
        assert process.wait(20) == 0
