# SPDX-License-Identifier: Apache-2.0
"""The images as far as they can be judged without building them: files, packages, user, compose commands, entry point."""

from __future__ import annotations

import re
import shlex
import subprocess
from typing import TYPE_CHECKING, Any

import pytest
import yaml

import system
from toftwin.cli import build_parser

if TYPE_CHECKING:
    from pathlib import Path

FLAVOURS = ("jazzy", "slim")


def dockerfile(repository: Path, flavour: str) -> str:
    """The file with its continued lines joined and its comments dropped."""
    text = (repository / "docker" / f"Dockerfile.{flavour}").read_text()
    return "\n".join(line for line in text.replace("\\\n", " ").splitlines() if not line.startswith("#"))


def compose(repository: Path) -> dict[str, Any]:
    loaded: dict[str, Any] = yaml.safe_load((repository / "docker" / "compose.yaml").read_text())
    return loaded


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_the_image_runs_the_same_set_up_as_a_user_who_is_not_root(flavour: str, repository: Path) -> None:
    text = dockerfile(repository, flavour)
    user, set_up = text.index("\nUSER toftwin"), text.index("make setup")
    assert user < set_up
    assert not re.findall(r"^USER (?!toftwin$).*", text, re.MULTILINE)
    assert re.search(r"^ENV ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST$", text, re.MULTILINE)


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_every_system_library_that_the_set_up_asks_for_is_installed(flavour: str, repository: Path) -> None:
    installed = set(shlex.split(re.findall(r"apt-get install (.*?) &&", dockerfile(repository, flavour))[0]))
    assert {*system.LIBRARIES.values(), "g++", "make", "python3-dev", "python3-venv"} <= installed


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_what_is_copied_exists_and_what_is_made_here_stays_out(flavour: str, repository: Path) -> None:
    sources = [re.split(r"\s+", line)[2] for line in re.findall(r"^COPY .*", dockerfile(repository, flavour), re.MULTILINE)]
    assert "docker/entrypoint.sh" in sources
    assert all((repository / source).exists() for source in sources)
    ignored = (repository / "docker" / f"Dockerfile.{flavour}.dockerignore").read_text().split("\n")
    assert {".git", ".venv", "out"} <= set(ignored)


def test_each_service_of_compose_is_a_call_that_the_parser_takes(repository: Path) -> None:
    services = compose(repository)["services"]
    assert set(services) == {"demo", "doctor", "graph"}
    for service in services.values():
        words = [re.sub(r"\$\{\w+:-(\w*)\}", r"\1", word) for word in service["command"]]
        assert words[0] == "toftwin"
        build_parser(words[1]).parse_args(words[1:])


def test_compose_drops_capabilities_and_keeps_discovery_on_the_host(repository: Path) -> None:
    for service in compose(repository)["services"].values():
        assert service["cap_drop"] == ["ALL"]
        assert service["environment"]["ROS_AUTOMATIC_DISCOVERY_RANGE"].endswith(":-LOCALHOST}")
        assert "privileged" not in service
        assert "ports" not in service


def test_the_entry_point_hands_on_command_and_exit_code(repository: Path) -> None:
    entry = repository / "docker" / "entrypoint.sh"
    done = subprocess.run([str(entry), "sh", "-c", 'echo "$0 $PATH"; exit 3', "here"], capture_output=True, text=True, check=False)
    assert done.returncode == 3
    assert done.stdout.startswith("here /opt/toftwin/.venv/bin:")
