# SPDX-License-Identifier: Apache-2.0
"""The cameras of a session, as labels need them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.capture import Posed
    from tof_scene.raycast import Raycaster
    from tof_scene.scene import Scene
    from toftwin.displaced import Displaced


@dataclass(frozen=True, slots=True, eq=False)
class Cameras:
    """The cameras of all views, and the parts that stand elsewhere than in the CAD."""

    posed: Sequence[Posed]
    displaced: tuple[Displaced, ...] = ()

    def caster(self, cad: Raycaster) -> Raycaster:
        """The scene as the session found it: the CAD's, or one with these parts where they stand."""
        if not self.displaced:
            return cad
        from tof_scene.raycast import Raycaster
        from toftwin.displaced import as_found

        return Raycaster(as_found(cad.scene, self.displaced))

    def note(self, scene: Scene) -> str:
        """A note of the parts whose labels show them elsewhere than in the CAD; empty if there are none."""
        if not self.displaced:
            return ""
        from toftwin.displaced import in_words

        return in_words(scene, self.displaced)
