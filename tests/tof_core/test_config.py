# SPDX-License-Identifier: Apache-2.0
"""Configuration: one table, unknown keys refused, every value checked before use."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tof_core.config import ParamInfo, bounds_of, flatten, from_mapping, param, section, table, to_mapping, updated
from tof_core.errors import ConfigError


@dataclass(frozen=True, slots=True)
class Gate:
    enable: bool = param(True, "whether the gate is on")
    speed: float = param(10.0, "faster than this is moving", unit="mm/s", low=0.0, high=100.0)


@dataclass(frozen=True, slots=True)
class Whole:
    gate: Gate = section(Gate, "the motion gate")
    strict: Gate = section(lambda: Gate(enable=False, speed=1.0))  # type: ignore[arg-type]
    count: int = param(5, "captures", low=1, high=9)
    method: str = param("mean", "how", choices=("mean", "median"))


def test_the_table_has_a_row_with_all_facts_for_every_value() -> None:
    rows = {r.name: r for r in table(Whole)}
    assert list(rows) == ["gate.enable", "gate.speed", "strict.enable", "strict.speed", "count", "method"]
    assert rows["gate.speed"] == ParamInfo(
        "gate.speed", float, 10.0, "faster than this is moving", "mm/s", 0.0, 100.0, (), section="the motion gate"
    )
    assert rows["gate.speed"].meaning == "the motion gate: faster than this is moving"
    assert (rows["gate.speed"].group, rows["count"].group, rows["count"].meaning) == ("gate", "", "captures")
    assert rows["strict.speed"].default == 1.0
    assert rows["method"].choices == ("mean", "median")


def test_nested_and_dotted_keys_mean_the_same() -> None:
    expected = replace(Whole(), gate=Gate(enable=False, speed=3.0), count=2)
    assert from_mapping(Whole, {"gate": {"enable": False, "speed": 3}, "count": 2}) == expected
    assert from_mapping(Whole, {"gate.enable": False, "gate.speed": 3.0, "count": 2}) == expected
    assert from_mapping(Whole, {"gate": {"enable": False}, "gate.speed": 3.0, "count": 2}) == expected


def test_a_section_s_own_defaults_survive_a_partial_change() -> None:
    assert from_mapping(Whole, {"strict": {"speed": 2.0}}).strict == Gate(enable=False, speed=2.0)
    assert updated(Whole(count=7), {"method": "median"}) == Whole(count=7, method="median")


def test_the_caller_s_mapping_is_left_alone() -> None:
    values: dict[str, Any] = {"gate": {"enable": False}, "gate.speed": 2.0}
    from_mapping(Whole, values)
    assert values == {"gate": {"enable": False}, "gate.speed": 2.0}


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"cuont": 3}, "config: unknown key 'cuont'; known keys: gate, strict, count, method"),
        ({"gate": {"sped": 3.0}}, r"config\.gate: unknown key 'sped'"),
        ({"gate": 3}, r"config\.gate: must be a group of keys"),
        ({"count": 0}, r"config\.count: 0 is below 1"),
        ({"gate.speed": 101}, r"config\.gate\.speed: 101\.0 is above 100 mm/s"),
        ({"count": 2.0}, "must be int, not float 2.0"),
        ({"count": True}, "must be int, not bool True"),
        ({"gate.enable": 1}, "must be bool, not int 1"),
        ({"gate.speed": float("nan")}, "must be a number, not nan"),
        ({"gate.speed": float("inf")}, "must be a number, not inf"),
        ({"method": "mode"}, "'mode' is not one of mean, median"),
        ({"gate": {"speed": 1.0}, "gate.speed": 2.0}, "key 'gate' is given twice"),
    ],
)
def test_bad_values_are_refused_with_key_bound_and_unit(values: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message) as caught:
        from_mapping(Whole, values)
    assert caught.value.exit_code == 2


@given(
    st.builds(
        Whole,
        gate=st.builds(Gate, enable=st.booleans(), speed=st.floats(0, 100)),
        count=st.integers(1, 9),
        method=st.sampled_from(["mean", "median"]),
    )
)
def test_a_configuration_goes_to_plain_values_and_back(config: Whole) -> None:
    assert from_mapping(Whole, to_mapping(config)) == config
    assert from_mapping(Whole, flatten(config)) == config


def test_every_configuration_of_the_bag_options_is_documented() -> None:
    from tof_core.motion import MotionConfig, StationConfig
    from tof_core.options import BagOptions

    rows = [row for cls in (BagOptions, MotionConfig, StationConfig) for row in table(cls)]
    assert len({row.name for row in rows}) == len(rows) >= 19
    assert all(row.text for row in rows)
    assert all(row.low is not None and row.high is not None for row in rows if row.kind in (int, float))


def test_a_parameter_states_its_bounds_and_is_unbounded_where_it_states_none() -> None:
    assert bounds_of(Gate, "speed") == (0.0, 100.0)
    assert bounds_of(Gate, "enable") == (-np.inf, np.inf)
