# SPDX-License-Identifier: Apache-2.0
"""Bad input through the command line: one line that says what and where, nothing half written."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import trimesh

from tof_core.bag import open_bag
from tof_core.bag_writer import BagWriter
from tof_core.decode import pixels
from tof_core.encode import image_fields
from tof_core.typestores import typestore_of
from tof_scene.builtin import write_builtin
from toftwin import cli

if TYPE_CHECKING:
    from collections.abc import Callable

GOLDEN = Path(__file__).parents[1] / "data" / "golden" / "bag"
DEPTH, INFO = "/depth/hand/image", "/depth/hand/camera_info"


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_builtin("body_section", tmp_path_factory.mktemp("scene"))


def rewritten(target: Path, change: Callable[[str, Any], Any]) -> Path:
    """The golden bag with each message passed through `change(topic, message)`; None drops it."""
    types = typestore_of("jazzy")
    with open_bag(GOLDEN) as reader, BagWriter(target) as writer:
        for raw in reader.messages():
            message = change(raw.topic, reader.deserialize(raw))
            if message is not None:
                writer.raw(raw.topic, raw.type, bytes(types.serialize_cdr(message, raw.type)), raw.log_ns)
    return target


def refused(capsys: pytest.CaptureFixture[str], bag: Path, scene: Path, out: Path, *flags: str, code: int = 1) -> str:
    """The one line with which `toftwin label` refuses."""
    assert cli.main(["label", str(bag), "--scene", str(scene), "--out", str(out), "--mode", "robot", *flags]) == code
    said = capsys.readouterr()
    assert said.err.count("\n") == 1, said.err
    assert "Traceback" not in said.err
    assert not (out / "dataset.zarr").exists()
    return said.err.removeprefix("toftwin: ")


def test_no_bag(capsys: pytest.CaptureFixture[str], scene: Path, tmp_path: Path) -> None:
    assert refused(capsys, tmp_path / "nowhere", scene, tmp_path / "out", code=2).startswith(f"{tmp_path}/nowhere: does not exist")


def test_a_truncated_bag_is_refused_and_says_what_can_be_had(capsys: pytest.CaptureFixture[str], scene: Path, tmp_path: Path) -> None:
    cut = Path(shutil.copytree(GOLDEN, tmp_path / "cut"))
    file = next(cut.glob("*.mcap"))
    file.write_bytes(file.read_bytes()[: file.stat().st_size * 2 // 3])
    assert "pass --recover" in refused(capsys, cut, scene, tmp_path / "out")
    assert cli.main(["label", str(cut), "--scene", str(scene), "--out", str(tmp_path / "out"), "--mode", "robot", "--recover"]) == 0
    out = capsys.readouterr().out
    assert "recording was not finished" in out


def test_no_camera_info(capsys: pytest.CaptureFixture[str], scene: Path, tmp_path: Path) -> None:
    bag = rewritten(tmp_path / "bag", lambda topic, m: None if "camera_info" in topic else m)
    assert "has no CameraInfo beside '/depth/hand/image'; record /depth/hand/camera_info too" in refused(
        capsys, bag, scene, tmp_path / "out"
    )


def test_uncalibrated_camera(capsys: pytest.CaptureFixture[str], scene: Path, tmp_path: Path) -> None:
    def change(topic: str, m: Any) -> Any:
        if topic == INFO:
            m.k = np.array([0.0, *m.k[1:]])
        return m

    assert "/depth/hand/camera_info: is uncalibrated (K[0] = 0" in refused(
        capsys, rewritten(tmp_path / "bag", change), scene, tmp_path / "out"
    )


def test_sizes_that_disagree(capsys: pytest.CaptureFixture[str], scene: Path, tmp_path: Path) -> None:
    def change(topic: str, m: Any) -> Any:
        if topic == INFO:
            m.width = 64
        return m

    line = refused(capsys, rewritten(tmp_path / "bag", change), scene, tmp_path / "out")
    assert "image is 56x43 but its camera_info says 64x43" in line


def test_unknown_encoding(capsys: pytest.CaptureFixture[str], scene: Path, tmp_path: Path) -> None:
    def change(topic: str, m: Any) -> Any:
        if topic == DEPTH:
            m.encoding = "bayer_rggb8"
        return m

    assert "bayer_rggb8" in refused(capsys, rewritten(tmp_path / "bag", change), scene, tmp_path / "out", "--depth-topic", DEPTH)


def test_big_endian_and_padded_rows_are_decoded_right(tmp_path: Path) -> None:
    def change(topic: str, m: Any) -> Any:
        if topic == DEPTH:
            for name, value in image_fields(pixels(m), m.encoding, step=160, bigendian=True).items():
                setattr(m, name, value)
        return m

    with open_bag(rewritten(tmp_path / "bag", change)) as odd, open_bag(GOLDEN) as plain:
        for a, b in zip(odd.captures(), plain.captures(), strict=True):
            np.testing.assert_array_equal(a.depth, b.depth)


def test_no_tf_at_all(capsys: pytest.CaptureFixture[str], scene: Path, tmp_path: Path) -> None:
    bag = rewritten(tmp_path / "bag", lambda topic, m: None if topic.startswith("/tf") else m)
    assert "no transform has come on /tf or /tf_static; publish both (and record both); where nothing moves, --initial-pose" in refused(
        capsys, bag, scene, tmp_path / "out"
    )


def test_a_gap_in_tf_is_counted_and_reported(capsys: pytest.CaptureFixture[str], scene: Path, tmp_path: Path) -> None:
    with open_bag(GOLDEN) as reader:
        middle = [c.stamp_ns for c in reader.captures()][4]

    def change(topic: str, m: Any) -> Any:
        stamp = m.transforms[0].header.stamp if topic == "/tf" else None
        return None if stamp and abs(stamp.sec * 10**9 + stamp.nanosec - middle) < 120_000_000 else m

    bag = rewritten(tmp_path / "bag", change)
    assert cli.main(["label", str(bag), "--scene", str(scene), "--out", str(tmp_path / "out"), "--mode", "robot"]) == 0
    assert "skipped: no transform " in capsys.readouterr().out


def test_a_scene_frame_that_tf_does_not_have(capsys: pytest.CaptureFixture[str], scene: Path, tmp_path: Path) -> None:
    other = Path(shutil.copytree(scene.parent, tmp_path / "scene")) / "scene.yaml"
    other.write_text(other.read_text().replace("frame: cell", "frame: hall"))
    line = refused(capsys, GOLDEN, other, tmp_path / "out")
    assert "TF does not have the cell frame 'hall'" in line
    assert "--cell-frame (TF has arm_link_sh1" in line


def broken_scene(folder: Path, mesh: trimesh.Trimesh | None = None, name: str = "part.stl") -> Path:
    folder.mkdir()
    if mesh is not None:
        mesh.export(folder / "part.stl")
    (folder / "scene.yaml").write_text(f"frame: cell\nparts:\n- name: part\n  mesh: {name}\n  inspect: true\n")
    return folder / "scene.yaml"


def box(size: float = 0.4) -> trimesh.Trimesh:
    return trimesh.creation.box((size, size, size))


def test_a_mesh_with_nan(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    path = broken_scene(tmp_path / "scene", box())
    data = bytearray((path.parent / "part.stl").read_bytes())
    data[84 + 12 : 84 + 16] = np.float32(np.nan).tobytes()
    (path.parent / "part.stl").write_bytes(bytes(data))
    line = refused(capsys, GOLDEN, path, tmp_path / "out")
    assert "NaN" in line
    assert "part.stl" in line


def test_an_empty_mesh(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    path = broken_scene(tmp_path / "scene")
    (path.parent / "part.stl").write_bytes(bytes(84))
    assert "part.stl" in refused(capsys, GOLDEN, path, tmp_path / "out")


def test_a_mesh_in_millimetres(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert "scale: 0.001" in refused(capsys, GOLDEN, broken_scene(tmp_path / "scene", box(400.0)), tmp_path / "out")


def test_a_mesh_outside_the_scenes_folder(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    box().export(tmp_path / "outside.stl")
    assert "outside" in refused(capsys, GOLDEN, broken_scene(tmp_path / "scene", name="../outside.stl"), tmp_path / "out")


def test_a_mesh_that_is_not_watertight_is_fine(tmp_path: Path) -> None:
    path = write_builtin("body_section", tmp_path / "scene")
    mesh = max((path.parent / "meshes").iterdir(), key=lambda p: p.stat().st_size)
    torn = trimesh.load_mesh(mesh, process=False)
    torn.update_faces(np.arange(len(torn.faces)) % 50 > 0)
    torn.export(mesh)
    assert not torn.is_watertight
    assert cli.main(["label", str(GOLDEN), "--scene", str(path), "--out", str(tmp_path / "out"), "--mode", "robot"]) == 0


def test_a_full_disk_is_one_line_and_leaves_no_dataset(scene: Path, tmp_path: Path) -> None:
    """No file may grow beyond 4 kB, which a frame's chunk does."""
    code = (
        "import resource, signal, sys; signal.signal(signal.SIGXFSZ, signal.SIG_IGN); resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096)); "
        "from toftwin import cli; sys.exit(cli.main(sys.argv[1:]))"
    )
    flags = ["label", str(GOLDEN), "--scene", str(scene), "--out", str(tmp_path / "out"), "--mode", "robot"]
    done = subprocess.run([sys.executable, "-c", code, *flags], capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1, done.stderr
    assert "dataset.zarr" in done.stderr
    assert not (tmp_path / "out" / "dataset.zarr").exists()


def test_every_frame_before_a_killed_recorder_is_readable(tmp_path: Path) -> None:
    flags = ["simulate", "--scene", "body_section", "--out", str(tmp_path / "bag"), "--views", "40", "--size", "112x86"]
    recorder = subprocess.Popen([sys.executable, "-m", "toftwin.cli", *flags], stdout=subprocess.DEVNULL)
    file = tmp_path / "bag" / "bag.mcap"
    # However slow the host is: what the recorder takes to begin is not asked here (a run that hangs is ended by the suite's time limit).
    while not (file.exists() and file.stat().st_size > 600_000):
        assert recorder.poll() is None, "the recording ended before it could be killed"
        time.sleep(0.02)
    os.kill(recorder.pid, signal.SIGKILL)
    recorder.wait()
    with open_bag(tmp_path / "bag") as reader:
        frames = [c for c in reader.captures() if np.isfinite(c.depth).any()]
        assert len(frames) >= reader.frame_count - 1 > 5
        assert "not finished" in reader.note
