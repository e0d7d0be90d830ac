# SPDX-License-Identifier: Apache-2.0
"""compressedDepth (PNG, RVL) and compressed colour: read as the raw image, bounded by their headers, damage is one line."""

from __future__ import annotations

import struct
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tests.tof_core import packing
from tof_core.bag import open_bag
from tof_core.bag_writer import BagWriter
from tof_core.camera import Camera
from tof_core.compressed import DEPTH_CODES, format_of, packed_depth
from tof_core.decode import decode_amplitude, decode_colour, decode_depth, image_size
from tof_core.errors import DecodeError
from tof_core.options import BagOptions
from tof_core.reasons import Reason
from tof_core.rvl import decode_rvl, encode_rvl
from tof_core.topics import COMPRESSED, IMAGE, INFO, find_topics

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

CAMERA = Camera(24, 18, 25.0, 25.0, 11.5, 8.5, frame_id="hand_depth_sensor")


def message(data: bytes, kind: str) -> Any:
    return SimpleNamespace(format=kind, data=data)


def scene(number: int = 0) -> NDArray[np.uint16]:
    """Counts (H, W) in millimetres of a slanted wall with holes."""
    rows, columns = np.indices(CAMERA.shape)
    counts = (800 + 3 * rows + 7 * columns + number).astype(np.uint16)
    counts[2:5, 3:9] = 0
    counts[0, 0] = 65535
    return counts


def test_an_rvl_image_is_read_as_its_paper_says() -> None:
    """Counts 0 0 5 6: two zeros (2), two differences (2), 5 is zigzag 10 (1010 0001 = A 1), 1 is zigzag 2 (2)."""
    data = struct.pack("<II", 4, 1) + bytes.fromhex("0020a122")
    assert decode_rvl(data).tolist() == [[0, 0, 5, 6]]


RUNS = arrays(np.uint16, st.tuples(st.integers(1, 9), st.integers(1, 9)), elements=st.sampled_from([0, 0, 1, 2, 900, 901, 65535]))


@given(RUNS)
def test_every_rvl_image_comes_back_as_it_was(counts: NDArray[np.uint16]) -> None:
    assert np.array_equal(decode_rvl(packing.rvl(counts)), counts)


@given(RUNS)
def test_an_rvl_image_is_written_as_its_paper_says(counts: NDArray[np.uint16]) -> None:
    assert encode_rvl(counts) == packing.rvl(counts)


def test_the_image_that_rvl_makes_longest_fits() -> None:
    """Lone pixels at both ends of the range: six nibbles a difference, two for the runs beside it."""
    counts = np.zeros((64, 64), np.uint16)
    counts[:, ::4], counts[:, 2::4] = 65535, 1
    assert encode_rvl(counts) == packing.rvl(counts)
    assert np.array_equal(decode_rvl(encode_rvl(counts)), counts)


@pytest.mark.parametrize("kind", ["png", "rvl"])
@pytest.mark.parametrize("encoding", ["16UC1", "mono16"])
def test_compressed_counts_decode_as_the_raw_image_does(kind: str, encoding: str) -> None:
    msg = message(packing.depth(scene(), kind=kind), f"{encoding}; compressedDepth {kind}")
    depth, reason = decode_depth(msg, "/depth")
    assert image_size(msg) == CAMERA.shape
    assert depth[10, 10] == np.float32(0.8 + 0.03 + 0.07)
    assert (reason[0, 0], reason[3, 4], reason[10, 10]) == (Reason.SATURATED, Reason.NO_RETURN, Reason.VALID)
    assert np.isnan(depth[3, 4])


def test_the_format_of_old_bags_means_png() -> None:
    depth, _ = decode_depth(message(packing.depth(scene()), "16UC1; compressedDepth"))
    assert depth[10, 10] == np.float32(0.9)


