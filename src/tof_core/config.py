# SPDX-License-Identifier: Apache-2.0
"""Typed, frozen configuration: units, bounds and meaning stand beside each value, once.

From the same table come YAML files, ROS parameter descriptors and the documentation.
"""

from __future__ import annotations

import math
from dataclasses import MISSING, Field, dataclass, field, fields, is_dataclass
from typing import TYPE_CHECKING, Any, TypeVar, cast, get_type_hints

from tof_core.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

C = TypeVar("C")


def param(
    default: Any, text: str, *, unit: str = "", low: float | None = None, high: float | None = None,
    choices: tuple[str, ...] = (),
) -> Any:
    """A field of a configuration: its default, what it means, its unit and its bounds."""
    return field(default=default, metadata={"text": text, "unit": unit, "low": low, "high": high, "choices": choices})


def section(factory: type[C], text: str = "") -> C:
    """A nested configuration."""
    return cast("C", field(default_factory=factory, metadata={"text": text}))


@dataclass(frozen=True, slots=True)
class ParamInfo:
    """One row of the table: a dotted name with all that is known about it."""

    name: str
    kind: type
    default: bool | int | float | str
    text: str
    unit: str
    low: float | None
    high: float | None
    choices: tuple[str, ...]


def table(cls: type[Any], prefix: str = "") -> Iterator[ParamInfo]:
    """Every parameter of a configuration class, depth first, names joined by dots."""
    hints = get_type_hints(cls)
    for f in fields(cls):
        kind = hints[f.name]
        if is_dataclass(kind):
            yield from table(cast("type[Any]", kind), f"{prefix}{f.name}.")
        else:
            yield _info(f, kind, prefix)


def _info(f: Field[Any], kind: type, prefix: str) -> ParamInfo:
    m = f.metadata
    default = f.default if f.default is not MISSING else cast("Any", f.default_factory)()
    return ParamInfo(prefix + f.name, kind, default, m.get("text", ""), m.get("unit", ""), m.get("low"),
                     m.get("high"), m.get("choices", ()))


def from_mapping(cls: type[C], values: Mapping[str, Any], *, where: str = "config") -> C:
    """Build a configuration from nested (or dotted) keys; unknown keys and bad values are refused."""
    nested = _nest(values)
    hints = get_type_hints(cls)
    known = {f.name: f for f in fields(cast("Any", cls))}
    unknown = sorted(set(nested) - set(known))
    if unknown:
        msg = f"unknown key '{unknown[0]}'"
        raise ConfigError(msg, where=where, todo=f"known keys: {', '.join(known)}")
    arguments: dict[str, Any] = {}
    for name, value in nested.items():
        kind = hints[name]
        at = f"{where}.{name}"
        if is_dataclass(kind):
            if not isinstance(value, dict):
                msg = "must be a group of keys"
                raise ConfigError(msg, where=at)
            arguments[name] = from_mapping(cast("type[Any]", kind), value, where=at)
        else:
            arguments[name] = _checked(_info(known[name], kind, ""), value, at)
    return cls(**arguments)


def to_mapping(config: object) -> dict[str, Any]:
    """Nested plain values of a configuration, as YAML would hold them."""
    return {
        f.name: to_mapping(v) if is_dataclass(v := getattr(config, f.name)) else v
        for f in fields(cast("Any", config))
    }


def flatten(config: object, prefix: str = "") -> dict[str, Any]:
    """Dotted names to values: the form of ROS parameters."""
    out: dict[str, Any] = {}
    for name, value in to_mapping(config).items():
        if isinstance(value, dict):
            out.update(_flatten_dict(value, f"{prefix}{name}."))
        else:
            out[prefix + name] = value
    return out


def _flatten_dict(values: dict[str, Any], prefix: str) -> dict[str, Any]:
    out: dict[str, Any] = {}
    for name, value in values.items():
        out.update(_flatten_dict(value, f"{prefix}{name}.") if isinstance(value, dict) else {prefix + name: value})
    return out


def _nest(values: Mapping[str, Any]) -> dict[str, Any]:
    out: dict[str, Any] = {}
    for name, value in values.items():
        head, _, rest = str(name).partition(".")
        if rest:
            group = out.setdefault(head, {})
            if isinstance(group, dict):
                group[rest] = value
        else:
            out[head] = value
    return out


def _checked(info: ParamInfo, value: Any, where: str) -> Any:
    if info.kind is float and isinstance(value, int) and not isinstance(value, bool):
        value = float(value)
    if info.kind in (bool, int, float, str) and type(value) is not info.kind:
        msg = f"must be {info.kind.__name__}, not {type(value).__name__} {value!r}"
        raise ConfigError(msg, where=where)
    if isinstance(value, float) and math.isnan(value):
        msg = "must be a number, not NaN"
        raise ConfigError(msg, where=where)
    unit = f" {info.unit}" if info.unit else ""
    if info.low is not None and value < info.low:
        msg = f"{value} is below {info.low:g}{unit}"
        raise ConfigError(msg, where=where)
    if info.high is not None and value > info.high:
        msg = f"{value} is above {info.high:g}{unit}"
        raise ConfigError(msg, where=where)
    if info.choices and value not in info.choices:
        msg = f"'{value}' is not one of {', '.join(info.choices)}"
        raise ConfigError(msg, where=where)
    return value
