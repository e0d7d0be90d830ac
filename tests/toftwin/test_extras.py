# SPDX-License-Identifier: Apache-2.0
"""The line that installs an extra names packages that an index has, for the Python that runs."""

from __future__ import annotations

import sys

import pytest

from toftwin.extras import install_line


@pytest.mark.parametrize(("extra", "package"), [("view", "rerun-sdk"), ("train", "torch"), ("batch", "ray")])
def test_the_line_names_this_python_and_the_packages(extra: str, package: str) -> None:
    line = install_line(extra)
    assert line.startswith(f"{sys.executable} -m pip install ")
    assert package in line
    assert "toftwin[" not in line


def test_an_unknown_extra_names_toftwin() -> None:
    assert install_line("nothing").endswith("'toftwin[nothing]'")
