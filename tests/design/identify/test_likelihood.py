"""The likelihood of rounded positions with noise: against scipy's normal distribution, differences, and draws."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm

from casahunt.design.identify.intervals import student_95
from casahunt.design.identify.likelihood import FINE_COUNTS, Noise, likeliest, log_phi


def test_the_logarithm_of_the_normal_distribution():
    z = np.linspace(-80, 12, 20011)
    assert log_phi(z) == pytest.approx(norm.logcdf(z), rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("sigma", [0.06, 0.3, 1.0, 4.0])
def test_probabilities_and_slopes(sigma):
    rng, noise = np.random.default_rng(1), Noise(sigma, 1.0)
    y = np.round(3 * rng.standard_normal(200))
    x = y + 0.6 * rng.standard_normal(200)
    at = noise.slopes(y, x)
    near = np.abs(y - x) < 0.5 + 5 * sigma
    exact = norm.cdf((y + 0.5 - x) / sigma) - norm.cdf((y - 0.5 - x) / sigma)
    assert np.exp(at.value[near]) == pytest.approx(exact[near], rel=1e-6, abs=1e-12)
    h = 1e-5
    ahead, behind = noise.slopes(y, x + h), noise.slopes(y, x - h)
    assert at.score == pytest.approx((ahead.value - behind.value) / (2 * h), rel=1e-5, abs=1e-5)
    assert at.curvature == pytest.approx((behind.score - ahead.score) / (2 * h), rel=1e-4, abs=1e-4)
    assert (at.curvature >= 0).all()


def test_without_rounding_it_is_least_squares():
    y, x = np.array([0.0, 1.0]), np.array([0.5, 1.0])
    found = Noise(0.5, 0.0).slopes(y, x)
    assert found.score.tolist() == [-2.0, 0.0] and found.curvature.tolist() == [4.0, 4.0]
    assert found.value == pytest.approx(norm.logpdf(y, x, 0.5) + 0.5 * np.log(2 * np.pi))


@pytest.mark.parametrize("sigma", [0.1, 0.5, 2.0])
def test_noise_and_information_of_draws(sigma):
    rng = np.random.default_rng(2)
    x = np.linspace(0.0, 20.0, 40_000)
    y = np.round(x + sigma * rng.standard_normal(x.size))
    assert likeliest(y, x, 1.0, 1.0).sigma == pytest.approx(sigma, rel=0.03)
    noise = Noise(sigma, 1.0)
    assert np.mean(noise.slopes(y, x).score ** 2) == pytest.approx(noise.information(x).mean(), rel=0.05)


def test_noise_far_above_the_counts_is_that_of_their_sum():
    """The sum over all counts goes on up to there; beyond it would be one over a million for the decimals of a file."""
    x = np.linspace(0.0, 1.0, 9)
    below, above = (Noise(factor * FINE_COUNTS, 1.0) for factor in (1 - 1e-9, 1 + 1e-9))
    assert above.information(x) == pytest.approx(below.information(x), rel=2e-6)
    assert Noise(1e6, 1.0).information(x) == pytest.approx(1e-12, rel=1e-9)


@pytest.mark.parametrize("freedom", [5, 20, 1000])
def test_the_point_of_student(freedom):
    from scipy.stats import t

    assert student_95(freedom) == pytest.approx(t.ppf(0.975, freedom), rel=0.01)