@pytest.mark.parametrize("kind", ["png", "rvl"])
def test_metres_come_back_from_their_inverse(kind: str) -> None:
    """compressed_depth_image_transport: a = z0 (z0 + 1), b = 1 - a / z_max, count = a / z + b."""
    metres, z0, z_max = np.array([[0.5, 1.0, 2.0, 0.0]]), 100.0, 10.0
    a = z0 * (z0 + 1)
    b = 1 - a / z_max
    with np.errstate(divide="ignore"):
        counts = np.where(metres > 0, a / metres + b, 0).astype(np.uint16)
    depth, reason = decode_depth(message(packing.depth(counts, kind=kind, a=a, b=b), f"32FC1; compressedDepth {kind}"))
    np.testing.assert_allclose(depth[0, :3], metres[0, :3], atol=5e-4)
    assert np.isnan(depth[0, 3])
    assert reason[0, 3] == Reason.NO_RETURN


@pytest.mark.parametrize("code", DEPTH_CODES)
def test_depth_that_a_node_packs_comes_back_to_half_a_count(code: str) -> None:
    rows, columns = np.indices((40, 60))
    metres = (0.4 + 0.002 * rows * columns).astype(np.float32)
    metres[0, :4] = np.nan, 0.0, 0.05, 40.0
    msg = message(*packed_depth(metres, code))
    assert msg.format == f"32FC1; compressedDepth {code}"
    depth, reason = decode_depth(msg)
    inside = np.isfinite(depth)
    assert np.array_equal(inside, (metres > 0.16) & (metres <= 10.0))
    assert (np.abs(depth - metres)[inside] <= 0.501 * metres[inside] ** 2 / 10100 + 1e-6).all()
    assert set(reason[~inside].tolist()) == {Reason.NO_RETURN}


def test_colour_comes_out_in_the_order_red_green_blue() -> None:
    bgr = np.zeros((16, 16, 3), np.uint8)
    bgr[..., 2], bgr[:, 8:, 0] = 200, 90
    exact = decode_colour(message(packing.png(bgr), "rgb8; png compressed bgr8"))
    assert exact[3, 3].tolist() == [200, 0, 0]
    assert exact[3, 12].tolist() == [200, 0, 90]
    lossy = decode_colour(message(packing.jpeg(bgr), "rgb8; jpeg compressed bgr8"))
    assert np.abs(lossy[3, 3].astype(int) - [200, 0, 0]).max() <= 12
    grey = decode_colour(message(packing.jpeg(np.full((8, 8), 77, np.uint8)), "jpeg"))
    assert np.abs(grey.astype(int) - 77).max() <= 2


def test_amplitude_may_be_a_16_bit_png() -> None:
    counts = np.arange(64, dtype=np.uint16).reshape(8, 8) * 100
    assert np.array_equal(decode_amplitude(message(packing.png(counts), "mono16; png compressed ")), counts.astype(np.float32))


FORMATS = {
    "16UC1; compressedDepth rvl": ("16UC1", True, True),
    "32FC1; compressedDepth png": ("32FC1", True, False),
    "rgb8; jpeg compressed bgr8": ("rgb8", False, False),
    "jpeg": ("", False, False),
    "": ("", False, False),
}


@pytest.mark.parametrize("text", FORMATS)
def test_the_format_says_encoding_and_code(text: str) -> None:
    assert format_of(text) == FORMATS[text]


HUGE = 60_000
BOMBS = {
    "PNG": message(packing.png(np.zeros((1, 1), np.uint16)), "16UC1; compressedDepth png"),
    "RVL": message(packing.CONFIG.pack(0, 0, 0) + struct.pack("<III", HUGE, HUGE, 0), "16UC1; compressedDepth rvl"),
    "JPEG": message(
        packing.jpeg(np.zeros((8, 8, 3), np.uint8)).replace(struct.pack(">HH", 8, 8), struct.pack(">HH", HUGE, HUGE), 1), "jpeg"
    ),
}


@pytest.mark.parametrize("name", BOMBS)
def test_an_image_larger_than_any_camera_s_is_refused_by_its_header(name: str) -> None:
    msg = BOMBS[name]
    if name == "PNG":
        data = packing.png(np.zeros((1, 1), np.uint16))
        msg = message(packing.CONFIG.pack(0, 0, 0) + data[:16] + struct.pack(">II", HUGE, HUGE) + data[24:], msg.format)
    with pytest.raises(DecodeError, match=f"has {HUGE}x{HUGE} pixels"):
        decode_depth(msg, "/depth")


