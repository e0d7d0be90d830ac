# SPDX-License-Identifier: Apache-2.0
"""The odd cases of the gap check's short form: two files, so that two test processes share the work."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from tests.benchmarks.gap_check.short_form import COUNT, folder_of, scored

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("number", range(1, COUNT, 2))
def test_a_case_is_recorded_sealed_and_diagnosed(number: int, repository: Path, request: pytest.FixtureRequest) -> None:
    row = scored(folder_of(request.config, repository), number)
    assert row.name == f"case{number:04d}"
    assert row.verdict, "a refusal is a verdict, too"
