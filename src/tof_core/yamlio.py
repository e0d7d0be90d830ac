# SPDX-License-Identifier: Apache-2.0
"""YAML in and out: safe loader, file and line in each error; duplicate keys and oversized alias expansions are refused."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import yaml

from tof_core.errors import ConfigError, brief

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path


class _Loader(yaml.CSafeLoader if hasattr(yaml, "CSafeLoader") else yaml.SafeLoader):  # type: ignore[misc]
    """The safe loader; a key given twice is an error."""


def _mapping(loader: Any, node: yaml.MappingNode) -> dict[Any, Any]:
    seen: set[Any] = set()
    for key_node, _ in node.value:
        key = loader.construct_object(key_node, deep=True)
        if not isinstance(key, str | int | float | bool) or (isinstance(key, int) and abs(key) > 2**63) or key in seen:
            raise yaml.constructor.ConstructorError(None, None, f"key {brief(key)} is given twice or is no plain key", key_node.start_mark)
        seen.add(key)
    loader.flatten_mapping(node)
    return dict(loader.construct_pairs(node, deep=True))


_Loader.add_constructor(yaml.resolver.BaseResolver.DEFAULT_MAPPING_TAG, _mapping)


DEEPEST = 32
"""Most levels of nesting; at some thousand, libyaml's stack overflows and ends the process."""
LARGEST = 100_000
"""Most values in a text, counting the values of an alias at each use: nine lines of aliases can stand for gigabytes."""


def load_yaml(path: Path) -> dict[str, Any]:
    """The mapping in a YAML file (an empty file is an empty mapping); errors name file and line."""
    return parse_yaml(read_text(path), where=str(path))


def read_text(path: Path) -> str:
    """A file's text; a ConfigError where it is no UTF-8."""
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "is no UTF-8 text"
        raise ConfigError(f"cannot be read: {reason}", where=path) from None


def parse_yaml(text: str, *, where: str = "yaml") -> dict[str, Any]:
    """The mapping in a YAML text; errors name `where` and the line."""
    values = yaml_values(text, where=where)
    if values is None:
        return {}
    if not isinstance(values, dict):
        raise ConfigError(f"must be a mapping of keys, not a {type(values).__name__}", where=where)
    return values


def yaml_values(text: str, *, where: str = "yaml") -> Any:
    """The values in a YAML text, of any kind; errors name `where` and the line."""
    with _one_line(where):
        _check_size(text, where)
        return yaml.load(text, _Loader)  # noqa: S506 (derived from the safe loader)


def compose_yaml(text: str, *, where: str = "yaml") -> yaml.Node | None:
    """The nodes of a YAML text, with their lines."""
    with _one_line(where):
        _check_size(text, where)
        node: yaml.Node | None = yaml.compose(text, _Loader)
    return node


def _check_size(text: str, where: str) -> None:
    """Refuse a text that is nested too deep, or too large once its aliases are expanded."""
    sizes: dict[str, int] = {}
    open_since: list[tuple[str | None, int]] = []
    count = 0
    for event in yaml.parse(text, _Loader):
        line = event.start_mark.line + 1 if event.start_mark else 0
        if isinstance(event, yaml.CollectionEndEvent):
            anchor, before = open_since.pop()
            if anchor:
                sizes[anchor] = count - before
        elif isinstance(event, yaml.AliasEvent):
            if event.anchor not in sizes:
                raise ConfigError(f"is no valid YAML: '*{event.anchor}' is not known, or stands within itself", where=f"{where}:{line}")
            count += sizes[event.anchor]
        elif isinstance(event, yaml.NodeEvent):
            count += 1
            if isinstance(event, yaml.CollectionStartEvent):
                open_since.append((event.anchor, count))
            elif event.anchor:
                sizes[event.anchor] = 1
        if len(open_since) > DEEPEST or count > LARGEST:
            what = f"is nested more than {DEEPEST} levels deep" if len(open_since) > DEEPEST else f"holds more than {LARGEST} values"
            raise ConfigError(what, where=f"{where}:{line}")


@contextmanager
def _one_line(where: str) -> Iterator[None]:
    """Every error of the YAML library becomes a ConfigError."""
    try:
        yield
    except ConfigError:
        raise
    except yaml.MarkedYAMLError as error:
        line = f":{error.problem_mark.line + 1}" if error.problem_mark else ""
        raise ConfigError(f"is no valid YAML: {error.problem}", where=f"{where}{line}") from None
    except Exception as error:  # noqa: BLE001 (tags such as !!int with a text that is none raise whatever comes)
        raise ConfigError(f"is no valid YAML: {str(error) or type(error).__name__}", where=where) from None


def dump_yaml(values: Mapping[str, Any]) -> str:
    """Plain values as YAML, keys in their order."""
    return str(yaml.safe_dump(dict(values), sort_keys=False, allow_unicode=True, default_flow_style=None, width=120))


def save_yaml(path: Path, values: Mapping[str, Any]) -> None:
    """Write a YAML file whole or not at all."""
    part = path.with_name(path.name + ".part")
    part.write_text(dump_yaml(values), encoding="utf-8")
    part.replace(path)
