# SPDX-License-Identifier: Apache-2.0
"""How a part's displacement is stated: what is uncertain has its standard deviation beside it."""

from __future__ import annotations

import pytest

from tof_sensor.effects.cad_deviation import CadDeviation
from tof_sensor.effects.wiggling import Wiggling

MOVED = CadDeviation(values=(0.008, -0.006, 0.0, 0.0, 0.0, 0.02, 0.0, 0.004, 0.0))
SURE = dict.fromkeys(CadDeviation.COEFFICIENTS, 1e-4)


def test_what_is_known_is_stated_alone() -> None:
    assert MOVED.stated_to(SURE) == MOVED.stated == "displaced by 10.0 mm, turned by 1.1 degrees, bent by 4.0 mm"


def test_a_slide_that_no_view_shows_is_stated_with_its_deviation_along_itself() -> None:
    """8 and 6 mm, known to 5 and 0 mm: 8 / 10 of 5 mm. Uncertainty across the displacement, here z, does not change its length."""
    slid = SURE | {"x_m": 0.005, "y_m": 0.0, "z_m": 0.020}
    assert MOVED.stated_to(slid) == "displaced by 10.0 mm (±4.0), turned by 1.1 degrees, bent by 4.0 mm"
    turned = SURE | {"rz_rad": 0.01}
    assert MOVED.stated_to(turned) == "displaced by 10.0 mm, turned by 1.1 degrees (±0.6), bent by 4.0 mm"


def test_the_map_of_a_part_is_rough_by_the_share_of_its_bend() -> None:
    """A part that is moved by 3 mm and turned by 0.02 over half of 0.1 m is off by 2 mm at its rim: 13 mm^2 rigid, 4 mm^2 bend."""
    rigid = (0.003, 0.0, 0.0, 0.0, 0.0, 0.02)
    bent = CadDeviation(values=(*rigid, 0.002, 0.0, 0.0), half_size_m=0.1)
    assert CadDeviation(values=(*rigid, 0.0, 0.0, 0.0), half_size_m=0.1).rough == 0.0
    assert bent.rough == pytest.approx(CadDeviation.ROUGH * 4.0 / 17.0)
    assert CadDeviation(values=(0.0,) * 6 + (0.002, 0.0, 0.0)).rough == CadDeviation.ROUGH
    assert Wiggling().rough == Wiggling.ROUGH
