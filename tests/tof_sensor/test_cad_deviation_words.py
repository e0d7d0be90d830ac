# SPDX-License-Identifier: Apache-2.0
"""How a part's displacement is stated: what is uncertain has its standard deviation beside it."""

from __future__ import annotations

from tof_sensor.effects.cad_deviation import CadDeviation

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
