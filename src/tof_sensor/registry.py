# SPDX-License-Identifier: Apache-2.0
"""All effects in `tof_sensor.effects` by name, in physical order."""

from __future__ import annotations

from difflib import get_close_matches
from importlib import import_module
from pkgutil import iter_modules
from typing import TYPE_CHECKING

from tof_core.errors import ConfigError, UsageError
from tof_sensor import effects
from tof_sensor.effect import Effect

if TYPE_CHECKING:
    from collections.abc import Iterable
    from types import ModuleType


def _defined(module: ModuleType) -> list[type[Effect]]:
    """The effects that a module defines."""
    return [
        kind for kind in vars(module).values() if isinstance(kind, type) and issubclass(kind, Effect) and kind.__module__ == module.__name__
    ]


_MODULES = [import_module(f"{effects.__name__}.{found.name}") for found in iter_modules(effects.__path__)]

PHYSICAL_ORDER: tuple[type[Effect], ...] = tuple(sorted((kind for module in _MODULES for kind in _defined(module)), key=lambda e: e.ORDER))
"""Part, pose, light, pixel, noise, output: by each effect's `ORDER`."""

EFFECTS: dict[str, type[Effect]] = {effect.NAME: effect for effect in PHYSICAL_ORDER}

VOCABULARY: tuple[str, ...] = tuple(sorted(name for name, effect in EFFECTS.items() if effect.MEANING))
"""Names of effects in a diagnosis, without the photon law, which every sensor has."""


def effect_class(name: str) -> type[Effect]:
    """The effect of that name, or a ConfigError that lists the names."""
    if name not in EFFECTS:
        msg = f"unknown effect '{name}'"
        raise ConfigError(msg, where="sensor", todo=f"known: {', '.join(sorted(EFFECTS))}")
    return EFFECTS[name]


def left_out(names: Iterable[str], where: str) -> frozenset[str]:
    """The names of effects that a diagnosis must not consider; unknown names are refused.

    Raises:
        UsageError: a name is no effect; the message lists similar names and all names.
    """
    asked = frozenset(names)
    for name in sorted(asked - set(VOCABULARY)):
        near = get_close_matches(name[:80], VOCABULARY, n=3)
        meant = f"did you mean {' or '.join(near)}? " if near else ""
        raise UsageError(f"there is no effect '{name}'", where=where, todo=f"{meant}effects: {', '.join(VOCABULARY)}")
    return asked
