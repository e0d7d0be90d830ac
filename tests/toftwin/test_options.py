# SPDX-License-Identifier: Apache-2.0
"""Settings from files and flags: typed by the table, the flag wins, what is unknown is refused with a hint."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from typing import TYPE_CHECKING

import pytest

from tof_core.config import param, section
from tof_core.errors import ConfigError, UsageError
from toftwin import cli, options

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


@pytest.mark.parametrize("text", ["-1", "0", "1.5", "many"])
def test_a_flag_that_counts_says_what_it_takes(text: str) -> None:
    count = options.at_least(1)
    assert (count("1"), count("12")) == (1, 12)
    with pytest.raises(argparse.ArgumentTypeError, match=f"'{text}' is not a whole number, 1 or more"):
        count(text)


@pytest.mark.parametrize("text", ["-1", "0", "nan", "inf", "fast"])
def test_a_flag_that_measures_says_what_it_takes(text: str) -> None:
    assert options.positive("0.5") == 0.5
    with pytest.raises(argparse.ArgumentTypeError, match=f"'{text}' is not a number above 0"):
        options.positive(text)


@pytest.mark.parametrize(
    ("command", "flag"),
    [
        ("label a b --scene s --out o", "--workers -1"),
        ("replay a --realtime", "--rate 0"),
        ("doctor --live", "--seconds -1"),
        ("view a", "--every 0"),
        ("evaluate a --scene s", "--frames 0"),
    ],
)
def test_a_flag_out_of_bounds_is_a_wrong_call_and_no_fault(command: str, flag: str, capsys: pytest.CaptureFixture[str]) -> None:
    name, value = flag.split()
    assert cli.main([*command.split(), name, value]) == 2
    assert f"error: argument {name}: '{value}' is not a" in capsys.readouterr().err


def test_a_pace_without_realtime_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["replay", str(tmp_path), "--rate", "2"]) == 2
    assert capsys.readouterr().err == "toftwin: --rate: only --realtime has a pace; add --realtime\n"


def test_settings_text_tells_default_unit_bounds_and_meaning() -> None:
    assert options.settings_text(Settings).splitlines() == [
        "name = 'a' [a | b]  a word",
        "far = 2 m [0 .. ]  largest depth",
        "sor.enable = true  whether it runs",
        "sor.count = 20 [2 .. 100]  neighbours",
    ]
