# SPDX-License-Identifier: Apache-2.0
"""YAML in and out: safe, with file and line in each error; duplicate keys are refused."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import yaml

from tof_core.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path


class _Loader(yaml.CSafeLoader if hasattr(yaml, "CSafeLoader") else yaml.SafeLoader):  # type: ignore[misc]
    """The safe loader, but a key given twice is an error."""


def _mapping(loader: Any, node: yaml.MappingNode) -> dict[Any, Any]:
    seen: set[Any] = set()
    for key_node, _ in node.value:
        key = loader.construct_object(key_node, deep=True)
        if not isinstance(key, str | int | float | bool) or key in seen:
            raise yaml.constructor.ConstructorError(None, None, f"key '{key}' is given twice or is no plain key", key_node.start_mark)
        seen.add(key)
    loader.flatten_mapping(node)
    return dict(loader.construct_pairs(node, deep=True))


_Loader.add_constructor(yaml.resolver.BaseResolver.DEFAULT_MAPPING_TAG, _mapping)


def load_yaml(path: Path) -> dict[str, Any]:
    """The mapping in a YAML file (an empty file is an empty mapping); errors name file and line."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "is no UTF-8 text"
        raise ConfigError(f"cannot be read: {reason}", where=path) from None
    return parse_yaml(text, where=str(path))


def parse_yaml(text: str, *, where: str = "yaml") -> dict[str, Any]:
    """The mapping in a YAML text; errors name `where` and the line."""
    try:
        values = yaml.load(text, _Loader)  # noqa: S506 (derived from the safe loader)
    except yaml.MarkedYAMLError as error:
        line = f":{error.problem_mark.line + 1}" if error.problem_mark else ""
        raise ConfigError(f"is no valid YAML: {error.problem}", where=f"{where}{line}") from None
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise ConfigError(f"is no valid YAML: {error}", where=where) from None
    if values is None:
        return {}
    if not isinstance(values, dict):
        raise ConfigError(f"must be a mapping of keys, not a {type(values).__name__}", where=where)
    return values


def dump_yaml(values: Mapping[str, Any]) -> str:
    """Plain values as YAML, keys in their order."""
    return str(yaml.safe_dump(dict(values), sort_keys=False, allow_unicode=True, default_flow_style=None, width=120))


def save_yaml(path: Path, values: Mapping[str, Any]) -> None:
    """Write a YAML file whole or not at all."""
    part = path.with_name(path.name + ".part")
    part.write_text(dump_yaml(values), encoding="utf-8")
    part.replace(path)
