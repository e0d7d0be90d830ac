# SPDX-License-Identifier: Apache-2.0
"""YAML, digests, progress, metrics and errors."""

from __future__ import annotations

import re
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from tof_core import errors, hashing
from tof_core.capture import Capture, RobotPose, View
from tof_core.errors import ConfigError, ToftwinError
from tof_core.metrics import depth_error
from tof_core.motion import MotionConfig
from tof_core.progress import progress, set_quiet, steps
from tof_core.yamlio import dump_yaml, load_yaml, parse_yaml, save_yaml

if TYPE_CHECKING:
    from collections.abc import Iterator

PLAIN = st.recursive(
    st.one_of(
        st.booleans(), st.integers(-(2**40), 2**40), st.floats(allow_nan=False, allow_infinity=False), st.text("abcåµ \"':#", max_size=8)
    ),
    lambda inner: st.one_of(st.lists(inner, max_size=3), st.dictionaries(st.text("abcde", min_size=1, max_size=5), inner, max_size=3)),
    max_leaves=8,
)


@given(st.dictionaries(st.text("abcde", min_size=1, max_size=5), PLAIN, max_size=4))
def test_plain_values_go_to_yaml_and_back(values: dict[str, Any]) -> None:
    assert parse_yaml(dump_yaml(values)) == values


def test_yaml_is_saved_whole(tmp_path: Path) -> None:
    save_yaml(tmp_path / "a.yaml", {"b": 1, "a": [1.5, 2.0]})
    assert load_yaml(tmp_path / "a.yaml") == {"b": 1, "a": [1.5, 2.0]}
    assert [p.name for p in tmp_path.iterdir()] == ["a.yaml"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: 1\nb: [1,\n", r"x\.yaml:3: is no valid YAML"),
        ("a: 1\nb: 2\na: 3\n", r"x\.yaml:3: is no valid YAML: key 'a' is given twice"),
        ("a: !!python/object/apply:os.system ['true']\n", r"x\.yaml:1: is no valid YAML"),
        ("- 1\n", r"x\.yaml: must be a mapping of keys, not a list"),
    ],
)
def test_bad_yaml_names_file_and_line(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "x.yaml").write_text(text)
    with pytest.raises(ConfigError, match=message) as caught:
        load_yaml(tmp_path / "x.yaml")
    assert "\n" not in str(caught.value)


def test_a_missing_yaml_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot be read: No such file"):
        load_yaml(tmp_path / "none.yaml")
    (tmp_path / "latin.yaml").write_bytes(b"a: \xe9")
    with pytest.raises(ConfigError, match="is no UTF-8 text"):
        load_yaml(tmp_path / "latin.yaml")


def test_an_empty_file_is_an_empty_mapping(tmp_path: Path) -> None:
    (tmp_path / "x.yaml").write_text("# nothing\n")
    assert load_yaml(tmp_path / "x.yaml") == {}


@given(hnp.arrays(np.float32, (2, 3), elements=st.floats(0, 9, width=32)))
def test_digests_of_arrays_depend_on_type_shape_and_content_alone(a: np.ndarray[Any, Any]) -> None:
    assert hashing.digest_arrays(a) == hashing.digest_arrays(np.asfortranarray(a.copy()))
    different = [a.reshape(3, 2), a.astype(np.float64), a + 1, a[:1]]
    assert len({hashing.digest_arrays(a), *(hashing.digest_arrays(d) for d in different)}) == 5


def test_boundaries_between_parts_count() -> None:
    assert hashing.digest_bytes(b"ab", b"c") != hashing.digest_bytes(b"a", b"bc")


def test_digests_of_files_are_those_of_their_content(tmp_path: Path) -> None:
    for name, content in (("a", b"1"), ("b", b"1"), ("c", b"2")):
        (tmp_path / name).write_bytes(content)
    a, b, c = (hashing.digest_file(tmp_path / n) for n in "abc")
    assert a == b != c


