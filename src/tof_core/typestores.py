# SPDX-License-Identifier: Apache-2.0
"""Message definitions of the ROS distributions that are read and written."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any, Literal

from tof_core.errors import UsageError

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

TYPE_VERSIONS: dict[str, Literal[8, 9]] = {"humble": 8, "jazzy": 9}
"""The rosbag2 metadata version written for each distribution (9 has Jazzy's spelling of QoS)."""


@cache
def typestore_of(distro: str) -> Typestore:
    """The types of a distribution; bags that embed no definitions are read with these."""
    from rosbags.typesys import Stores, get_typestore

    stores = {"humble": Stores.ROS2_HUMBLE, "jazzy": Stores.ROS2_JAZZY}
    if distro not in stores:
        raise UsageError(f"ROS distribution '{distro}' is not known", todo="use jazzy or humble")
    return get_typestore(stores[distro])


class JazzyWhenAsked:
    """Jazzy's definitions, with which rosbags reads a bag that embeds none; loaded at first use, which takes 0.1 s."""

    @property
    def fielddefs(self) -> dict[str, Any]:
        """The fields of each type, by its name."""
        return typestore_of("jazzy").fielddefs
