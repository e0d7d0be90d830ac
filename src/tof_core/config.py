# SPDX-License-Identifier: Apache-2.0
"""Typed, frozen configuration: unit, bounds and meaning stand beside each value.

YAML files, ROS parameter descriptors and the documentation are made from the same table.
"""

from __future__ import annotations

from dataclasses import Field, dataclass, field, fields, is_dataclass, replace
from functools import cache
from math import inf
from typing import TYPE_CHECKING, Any, TypeVar, cast, get_type_hints

from tof_core.errors import ConfigError, brief

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

C = TypeVar("C")
LARGEST = 1e300
"""Largest magnitude of a number in a configuration; a larger int cannot become a float."""


def param(
    default: Any,
    text: str,
    *,
    unit: str = "",
    low: float | None = None,
    high: float | None = None,
    choices: tuple[str, ...] = (),
    why: str = "",
) -> Any:
    """A field of a configuration: default, meaning, unit, bounds, and the reason for the default."""
    return field(default=default, metadata={"text": text, "unit": unit, "low": low, "high": high, "choices": choices, "why": why})


def bounds_of(cls: type[Any], name: str) -> tuple[float, float]:
    """Bounds (low, high) that a parameter states; infinite where it states none."""
    stated = cls.__dataclass_fields__[name].metadata
    low, high = stated.get("low"), stated.get("high")
    return -inf if low is None else float(low), inf if high is None else float(high)


def section(factory: type[C], text: str = "") -> C:
    """A nested configuration."""
    made: Any = field(default_factory=factory, metadata={"text": text})
    return cast("C", made)


@dataclass(frozen=True, slots=True)
class ParamInfo:
    """One row of the table: a parameter's dotted name, type, default, meaning, unit, bounds and reason, and what its section holds."""

    name: str
    kind: type
    default: bool | int | float | str
    text: str
    unit: str
    low: float | None
    high: float | None
    choices: tuple[str, ...]
    why: str = ""
    section: str = ""

    @property
    def meaning(self) -> str:
        """The meaning where the parameter stands alone: that of the section first."""
        return f"{self.section}: {self.text}" if self.section else self.text

    @property
    def group(self) -> str:
        """The dotted name of its section; empty at the top."""
        return self.name.rpartition(".")[0]


def table(cls: type[Any], prefix: str = "") -> tuple[ParamInfo, ...]:
    """Every parameter of a configuration class, depth first, names joined by dots; cached."""
    return _table(cast("Any", cls), prefix)


@cache
def _table(cls: Any, prefix: str) -> tuple[ParamInfo, ...]:
    return tuple(_rows(cls(), prefix))


def _rows(config: Any, prefix: str, about: str = "") -> Iterator[ParamInfo]:
    """The rows of one configuration, with its values as defaults: a section may differ from its class's defaults. about: what it holds."""
    hints = _hints(cast("Any", type(config)))
    for f in fields(config):
        value = getattr(config, f.name)
        if is_dataclass(value):
            yield from _rows(value, f"{prefix}{f.name}.", f.metadata.get("text", ""))
        else:
            yield _info(f, hints[f.name], value, prefix, about)


@cache
def _hints(cls: Any) -> dict[str, Any]:
    return get_type_hints(cls)


def _info(f: Field[Any], kind: type, value: Any, prefix: str = "", about: str = "") -> ParamInfo:
    m = f.metadata
    return ParamInfo(
        prefix + f.name,
        kind,
        value,
        m.get("text", ""),
        m.get("unit", ""),
        m.get("low"),
        m.get("high"),
        m.get("choices", ()),
        m.get("why", ""),
        about,
    )


def from_mapping(cls: type[C], values: Mapping[str, Any], *, where: str = "config") -> C:
    """Build a configuration from nested (or dotted) keys; unknown keys and bad values are refused."""
    return updated(cls(), values, where=where)


def updated(config: C, values: Mapping[str, Any], *, where: str = "config") -> C:
    """`config` with some values changed; unknown keys and bad values are refused before any change."""
    nested = _nest(values, where)
    hints = _hints(cast("Any", type(config)))
    known = {f.name: f for f in fields(cast("Any", config))}
    unknown = sorted(set(nested) - set(known))
    if unknown:
        raise ConfigError(f"unknown key '{unknown[0]}'", where=where, todo=f"known keys: {', '.join(known)}")
    changes: dict[str, Any] = {}
    for name, value in nested.items():
        old, at = getattr(config, name), f"{where}.{name}"
        if is_dataclass(old):
            if not isinstance(value, dict):
                raise ConfigError("must be a group of keys", where=at)
            changes[name] = updated(old, value, where=at)
        else:
            changes[name] = _checked(_info(known[name], hints[name], old), value, at)
    return cast("C", replace(cast("Any", config), **changes))


def to_mapping(config: object) -> dict[str, Any]:
    """Nested plain values of a configuration, as YAML would hold them."""
    return {f.name: to_mapping(v) if is_dataclass(v := getattr(config, f.name)) else v for f in fields(cast("Any", config))}


def flatten(config: object, prefix: str = "") -> dict[str, Any]:
    """Dotted names to values: the form of ROS parameters."""
    return flatten_mapping(to_mapping(config), prefix)


def flatten_mapping(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Dotted names to values of nested mappings."""
    out: dict[str, Any] = {}
    for name, value in values.items():
        out.update(flatten_mapping(value, f"{prefix}{name}.") if isinstance(value, dict) else {f"{prefix}{name}": value})
    return out


def _nest(values: Mapping[str, Any], where: str) -> dict[str, Any]:
    """Nested groups from nested or dotted keys; the caller's mapping is not changed."""
    out: dict[str, Any] = {}
    for name, value in values.items():
        head, _, rest = str(name).partition(".")
        given = {rest: value} if rest else dict(value) if isinstance(value, dict) else value
        old = out.get(head, {})
        if head in out and not (isinstance(old, dict) and isinstance(given, dict) and not old.keys() & given.keys()):
            raise ConfigError(f"key '{head}' is given twice", where=where)
        out[head] = {**old, **given} if isinstance(given, dict) else given
    return out


def _checked(info: ParamInfo, value: Any, where: str) -> Any:
    if isinstance(value, int | float) and not -LARGEST < value < LARGEST:
        raise ConfigError(f"must be a number, not {brief(value)}", where=where)
    if info.kind is float and isinstance(value, int) and not isinstance(value, bool):
        value = float(value)
    if info.kind in (bool, int, float, str) and type(value) is not info.kind:
        msg = f"must be {info.kind.__name__}, not {type(value).__name__} {brief(value)}"
        raise ConfigError(msg, where=where)
    unit = f" {info.unit}" if info.unit else ""
    if info.low is not None and value < info.low:
        msg = f"{value} is below {info.low:g}{unit}"
        raise ConfigError(msg, where=where)
    if info.high is not None and value > info.high:
        msg = f"{value} is above {info.high:g}{unit}"
        raise ConfigError(msg, where=where)
    if info.choices and value not in info.choices:
        msg = f"{brief(value)} is not one of {', '.join(info.choices)}"
        raise ConfigError(msg, where=where)
    return value
