# SPDX-License-Identifier: Apache-2.0
"""An appended frame is never lost: processes killed between any two writes, and disks that fill at any of them."""

from __future__ import annotations

import errno
import json
import os
import random
import resource
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
import zarr
from zarr.codecs import BloscCodec

from tests.tof_sim_label.made import ATTRIBUTES, CAMERA, capture, label, view
from tof_core.errors import DatasetError
from tof_sim_label.dataset import DatasetWriter, open_dataset
from tof_sim_label.schema import COLUMNS
from tof_sim_label.store import array_meta, create

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import IO

RECORDER = """
import sys
from tests.tof_sim_label.made import *
from tof_sim_label.dataset import DatasetWriter, open_dataset
path = sys.argv[1]
with DatasetWriter(path, CAMERA, ATTRIBUTES) as writer:
    while True:
        print("capture", writer.append_capture(capture(writer.captures)), flush=True)
        if writer.captures % 3 == 0:
            print("view", writer.append_view(view(writer.views), label(writer.views)), flush=True)
"""


def acknowledged(lines: list[str], what: str) -> int:
    """Number of frames of a kind that were acknowledged to the recorder."""
    return max((int(line.split()[1]) + 1 for line in lines if line.startswith(what)), default=0)


def must_be_whole(path: Path, captures: int, views: int) -> None:
    """At least so many frames are there, and each is what was appended."""
    data = open_dataset(path)
    assert data.captures >= captures
    assert data.views >= views
    for i in range(data.captures):
        np.testing.assert_array_equal(data.frame("captures/raw", i), capture(i).depth)
    for i in range(data.views):
        np.testing.assert_array_equal(data.frame("views/label", i), label(i).depth)
    assert len(data.verdicts) == data.views
    np.testing.assert_array_equal(data.column("captures/stamp_ns"), 1_000 + np.arange(data.captures))


@pytest.mark.parametrize(("group", "name"), [(group, name) for group, columns in COLUMNS.items() for name in columns])
def test_the_metadata_of_an_array_are_those_that_zarr_writes(group: str, name: str, tmp_path: Path) -> None:
    column = COLUMNS[group][name]
    frame, dtype = column.frame_shape(CAMERA), np.dtype(column.dtype)
    zarr.create_array(
        tmp_path,
        shape=(0, *frame),
        chunks=(1, *frame),
        dtype=dtype,
        compressors=BloscCodec(typesize=dtype.itemsize, cname="zstd", clevel=1, shuffle="bitshuffle") if column.image else None,
        fill_value=np.nan if dtype.kind == "f" else 0,
        chunk_key_encoding={"name": "default", "separator": "."},
    )
    assert array_meta(column, CAMERA) == json.loads((tmp_path / "zarr.json").read_text())


def test_the_metadata_of_a_group_are_those_that_zarr_writes(tmp_path: Path) -> None:
    zarr.create_group(tmp_path / "zarr", attributes={"schema": "x"})
    create(tmp_path / "ours", CAMERA, {"schema": "x"})
    assert json.loads((tmp_path / "ours/zarr.json").read_text()) == json.loads((tmp_path / "zarr/zarr.json").read_text())


def test_a_killed_recorder_loses_no_acknowledged_frame(tmp_path: Path, repository: Path) -> None:
    path, dice = tmp_path / "d", random.Random(7)
    for _ in range(4):
        with subprocess.Popen([sys.executable, "-c", RECORDER, path], stdout=subprocess.PIPE, text=True, cwd=repository) as recorder:
            assert recorder.stdout is not None
            lines = [recorder.stdout.readline()]
            time.sleep(dice.uniform(0.0, 0.15))
            recorder.send_signal(signal.SIGKILL)
            lines += rest(recorder.stdout)
        must_be_whole(path, acknowledged(lines, "capture"), acknowledged(lines, "view"))


def rest(stream: IO[str]) -> list[str]:
    """Complete lines left in the pipe; an incomplete last line is dropped."""
    return [line for line in stream.read().splitlines(keepends=True) if line.endswith("\n")]


class SystemCalls:
    """Counts every sync and rename; at `full_at` and after it the disk is full, at `dies_at` the process is killed."""

    full_at = dies_at = 0

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self._lock, self._count = threading.Lock(), 0
        for owner, name in ((os, "fsync"), (Path, "replace")):
            patch.setattr(owner, name, self._counted(getattr(owner, name)))

    def start(self, *, full_at: int = 0, dies_at: int = 0) -> None:
        self._count, self.full_at, self.dies_at = 0, full_at, dies_at

    def _counted(self, real: Callable[..., object]) -> Callable[..., object]:
        def call(*args: object) -> object:
            with self._lock:
                self._count += 1
                if self._count == self.dies_at:
                    os.kill(os.getpid(), signal.SIGKILL)
                if self.full_at and self._count >= self.full_at:
                    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            return real(*args)

        return call


