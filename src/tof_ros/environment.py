# SPDX-License-Identifier: Apache-2.0
"""Starting rclpy so that nothing leaves this host unless the user's environment asks for it."""

from __future__ import annotations

import os
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from rclpy.context import Context


@contextmanager
def ros_context(args: Sequence[str] = (), *, domain: int | None = None) -> Iterator[Context]:
    """An rclpy context of its own, shut down at the end; `args` as after `--ros-args`.

    Discovery stays on this host unless ROS_AUTOMATIC_DISCOVERY_RANGE says otherwise.
    """
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    import rclpy

    context = rclpy.Context()
    ros_args = ["toftwin", "--ros-args", *args] if args else None
    rclpy.init(args=ros_args, context=context, domain_id=domain, signal_handler_options=rclpy.SignalHandlerOptions.NO)
    try:
        yield context
    finally:
        context.try_shutdown()
