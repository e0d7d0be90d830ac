# SPDX-License-Identifier: Apache-2.0
"""Give each effect the physical size at which it makes the error that its strength asks for."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tof_virtual.session import Session


def calibrate(session: Session) -> None:
    """Set the size of every effect whose strength is stated as an error."""