@pytest.fixture
def system_calls(monkeypatch: pytest.MonkeyPatch) -> SystemCalls:
    return SystemCalls(monkeypatch)


@pytest.mark.parametrize("kind", ["capture", "view"])
def test_a_disk_that_fills_at_any_write_costs_the_frame_alone(tmp_path: Path, system_calls: SystemCalls, kind: str) -> None:
    path, messages = tmp_path / "d", set[str]()
    with DatasetWriter(path, CAMERA, ATTRIBUTES) as writer:
        append_one(writer, kind)
        for fails_at in range(1, 1000):
            kept = writer.captures + writer.views
            system_calls.start(full_at=fails_at)
            try:
                append_one(writer, kind)
            except DatasetError as error:
                messages.add(str(error))
                data = open_dataset(path)
                # Failing after the rename that commits is the one case in which the frame is there.
                assert data.captures + data.views in {kept, kept + 1}
            else:
                break
        system_calls.start()
    assert fails_at > 20, "every file of the frame was made to fail"
    assert messages == {
        f"{path}: cannot be written (No space left on device); every frame before is kept; free some space or name another folder"
    }
    with DatasetWriter(path, CAMERA, ATTRIBUTES) as writer:
        kept = writer.captures + writer.views
    must_be_whole(path, kept * (kind == "capture"), kept * (kind == "view"))


@pytest.mark.filterwarnings("ignore:.*multi-threaded.*fork:DeprecationWarning")
@pytest.mark.parametrize("kind", ["capture", "view"])
def test_a_kill_between_any_two_writes_leaves_a_whole_dataset(tmp_path: Path, system_calls: SystemCalls, kind: str) -> None:
    path = tmp_path / "d"
    DatasetWriter(path, CAMERA, ATTRIBUTES).close()
    for dies_at in range(1, 1000, 1 if kind == "capture" else 3):
        with DatasetWriter(path, CAMERA, ATTRIBUTES) as writer:
            kept = writer.captures + writer.views
            finished = in_a_child_that_dies(dies_at, system_calls, lambda: append_one(writer, kind))
        data = open_dataset(path)
        assert data.captures + data.views in ({kept + 1} if finished else {kept, kept + 1})
        must_be_whole(path, data.captures, data.views)
        if finished:
            break
    assert dies_at > 20, "the child was killed between any two writes"


def append_one(writer: DatasetWriter, kind: str) -> None:
    """One more frame of the kind."""
    if kind == "capture":
        writer.append_capture(capture(writer.captures))
    else:
        writer.append_view(view(writer.views), label(writer.views))


def in_a_child_that_dies(at: int, system_calls: SystemCalls, work: Callable[[], None]) -> bool:
    """Do the work in a forked process that kills itself at that system call; returns whether it finished."""
    child = os.fork()
    if child == 0:
        system_calls.start(dies_at=at)
        work()
        os._exit(0)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0


def test_a_real_limit_of_the_system_is_one_line_and_the_writer_goes_on(tmp_path: Path) -> None:
    path = tmp_path / "d"
    noisy = capture(0)
    noisy.depth[:] = np.random.default_rng(0).normal(size=noisy.depth.shape)
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    ignored = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    with DatasetWriter(path, CAMERA, ATTRIBUTES) as writer:
        writer.append_capture(noisy)
        try:
            resource.setrlimit(resource.RLIMIT_FSIZE, (100, before[1]))
            with pytest.raises(DatasetError, match="cannot be written"):
                writer.append_capture(noisy)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)
            signal.signal(signal.SIGXFSZ, ignored)
        writer.append_capture(noisy)
    data = open_dataset(path)
    assert data.captures == 2
    assert not list(path.rglob("*.part"))
    np.testing.assert_array_equal(data.frame("captures/raw", 1), noisy.depth)


def test_a_dataset_that_cannot_be_made_leaves_nothing(tmp_path: Path, system_calls: SystemCalls) -> None:
    system_calls.start(full_at=1)
    with pytest.raises(DatasetError, match="No space left"):
        DatasetWriter(tmp_path / "d", CAMERA, ATTRIBUTES)
    assert not [p for p in tmp_path.iterdir() if p.name.startswith(".")]
