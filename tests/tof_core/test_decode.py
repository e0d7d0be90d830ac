# SPDX-License-Identifier: Apache-2.0
"""Images are decoded correctly for every encoding, byte order and row padding."""

from __future__ import annotations

import array
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from tof_core.camera import Camera
from tof_core.decode import camera_from_info, check_size, decode_amplitude, decode_colour, decode_depth, pixels
from tof_core.encode import ENCODINGS, camera_info_fields, depth_counts, image_fields
from tof_core.errors import CameraError, DecodeError
from tof_core.reasons import Reason


def image(data: np.ndarray[Any, Any], encoding: str, *, step: int = 0, bigendian: bool = False) -> SimpleNamespace:
    return SimpleNamespace(**image_fields(data, encoding, step=step, bigendian=bigendian))


@st.composite
def rasters(draw: st.DrawFn) -> tuple[np.ndarray[Any, Any], str, int, bool]:
    """Any raster of any encoding with any padding in any byte order."""
    name = draw(st.sampled_from(sorted(ENCODINGS)))
    kind = ENCODINGS[name]
    shape = draw(st.tuples(st.integers(1, 9), st.integers(1, 9)))
    full = shape if kind.channels == 1 else (*shape, kind.channels)
    raster = draw(hnp.arrays(np.dtype(kind.element), full))
    padding = draw(st.integers(0, 7))
    return raster, name, shape[1] * kind.channels * raster.dtype.itemsize + padding, draw(st.booleans())


@given(rasters())
def test_what_was_encoded_is_decoded(case: tuple[np.ndarray[Any, Any], str, int, bool]) -> None:
    raster, name, step, bigendian = case
    msg = image(raster, name, step=step, bigendian=bigendian)
    assert msg.step == step
    assert len(msg.data) == step * raster.shape[0]
    np.testing.assert_array_equal(pixels(msg), raster)


@given(hnp.arrays(np.uint16, (4, 5)), st.booleans(), st.sampled_from([0.001, 1 / 999, 0.00025]))
def test_integer_depth_is_counts_times_scale_but_for_both_invalid_codes(
    counts: np.ndarray[Any, Any],
    bigendian: bool,  # noqa: FBT001  (hypothesis gives it by place)
    scale: float,
) -> None:
    depth, reason = decode_depth(image(counts, "16UC1", bigendian=bigendian), scale=scale)
    invalid = (counts == 0) | (counts == 65535)
    np.testing.assert_array_equal(np.isnan(depth), invalid)
    np.testing.assert_allclose(depth[~invalid], counts[~invalid] * scale, rtol=1e-7)
    np.testing.assert_array_equal(reason, np.select([counts == 0, counts == 65535], [Reason.NO_RETURN, Reason.SATURATED], Reason.VALID))


def test_float_depth_follows_rep_117_and_takes_zero_for_no_return() -> None:
    values = np.array([[1.5, np.nan, np.inf, 1e10], [-np.inf, 0.0, -0.2, 2500.0]], np.float32)
    depth, reason = decode_depth(image(values, "32FC1"))
    np.testing.assert_array_equal(depth, np.array([[1.5, np.nan, np.nan, np.nan], [np.nan, np.nan, np.nan, 2500.0]], np.float32))
    none, out = Reason.NO_RETURN, Reason.OUT_OF_RANGE
    np.testing.assert_array_equal(reason, [[Reason.VALID, none, none, none], [out, none, out, Reason.VALID]])


@given(hnp.arrays(np.uint16, (3, 4)))
def test_metres_go_to_counts_and_back(counts: np.ndarray[Any, Any]) -> None:
    depth, _ = decode_depth(image(counts, "16UC1"))
    np.testing.assert_array_equal(depth_counts(depth), np.where(counts == 65535, 0, counts))


def test_depth_beyond_the_counts_is_saturated_not_wrapped() -> None:
    np.testing.assert_array_equal(depth_counts(np.array([[70.0, np.inf, -1.0, np.nan]], np.float32)), [[65535, 65535, 0, 0]])


@pytest.mark.parametrize("wrap", [bytes, lambda a: array.array("B", a.tobytes()), memoryview, list])
def test_any_message_type_s_bytes_are_read(wrap: Any) -> None:
    counts = np.arange(12, dtype=np.uint16).reshape(3, 4) + 500
    msg = image(counts, "16UC1")
    msg.data = wrap(msg.data) if wrap is not bytes else msg.data.tobytes()
    np.testing.assert_allclose(decode_depth(msg)[0], counts * 0.001, rtol=1e-6)


def test_decoding_does_not_change_the_message() -> None:
    values = np.array([[0.0, 1.0]], np.float32)
    msg = image(values, "32FC1")
    before = bytes(msg.data)
    decode_depth(msg)[0][:] = 7.0
    assert bytes(msg.data) == before


@pytest.mark.parametrize(
    ("encoding", "order"), [("rgb8", [0, 1, 2]), ("bgr8", [2, 1, 0]), ("rgba8", [0, 1, 2, 3]), ("bgra8", [2, 1, 0, 3])]
)
def test_colour_is_rgb_whatever_order_it_came_in(encoding: str, order: list[int]) -> None:
    rgba = np.random.default_rng(1).integers(0, 256, (4, 5, 4), np.uint8)
    decoded = decode_colour(image(np.ascontiguousarray(rgba[..., order]), encoding))
    np.testing.assert_array_equal(decoded, rgba[..., :3])


def test_grey_colour_has_three_equal_channels() -> None:
    grey = np.arange(6, dtype=np.uint8).reshape(2, 3)
    np.testing.assert_array_equal(decode_colour(image(grey, "mono8")), np.stack([grey] * 3, axis=-1))


