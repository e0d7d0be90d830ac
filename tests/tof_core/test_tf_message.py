# SPDX-License-Identifier: Apache-2.0
"""Transforms are read from the bytes of a message as a deserialiser reads them."""

from __future__ import annotations

import math
import struct
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore

from tof_core.errors import TransformError
from tof_core.tf import TransformBuffer
from tof_core.tf_message import PADDING, TYPE_HASH, StampedTransform, read_transforms

STORE = get_typestore(Stores.ROS2_JAZZY)
KIND = "tf2_msgs/msg/TFMessage"
NAMES = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=12)
NUMBERS = st.tuples(*7 * [st.floats(allow_nan=False)])
SENT = st.builds(StampedTransform, NAMES, NAMES, st.integers(-(2**31) * 10**9, 2**31 * 10**9 - 1), NUMBERS)


def message(sent: list[StampedTransform]) -> Any:
    """As the typestore has it."""
    kinds = STORE.types

    def transform(t: StampedTransform) -> Any:
        sec, nanosec = divmod(t.stamp_ns, 10**9)
        head = kinds["std_msgs/msg/Header"](kinds["builtin_interfaces/msg/Time"](sec, nanosec), t.parent)
        move, turn = kinds["geometry_msgs/msg/Vector3"](*t.motion[:3]), kinds["geometry_msgs/msg/Quaternion"](*t.motion[3:])
        return kinds["geometry_msgs/msg/TransformStamped"](head, t.child, kinds["geometry_msgs/msg/Transform"](move, turn))

    return kinds[KIND]([transform(t) for t in sent])


def serialised(sent: list[StampedTransform], *, little_endian: bool = True) -> bytes:
    return bytes(STORE.serialize_cdr(message(sent), KIND, little_endian=little_endian))


TWO = [
    StampedTransform("cell", "spot/body", 1_500_000_007, (1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0)),
    StampedTransform("spot/body", "hand", 1_600_000_000, (0.1, 0.2, 0.3, 0.5, -0.5, 0.5, -0.5)),
]


@given(st.lists(SENT, max_size=4), st.booleans())
def test_what_is_read_is_what_was_sent(sent: list[StampedTransform], little_endian: bool) -> None:  # noqa: FBT001
    assert read_transforms(serialised(sent, little_endian=little_endian)) == sent


@given(st.lists(SENT, max_size=3), st.integers(0, 12))
def test_of_a_whole_message_at_most_padding_is_left(sent: list[StampedTransform], further: int) -> None:
    cdr = serialised(sent) + bytes(further)
    assert read_transforms(cdr) == sent
    if further <= PADDING:
        assert read_transforms(cdr, whole=True) == sent
        return
    with pytest.raises(TransformError, match="is no tf2_msgs/TFMessage"):
        read_transforms(cdr, whole=True)


def test_the_type_hash_is_that_of_both_distributions() -> None:
    assert {get_typestore(store).hash_rihs01(KIND) for store in (Stores.ROS2_JAZZY, Stores.ROS2_HUMBLE)} == {TYPE_HASH}


@pytest.mark.parametrize(("representation", "between"), [(b"\0\1\0\0", "4x"), (b"\0\7\0\0", "")])
def test_numbers_of_eight_bytes_are_aligned_as_the_representation_has_it(representation: bytes, between: str) -> None:
    content = struct.pack(f"<IiII4sI4s{between}7d", 1, 1, 5, 4, b"odo", 4, b"hip", *TWO[0].motion)
    assert read_transforms(representation + content) == [StampedTransform("odo", "hip", 1_000_000_005, TWO[0].motion)]


@pytest.mark.parametrize("short", range(len(serialised(TWO))))
def test_a_message_that_is_cut_short_is_refused(short: int) -> None:
    with pytest.raises(TransformError, match=r"is no tf2_msgs/TFMessage"):
        read_transforms(serialised(TWO)[:short])


@pytest.mark.parametrize(
    "data", [b"\0\2" + serialised(TWO)[2:], serialised(TWO).replace(b"spot", b"\xff\xfe\xfd\xfc"), b"\0\1\0\0\xff\xff\xff\xff"]
)
def test_what_is_no_such_message_is_refused(data: bytes) -> None:
    with pytest.raises(TransformError):
        read_transforms(data)


def test_a_buffer_has_the_same_transforms_from_bytes_as_from_messages() -> None:
    from_bytes, from_message = TransformBuffer(), TransformBuffer()
    for t in read_transforms(serialised(TWO)):
        from_bytes.put(t)
    from_message.add_message(message(TWO))
    for parent, child, stamp, _ in TWO:
        np.testing.assert_array_equal(from_bytes.lookup(parent, child, stamp), from_message.lookup(parent, child, stamp))
    with pytest.raises(TransformError, match="no rigid motion"):
        from_bytes.put(TWO[0]._replace(motion=(math.nan, *TWO[0].motion[1:])))
