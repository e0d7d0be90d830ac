# SPDX-License-Identifier: Apache-2.0
"""What a validation says: errors over the pixels that count, their shares by hand, and the limit of sigma."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="training needs the extra `train`")

from tof_infer.sigma_calibration import Calibration, calibrate, sigma_limit  # noqa: E402
from tof_infer.validate import STRIDE, Validation, validate  # noqa: E402

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import ArrayLike


def verdict(error: ArrayLike, raw: ArrayLike, own: ArrayLike, mae: float = 0.004, loss: float = -4.0) -> Validation:
    """Pixels whose scale with the frame's correction is twice their own."""
    return Validation(loss, mae, 0.012, np.asarray(error), np.asarray(raw), np.log(2.0 * np.asarray(own)), np.log(own))


def test_figures_are_those_of_the_pixels_below_the_limit() -> None:
    """Five pixels are sure by their own scale, the last one is not: three of the five are within one sigma of 2 mm, four within two."""
    of = verdict([0.001, -0.0019, 0.0019, 0.0035, -0.011, 0.02], [0.001, -0.011, 0.01, 0.012, -0.03, 0.02], [1e-3] * 5 + [3e-3])
    found = of.figures("val", Calibration(), 2e-3)
    assert found == pytest.approx(
        {
            "val_mae_mm": 4.0,
            "val_raw_mae_mm": 12.0,
            "val_mae_known_mm": 3.86,
            "val_known": 5 / 6,
            "val_within_1_sigma": 3 / 5,
            "val_within_2_sigma": 4 / 5,
            "val_wrong_10mm": 1 / 6,
            "val_raw_wrong_10mm": 4 / 6,
        }
    )


def test_ten_millimetres_are_not_wrong_yet() -> None:
    found = verdict([0.01, -0.01], [0.01, -0.01], [1e-3] * 2).figures("val", Calibration(), 2e-3)
    assert found["val_wrong_10mm"] == found["val_raw_wrong_10mm"] == 0.0


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_without_pixels_of_small_sigma_their_error_is_unknown() -> None:
    found = verdict([0.001], [0.001], [1.0]).figures("val", Calibration(), 2e-3)
    assert found["val_mae_known_mm"] is None
    assert found["val_known"] == 0.0


def test_the_limit_is_chosen_unless_it_is_given() -> None:
    rng = np.random.default_rng(3)
    own = np.exp(rng.normal(-6, 0.5, 3000))
    of = verdict(own * rng.normal(size=3000), rng.normal(0, 0.02, 3000), own)
    calibration = calibrate(of.error, of.log_scale, of.own)
    assert of.calibrated() == (calibration, sigma_limit(of.error, of.raw_error, calibration.sigma(of.own)))
    assert of.calibrated(0.5) == (calibration, 0.5)


def test_validations_together_are_weighted_by_their_pixels() -> None:
    one, three = verdict([0.1], [0.1], [1e-3], 0.004, -4.0), verdict([0.1] * 3, [0.1] * 3, [1e-3] * 3, 0.008, -2.0)
    both = Validation.of_all([one, three])
    assert (both.mae, both.loss, both.raw_mae) == pytest.approx((0.007, -2.5, 0.012))
    assert len(both.error) == len(both.raw_error) == len(both.log_scale) == len(both.own) == 4


class Shifted:
    """Stands for a network that adds 3 mm to what it gets; scales are the logs of 2 mm, own ones of 1 mm."""

    def eval(self) -> None:
        """As a network has it."""

    def with_correction(self, images: dict[str, Any]) -> tuple[Any, Any, Any]:
        depth = images["depth"]
        return depth + 0.003, torch.full_like(depth, np.log(2e-3)), torch.full_like(depth, np.log(1e-3))


def test_errors_are_measured_minus_label_over_usable_pixels() -> None:
    """The raw depth is 10 mm too near, the network's 7 mm; pixels without depth or outside the mask do not count."""
    label = torch.full((1, 1, 6, 7), 1.0)
    depth = label - 0.010
    depth[0, 0, 0, 0], mask = float("nan"), torch.ones_like(label, dtype=torch.bool)
    mask[0, 0, 5, :] = False
    depth[0, 0, 5, :] = 9.0

    def plain() -> Iterator[tuple[dict[str, Any], dict[str, Any]]]:
        yield {"depth": depth}, {"label": label, "mask": mask, "sigma": torch.zeros_like(label)}

    found = validate(Shifted(), SimpleNamespace(plain=plain), torch.device("cpu"), "mse")
    assert found.mae == pytest.approx(0.007, abs=1e-6)
    assert found.raw_mae == pytest.approx(0.010, abs=1e-6)
    assert found.loss == pytest.approx(0.007**2, abs=1e-8)
    assert len(found.error) == -(-34 // STRIDE)
    np.testing.assert_allclose(found.error, -0.007, atol=1e-6)
    np.testing.assert_allclose(found.raw_error, -0.010, atol=1e-6)
    np.testing.assert_allclose(np.exp([found.log_scale, found.own]), [[2e-3] * 5, [1e-3] * 5], rtol=1e-5)
