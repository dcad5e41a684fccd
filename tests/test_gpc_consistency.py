"""Normalised squares: honest ones lie in the band, others are called what they are."""

import numpy as np
import pytest
from scipy import stats

from gpc import ChaosError, normalised_square
from gpc.consistency import consistency, nees

COVARIANCE = np.array([[2.0, 0.6], [0.6, 0.5]])


def test_the_band_is_that_of_the_chi_square_distribution():
    found = consistency(np.full(50, 3.0), 3)
    assert found.mean == pytest.approx(1.0, rel=1e-14)
    assert (found.low, found.high) == pytest.approx(tuple(stats.chi2.ppf([0.025, 0.975], 150) / 150))
    wide = consistency([1.0], 2, level=0.99)
    assert (wide.low, wide.high) == pytest.approx(tuple(stats.chi2.ppf([0.005, 0.995], 2) / 2))


@pytest.mark.parametrize(("factor", "verdict"), [(1.0, "honest"), (0.5, "over-confident"), (2.0, "timid")])
def test_a_filter_is_called_what_it_is(factor, verdict):
    errors = np.random.default_rng(0).multivariate_normal([0.0, 0.0], COVARIANCE, 400)
    found = nees(errors, np.repeat(factor * COVARIANCE[np.newaxis], 400, axis=0))
    assert found.verdict == verdict
    assert found.honest == (verdict == "honest")


def test_the_band_holds_as_often_as_it_says():
    errors = np.random.default_rng(1).standard_normal((400, 20, 2))
    unit = np.repeat(np.eye(2)[np.newaxis], 20, axis=0)
    held = sum(nees(runs, unit).honest for runs in errors)
    low, high = stats.binom.ppf([0.001, 0.999], 400, 0.95)
    assert low <= held <= high


def test_a_collapsed_covariance_is_over_confident():
    """Singular but for rounding, a plain solution would give a negative square."""
    root = np.array([[1.0, 0.0], [1.0 / 3.0, 1e-17], [0.7, 0.1]])
    assert normalised_square([1.0, -1.0, 0.2], root @ root.T) == np.inf
    found = nees([[1.0, 2.0], [0.1, 0.1]], [np.zeros((2, 2)), np.eye(2)])
    assert found.mean == np.inf
    assert found.verdict == "over-confident"
    assert consistency([np.nan], 1).verdict == "over-confident"


@pytest.mark.parametrize("wrong", [([], 1, 0.95), ([1.0], 0, 0.95), ([1.0], 1, 1.0)])
def test_what_cannot_be_judged_is_refused(wrong):
    with pytest.raises(ChaosError, match="one normalised square or more"):
        consistency(*wrong)


def test_errors_and_covariances_must_fit():
    with pytest.raises(ChaosError, match=r"\(n, p, p\), got \(2, 2\)"):
        nees([[1.0, 2.0]], np.eye(2))
