# SPDX-License-Identifier: Apache-2.0
"""Small files that stand for gigabytes or minutes: each is refused, or read, within 1 GB and few times a peer's processor time by a process of its own (`-rP` prints all)."""

from __future__ import annotations

import json
import os
import sqlite3
import struct
import subprocess
import sys
import tempfile
import threading
import time
import zipfile
import zlib
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from backports import zstd

from tests.tof_core import bags

MOST_PEERS = 15.0
"""Most processor time, in units of the peer's: the peer takes a second on the hosts that these tests run on, which differ by a factor of two."""
PEER = """
known = {}
for i in range(2_000_000):
    known[f"frame{i}"] = (float(i), i)
    if len(known) > 10_000:
        known.clear()
"""
HUNG_S = 300.0
MOST_MB = 1000.0
GIGABYTE = 10**9
SRC = Path(__file__).parents[2] / "src"

REPORT = """
import atexit, os, sys
from pathlib import Path
from tof_core.errors import ToftwinError
def peak():
    # The kernel's own account of a child (ru_maxrss) begins with the memory of the process that started it.
    line = next(x for x in Path("/proc/self/status").read_text().splitlines() if x.startswith("VmHWM:"))
    Path(os.environ["PEAK"]).write_text(line.split()[1])
atexit.register(peak)
def attempt(call):
    try:
        call()
    except ToftwinError as error:
        print(str(error))
"""


def spent(code: str, *arguments: object, temporary: Path | None = None) -> str:
    """Output of a Python process that ran `code`, held to the bars of time and memory, which are printed."""
    with tempfile.TemporaryDirectory() as folder:
        return _spent(code, arguments, Path(folder) / "peak", {"TMPDIR": str(temporary)} if temporary else {})


def _spent(code: str, arguments: tuple[object, ...], peak: Path, more: dict[str, str]) -> str:
    environment = os.environ | {"PYTHONPATH": str(SRC), "PEAK": str(peak)} | more
    start = time.monotonic()
    with subprocess.Popen(
        [sys.executable, "-c", REPORT + code, *map(str, arguments)],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=environment,
    ) as process:  # fmt: skip
        late = threading.Timer(HUNG_S, process.kill)
        late.start()
        assert process.stdout is not None
        said = process.stdout.read()
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        late.cancel()
    seconds = usage.ru_utime + usage.ru_stime
    megabytes = (float(peak.read_text()) if peak.exists() else usage.ru_maxrss) * 1024 / 1e6
    sys.stdout.write(f"{seconds:.1f} s of processor ({time.monotonic() - start:.1f} s), {megabytes:.0f} MB: {said.strip()}\n")
    assert process.returncode == 0, said
    assert seconds < MOST_PEERS * peer_s()
    assert megabytes < MOST_MB
    return said


@cache
def peer_s() -> float:
    """Processor seconds that a process needs to file two million names in a dictionary."""
    with subprocess.Popen([sys.executable, "-c", PEER]) as process:
        _, _, usage = os.wait4(process.pid, 0)
        process.returncode = 0
    seconds = usage.ru_utime + usage.ru_stime
    sys.stdout.write(f"peer: {seconds:.1f} s of processor\n")
    return seconds


OPEN_BAG = "from tof_core.bag import open_bag\nattempt(lambda: open_bag(sys.argv[1], cell_frame='cell'))"


