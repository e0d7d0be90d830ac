# SPDX-License-Identifier: Apache-2.0
"""Locks, bill of materials and third-party page: complete, of one version each, every file with its hash."""

from __future__ import annotations

import json
import re
import tomllib
from typing import TYPE_CHECKING

import pytest

import bill
import lock
import set_up
from progress import Steps

if TYPE_CHECKING:
    from pathlib import Path

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
        assert set_up.locks("run", "pip") == expected
        assert set_up.locks("run", "sourced") == expected[:-1]
        assert set_up.locks("dev", "pip") == ["dev", "ros"]


def test_set_up_installs_by_hash_and_looks_nothing_up_beside_the_locks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ran: list[list[str]] = []
    steps = Steps(1, tmp_path / "log", tmp_path)
    monkeypatch.setattr(steps, "run", ran.append)
    set_up.install_packages(steps, "dev", "pip")
    packages, own = ran
    assert "--require-hashes" in packages
    assert [word for word in packages if word.startswith("requirements/")] == ["requirements/dev.txt", "requirements/ros.txt"]
    assert "--no-build-isolation" in own
    for command in ran:
        assert "--no-deps" in command


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
