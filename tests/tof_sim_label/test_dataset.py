# SPDX-License-Identifier: Apache-2.0
"""The dataset's contract: names and types as designed, appended frames kept, foreign ones refused."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import zarr
from zarr.codecs import GzipCodec

from tests.tof_sim_label.made import ATTRIBUTES, CAMERA, capture, label, view
from tof_core.errors import DatasetError
from tof_core.lens import with_lens
from tof_sim_label.dataset import DatasetWriter, open_dataset
from tof_sim_label.schema import COLUMNS

if TYPE_CHECKING:
    from pathlib import Path

SEPARATOR: Any = {"name": "default", "separator": "."}


def fill(path: Path, captures: int = 3, views: int = 2) -> None:
    """A session of `views` views with one station each; capture i belongs to view i // 2."""
    with DatasetWriter(path, CAMERA, ATTRIBUTES) as writer:
        for i in range(captures):
            writer.append_capture(capture(i), view=i // 2)
        for i in range(views):
            writer.append_view(view(i, station=i), label(i))


def test_the_layout_is_the_designs_and_any_zarr_reader_opens_it(tmp_path: Path) -> None:
    fill(tmp_path / "d")
    group = zarr.open_group(tmp_path / "d", mode="r")
    h, w = CAMERA.shape
    expected = {
        "captures/raw": ("float32", (3, h, w)),
        "captures/amplitude": ("float32", (3, h, w)),
        "captures/stamp_ns": ("int64", (3,)),
        "captures/temperature": ("float32", (3,)),
        "captures/view": ("int32", (3,)),
        "views/depth": ("float32", (2, h, w)),
        "views/sigma": ("float32", (2, h, w)),
        "views/count": ("uint16", (2, h, w)),
        "views/label": ("float32", (2, h, w)),
        "views/label_sigma": ("float32", (2, h, w)),
        "views/mask": ("uint8", (2, h, w)),
        "views/reason": ("uint8", (2, h, w)),
        "views/part": ("int16", (2, h, w)),
        "views/mixed": ("float32", (2, h, w)),
        "views/incidence": ("float32", (2, h, w)),
        "views/T_cell_camera": ("float64", (2, 4, 4)),
        "views/pose_cov": ("float64", (2, 6, 6)),
        "views/station": ("int32", (2,)),
        "views/stamp_ns": ("int64", (2,)),
    }
    found = {f"{g}/{n}": (str(a.dtype), a.shape) for g in COLUMNS for n, a in group[g].arrays()}  # type: ignore[union-attr]
    assert found == expected
    assert {a.chunks[0] for g in COLUMNS for _, a in group[g].arrays()} == {1}  # type: ignore[union-attr]
    assert group.metadata.zarr_format == 3
    assert group.attrs["schema"] == "toftwin.dataset/1"
    assert group.attrs["hashes"] == {"cad": "cad0", "config": "config0"}
    assert group.attrs["pose_source"] == "session, final"
    assert group.attrs["verdicts"] == ["ok 0", "ok 1"]
    assert group.attrs["camera"]["fx"] == 10.0  # type: ignore[call-overload,index]


def test_every_value_comes_back_as_it_went_in(tmp_path: Path) -> None:
    fill(tmp_path / "d")
    data = open_dataset(tmp_path / "d")
    assert (data.captures, data.views, data.camera, data.attributes) == (3, 2, CAMERA, ATTRIBUTES)
    np.testing.assert_array_equal(data.frame("captures/raw", 2), capture(2).depth)
    np.testing.assert_array_equal(data.frame("captures/amplitude", 1), capture(1).amplitude)
    np.testing.assert_array_equal(data.column("captures/view"), [0, 0, 1])
    np.testing.assert_array_equal(data.column("captures/temperature"), np.array([20, 21, 22], np.float32))
    np.testing.assert_array_equal(data.column("captures/stamp_ns"), [1000, 1001, 1002])
    expected = label(1)
    for name, value in {
        "label": expected.depth,
        "label_sigma": expected.sigma,
        "mask": expected.mask,
        "reason": expected.reason,
        "part": expected.part,
        "mixed": expected.mixed,
        "incidence": expected.incidence,
        "count": view(1).count,
        "T_cell_camera": expected.posed.T_cell_camera,
        "pose_cov": expected.posed.cov,
    }.items():
        np.testing.assert_array_equal(data.frame(f"views/{name}", 1), value)
    np.testing.assert_array_equal(data.column("views/station"), [0, 1])


def test_the_lens_that_a_label_was_seen_through_is_kept_with_its_view(tmp_path: Path) -> None:
    fill(tmp_path / "d")
    other = with_lens(CAMERA, np.array([0.01, 0.0, 0.5, 0.0, -0.02, 0.0, 0.0, 0.0]))
    with DatasetWriter(tmp_path / "d", CAMERA, ATTRIBUTES) as writer:
        through = label(2)
        writer.append_view(view(2), replace(through, posed=replace(through.posed, camera=other)))
    data = open_dataset(tmp_path / "d")
    assert [data.lens(k) for k in range(data.views)] == [CAMERA, CAMERA, other]
    assert data.camera == CAMERA


def test_a_camera_without_amplitude_or_temperature_gives_nan(tmp_path: Path) -> None:
    with DatasetWriter(tmp_path / "d", CAMERA, ATTRIBUTES) as writer:
        writer.append_capture(replace(capture(0), amplitude=None, temperature=float("nan")))
    data = open_dataset(tmp_path / "d")
    assert np.isnan(data.frame("captures/amplitude", 0)).all()
    assert np.isnan(data.column("captures/temperature")[0])
    assert data.column("captures/view")[0] == -1


def test_a_second_session_goes_on_with_new_stations_and_views(tmp_path: Path) -> None:
    fill(tmp_path / "d")
    fill(tmp_path / "d")
    data = open_dataset(tmp_path / "d")
    np.testing.assert_array_equal(data.column("views/station"), [0, 1, 2, 3])
    np.testing.assert_array_equal(data.column("captures/view"), [0, 0, 1, 2, 2, 3])
    assert data.verdicts == ("ok 0", "ok 1", "ok 0", "ok 1")


def test_captures_of_a_view_that_never_came_are_freed_on_continuing(tmp_path: Path) -> None:
    fill(tmp_path / "d", captures=6, views=2)  # captures 4 and 5 wait for a view 2 that is not written
    fill(tmp_path / "d", captures=1, views=1)
    np.testing.assert_array_equal(open_dataset(tmp_path / "d").column("captures/view"), [0, 0, 1, 1, -1, -1, 2])


@pytest.mark.parametrize(
    ("camera", "attributes", "message"),
    [
        (replace(CAMERA, width=13), ATTRIBUTES, "camera 12x8"),
        (replace(CAMERA, fx=10.5), ATTRIBUTES, "fx 10.00"),
        (CAMERA, replace(ATTRIBUTES, cad_hash="other"), "cad_hash"),
        (CAMERA, replace(ATTRIBUTES, config_hash="other"), "config_hash"),
        (CAMERA, replace(ATTRIBUTES, parts=("sill",)), "parts"),
    ],
)
def test_frames_with_other_attributes_are_not_appended(tmp_path: Path, camera: object, attributes: object, message: str) -> None:
    fill(tmp_path / "d")
    with pytest.raises(DatasetError, match=message):
        DatasetWriter(tmp_path / "d", camera, attributes)  # type: ignore[arg-type]


def test_another_schema_is_refused_by_name(tmp_path: Path) -> None:
    fill(tmp_path / "d")
    meta = tmp_path / "d" / "zarr.json"
    meta.write_text(meta.read_text().replace("toftwin.dataset/1", "toftwin.dataset/9"))
    with pytest.raises(DatasetError, match=r"toftwin\.dataset/9"):
        open_dataset(tmp_path / "d")
    with pytest.raises(DatasetError, match=r"toftwin\.dataset/9"):
        DatasetWriter(tmp_path / "d", CAMERA, ATTRIBUTES)


def test_a_folder_that_is_no_dataset_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(DatasetError, match="is no dataset"):
        DatasetWriter(tmp_path, CAMERA, ATTRIBUTES)
    with pytest.raises(DatasetError, match="is no dataset"):
        open_dataset(tmp_path / "nothing")
    assert [p.name for p in tmp_path.iterdir()] == ["notes.txt"]


def test_a_frame_of_another_size_is_refused_and_nothing_is_half_written(tmp_path: Path) -> None:
    with DatasetWriter(tmp_path / "d", CAMERA, ATTRIBUTES) as writer:
        writer.append_capture(capture(0))
        with pytest.raises(DatasetError, match="must be"):
            writer.append_capture(capture(1, replace(CAMERA, width=20)))
        writer.append_capture(capture(2))
    np.testing.assert_array_equal(open_dataset(tmp_path / "d").column("captures/stamp_ns"), [1000, 1002])


def test_one_writer_at_a_time_and_readers_beside_it(tmp_path: Path) -> None:
    with DatasetWriter(tmp_path / "d", CAMERA, ATTRIBUTES) as writer:
        with pytest.raises(DatasetError, match="another process"):
            DatasetWriter(tmp_path / "d", CAMERA, ATTRIBUTES)
        for i in range(3):
            writer.append_capture(capture(i))
            assert open_dataset(tmp_path / "d").captures == i + 1


def test_a_missing_or_damaged_chunk_is_an_error_not_nan(tmp_path: Path) -> None:
    fill(tmp_path / "d")
    (tmp_path / "d/captures/raw/c.1.0.0").unlink()
    (tmp_path / "d/views/label/c.0.0.0").write_bytes(b"not blosc")
    data = open_dataset(tmp_path / "d")
    with pytest.raises(DatasetError, match=r"c\.1\.0\.0: committed chunk is missing"):
        data.frame("captures/raw", 1)
    with pytest.raises(DatasetError, match="views/label is damaged"):
        data.frame("views/label", 0)


def test_a_chunk_that_states_another_size_is_damaged(tmp_path: Path) -> None:
    fill(tmp_path / "d")
    chunk = tmp_path / "d/views/label/c.0.0.0"
    data = bytearray(chunk.read_bytes())
    data[4:8] = (2**31 - 1).to_bytes(4, "little")
    chunk.write_bytes(data)
    (tmp_path / "d/views/station/c.1").write_bytes(b"12345")
    with pytest.raises(DatasetError, match=r"views/label is damaged .*holds 2147483647 bytes"):
        open_dataset(tmp_path / "d").frame("views/label", 0)
    with pytest.raises(DatasetError, match=r"views/station is damaged .*holds 5 bytes, not 4"):
        open_dataset(tmp_path / "d").column("views/station")


@pytest.mark.parametrize("name", ["views/label", "views/reason", "views/T_cell_camera"])
def test_arrays_that_another_program_packed_otherwise_are_read_as_well(name: str, tmp_path: Path) -> None:
    fill(tmp_path / "d")
    group = zarr.open_group(tmp_path / "d", mode="r+", zarr_format=3)
    values = np.asarray(group[name])
    chunks = (1, *values.shape[1:])
    group.create_array(name, data=values, chunks=chunks, compressors=GzipCodec(level=1), chunk_key_encoding=SEPARATOR, overwrite=True)
    after = open_dataset(tmp_path / "d")
    for i in range(2):
        np.testing.assert_array_equal(after.frame(name, i), values[i])


def test_unknown_names_and_numbers_are_errors(tmp_path: Path) -> None:
    fill(tmp_path / "d")
    data = open_dataset(tmp_path / "d")
    for wrong in ("views/depht", "depth", "nothing/depth"):
        with pytest.raises(DatasetError, match="has no array"):
            data.frame(wrong, 0)
    for beyond in (-1, 2):
        with pytest.raises(DatasetError, match="it holds 2"):
            data.frame("views/depth", beyond)


def test_the_attributes_say_what_each_array_is(tmp_path: Path) -> None:
    fill(tmp_path / "d")
    meta = json.loads((tmp_path / "d" / "zarr.json").read_text())
    assert set(meta["attributes"]["columns"]) == {f"{g}/{n}" for g, columns in COLUMNS.items() for n in columns}