def zeros_as_zstd(size: int) -> bytes:
    """`size` zero bytes in one frame, made without holding them."""
    packer = zstd.ZstdCompressor()
    block = bytes(10**7)
    parts = [packer.compress(block) for _ in range(size // len(block))]
    return b"".join([*parts, packer.flush()])


def as_compressed(path: Path, mode: str) -> None:
    """Say in a bag's metadata that it is compressed."""
    file = path / "metadata.yaml"
    text = (
        file.read_text()
        .replace("compression_format: ''", "compression_format: zstd")
        .replace("compression_mode: ''", f"compression_mode: {mode}")
    )
    assert mode in text
    file.write_text(text)


def test_a_storage_file_that_unpacks_to_three_gigabytes(tmp_path: Path) -> None:
    path = bags.write(tmp_path / "bag")
    (storage,) = path.glob("*.mcap")
    as_compressed(path, "FILE")
    text = (path / "metadata.yaml").read_text()
    (path / "metadata.yaml").write_text(text.replace(storage.name, f"{storage.name}.zstd"))
    storage.with_name(f"{storage.name}.zstd").write_bytes(zeros_as_zstd(3 * GIGABYTE))
    storage.unlink()
    assert "unpack to more than 256000000 bytes" in spent(OPEN_BAG, path, temporary=tmp_path)


def test_a_compressed_storage_file_of_ordinary_size_is_read(tmp_path: Path) -> None:
    path = bags.write(tmp_path / "bag")
    (storage,) = path.glob("*.mcap")
    as_compressed(path, "FILE")
    text = (path / "metadata.yaml").read_text()
    (path / "metadata.yaml").write_text(text.replace(storage.name, f"{storage.name}.zstd"))
    storage.with_name(f"{storage.name}.zstd").write_bytes(zstd.compress(storage.read_bytes()))
    storage.unlink()
    assert spent("from tof_core.bag import open_bag\nprint(open_bag(sys.argv[1], cell_frame='cell').frame_count)", path) == "6\n"


def test_a_message_that_unpacks_to_four_gigabytes(tmp_path: Path) -> None:
    path = bags.write(tmp_path / "bag", bags.Session(storage="sqlite3"))
    as_compressed(path, "MESSAGE")
    (storage,) = path.glob("*.db3")
    with sqlite3.connect(storage) as db:
        rows = db.execute("SELECT id, data FROM messages").fetchall()
        db.executemany("UPDATE messages SET data = ? WHERE id = ?", [(zstd.compress(data), key) for key, data in rows])
        db.execute("UPDATE messages SET data = ? WHERE id = (SELECT MAX(id) FROM messages)", [zeros_as_zstd(4 * GIGABYTE)])
    assert "a compressed message of more than 64000000 bytes" in spent(OPEN_BAG, path)


def test_a_row_that_sqlite_would_make_up(tmp_path: Path) -> None:
    """A generated column: SQLite makes a gigabyte of zeros for each row of a file of some kilobytes."""
    path = bags.write(tmp_path / "bag", bags.Session(storage="sqlite3"))
    (storage,) = path.glob("*.db3")
    with sqlite3.connect(storage) as db:
        db.execute("CREATE TABLE other(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB AS (zeroblob(999999999)))")
        db.execute("INSERT INTO other(topic_id, timestamp) SELECT topic_id, timestamp FROM messages")
        db.execute("DROP TABLE messages")
        db.execute("ALTER TABLE other RENAME TO messages")
    assert "damaged or no bag" in spent(OPEN_BAG, path)


def test_a_metadata_file_that_swells_or_repeats(tmp_path: Path) -> None:
    path = bags.write(tmp_path / "bag")
    file = path / "metadata.yaml"
    text = file.read_text()
    (storage,) = path.glob("*.mcap")
    laughs = "".join(f"{b}: &{b} [{', '.join([f'*{a}'] * 9)}]\n" for a, b in zip("abcdefgh", "bcdefghi", strict=True))
    file.write_text("a: &a [x, x, x, x, x, x, x, x, x]\n" + laughs + text)
    assert "holds more than 100000 values" in spent(OPEN_BAG, path)
    file.write_text(text.replace(f"- {storage.name}", f"- {storage.name}\n  - {storage.name}", 1))
    assert "names a storage file twice" in spent(OPEN_BAG, path)


@pytest.fixture(scope="module")
def three_gigabytes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An .npz with one array of zero bytes, `depth`, deflated to a few megabytes: fast rather than small."""
    path, size = tmp_path_factory.mktemp("bomb") / "zeros.npz", 3 * GIGABYTE
    header = repr({"descr": "|u1", "fortran_order": False, "shape": (size,)}).encode()
    header += b" " * (-(len(header) + 11) % 64) + b"\n"
    fast = zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1)
    with fast as archive, archive.open("depth.npy", "w", force_zip64=True) as member:
        member.write(b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header)
        block = bytes(10**7)
        for _ in range(size // len(block)):
            member.write(block)
    return path


@pytest.mark.parametrize("name", ["reference", "gap_maps"])
def test_an_array_file_of_three_gigabytes(name: str, three_gigabytes: Path, tmp_path: Path) -> None:
    (tmp_path / f"{name}.npz").hardlink_to(three_gigabytes)
    (tmp_path / "reference.json").write_text('{"schema": "toftwin.reference/1"}')
    (tmp_path / "gap.json").write_text('{"verdict": []}')
    read = {
        "reference": "from arm_correction.reference import load_reference\nattempt(lambda: load_reference(sys.argv[1] + '/reference'))",
        "gap_maps": "from pathlib import Path\nfrom toftwin.viewing import draw_gap\nattempt(lambda: draw_gap(None, Path(sys.argv[1]), None))",
    }
    assert "arrays of more than 512000000 bytes" in spent(read[name], tmp_path)


def chunk(name: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))


def test_a_mask_of_four_thousand_million_pixels(tmp_path: Path) -> None:
    header = chunk(b"IHDR", struct.pack(">IIBBBBB", 65535, 65535, 8, 0, 0, 0, 0))
    (tmp_path / "mask.png").write_bytes(b"\x89PNG\r\n\x1a\n" + header + chunk(b"IDAT", zlib.compress(bytes(10**6))) + chunk(b"IEND", b""))
    said = spent("from tof_preproc.gates import load_mask\nattempt(lambda: load_mask(sys.argv[1]))", tmp_path / "mask.png")
    assert "mask.png: has 65535x65535 pixels; give self_mask.path a PNG" in said


LOAD_MESH = "from pathlib import Path\nfrom tof_scene.mesh_file import load_mesh\nattempt(lambda: load_mesh(Path(sys.argv[1])))"


def gltf(nodes: list[dict[str, Any]], **changed: object) -> dict[str, object]:
    """A glTF of one triangle, shown by the nodes that name mesh 0."""
    import base64

    data = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32).tobytes()
    return {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": nodes,
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "bufferViews": [{"buffer": 0, "byteLength": len(data)}],
        "buffers": [{"byteLength": len(data), "uri": "data:application/octet-stream;base64," + base64.b64encode(data).decode()}],
    } | changed


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (gltf([{"children": list(range(1, 200_000))}, *({"mesh": 0} for _ in range(199_999))]), "200000 nodes"),
        (gltf([{"children": [i + 1], "mesh": 0} for i in range(9_000)] + [{"mesh": 0}]), "levels deep"),
        (gltf([{"mesh": 0, "children": [0]}]), "levels deep"),
        (gltf([{"mesh": 0}], accessors=[{"componentType": 5126, "count": 10**10, "type": "VEC3"}]), "20000000000 vertices"),
        (gltf([{"mesh": 0}], bufferViews=[{"buffer": 0, "byteLength": 36_000_000}] * 20), "720000000 bytes in its buffer views"),
    ],
    ids=["wide", "deep", "a circle", "placeholder", "views"],
)  # fmt: skip
def test_a_gltf_file_without_end(content: dict[str, object], says: str, tmp_path: Path) -> None:
    (tmp_path / "a.gltf").write_text(json.dumps(content))
    assert says in spent(LOAD_MESH, tmp_path / "a.gltf")


@pytest.mark.parametrize("suffix", [".gltf", ".glb"])
def test_an_assembly_at_the_limit_is_read(suffix: str, tmp_path: Path) -> None:
    content = gltf([{"children": list(range(1, 9_000))}, *({"mesh": 0} for _ in range(8_999))])
    text = json.dumps(content).encode()
    path = tmp_path / f"a{suffix}"
    text += b" " * (-len(text) % 4)
    path.write_bytes(text if suffix == ".gltf" else struct.pack("<5I", 0x46546C67, 2, 20 + len(text), len(text), 0x4E4F534A) + text)
    assert (
        spent("from pathlib import Path\nfrom tof_scene.mesh_file import load_mesh\nprint(len(load_mesh(Path(sys.argv[1]))[1]))", path)
        == "8999\n"
    )


def test_transforms_in_backward_order(tmp_path: Path) -> None:
    code = """
import math
from tof_core.tf import TransformBuffer
buffer, motion = TransformBuffer(), (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
for i in range(200_000, 0, -1):
    buffer._put("a", "b", 1_000_000 * i, (float(i), *motion[1:]), static=False)
print(buffer.lookup("a", "b", 123_456_500_000)[0, 3])
"""
    assert float(spent(code)) == pytest.approx(123456.5)


TRANSFORMS = """
from types import SimpleNamespace as S
from tof_core.tf import TransformBuffer
from tof_core.bounds import MOST_FRAMES
motion = S(translation=S(x=0.0, y=0.0, z=0.0), rotation=S(x=0.0, y=0.0, z=0.0, w=1.0))
transform = S(header=S(frame_id="cell", stamp=S(sec=0, nanosec=0)), child_frame_id="", transform=motion)
message = S(transforms=[transform])
def said(child, i):
    transform.child_frame_id, transform.header.stamp.sec, transform.header.stamp.nanosec = child, i // 1000, i % 1000 * 1_000_000
    return message
"""


def test_three_hundred_thousand_frames_live_are_forgotten_and_the_camera_is_kept() -> None:
    code = """
buffer = TransformBuffer(keep_s=10.0)
for i in range(300_000):
    buffer.add_message(said(f"frame{i}", i))
    if i % 1000 == 0:
        buffer.add_message(said("camera", i))
print(len(buffer.frames()) <= MOST_FRAMES + 1, buffer.connected("cell", "camera"), buffer.connected("cell", "frame1"))
"""
    assert spent(TRANSFORMS + code) == "True True False\n"


def test_three_hundred_thousand_frames_of_a_bag_are_refused_beyond_the_limit() -> None:
    code = """
buffer, refused = TransformBuffer(), 0
for i in range(300_000):
    try:
        buffer.add_message(said(f"frame{i}", i))
    except ToftwinError as error:
        refused, last = refused + 1, error
print(len(buffer.frames()) - 1, refused, last)
"""
    said = spent(TRANSFORMS + code)
    assert said.startswith("10000 290000 /tf: has more than 10000 frames")


def test_a_transform_message_of_a_million_frames_is_refused_unread(tmp_path: Path) -> None:
    from tof_core.bag_writer import BagWriter

    path = tmp_path / "bag"
    with BagWriter(path, "mcap", "jazzy") as bag:
        bag.tf(bags.START, [("cell", f"frame{i}", np.eye(4)) for i in range(100_000)])
    assert "a message of" in spent(OPEN_BAG, path)
