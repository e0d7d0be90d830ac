# SPDX-License-Identifier: Apache-2.0
"""How captures of a dwell differ is known from the dwells that state it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.tof_gap.quiet_views import SHAPE, VIEWS, views
from tof_gap.seen.evidence.shared_noise import _between2

if TYPE_CHECKING:
    from tof_gap.seen.evidence.view import ViewEvidence


def dwells(of_views: range) -> list[ViewEvidence]:
    """Views of four captures, of which some state the noise of their mean: half of what neighbours show."""
    out = []
    for k, v in enumerate(views(np.random.default_rng(3), captures=(4,) * VIEWS)):
        sigma = 0.5 * v.sigma if k in of_views else np.full(SHAPE, np.nan)
        out.append(replace(v, view=replace(v.view, sigma=sigma.astype(np.float32))))
    return out


@pytest.mark.parametrize("stated", [range(VIEWS), range(3)])
def test_dwells_without_a_noise_of_their_own_do_not_count(stated: range) -> None:
    assert _between2(dwells(stated)) == pytest.approx(0.25, rel=0.01)


def test_where_no_dwell_states_it_captures_are_not_compared() -> None:
    assert _between2(dwells(range(0))) == 0.0
    assert _between2(views(np.random.default_rng(3))) == 0.0
