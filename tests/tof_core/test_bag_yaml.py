# SPDX-License-Identifier: Apache-2.0
"""The YAML of bags is the same as that of rosbags' own library, and its errors are those that rosbags expects."""

from __future__ import annotations

from io import StringIO
from typing import TYPE_CHECKING, Any

import pytest
from rosbags.rosbag2 import metadata
from rosbags.rosbag2.errors import ReaderError
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from tof_core.bag_yaml import BagYaml, use_libyaml
from tof_core.yamlio import DEEPEST

if TYPE_CHECKING:
    from pathlib import Path

TIME = {"sec": 9223372036, "nsec": 854775807}
QOS: dict[str, Any] = {
    "history": "keep_last",
    "depth": 10,
    "reliability": 1,
    "durability": "transient_local",
    "deadline": TIME,
    "lifespan": TIME,
    "liveliness": "automatic",
    "liveliness_lease_duration": TIME,
    "avoid_ros_namespace_conventions": False,
}


def test_it_reads_the_metadata_of_a_bag_as_ruamel_does(repository: Path) -> None:
    text = (repository / "tests/data/golden/bag/metadata.yaml").read_text()
    values = BagYaml().load(text)
    assert values == YAML(typ="safe").load(text)
    assert "rosbag2_bagfile_information" in values


@pytest.mark.parametrize("flow", [None, False])
def test_ruamel_reads_what_it_writes(flow: bool | None) -> None:  # noqa: FBT001
    stream, writer = StringIO(), BagYaml()
    writer.default_flow_style = flow
    writer.dump([QOS], stream)
    assert YAML(typ="safe").load(stream.getvalue()) == [QOS]


def test_a_text_nested_too_deep_is_an_error_of_rosbags() -> None:
    """In libyaml itself it would end the process."""
    use_libyaml()
    deep = "[" * (DEEPEST + 2) + "]" * (DEEPEST + 2)
    with pytest.raises(YAMLError, match=f"more than {DEEPEST} levels deep"):
        BagYaml().load(deep)
    with pytest.raises(ReaderError, match="offered_qos_profiles"):
        metadata.parse_qos(deep)
