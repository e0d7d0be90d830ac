# SPDX-License-Identifier: Apache-2.0
"""Message and action classes by name, and what of toftwin_msgs this environment has."""

from __future__ import annotations

from importlib import import_module
from typing import Any

PACKAGE = "toftwin_msgs"
"""The graph's own interfaces (ros_ws/src/toftwin_msgs)."""
MISSING = f"{PACKAGE} is not installed: no typed topics and no actions (make setup builds it, or colcon build --packages-select {PACKAGE})"


def message_class(type_name: str) -> type[Any] | None:
    """The class of `package/msg/Name` or `package/Name`, or None where this host has no such package."""
    package, _, name = type_name.replace("/msg/", "/").partition("/")
    return _found(f"{package}.msg", name)


def own_message(name: str) -> type[Any] | None:
    """A message of toftwin_msgs, or None where that is not installed."""
    return _found(f"{PACKAGE}.msg", name)


def own_action(name: str) -> type[Any] | None:
    """An action of toftwin_msgs, or None where that is not installed."""
    return _found(f"{PACKAGE}.action", name)


def _found(module: str, name: str) -> type[Any] | None:
    try:
        found: type[Any] = getattr(import_module(module), name)
    except (ImportError, AttributeError):
        return None
    return found
