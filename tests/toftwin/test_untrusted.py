# SPDX-License-Identifier: Apache-2.0
"""What comes from outside is not trusted: paths, archives, YAML, pickles, what a report shows; and nothing listens on the network."""

from __future__ import annotations

import ast
import json
import os
import re
import signal
import subprocess
import sys
import time
import zipfile
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np
import pytest
import trimesh
from backports import zstd

from tests.tof_core import bags
from tof_core.bag_files import deserialize, open_files
from tof_core.bounds import LARGEST_CHUNK
from tof_core.decode import camera_from_info
from tof_core.encode import camera_info_fields
from tof_core.errors import BagError, CameraError, ConfigError, SceneError, ToftwinError
from tof_core.unpack import unpack
from tof_core.yamlio import DEEPEST, parse_yaml
from tof_scene.scene_file import load_scene

if TYPE_CHECKING:
    from collections.abc import Iterator

SOURCES = sorted((Path(__file__).parents[2] / "src").rglob("*.py"))
DDS_PORTS = range(7000, 32768)
"""Where DDS listens for discovery and data, for domains up to 101; Linux gives the ports above to sockets that only send."""


def scene(folder: Path, mesh: str) -> Path:
    (folder / "cell").mkdir()
    (folder / "cell" / "scene.yaml").write_text(f"frame: cell\nparts:\n- {{name: a, mesh: {mesh}}}\n")
    return folder / "cell"


def box(path: Path) -> Path:
    trimesh.creation.box((0.1, 0.1, 0.1)).export(path)
    return path


@pytest.mark.parametrize("mesh", ["../out.stl", "link.stl", "folder/../../out.stl", "{outside}"])
def test_a_mesh_outside_the_scenes_folder_is_refused_however_it_is_named(mesh: str, tmp_path: Path) -> None:
    outside = box(tmp_path / "out.stl")
    folder = scene(tmp_path, mesh.format(outside=outside))
    (folder / "folder").mkdir()
    (folder / "link.stl").symlink_to(outside)
    with pytest.raises(SceneError, match="lies outside the scene's folder"):
        load_scene(folder)


def test_a_mesh_file_cannot_name_files_outside_its_folder(tmp_path: Path) -> None:
    """A glTF whose triangles lie in a file of the parent folder."""
    folder = scene(tmp_path, "a.gltf")
    for name, data in trimesh.Scene(trimesh.creation.box((0.1, 0.1, 0.1))).export(file_type="gltf").items():
        (folder / ("a.gltf" if name.endswith(".gltf") else name)).write_bytes(data)
    assert len(load_scene(folder).parts[0].faces) == 12
    text = json.loads((folder / "a.gltf").read_text())
    for buffer in text["buffers"]:
        (folder / buffer["uri"]).rename(tmp_path / buffer["uri"])
        buffer["uri"] = f"../{buffer['uri']}"
    (folder / "a.gltf").write_text(json.dumps(text))
    with pytest.raises(SceneError, match="cannot be read"):
        load_scene(folder)


@pytest.mark.parametrize("name", ["a.zip", "a.stl.gz", "a.tar.bz2"])
def test_an_archive_is_no_mesh(name: str, tmp_path: Path) -> None:
    folder = scene(tmp_path, name)
    with zipfile.ZipFile(folder / name, "w") as archive:
        archive.writestr("a.stl", box(tmp_path / "a.stl").read_bytes())
    with pytest.raises(SceneError, match="is an archive"):
        load_scene(folder)


def test_a_chunk_is_unpacked_no_further_than_it_says() -> None:
    bomb = zstd.compress(bytes(10_000_000))
    assert len(bomb) < 2000
    assert unpack(zstd.compress(b"abc"), "zstd", 3) == b"abc"
    with pytest.raises(BagError, match="larger than the 1000 bytes that its header states"):
        unpack(bomb, "zstd", 1000)
    with pytest.raises(BagError, match="holds a chunk of"):
        unpack(bomb, "zstd", LARGEST_CHUNK + 1)


