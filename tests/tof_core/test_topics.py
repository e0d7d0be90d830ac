# SPDX-License-Identifier: Apache-2.0
"""Topics: found by type, word and sibling; where several fit, the message lists them and the flag."""

from __future__ import annotations

import pytest

from tof_core.errors import TopicError, UsageError
from tof_core.options import BagOptions
from tof_core.topics import COMPRESSED, IMAGE, INFO, POINTS, TEMPERATURE, Topics, find_topics

SPOT = {
    "/depth/hand/image": IMAGE,
    "/depth/hand/camera_info": INFO,
    "/ir/hand/image": IMAGE,
    "/ir/hand/camera_info": INFO,
    "/camera/hand/image": IMAGE,
    "/camera/hand/camera_info": INFO,
    "/hand/temperature": TEMPERATURE,
    "/depth_registered/hand/image": IMAGE,
    "/depth_registered/hand/camera_info": INFO,
    "/tf": "tf2_msgs/msg/TFMessage",
}
FULL = Topics(
    "/depth/hand/image",
    "/depth/hand/camera_info",
    "",
    "/ir/hand/image",
    "/camera/hand/image",
    "/camera/hand/camera_info",
    "/hand/temperature",
)


def named(types: dict[str, str], prefix: str) -> dict[str, str]:
    return {prefix + name: kind for name, kind in types.items()}


def test_spot_s_names_are_found() -> None:
    assert find_topics(SPOT, BagOptions()) == FULL


@pytest.mark.parametrize("prefix", ["/spot", "/fleet/robot_7"])
def test_any_namespace_will_do(prefix: str) -> None:
    found = find_topics(named(SPOT, prefix), BagOptions())
    assert found.depth == f"{prefix}/depth/hand/image"
    assert found.amplitude == f"{prefix}/ir/hand/image"
    assert found.temperature == f"{prefix}/hand/temperature"


def test_depth_that_is_aligned_to_colour_is_taken_only_where_there_is_no_other() -> None:
    aligned = {"/camera/aligned_depth_to_color/image_raw": IMAGE, "/camera/aligned_depth_to_color/camera_info": INFO}
    own = {"/camera/depth/image_rect_raw": IMAGE, "/camera/depth/camera_info": INFO}
    assert find_topics(aligned | own, BagOptions()).depth == "/camera/depth/image_rect_raw"
    assert find_topics(aligned, BagOptions()).depth == "/camera/aligned_depth_to_color/image_raw"


def test_realsense_names_are_found_by_word() -> None:
    found = find_topics(
        {
            "/camera/depth/image_rect_raw": IMAGE,
            "/camera/depth/camera_info": INFO,
            "/camera/infra1/image_rect_raw": IMAGE,
            "/camera/infra1/camera_info": INFO,
            "/camera/color/image_raw": IMAGE,
            "/camera/color/camera_info": INFO,
        },
        BagOptions(),
    )
    assert found.depth == "/camera/depth/image_rect_raw"
    assert found.colour == "/camera/color/image_raw"


def test_the_encoding_decides_where_the_name_does_not() -> None:
    types = {"/tof/image": IMAGE, "/tof/camera_info": INFO, "/webcam/image": IMAGE, "/webcam/camera_info": INFO}
    assert find_topics(types, BagOptions(), encodings={"/tof/image": "16UC1", "/webcam/image": "rgb8"}).depth == "/tof/image"


def test_a_picture_that_only_has_the_word_is_not_depth() -> None:
    types = {"/depth/preview/image": IMAGE, "/depth/preview/camera_info": INFO, "/depth/arm/image": IMAGE, "/depth/arm/camera_info": INFO}
    found = find_topics(types, BagOptions(), encodings={"/depth/preview/image": "rgb8", "/depth/arm/image": "16UC1"})
    assert found.depth == "/depth/arm/image"


TWO = {"/depth/left/image": IMAGE, "/depth/left/camera_info": INFO, "/depth/right/image": IMAGE, "/depth/right/camera_info": INFO}


def test_two_depth_cameras_are_listed_with_the_flag() -> None:
    with pytest.raises(TopicError) as caught:
        find_topics(TWO, BagOptions(), where="my_bag")
    assert str(caught.value) == (
        "my_bag: has 2 topics that may be the depth image; pass --depth-topic with one of: /depth/left/image, /depth/right/image"
    )


def test_a_named_topic_settles_it_and_brings_its_siblings() -> None:
    types = {**TWO, "/ir/left/image": IMAGE, "/ir/right/image": IMAGE, "/left/temperature": TEMPERATURE, "/right/temperature": TEMPERATURE}
    found = find_topics(types, BagOptions(depth_topic="depth/right/image"))
    assert found == Topics("/depth/right/image", "/depth/right/camera_info", "", "/ir/right/image", "", "", "/right/temperature")


def test_optional_topics_can_be_left_out() -> None:
    found = find_topics(SPOT, BagOptions(amplitude_topic="none", colour_topic="none", temperature_topic="none"))
    assert (found.amplitude, found.colour, found.temperature) == ("", "", "")


def test_an_ambiguous_optional_topic_is_asked_for_not_guessed() -> None:
    types = {**SPOT, "/a/temperature": TEMPERATURE, "/b/temperature": TEMPERATURE}
    del types["/hand/temperature"]
    with pytest.raises(TopicError, match="--temperature-topic with one of: /a/temperature, /b/temperature"):
        find_topics(types, BagOptions())


def test_points_stand_in_where_there_is_no_depth_image() -> None:
    types = {"/depth/hand/points": POINTS, "/depth/hand/camera_info": INFO}
    assert find_topics(types, BagOptions()) == Topics(points="/depth/hand/points", info="/depth/hand/camera_info")


def test_points_that_the_user_names_win_over_the_image() -> None:
    found = find_topics({**SPOT, "/depth/hand/points": POINTS}, BagOptions(points_topic="/depth/hand/points"))
    assert (found.depth, found.points) == ("", "/depth/hand/points")


@pytest.mark.parametrize(
    ("types", "options", "message"),
    [
        ({}, BagOptions(), "has no depth image and no point cloud; its topics: none"),
        ({"/depth/hand/image/compressedDepth": COMPRESSED}, BagOptions(), "record /depth/hand/camera_info too"),
        ({"/depth/hand/image": IMAGE}, BagOptions(), "has no CameraInfo beside '/depth/hand/image'; record /depth/hand/camera_info too"),
        (
            {"/depth/hand/image": IMAGE, "/x/camera_info": INFO},
            BagOptions(),
            "/depth/hand/camera_info too .*, or pass --info-topic with .*, one of: /x/camera_info",
        ),
        (SPOT, BagOptions(depth_topic="/nope"), r"has no topic '/nope' \(--depth-topic\); its topics: /camera"),
        (SPOT, BagOptions(depth_topic="/tf"), "is a tf2_msgs/msg/TFMessage, not a sensor_msgs/msg/Image"),
    ],
)
def test_a_missing_topic_is_named_with_what_to_do(types: dict[str, str], options: BagOptions, message: str) -> None:
    with pytest.raises(TopicError, match=message):
        find_topics(types, options)


def test_a_wrong_name_in_the_call_is_the_call_s_fault() -> None:
    with pytest.raises(UsageError, match="--points-topic") as caught:
        find_topics(SPOT, BagOptions(points_topic="/nope"))
    assert caught.value.exit_code == 2
