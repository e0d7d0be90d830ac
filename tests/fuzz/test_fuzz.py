# SPDX-License-Identifier: Apache-2.0
"""Every door for foreign bytes: what fuzzing once found stays mended, and some thousand mutations of good input a run (`make fuzz` does the millions)."""

from __future__ import annotations

import os
import random
import subprocess
from pathlib import Path

import pytest

from tests.fuzz import run
from tests.fuzz.targets import DOORS, TARGETS

FOUND = Path(__file__).parent / "found"
MUTATIONS = {
    "image": 4000, "cloud": 3000, "config": 800, "scene": 800, "mesh": 300, "bag": 60, "dataset": 60, "onnx": 300,
    "compressed": 3000, "packed": 2000, "parameters": 800, "tf": 800, "reference": 200, "gap": 300,
}  # fmt: skip
NASTY = (b"\x00", b"\xff" * 4, b"\xff\xff\xff\x7f", b"[" * 64, b"&a *a", b"9" * 400, b"1e999", b"!!int ", b"\n", b"../")


def mutated(seed: bytes, rng: random.Random) -> bytes:
    """One to four bytes changed, pieces taken out, doubled or put in, or the end cut off."""
    data = bytearray(seed)
    for _ in range(rng.randint(1, 4)):
        at = rng.randrange(len(data) + 1)
        to = min(len(data), at + rng.randint(1, 8))
        match rng.randrange(5):
            case 0:
                data[at : at + 1] = bytes([rng.randrange(256)])
            case 1:
                del data[at:to]
            case 2:
                data[at:at] = data[at:to]
            case 3:
                data[at:to] = rng.choice(NASTY)
            case _:
                del data[len(data) - len(data) // rng.randint(2, 20) :]
    return bytes(data)


@pytest.mark.parametrize("name", TARGETS)
def test_foreign_bytes_give_a_result_or_one_line(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Anything that is raised here is not a ToftwinError."""
    if name == "onnx":
        pytest.importorskip("onnx", reason="making a network needs the extra `train`")
    restore_what_a_target_patches(monkeypatch)
    target, rng = TARGETS[name], random.Random(0)
    call = target.open(tmp_path)
    seeds = target.seeds(tmp_path)
    for data in [b"", *seeds, *(path.read_bytes() for path in sorted((FOUND / name).glob("*")))]:
        call(data)
    for _ in range(MUTATIONS[name]):
        call(mutated(rng.choice(seeds), rng))


def restore_what_a_target_patches(monkeypatch: pytest.MonkeyPatch) -> None:
    """Targets speed up what is not under test; other tests must not see that."""
    import difflib

    from rosbags.rosbag2 import storage_mcap
    from rosbags.serde import cdr, ros1

    from tof_core import edge
    from tof_scene import scene_file

    for module, name in (
        (edge, "BLOCK"),
        (difflib, "get_close_matches"),
        (scene_file, "load_mesh"),
        (storage_mcap, "parse_qos"),
        (cdr, "compile_lines"),
        (ros1, "compile_lines"),
    ):
        monkeypatch.setattr(module, name, vars(module)[name])


def test_what_is_found_is_of_a_target() -> None:
    assert {path.name for path in FOUND.iterdir()} <= TARGETS.keys()


def test_every_door_has_a_name_of_its_own() -> None:
    assert len(TARGETS) == len(DOORS)


@pytest.mark.parametrize(("processor_s", "hangs"), [(3.0, False), (9.0, False), (11.0, True), (None, True)])
def test_a_timeout_is_a_finding_where_the_processor_was_busy_with_it(
    monkeypatch: pytest.MonkeyPatch, processor_s: float | None, *, hangs: bool
) -> None:
    """Beside busy processes a call of milliseconds may take ten seconds of the clock; None: it does not end at all."""
    spent = [0.0]

    def call(command: list[str], **_: object) -> None:
        if processor_s is None:
            raise subprocess.TimeoutExpired(command, 600.0)
        spent[0] = processor_s

    monkeypatch.setattr(subprocess, "run", call)
    monkeypatch.setattr(os, "times", lambda: os.times_result((0.0, 0.0, 0.75 * spent[0], 0.25 * spent[0], 0.0)))
    assert run._hangs("packed", Path("timeout-0")) is hangs
    assert not run._hangs("packed", Path("slow-unit-0"))


def test_an_input_is_tried_again_by_itself(tmp_path: Path) -> None:
    (tmp_path / "timeout-0").write_bytes(b"\x00")
    assert run.again("compressed", tmp_path / "timeout-0") == 0
