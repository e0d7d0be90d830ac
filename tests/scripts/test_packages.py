# SPDX-License-Identifier: Apache-2.0
"""Locks, bill of materials and third-party page: complete, of one version each, every file with its hash."""

from __future__ import annotations

import json
import os
import re
import sys
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

import bill
import lock
import packages
import set_up
from progress import Steps

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

LOCKED = bill.locked()


def pins(repository: Path) -> dict[str, str]:
    lines = (repository / "constraints.txt").read_text().splitlines()
    return {bill.normal(name): version for name, version in (line.split("==") for line in lines if "==" in line)}


def test_every_locked_package_has_hashes_and_the_version_of_the_constraints(repository: Path) -> None:
    pinned = pins(repository)
    assert len(LOCKED) > 100
    for package in LOCKED:
        assert package.hashes, package.name
        assert len(set(package.hashes)) == len(package.hashes)
    differing = {p.name: (p.version, pinned[p.name]) for p in LOCKED if p.name in pinned and p.version != pinned[p.name]}
    assert differing == {}


@pytest.mark.parametrize("name", lock.LOCKS)
def test_a_lock_has_all_that_the_project_asks_of_it(name: str) -> None:
    held = {p.name for p in LOCKED if name in p.locks}
    asked = {bill.normal(re.split(r"[\[<>=!~; ]", line)[0]) for line in lock.wanted(name)}
    assert asked - held == set()
    text = (lock.FOLDER / f"{name}.txt").read_text()
    assert not re.search(r"https?://|--index|--extra|--find", text), "no registry is named"
    assert len(re.findall(r"^\S+==", text, re.MULTILINE)) == len(held)


def test_the_commands_take_neither_notebooks_nor_web_servers() -> None:
    run = {p.name for p in LOCKED if {"run", "ros"} & set(p.locks)}
    assert run.isdisjoint({"open3d", "dash", "flask", "ipython", "ipywidgets", "notebook", "plotly", "torch", "pytest"})
    assert len({p.name for p in LOCKED if "run" in p.locks}) < 50


def test_set_up_takes_open3d_only_where_embree_has_no_wheel(monkeypatch: pytest.MonkeyPatch) -> None:
    for machine, expected in (("x86_64", ["run", "ros"]), ("aarch64", ["run", "open3d", "ros"])):
        monkeypatch.setattr("platform.machine", lambda machine=machine: machine)
        assert set_up.locks("pip") == expected
        assert set_up.locks("sourced") == expected[:-1]


def test_what_tests_need_keeps_what_the_commands_got() -> None:
    """Kernels are compiled from the packages of the commands while those of tests are installed: none of them may be replaced."""
    version = {name: {p.name for p in LOCKED if name in p.locks} for name in ("run", "open3d", "dev")}
    assert version["run"] | version["open3d"] <= version["dev"], "and a lock's versions are those of all locks (bill.locked)"


class Recorded(Steps):
    """Steps that only write down what they would run; with uv's commands failing or not."""

    def __init__(self, folder: Path, *, uv_works: bool = True) -> None:
        super().__init__(1, folder / "log", folder)
        self.ran: list[list[str]] = []
        self.uv_works = uv_works

    def run(self, command: Sequence[str], *, quiet_failure: bool = False, environment: Mapping[str, str] | None = None) -> bool:
        self.ran.append(list(command))
        return self.uv_works or not command[0].endswith("uv")


def test_set_up_installs_by_hash_and_looks_nothing_up_beside_the_locks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(set_up, "PYTHON", tmp_path / "python")
    steps = Recorded(tmp_path)
    packages.ensure_uv(steps, tmp_path / "python")
    set_up.install_packages(steps, "run", "ros")
    set_up.install_toftwin(steps)
    uv, locked, own = steps.ran
    assert "requirements/uv.txt" in uv
    assert [word for word in locked if word.startswith("requirements/")] == ["requirements/run.txt", "requirements/ros.txt"]
    for command in (uv, locked):
        assert "--require-hashes" in command
    assert "--no-build-isolation" in own
    for command in steps.ran:
        assert "--no-deps" in command


