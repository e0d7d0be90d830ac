# SPDX-License-Identifier: Apache-2.0
"""Labelling many bags: one that fails costs itself alone, what is done stays done, and the exit code tells."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from tof_core.errors import UsageError
from toftwin import cli
from toftwin.batch import find_bags, is_batch, label_bags
from toftwin.batch_engines import _Worker
from toftwin.faults import EXIT_INTERRUPTED
from toftwin.label_call import FAILED, LabelCall, Outcome
from toftwin.pipeline import PipelineConfig

GOLDEN = Path(__file__).parents[1] / "data" / "golden" / "bag"


@pytest.fixture
def bags(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two good bags and one that is none."""
    folder = tmp_path_factory.mktemp("bags")
    for name in ("a", "b"):
        shutil.copy(GOLDEN / "bag.mcap", folder / f"{name}.mcap")
    (folder / "bad.mcap").write_bytes(b"nonsense" * 9)
    return folder


def outcomes(out: Path) -> dict[str, dict[str, Any]]:
    """`batch.json` by the bags' names."""
    return {Path(o["bag"]).stem: o for o in json.loads((out / "batch.json").read_text())}


def label(bags: Path, out: Path, *flags: str) -> int:
    return cli.main(["label", str(bags / "*.mcap"), "--scene", "body_section", "--mode", "robot", "--out", str(out), *flags])


def test_a_failing_bag_is_reported_and_the_others_continue(bags: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Then the same call again, where one bag has become younger than its labels: that one alone is labelled."""
    out = tmp_path / "out"
    assert label(bags, out, "--workers", "1") == 1
    told = outcomes(out)
    assert {name: o["state"] for name, o in told.items()} == {"a": "done", "b": "done", "bad": "failed"}
    assert told["a"]["result"]["views"] == 4
    assert (out / "a" / "dataset.zarr").is_dir()
    assert "\n" not in told["bad"]["error"]
    assert "bad.mcap" in told["bad"]["error"]
    assert "3 bags: 2 labelled (0 of them before), 1 failed" in capsys.readouterr().out
    later = (out / "b" / "metrics.json").stat().st_mtime + 10
    os.utime(bags / "b.mcap", (later, later))
    assert label(bags, out, "--workers", "1", "--json") == 1
    assert {Path(o["bag"]).stem: o["state"] for o in json.loads(capsys.readouterr().out)} == {"a": "kept", "b": "done", "bad": "failed"}


def test_a_batch_from_python(bags: Path, tmp_path: Path) -> None:
    heard: list[Outcome] = []
    found = label_bags([str(bags / "b*.mcap")], Path("body_section"), tmp_path, mode="robot", workers=1, each=heard.append)
    assert {Path(o.bag).stem: o.state for o in found} == {"b": "done", "bad": "failed"}
    assert found == heard
    assert outcomes(tmp_path)["b"]["megabytes"] == pytest.approx(next(o.megabytes for o in found if o.state == "done"))
    again = label_bags([str(bags / "b.mcap")], Path("body_section"), tmp_path, mode="robot", workers=1, each=heard.append)
    assert [o.state for o in again] == ["kept"]
    assert len(heard) == 2, "what is kept is not made"


def test_a_batch_that_is_stopped_ends_its_workers_and_says_so(bags: Path, tmp_path: Path) -> None:
    # Enough to do after the first failure that a slow machine finds it at work.
    later = [str(shutil.copy(bags / "a.mcap", tmp_path / f"later_{i}.mcap")) for i in range(20)]
    flags = [
        "label",
        str(bags / "bad.mcap"),
        *later,
        "--scene",
        "body_section",
        "--out",
        str(tmp_path / "out"),
        "--workers",
        "1",
    ]
    # A shell that starts tests in the background has them, and all that they start, ignore this signal.
    heed = f"import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler); sys.argv[1:] = {flags!r}; "
    code = heed + "from toftwin.cli import main; sys.exit(main())"
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as batch:
        assert batch.stdout is not None
        assert batch.stdout.readline().startswith("failed")
        workers = [pid for task in Path(f"/proc/{batch.pid}/task").iterdir() for pid in (task / "children").read_text().split()]
        batch.send_signal(signal.SIGINT)
        _, said = batch.communicate(timeout=60)
    assert batch.returncode == EXIT_INTERRUPTED
    assert "what was finished is kept" in said
    assert workers
    deadline = time.monotonic() + 10  # multiprocessing's own tracker ends a moment after us
    while [pid for pid in workers if Path(f"/proc/{pid}").exists()] and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not [pid for pid in workers if Path(f"/proc/{pid}").exists()]
    assert outcomes(tmp_path / "out")["bad"]["state"] == "failed"


class Deadly:
    """Ends the process that unpacks it."""

    def __reduce__(self) -> tuple[Any, ...]:
        return os._exit, (9,)


def test_a_worker_that_dies_costs_its_bag_alone() -> None:
    worker = _Worker(min(os.sched_getaffinity(0)))
    try:
        died = worker.label(LabelCall("a", Deadly(), Path("a"), PipelineConfig()))  # type: ignore[arg-type]
        assert (died.state, died.bag) == (FAILED, "a")
        assert "its worker ended with 9" in died.error
        again = worker.label(LabelCall("b", Path("body_section"), Path("b"), PipelineConfig()))
        assert again.state == FAILED
        assert "its worker" not in again.error
    finally:
        worker.stop()


@pytest.mark.slow
def test_ray_labels_the_same(bags: Path, tmp_path: Path) -> None:
    pytest.importorskip("ray", reason="needs the extra `batch`")
    assert label(bags, tmp_path / "out", "--engine", "ray", "--workers", "1") == 1
    assert {name: o["state"] for name, o in outcomes(tmp_path / "out").items()} == {"a": "done", "b": "done", "bad": "failed"}


def test_patterns_and_names(bags: Path, tmp_path: Path) -> None:
    assert [Path(b).name for b in find_bags([str(bags / "*.mcap"), str(bags / "a.mcap")])] == ["a.mcap", "b.mcap", "bad.mcap"]
    with pytest.raises(UsageError, match="no bag fits this pattern"):
        find_bags([str(tmp_path / "*.mcap")])
    shutil.copy(bags / "a.mcap", tmp_path / "a.mcap")
    with pytest.raises(UsageError, match="two bags are called 'a'"):
        find_bags([str(bags / "a.mcap"), str(tmp_path / "a.mcap")])


def test_a_pattern_or_an_engine_makes_a_batch(tmp_path: Path) -> None:
    (tmp_path / "odd[1].mcap").touch()
    for bag, engine, batch in (("x", None, False), ("x*", None, True), ("x", "local", True), (str(tmp_path / "odd[1].mcap"), None, False)):
        assert is_batch([bag], engine) is batch
