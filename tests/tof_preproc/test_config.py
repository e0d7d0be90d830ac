# SPDX-License-Identifier: Apache-2.0
"""The order is checked, presets are expanded, and every parameter is described."""

from __future__ import annotations

import pytest

from tof_core.config import from_mapping, table
from tof_core.errors import ConfigError
from tof_preproc.config import ORDER, PreprocConfig, stages_of
from tof_preproc.stages import enabled, split


def test_the_default_order_splits_at_accumulate() -> None:
    assert split(PreprocConfig()) == (("range", "amplitude", "self"), ("iqr", "sigma3"), ("flying", "grazing", "sor"))


def test_the_order_is_the_users() -> None:
    config = from_mapping(PreprocConfig, {"order": "sor, flying, sigma3, iqr, accumulate, range"})
    assert split(config) == (("sor", "flying"), ("sigma3", "iqr"), ("range",))


def test_a_stage_can_be_switched_off_without_touching_the_order() -> None:
    config = from_mapping(PreprocConfig, {"sor.enable": False, "iqr": {"enable": False}})
    assert enabled(config) == tuple(s for s in ORDER.split(",") if s not in ("sor", "iqr"))


@pytest.mark.parametrize(
    ("order", "message"),
    [
        ("accumulate,sort", "'sort' is unknown"),
        ("sor,accumulate,sor", "'sor' is named twice"),
        ("range,sor", "no 'accumulate'"),
        ("accumulate,iqr", "'iqr' compares captures"),
    ],
)
def test_an_order_that_cannot_be_done_is_refused(order: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        stages_of(order)
    with pytest.raises(ConfigError, match=message):
        PreprocConfig(order=order)


def test_bounds_that_leave_nothing_are_refused() -> None:
    with pytest.raises(ConfigError, match="not below"):
        from_mapping(PreprocConfig, {"range": {"low": 3.0, "high": 2.0}})


def test_the_paper_preset_is_section_3_1_with_the_users_numbers() -> None:
    config = from_mapping(PreprocConfig, {"preset": "paper", "sor.neighbours": 30}).resolved
    assert split(config) == ((), ("iqr", "sigma3"), ("sor",))
    assert (config.accumulate.method, config.iqr.method, config.sigma3.method, config.sor.method) == ("paper",) * 4
    assert (config.iqr.low, config.iqr.high, config.sigma3.ratio, config.sor.ratio) == (0.2, 0.8, 3.0, 2.0)
    assert config.sor.neighbours == 30
    assert config.accumulate.min_share == 0


def test_every_parameter_is_described_and_its_default_lies_within_its_bounds() -> None:
    for row in table(PreprocConfig):
        assert row.text, row.name
        if row.low is not None and row.high is not None:
            assert row.low <= float(row.default) <= row.high, row.name
        if row.choices:
            assert row.default in row.choices, row.name
