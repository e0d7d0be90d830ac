# SPDX-License-Identifier: Apache-2.0
"""Settings from files and flags: typed by the table, the flag wins, what is unknown is refused with a hint."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from typing import TYPE_CHECKING

import pytest

from tof_core.config import param, section
from tof_core.errors import ConfigError, UsageError
from toftwin import options

if TYPE_CHECKING:
    from pathlib import Path


@dataclass(frozen=True, slots=True)
class Stage:
    """One stage."""

    enable: bool = param(True, "whether it runs")
    count: int = param(20, "neighbours", low=2, high=100)


@dataclass(frozen=True, slots=True)
class Settings:
    """All settings."""

    name: str = param("a", "a word", choices=("a", "b"))
    far: float = param(2.0, "largest depth", unit="m", low=0.0)
    sor: Stage = section(Stage)


def load(*argv: str) -> Settings:
    parser = argparse.ArgumentParser()
    options.add_config_arguments(parser)
    return options.load_config(Settings, parser.parse_args(argv))


def test_flags_are_read_in_the_kind_of_their_row() -> None:
    assert load() == Settings()
    assert load("--set", "sor.enable=off", "--set", "far=3", "--set", "name=b") == Settings("b", 3.0, Stage(enable=False))


def test_a_file_is_overlaid_by_flags(tmp_path: Path) -> None:
    path = tmp_path / "settings.yaml"
    path.write_text("far: 5.0\nsor: {count: 30}\n")
    assert load("--config", str(path), "--set", "far=1.5") == Settings("a", 1.5, Stage(count=30))


@pytest.mark.parametrize(
    ("pair", "says"),
    [
        ("sor.cuont=3", "did you mean sor.count"),
        ("sor.count=x", "'x' is no int"),
        ("sor.count=1", "1 is below 2"),
        ("sor.enable=maybe", "neither true nor false"),
        ("name=c", "not one of a, b"),
    ],
)
def test_bad_settings_are_refused_with_a_hint(pair: str, says: str) -> None:
    with pytest.raises(ConfigError, match=says):
        load("--set", pair)


def test_a_setting_without_a_value_is_a_wrong_call() -> None:
    with pytest.raises(UsageError, match="KEY=VALUE"):
        load("--set", "far")


def test_settings_text_tells_default_unit_bounds_and_meaning() -> None:
    assert options.settings_text(Settings).splitlines() == [
        "name = 'a' [a | b]  a word",
        "far = 2 m [0 .. ]  largest depth",
        "sor.enable = true  whether it runs",
        "sor.count = 20 [2 .. 100]  neighbours",
    ]
