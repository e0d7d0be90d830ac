# SPDX-License-Identifier: Apache-2.0
"""`toftwin node --auto`: the topics of the only published camera, as parameters of the nodes that subscribe to it."""

from __future__ import annotations

import os
import re
import time
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from tof_core.errors import TopicError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from tof_core.topics import Topics

PATIENCE_S = 10.0
"""Seconds within which a newly started driver has made its publishers."""
SENSED = ("preproc", "infer")
COLOURED = ("correct", "inspect")


def find_live(seconds: float = PATIENCE_S) -> Topics:
    """The topics of the only camera that is published in this ROS domain.

    Raises:
        TopicError: no camera within `seconds`, or several; the message lists the topics and the flag to pass.
    """
    from tof_core.options import BagOptions
    from tof_core.topics import find_topics
    from tof_ros.environment import reach
    from tof_ros.survey import watch_types

    end, refusal = time.monotonic() + seconds, TopicError("nothing is published", where="--auto")
    for types in watch_types():
        try:
            return find_topics(types, BagOptions(), where="--auto")
        except TopicError as error:
            refusal = error
        if time.monotonic() > end:
            break
    todo = re.sub(r"--(\w+)-(\w+) with one of", r"--param preproc.input.\1_\2=TOPIC with one of", refusal.todo or "")
    raise TopicError(f"{refusal.what} ({reach(os.environ)})", where="--auto", todo=todo.replace("record the", "publish the"))


def parameters_of(topics: Topics, nodes: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Parameters of the nodes, by node and dotted name; topics that are not published keep their defaults."""
    sensed = {"depth_topic": topics.depth, "points_topic": topics.points, "info_topic": topics.info}
    sensed |= {"amplitude_topic": topics.amplitude, "temperature_topic": topics.temperature}
    colour = {"live.colour_topic": topics.colour, "live.colour_info_topic": topics.colour_info}
    given = {f"input.{name}": topic for name, topic in sensed.items() if topic}
    seen = {name: topic for name, topic in colour.items() if topic}
    return {node: given if node in SENSED else seen for node in nodes if node in (*SENSED, *COLOURED)}


def with_topics(parameters: Mapping[str, Mapping[str, Any]], topics: Topics, nodes: Sequence[str]) -> dict[str, dict[str, Any]]:
    """The user's parameters, completed by the topics found."""
    found = parameters_of(topics, nodes)
    return {node: {**found.get(node, {}), **parameters.get(node, {})} for node in nodes}


def taken(topics: Topics) -> str:
    """One line with the topics found."""
    plain = replace(topics, colour_info="")
    return f"auto: {', '.join(plain.named())}"