def test_rosbags_unpacks_chunks_by_the_same_rule(tmp_path: Path) -> None:
    from rosbags.rosbag2 import storage_mcap

    open_files(bags.write(tmp_path / "bag")).close()
    with pytest.raises(BagError, match="larger than the 10 bytes"):
        storage_mcap.DECOMPRESSORS["zstd"](zstd.compress(bytes(1000)), 10)


def test_a_definition_that_would_take_minutes_to_compile_is_refused(tmp_path: Path) -> None:
    from rosbags.typesys import get_types_from_msg

    files = open_files(bags.write(tmp_path / "bag"))
    files.types.fielddefs.update(get_types_from_msg("string[100000] names", "evil/msg/Long"))
    files.topics["/evil"] = type(next(iter(files.topics.values())))("/evil", "evil/msg/Long", 1)
    start = time.monotonic()
    with pytest.raises(BagError, match="100000 elements"):
        deserialize(files, "/evil", bytes(8))
    assert time.monotonic() - start < 1.0
    files.close()


def test_a_camera_of_gigabytes_is_refused() -> None:
    fields = camera_info_fields(replace(bags.CAMERA, width=60_000, height=60_000))
    header = SimpleNamespace(frame_id="camera")
    with pytest.raises(CameraError, match="states 60000x60000 pixels"):
        camera_from_info(SimpleNamespace(**fields, header=header, roi=SimpleNamespace(x_offset=0, y_offset=0, width=0, height=0)), "info")


LAUGHS = "a: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{b}: &{b} [{', '.join([f'*{a}'] * 9)}]\n" for a, b in zip("abcdefgh", "bcdefghi", strict=True)
)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (LAUGHS, "holds more than 100000 values"),
        ("[" * 100_000, f"nested more than {DEEPEST} levels"),
        ("a: &a {b: *a}", "stands within itself"),
        ("a: !!python/object/apply:os.system ['true']", "could not determine a constructor"),
        ("a: !!int ''", "is no valid YAML"),
        ("a: 1\na: 2", "given twice"),
    ],
    ids=["swells", "deep", "within itself", "code", "empty number", "twice"],
)
def test_yaml_is_refused_where_it_is_foreign_code_or_without_end(text: str, says: str) -> None:
    """Nine lines of aliases stand for gigabytes, and libyaml ends the process some thousand levels down."""
    with pytest.raises(ConfigError, match=re.escape(says)):
        parse_yaml(text)


def test_aliases_that_stay_small_are_read() -> None:
    assert parse_yaml("a: &a {b: 1}\nc: *a\n") == {"a": {"b": 1}, "c": {"b": 1}}


def calls(path: Path) -> Iterator[tuple[str, ast.Call]]:
    """Dotted name and call of everything that a file calls."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Call):
            yield ast.unparse(node.func), node


def test_nothing_reads_pickles_or_runs_a_shell() -> None:
    for path in SOURCES:
        for name, call in calls(path):
            flags = {word.arg: ast.unparse(word.value) for word in call.keywords}
            assert not re.match(
                r"(pickle|dill|joblib|shelve|marshal)\.|eval$|exec$|os\.(system|popen)$|yaml\.(unsafe_load|full_load)$", name
            ), (path, name)
            assert flags.get("allow_pickle", "False") == "False", path
            assert flags.get("shell", "False") == "False", path
            assert name != "torch.load" or flags["weights_only"] == "True", path


def test_an_array_file_that_holds_a_pickle_is_refused(tmp_path: Path) -> None:
    from toftwin.viewing import draw_gap

    (tmp_path / "gap.json").write_text('{"verdict": []}')
    np.savez(tmp_path / "gap_maps.npz", view_stamp_ns=np.array([{"a": 1}], object))
    with pytest.raises(ToftwinError, match="is no gap report"):
        draw_gap(None, tmp_path, None)  # type: ignore[arg-type]


def test_reports_escape_what_they_show() -> None:
    """Each environment escapes and no template asks it not to; tests/tof_inspect/test_report.py has a part whose name is markup."""
    found = [path for path in SOURCES if "Environment(" in path.read_text()]
    assert found
    for path in found:
        (made,) = [call for name, call in calls(path) if name == "Environment"]
        assert {word.arg: ast.unparse(word.value) for word in made.keywords}["autoescape"] == "True", path
    templates = list((Path(__file__).parents[2] / "src").rglob("*.j2"))
    assert len(templates) >= 5
    for template in templates:
        assert not re.search(r"\|\s*safe|autoescape", template.read_text()), template


def sockets(pid: int) -> list[tuple[str, str, int, bool]]:
    """(protocol, address, port, listening for connections) of a process's Internet sockets."""
    held = {m[1] for fd in Path(f"/proc/{pid}/fd").iterdir() if (m := re.match(r"socket:\[(\d+)\]", str(fd.readlink())))}
    found = []
    for protocol in ("tcp", "tcp6", "udp", "udp6"):
        for line in Path(f"/proc/{pid}/net/{protocol}").read_text().splitlines()[1:]:
            fields = line.split()
            address, port = fields[1].split(":")
            if fields[9] in held:
                found.append((protocol, address, int(port, 16), fields[3] == "0A"))
    return found


