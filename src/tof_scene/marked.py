# SPDX-License-Identifier: Apache-2.0
"""YAML values with their file and line, for error messages."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import yaml

from tof_core.config import LARGEST
from tof_core.errors import ConfigError, SceneError, brief
from tof_core.yamlio import compose_yaml, parse_yaml, read_text

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path


@dataclass(frozen=True, slots=True)
class Marked:
    """A plain YAML value, its dotted name and the node it came from."""

    value: Any
    name: str
    path: Path
    node: yaml.Node | None

    def error(self, what: str, todo: str = "") -> SceneError:
        """The error, with file and line."""
        line = f":{self.node.start_mark.line + 1}" if self.node else ""
        return SceneError(what, where=f"{self.path}{line}", todo=todo)

    def get(self, key: str) -> Marked | None:
        """The value of a key, None where it is absent or null."""
        self._mapping()
        if self.value.get(key) is None:
            return None
        nodes = {k.value: v for k, v in self.node.value} if isinstance(self.node, yaml.MappingNode) else {}
        return Marked(self.value[key], f"{self.name}.{key}".lstrip("."), self.path, nodes.get(key, self.node))

    def need(self, key: str) -> Marked:
        """The value of a key that must be there."""
        found = self.get(key)
        if found is None:
            raise self.error(f"the key '{key}' is missing", f"add it to {self.name or 'the scene'}")
        return found

    def only(self, keys: Iterable[str]) -> None:
        """Refuse every other key."""
        keys = tuple(keys)
        for key in self._mapping():
            if key not in keys:
                wrong = (
                    next((k for k, _ in self.node.value if k.value == str(key)), None) if isinstance(self.node, yaml.MappingNode) else None
                )
                raise Marked(key, self.name, self.path, wrong or self.node).error(f"unknown key '{key}'", f"known keys: {', '.join(keys)}")

    def items(self) -> list[Marked]:
        """The entries of a list."""
        if not isinstance(self.value, list):
            raise self.error(f"{self.name} must be a list")
        nodes = self.node.value if isinstance(self.node, yaml.SequenceNode) else [self.node] * len(self.value)
        return [Marked(v, f"{self.name}[{i}]", self.path, n) for i, (v, n) in enumerate(zip(self.value, nodes, strict=True))]

    def text(self) -> str:
        """A string that is not empty."""
        if not isinstance(self.value, str) or not self.value.strip():
            raise self.error(f"{self.name} must be a text, not {brief(self.value)}")
        return self.value

    def flag(self) -> bool:
        """True or false."""
        if not isinstance(self.value, bool):
            raise self.error(f"{self.name} must be true or false, not {brief(self.value)}")
        return self.value

    def number(self, *, above: float = -math.inf, low: float = -math.inf, high: float = math.inf) -> float:
        """A finite number within bounds."""
        v = self.value
        if isinstance(v, bool) or not isinstance(v, int | float) or not -LARGEST < v < LARGEST or not (v > above and low <= v <= high):
            bounds = f" above {above:g}" if above > -math.inf else f" from {low:g} to {high:g}" if low > -math.inf else ""
            raise self.error(f"{self.name} must be a number{bounds}, not {brief(v)}")
        return float(v)

    def numbers(self, count: int) -> list[float]:
        """A list of finite numbers."""
        if not isinstance(self.value, list) or len(self.value) != count:
            raise self.error(f"{self.name} must be {count} numbers, not {brief(self.value)}")
        return [entry.number() for entry in self.items()]

    def _mapping(self) -> dict[str, Any]:
        if not isinstance(self.value, dict):
            raise self.error(f"{self.name or 'the scene'} must be a group of keys, not {brief(self.value)}")
        return self.value


def load_marked(path: Path) -> Marked:
    """The mapping in a YAML file, with line numbers."""
    try:
        text = read_text(path)
        values, node = parse_yaml(text, where=str(path)), compose_yaml(text, where=str(path))
    except ConfigError as error:
        raise SceneError(error.what, where=error.where, todo=error.todo) from None
    return Marked(values, "", path, node)
