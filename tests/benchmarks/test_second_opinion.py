# SPDX-License-Identifier: Apache-2.0
"""The second judge: its integrals against quadrature, its sampler against enumeration, and what counts as calibrated."""

from __future__ import annotations

from dataclasses import replace
from math import comb
from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy.integrate import dblquad, quad
from scipy.special import logsumexp
from scipy.stats import norm

from benchmarks.calibration import brier, calibration_error
from benchmarks.second_opinion.evidence import Evidence, Quadratic, log_between
from benchmarks.second_opinion.hypotheses import TOGETHER, Form, Search, by_name, kept, log_prior_count, searched
from benchmarks.second_opinion.score import Session, figures, line
from benchmarks.second_opinion.table import Sampled, Table, drawn_forms
from tests.tof_gap.solve.choose.test_select import design, plain
from tof_sensor.effects.depth_scale import DepthScale
from tof_sensor.effects.range_offset import RangeOffset
from tof_sensor.effects.temperature_drift import TemperatureDrift

if TYPE_CHECKING:
    from tof_gap.solve.hypotheses.columns import Design

NONE = np.zeros((0, 1))


def gaussian(X: np.ndarray, y: np.ndarray, prior: np.ndarray) -> Quadratic:
    """The quadratic form of y = X x + white noise of deviation 1."""
    return Quadratic(X.T @ X + np.diag(prior), X.T @ y, float(y @ y), prior)


# the integral -------------------------------------------------------------------------------------
def likelihood(X: np.ndarray, y: np.ndarray, *x: float) -> float:
    return float(np.exp(-0.5 * np.sum((y - X @ np.array(x)) ** 2)))


def test_the_marginal_likelihood_of_one_coefficient_is_quadrature_s() -> None:
    rng = np.random.default_rng(3)
    X, y, sd = rng.normal(size=(6, 1)), rng.normal(size=6), 0.7
    brute = quad(lambda x: likelihood(X, y, x) * norm.pdf(x, 0, sd), -8, 8, epsabs=1e-14)[0]
    assert gaussian(X, y, np.array([sd**-2])).log_integral(NONE, [], []) == pytest.approx(np.log(brute), abs=1e-8)


def test_a_bound_cuts_the_prior_and_its_mass_is_made_up_for() -> None:
    rng = np.random.default_rng(4)
    X, y, sd = rng.normal(size=(5, 1)), rng.normal(size=5) + 0.5, 0.9
    inside = norm.cdf(1.5, 0, sd) - norm.cdf(0.2, 0, sd)
    brute = quad(lambda x: likelihood(X, y, x) * norm.pdf(x, 0, sd) / inside, 0.2, 1.5, epsabs=1e-14)[0]
    found = gaussian(X, y, np.array([sd**-2])).log_integral(np.ones((1, 1)), [0.2], [1.5])
    assert found == pytest.approx(np.log(brute), abs=1e-8)


def test_the_marginal_likelihood_of_two_coefficients_with_one_bounded_direction_is_quadrature_s() -> None:
    rng = np.random.default_rng(5)
    X, y, sd = rng.normal(size=(7, 2)), rng.normal(size=7), np.array([0.6, 1.1])

    def density(b: float, a: float) -> float:
        return likelihood(X, y, a, b) * float(norm.pdf(a, 0, sd[0]) * norm.pdf(b, 0, sd[1]))

    q = gaussian(X, y, sd**-2.0)
    assert q.log_integral(np.zeros((0, 2)), [], []) == pytest.approx(np.log(dblquad(density, -6, 6, -9, 9)[0]), abs=1e-6)
    bounded = 2.0 * dblquad(density, 0, 6, -9, 9)[0]
    assert q.log_integral(np.array([[1.0, 0.0]]), [0.0], [np.inf]) == pytest.approx(np.log(bounded), abs=1e-6)


def test_the_probability_of_an_interval_keeps_its_digits_in_both_tails() -> None:
    assert log_between(-1.0, 1.0, 0.0, 1.0) == pytest.approx(np.log(0.6826894921370859))
    assert log_between(30.0, np.inf, 0.0, 1.0) == pytest.approx(norm.logsf(30.0))
    assert log_between(-np.inf, -30.0, 0.0, 1.0) == pytest.approx(norm.logcdf(-30.0))


# calibration --------------------------------------------------------------------------------------
def test_the_calibration_error_is_the_mean_distance_of_stated_and_right() -> None:
    # Ten at 0.95 of which eight are right, ten at 0.15 of which two are: off by 0.15 and by 0.05.
    stated, right = [0.95] * 10 + [0.15] * 10, [1] * 8 + [0] * 2 + [1] * 2 + [0] * 8
    assert calibration_error(stated, right) == pytest.approx(0.1)
    assert calibration_error([1.0, 0.0], [True, False]) == 0.0
    assert calibration_error([1.0, 1.0], [True, False]) == pytest.approx(0.5)


def test_the_brier_score_is_a_mean_square() -> None:
    assert brier([1.0, 0.5, 0.0], [True, True, True]) == pytest.approx((0 + 0.25 + 1) / 3)


# sets of effects ----------------------------------------------------------------------------------
SIGMA_M = 0.01


def drawn(strengths: list[float]) -> Design:
    """Three effects of one column each, of `strengths` times 10 mm RMS, before noise of 10 mm a pixel."""
    d = design(plain(RangeOffset(), DepthScale(), TemperatureDrift()), strengths)
    gram, at = d.system.normal.gram.copy(), slice(12, 15)
    gram[:, at] /= SIGMA_M
    gram[:, :, at] /= SIGMA_M
    system = replace(d.system, normal=replace(d.system.normal, gram=gram), weight=d.system.weight / SIGMA_M**2)
    return replace(d, system=system)


