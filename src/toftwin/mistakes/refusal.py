# SPDX-License-Identifier: Apache-2.0
"""A refused session, with the usual mistake that explains the refusal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tof_core.errors import RefusedError
from tof_core.shares import in_percent
from toftwin.mistakes.find import find_mistake
from toftwin.mistakes.fit import fitting

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_align.config import AlignConfig
    from tof_core.capture import View
    from tof_core.options import BagOptions
    from tof_scene.raycast import Raycaster


def explained(error: RefusedError, views: Sequence[View], caster: Raycaster, options: BagOptions, align: AlignConfig) -> RefusedError:
    """The refusal with the line to change, if a common mistake explains it; else the unchanged refusal."""
    found = find_mistake(views, caster, options, align)
    if found.mistake is None:
        return error
    without = f"without that {in_percent(found.undone)} of the pixels are {fitting(found.mistake.metres)}"
    why = f"{error.what}; {found.mistake.what}: {without}, with it {in_percent(found.share)} are {fitting()}"
    return RefusedError(why, where=error.where, todo=found.mistake.todo)