WHOLE = [
    message(packing.depth(scene()), "16UC1; compressedDepth png"),
    message(packing.depth(scene(), kind="rvl"), "16UC1; compressedDepth rvl"),
    message(packing.jpeg(np.zeros((16, 16, 3), np.uint8)), "rgb8; jpeg compressed bgr8"),
]


@given(st.sampled_from(WHOLE), st.data())
def test_damage_is_one_line_or_an_image_and_never_a_crash(whole: Any, data: st.DataObject) -> None:
    raw = bytearray(whole.data)
    for _ in range(data.draw(st.integers(0, 3))):
        raw[data.draw(st.integers(0, len(raw) - 1))] = data.draw(st.integers(0, 255))
    cut = bytes(raw[: data.draw(st.integers(0, len(raw)))])
    for decode in (decode_depth, decode_colour):
        said = ""
        try:
            decode(message(cut, whole.format), "/topic")
        except DecodeError as error:
            said = str(error)
        assert not said or said.startswith("/topic: ")
        assert "\n" not in said


@pytest.mark.parametrize("text", ["theora", "h264; compressed", "16UC1; compressedDepth zstd"])
def test_another_code_is_refused_with_those_that_are_read(text: str) -> None:
    with pytest.raises(DecodeError, match="is not read; publish compressedDepth with PNG or RVL"):
        decode_depth(message(bytes(64), text), "/depth")


TYPES = {"/depth/hand/camera_info": INFO, "/camera/hand/camera_info": INFO}


def test_compressed_topics_are_found_beside_their_camera_info() -> None:
    types = {**TYPES, "/depth/hand/image/compressedDepth": COMPRESSED, "/camera/hand/image/compressed": COMPRESSED}
    topics = find_topics(types, BagOptions())
    assert (topics.depth, topics.info) == ("/depth/hand/image/compressedDepth", "/depth/hand/camera_info")
    assert (topics.colour, topics.colour_info) == ("/camera/hand/image/compressed", "/camera/hand/camera_info")


def test_the_raw_topic_goes_before_its_compressed_ones_and_compressed_depth_before_jpeg() -> None:
    packed = {**TYPES, "/depth/hand/image/compressedDepth": COMPRESSED, "/depth/hand/image/compressed": COMPRESSED}
    assert find_topics(packed, BagOptions()).depth == "/depth/hand/image/compressedDepth"
    assert find_topics({**packed, "/depth/hand/image": IMAGE}, BagOptions()).depth == "/depth/hand/image"
    named = find_topics(packed, BagOptions(depth_topic="/depth/hand/image"))
    assert named.depth == "/depth/hand/image/compressedDepth"


@pytest.mark.parametrize("kind", ["png", "rvl"])
def test_a_bag_of_compressed_depth_gives_the_captures_of_the_raw_bag(kind: str, tmp_path: Path) -> None:
    captures = []
    for name in ("raw", "packed"):
        with BagWriter(tmp_path / name) as bag:
            for i in range(4):
                at = 1_000_000_000 + i * 66_000_000
                bag.camera_info("/depth/hand/camera_info", CAMERA, at)
                if name == "raw":
                    bag.image("/depth/hand/image", scene(i), "16UC1", CAMERA.frame_id, at)
                else:
                    data = np.frombuffer(packing.depth(scene(i), kind=kind), np.uint8)
                    fields = {"header": bag._header(at, CAMERA.frame_id), "format": f"16UC1; compressedDepth {kind}", "data": data}
                    bag._message("/depth/hand/image/compressedDepth", COMPRESSED, at, **fields)
        with open_bag(tmp_path / name) as reader:
            captures.append(list(reader.captures(need_tf=False)))
    raw, packed = captures
    assert [c.stamp_ns for c in packed] == [c.stamp_ns for c in raw]
    assert len(packed) == 4
    for a, b in zip(raw, packed, strict=True):
        np.testing.assert_array_equal(b.depth, a.depth)
        np.testing.assert_array_equal(b.reason, a.reason)