def test_pip_installs_what_uv_cannot(tmp_path: Path) -> None:
    python, what = tmp_path / "bin" / "python", ("--no-deps", "numpy")
    python.parent.mkdir()
    python.symlink_to(sys.executable)
    steps = Recorded(tmp_path, uv_works=False)
    packages.install(steps, python, *what)
    python.with_name("uv").symlink_to("/bin/false")
    packages.install(steps, python, *what)
    without, failed, instead = steps.ran
    assert without == instead == [*packages.pip_command(python), *what]
    assert failed[0] == str(python.with_name("uv"))
    assert tuple(failed[-2:]) == what
    steps = Recorded(tmp_path)
    packages.install(steps, python, *what)
    assert len(steps.ran) == 1


def test_uv_asks_where_pip_would() -> None:
    listed = """
:env:.index-url='https://mirror.example/simple'
global.cert='/etc/certificates.crt'
global.extra-index-url='file:///a\\nfile:///b'
global.find-links='/c /d'
global.index-url='https://index.example/simple'
install.no-index='true'
list.format='columns'
"""
    assert packages.settings(listed) == {
        "SSL_CERT_FILE": "/etc/certificates.crt",
        "UV_DEFAULT_INDEX": "https://mirror.example/simple",
        "UV_FIND_LINKS": "/c,/d",
        "UV_INDEX": "file:///a file:///b",
        "UV_OFFLINE": "true",
    }
    assert packages.settings("") == {}


def test_what_a_user_says_to_uv_goes_before_what_pip_was_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PIP_FIND_LINKS", "/c")
    monkeypatch.setenv("PIP_CERT", "/d")
    monkeypatch.setenv("UV_FIND_LINKS", "/e")
    made = packages.uv_environment(Path(sys.executable))
    assert made["UV_FIND_LINKS"] == "/e"
    assert made["SSL_CERT_FILE"] == os.environ.get("SSL_CERT_FILE", "/d")
    assert made["UV_CACHE_DIR"].startswith(sys.prefix), "hard links need one file system"


def test_the_bill_of_materials_names_each_package_once_with_its_hashes(repository: Path) -> None:
    made = json.loads(json.dumps(bill.bill(LOCKED, "1.0")))
    assert (made["bomFormat"], made["specVersion"], made["version"]) == ("CycloneDX", "1.6", 1)
    assert re.fullmatch(r"urn:uuid:[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}", made["serialNumber"])
    references = [c["bom-ref"] for c in made["components"]]
    assert len(set(references)) == len(references) == len(LOCKED)
    for one, package in zip(made["components"], LOCKED, strict=True):
        assert one["purl"] == f"pkg:pypi/{package.name}@{package.version}"
        assert one["type"] == "library"
        assert {h["content"] for r in one["externalReferences"] for h in r["hashes"]} == set(package.hashes)
    assert bill.bill(LOCKED, "1.0") == made, "the same locks, the same document"


def test_the_third_party_page_is_that_of_the_locks(repository: Path) -> None:
    rows = re.findall(r"^\| ([\w.-]+) \| (\S+) \| ([^|]*) \|", (repository / "THIRD_PARTY.md").read_text(), re.MULTILINE)
    assert {(name, version) for name, version, _ in rows if name != "package"} == {(p.name, p.version) for p in LOCKED}
    unknown = [name for name, _, licence in rows if licence.strip() in ("", "not installed here")]
    assert len(unknown) <= 20, unknown


def test_every_extra_is_in_a_lock_or_said_not_to_be(repository: Path) -> None:
    extras = tomllib.loads((repository / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    covered = {extra for _, names in lock.LOCKS.values() for extra in names}
    assert set(extras) - covered == {"train", "batch", "fuzz", "rivals"}
    security = (repository / "SECURITY.md").read_text()
    for extra in ("train", "batch", "fuzz", "rivals"):
        assert f"`{extra}`" in security
