# SPDX-License-Identifier: Apache-2.0
"""Two nodes of one name mix their outputs: both say so, the first once the second comes, and no longer once it is gone."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip("rclpy", reason="no ROS 2 here")
from tests.tof_ros.peers import Observer, wait_for

if TYPE_CHECKING:
    from collections.abc import Iterator

pytestmark = pytest.mark.dds


@pytest.fixture
def context(ros_domain: int) -> Iterator[Any]:
    from tof_ros.environment import ros_context

    with ros_context(domain=ros_domain) as context:
        yield context


def test_a_second_node_of_a_name_is_reported_while_it_is_there(context: Any) -> None:
    from tof_preproc.node import make_node
    from tof_ros.environment import parameter_overrides
    from tof_ros.spin import spinning

    def preproc(namespace: str) -> Any:
        return make_node(context=context, namespace=namespace, parameter_overrides=parameter_overrides({"live.need_tf": False}))

    observer, first, other = Observer(context), preproc("spot"), preproc("rover")
    with spinning([observer.node, first, other]):
        observer.status("spot/preproc")
        assert first.complaints() == other.complaints() == []
        with spinning([preproc("spot")]):
            status = observer.status("spot/preproc", lambda s: s.level == b"\x01")
            assert status.message.startswith(
                "2 nodes are named /spot/preproc: their topics, services and /tf_static are mixed; stop the others"
            )
            wait_for(lambda: any("2 nodes are named /spot/preproc" in line for line in observer.log), what="for the log")
            assert other.complaints() == []
        wait_for(lambda: first.complaints() == [], what="for the second to be gone")