def table_of(strengths: list[float]) -> Table:
    search, _ = searched(drawn(strengths), (), 1.0)
    return Table.of(search, kept(search.pool))


def test_the_evidence_of_a_design_is_that_of_all_unknowns_at_once() -> None:
    d = drawn([0.3, 0.0, 0.5])
    evidence, size = Evidence.of(d, 1.0), 3e-3
    n = d.system.normal
    prior = np.concatenate([n.info[:12], np.zeros(3), n.own_info])
    found = []
    for members in ([], [0], [0, 2]):
        # Every view's arm is its own: poses and columns first, then six unknowns a view.
        at = np.array([*range(12), *(12 + m for m in members)])
        g, V = len(at), len(n.gram)
        H, b = np.zeros((g + 6 * V, g + 6 * V)), np.zeros(g + 6 * V)
        for v, G in enumerate(n.gram):
            place, own = np.r_[0:g, g + 6 * v : g + 6 * v + 6], np.r_[at, 15:21]
            H[np.ix_(place, place)] += G[np.ix_(own, own)]
            b[place] += G[own, -1]
        square = n.gram[:, 12:15, 12:15].sum(axis=0) / d.system.weight.sum()
        info = np.concatenate([prior[:12], [square[m, m] / size**2 for m in members], np.tile(prior[15:], V)])
        q = Quadratic(H + np.diag(info), b, float(n.gram[:, -1, -1].sum()), info)
        found.append((q.log_integral(np.zeros((0, len(b))), [], []), bounded_less(evidence, members, size)))
    dense, ours = np.array(found).T
    np.testing.assert_allclose(np.diff(dense), np.diff(ours), rtol=1e-9)


def bounded_less(evidence: Evidence, members: list[int], size: float) -> float:
    """The evidence of members without their bounds."""
    q = evidence.joined(members, size)
    return q.log_integral(np.zeros((0, len(q.b))), [], [])


def test_what_was_added_is_included_and_nothing_else() -> None:
    table = table_of([0.3, 0.0, 0.5])
    found = dict(zip((f.name for f in table.forms), table.inclusion(table.posterior().sum(axis=0)), strict=True))
    assert found["range_offset"] > 0.99
    assert found["temperature_drift"] > 0.99
    assert found["depth_scale"] < 0.1


def test_priors_of_all_sets_sum_to_one() -> None:
    names = 9
    assert logsumexp([log_prior_count(k, names) + np.log(comb(names, k)) for k in range(names + 1)]) == pytest.approx(0.0, abs=1e-12)


def test_a_set_has_its_probability_whatever_the_order_of_its_places() -> None:
    table = table_of([0.05, 0.02, 0.05])
    dense = table.dense()
    assert dense.shape == (3, *(len(table.forms) + 1,) * TOGETHER)
    for k, s in enumerate(table.sets):
        mask = np.zeros(dense.shape[1:], bool)
        for places in np.ndindex(mask.shape):
            mask[places] = sorted(p - 1 for p in places if p) == sorted(s)
        np.testing.assert_allclose(logsumexp(dense[:, mask], axis=1), table.values[:, k], atol=1e-12)


def test_repeats_and_their_numbers_are_priced() -> None:
    search = Search(Evidence.of(drawn([0.0, 0.0, 0.0]), 1.0))
    assert search.log_prior(Form("range_offset", (0,))) == 0.0
    assert by_name(search.design, (2, 0)) == {
        "temperature_drift": Form("temperature_drift", (2,)),
        "range_offset": Form("range_offset", (0,)),
    }


def test_forms_are_there_wherever_they_stand() -> None:
    places = np.array([[[0, 2, 0, 1], [0, 0, 0, 2]]])
    np.testing.assert_array_equal(drawn_forms(places, 3), [[[1, 1, 0], [0, 1, 0]]])
    assert Sampled(np.array([[0.2, 0.5], [0.3, 0.5]]), 1.0).apart == pytest.approx(0.1)


def test_the_sampler_agrees_with_enumeration() -> None:
    pytest.importorskip("numpyro", reason="needs the extra `rivals`")
    from benchmarks.second_opinion.sampler import sample

    table = table_of([0.03, 0.02, 0.04])
    exact = table.inclusion(table.posterior().sum(axis=0))
    assert ((exact > 0.05) & (exact < 0.95)).any(), "some are in doubt: else any sampler would do"
    found = sample(table)
    np.testing.assert_allclose(found.inclusion.mean(axis=0), exact, atol=0.03)
    assert found.apart < 0.04
    assert found.r_hat < 1.01


# the score ----------------------------------------------------------------------------------------
def test_where_judges_differ_is_listed_with_who_is_right() -> None:
    asked = ("multipath", "wiggling")
    s = Session(
        "case0001", "single", ("wiggling",), asked, {"multipath": 0.8}, {"wiggling": 0.9, "multipath": 0.1}, ("multipath",), ("wiggling",)
    )
    assert line(s).endswith("1: multipath; 2: wiggling R")
    rows = {what: values for what, *values in figures([s])}
    assert rows["names stated, of them right"] == ["1, 0", "1, 1"]
    assert rows["true names that the evidence holds, of them stated"] == ["1, 0", "1, 1"]
    assert rows["expected calibration error of stated names"] == ["80.0 %", "10.0 %"]
    assert rows["Brier score of all names asked"] == ["0.8200", "0.0100"]


def test_truth_that_is_no_column_is_beyond_the_evidence() -> None:
    s = Session("case0002", "single", ("noise",), ("wiggling",), {"noise": 1.0}, {"wiggling": 0.0}, ("noise",), ())
    assert not s.holds
    assert s.only_first == ()
    assert "[beyond the evidence]" in line(s)
