# SPDX-License-Identifier: Apache-2.0
"""Quality of service, one rule per kind of topic.

A reliable subscriber cannot hear a best-effort publisher, a transient-local one no volatile publisher;
so sensors are heard best-effort and volatile (that hears everybody) unless asked otherwise, and
results are published reliable and volatile (that everybody hears).
"""

from __future__ import annotations

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy


def _profile(depth: int, *, reliable: bool, latched: bool = False) -> QoSProfile:
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


OUTPUT = _profile(30, reliable=True)
"""What nodes publish, and how they hear each other: two seconds of frames, should one of them be busy."""
LATCHED = _profile(1, reliable=True, latched=True)
"""Results a late subscriber still wants: the scene, the model."""
TF = _profile(100, reliable=True)
TF_STATIC = _profile(100, reliable=True, latched=True)
RECORD = _profile(64, reliable=True)
"""Recorders of our own topics: deep enough for one slow disk write."""


def sensor(*, reliable: bool = False, depth: int = 16) -> QoSProfile:
    """How a sensor's stream is heard: best-effort hears every publisher, reliable loses nothing of a reliable one."""
    return _profile(depth, reliable=reliable)