@pytest.mark.parametrize(
    ("encoding", "kind"), [("mono8", np.uint8), ("8UC1", np.uint8), ("mono16", np.uint16), ("16UC1", np.uint16), ("32FC1", np.float32)]
)
def test_amplitude_keeps_its_counts(encoding: str, kind: Any) -> None:
    raw = np.array([[0, 7, 250]], kind)
    amplitude = decode_amplitude(image(raw, encoding))
    assert amplitude.dtype == np.float32
    np.testing.assert_array_equal(amplitude, raw)


@pytest.mark.parametrize("encoding", ["yuv422", "bayer_rggb8", "64FC1", ""])
def test_unknown_encodings_are_refused_by_name(encoding: str) -> None:
    msg = image(np.zeros((2, 2), np.uint8), "mono8")
    msg.encoding = encoding
    with pytest.raises(DecodeError, match=f"/depth: encoding '{encoding}' is not known"):
        decode_depth(msg, "/depth")


def test_a_known_encoding_in_the_wrong_place_is_refused_by_name() -> None:
    with pytest.raises(DecodeError, match="'rgb8' holds no depth"):
        decode_depth(image(np.zeros((2, 2, 3), np.uint8), "rgb8"))
    with pytest.raises(DecodeError, match="'32FC1' holds no colour"):
        decode_colour(image(np.zeros((2, 2), np.float32), "32FC1"))


@pytest.mark.parametrize(("field", "value"), [("step", 3), ("step", 0), ("height", 9), ("width", 900), ("width", 0)])
def test_sizes_that_do_not_fit_the_bytes_are_refused(field: str, value: int) -> None:
    msg = image(np.zeros((4, 5), np.uint16), "16UC1")
    setattr(msg, field, value)
    with pytest.raises(DecodeError, match="does not fit its 40 bytes"):
        decode_depth(msg)


def test_a_compressed_image_that_is_none_is_refused_in_one_line() -> None:
    with pytest.raises(DecodeError, match="format 'png' is not read; publish compressedDepth") as caught:
        decode_depth(SimpleNamespace(format="png", data=b"123"), "/depth/compressed")
    assert "\n" not in str(caught.value)


def test_an_array_of_the_wrong_type_is_not_silently_converted() -> None:
    with pytest.raises(DecodeError, match="depth_counts"):
        image_fields(np.ones((2, 2), np.float32), "16UC1")


CAMERA = Camera(40, 30, 50.0, 51.0, 19.2, 14.9, "plumb_bob", (0.1, -0.02, 1e-3, 2e-3, 0.0), "sensor")


def info(camera: Camera = CAMERA, **changes: Any) -> SimpleNamespace:
    roi = SimpleNamespace(x_offset=0, y_offset=0, width=0, height=0, do_rectify=False)
    msg = SimpleNamespace(header=SimpleNamespace(frame_id=camera.frame_id), roi=roi, **camera_info_fields(camera))
    for name, value in changes.items():
        setattr(msg, name, value)
    return msg


def test_a_camera_goes_to_camera_info_and_back() -> None:
    assert camera_from_info(info()) == CAMERA
    rational = replace(CAMERA, distortion_model="rational_polynomial", distortion=(0.5, -0.1, 1e-3, 0.0, 0.0, 0.8, 0.1, 0.0))
    assert camera_from_info(info(rational)) == rational


def test_a_binned_pixel_lies_amid_those_it_is_made_of() -> None:
    camera = camera_from_info(info(binning_x=2, binning_y=2))
    assert camera.shape == (15, 20)
    ray = camera.rays_at([7.0, 5.0])
    full = CAMERA.project(ray)
    np.testing.assert_allclose(full, [14.5, 10.5], atol=1e-9)


def test_a_region_of_interest_shifts_the_principal_point() -> None:
    roi = SimpleNamespace(x_offset=10, y_offset=4, width=20, height=16, do_rectify=False)
    camera = camera_from_info(info(roi=roi))
    assert camera.shape == (16, 20)
    np.testing.assert_allclose(camera.rays_at([0.0, 0.0]), CAMERA.rays_at([10.0, 4.0]), atol=1e-12)


def test_a_rectified_image_takes_p_and_no_distortion() -> None:
    p = np.array([60.0, 0, 20, 0, 0, 61, 15, 0, 0, 0, 1, 0])
    camera = camera_from_info(info(p=p), rectified=True)
    assert (camera.fx, camera.fy, camera.cx, camera.cy, camera.distortion) == (60.0, 61.0, 20.0, 15.0, ())


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"k": np.zeros(9)}, r"K\[0\] = 0"),
        ({"width": 0}, "size 0x30"),
        ({"distortion_model": "equidistant"}, "'equidistant' is not known"),
        (
            {"d": np.array([0.1, 0, 0, 0, 0, 0, 0, 0, 0.2]), "distortion_model": "rational_polynomial"},
            "more than 'rational_polynomial' has",
        ),
        ({"k": np.array([50.0, 3.0, 20, 0, 50, 15, 0, 0, 1])}, "skew"),
    ],
)
def test_a_camera_that_no_calibration_gives_is_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(CameraError, match=message) as caught:
        camera_from_info(info(**changes), "/depth/camera_info")
    assert str(caught.value).startswith("/depth/camera_info: ")


def test_an_image_of_another_size_than_its_camera_is_refused() -> None:
    check_size((30, 40), CAMERA, "/depth")
    with pytest.raises(CameraError, match="/depth: image is 30x40 but its camera_info says 40x30"):
        check_size((40, 30), CAMERA, "/depth")