@pytest.mark.parametrize(
    ("given", "profile"),
    [
        ({}, "this_host.xml"),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}, ""),
        ({"PROFILES": "mine.xml"}, "mine.xml"),
        ({"FASTDDS_BUILTIN_TRANSPORTS": "UDPv4"}, ""),
    ],
)
def test_who_asks_for_the_network_gets_it(given: dict[str, str], profile: str, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("rclpy", reason="no ROS 2 here")
    from tof_ros.environment import TRANSPORT_CHOICES, keep_to_this_host, profile_variable

    given = {profile_variable() if name == "PROFILES" else name: value for name, value in given.items()}
    for name in ("ROS_AUTOMATIC_DISCOVERY_RANGE", *TRANSPORT_CHOICES):
        monkeypatch.setenv(name, "")  # so that what is set below is undone
        monkeypatch.delenv(name)
    for name, value in given.items():
        monkeypatch.setenv(name, value)
    keep_to_this_host()
    assert os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] == given.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    assert Path(os.environ.get(profile_variable(), "")).name == profile


@pytest.mark.dds
@pytest.mark.skipif(not Path("/proc/self/net/udp").exists(), reason="sockets are listed from Linux's /proc")
def test_a_running_node_listens_on_this_host_alone(ros_domain: int) -> None:
    """The ports of DDS are bound on the loopback interface; no TCP port is open; discovery stays here."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("ROS_AUTOMATIC", "FASTRTPS", "FASTDDS"))}
    command = [sys.executable, "-m", "toftwin.cli", "node", "preproc"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, env=environment, text=True) as node:
        try:
            assert node.stdout is not None
            assert any("running" in line for line in node.stdout)
            found = sockets(node.pid)
        finally:
            node.send_signal(signal.SIGINT)
            node.communicate(timeout=30)
    listening = {port: address for protocol, address, port, _ in found if protocol.startswith("udp") and port in DDS_PORTS}
    assert len(listening) >= 2
    assert set(listening.values()) == {"0100007F"}, found
    assert not [s for s in found if s[3]], found
    assert not [s for s in found if s[0].startswith("tcp")], found


def test_labelling_opens_no_socket() -> None:
    """Everything of a command that is not a node is imported; none of it opens an Internet socket."""
    code = (
        "import os, re; import toftwin.labelling, tof_align.session, tof_scene.raycast, tof_sim_label.labeller, tof_infer.session, tof_gap.diagnose; "
        "held = [os.readlink(f'/proc/self/fd/{fd}') for fd in os.listdir('/proc/self/fd') if os.path.exists(f'/proc/self/fd/{fd}')]; "
        "print(sum(h.startswith('socket') for h in held))"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip() == "0"