def test_digests_of_configurations_do_not_depend_on_the_order_of_keys() -> None:
    config = MotionConfig()
    assert hashing.digest_config(config) == hashing.digest_config(dict(reversed([(f, getattr(config, f)) for f in config.__slots__])))
    assert hashing.digest_config(config) != hashing.digest_config(replace(config, window_s=0.05))


@pytest.mark.parametrize("tty", [False, True])
def test_progress_passes_everything_on_and_is_seen_only_on_a_terminal(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tty: bool,  # noqa: FBT001  (pytest gives it by name)
) -> None:
    monkeypatch.setattr("sys.stderr.isatty", lambda: tty, raising=False)
    monkeypatch.setattr("tof_core.progress.DELAY_S", 0.0)
    assert list(progress(range(5), "counting", 5)) == [0, 1, 2, 3, 4]
    assert ("counting" in capsys.readouterr().err) == tty
    set_quiet(True)
    try:
        assert list(progress(iter("ab"), "spelling")) == ["a", "b"]
        assert capsys.readouterr().err == ""
    finally:
        set_quiet(False)


@pytest.mark.parametrize("tty", [False, True])
def test_steps_are_named_and_counted_with_the_time_that_remains(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tty: bool,  # noqa: FBT001  (pytest gives it by name)
) -> None:
    monkeypatch.setattr("sys.stderr.isatty", lambda: tty, raising=False)
    monkeypatch.setattr("tof_core.progress.DELAY_S", 0.0)
    with steps("parts", 3) as begin:
        begin("poses")
        time.sleep(0.2)
        begin("panel")
        time.sleep(0.2)
    said = capsys.readouterr().err
    assert bool(said) == tty
    assert not tty or re.search(r"parts: .*1/3 \[00:00<00:00.*panel\]", said)


def test_work_that_is_done_soon_shows_no_progress(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("sys.stderr.isatty", lambda: True, raising=False)
    assert list(progress(range(5), "counting", 5)) == [0, 1, 2, 3, 4]
    assert capsys.readouterr().err == ""


def test_depth_errors_have_their_denominators() -> None:
    true = np.array([[1.0, 2.0, 4.0, np.nan]], np.float32)
    measured = np.array([[1.1, 1.8, np.nan, 3.0]], np.float32)
    e = depth_error(measured, true)
    assert (e.pixels, e.reference) == (2, 3)
    assert e.mae == pytest.approx(0.15, abs=1e-6)
    assert e.bias == pytest.approx(-0.05, abs=1e-6)
    assert e.rmse == pytest.approx(np.sqrt((0.01 + 0.04) / 2), abs=1e-6)
    assert e.completeness == pytest.approx(2 / 3)
    assert e.alignment == pytest.approx(90.0, abs=1e-4)
    nothing = depth_error(measured, true, np.zeros((1, 4), bool))
    assert nothing.pixels == 0
    assert np.isnan(nothing.mae)


def every_error() -> Iterator[type[ToftwinError]]:
    yield from (e for e in vars(errors).values() if isinstance(e, type) and issubclass(e, ToftwinError))


@pytest.mark.parametrize("kind", list(every_error()))
def test_every_error_is_one_line_of_what_where_and_what_to_do(kind: type[ToftwinError]) -> None:
    error = kind("is\nbroken", where=Path("a/b"), todo="repair  it")
    assert str(error) == "a/b: is broken; repair it"
    assert (error.what, error.where, error.todo) == ("is\nbroken", "a/b", "repair  it")
    assert error.exit_code in (1, 2)


def test_a_capture_is_a_view_of_one() -> None:
    from tests.tof_core.bags import CAMERA, depth_of

    robot = RobotPose(np.eye(4), np.eye(4))
    capture = Capture(7, CAMERA, depth_of(0), np.zeros(CAMERA.shape, np.uint8), robot, temperature=31.0)
    view = View.of_capture(capture, station=2)
    assert (view.stamp_ns, view.dwell_ns, view.station, view.captures, view.temperature) == (7, 7, 2, 1, 31.0)
    np.testing.assert_array_equal(view.count, np.isfinite(capture.depth))
    np.testing.assert_array_equal(view.valid, np.isfinite(capture.depth))
    assert np.isnan(view.sigma).all()
