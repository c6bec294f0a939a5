"""A law with very many minima, ε = |a + b cos wv|: the lowest is found, or a warning says that it may not be."""

import jax.numpy as jnp
import numpy as np
import pytest

import calibration as cal
import softjax as sj

U = 0.01
START = {"a": 0.5, "b": 0.1, "w": 2.0}


class Wave(sj.HardSphereLaw):
    """Its rate w tells itself within 0.5 s/m alone: beyond, the cost has other minima."""

    a: float = sj.number_field("a", "-", "level")
    b: float = sj.number_field("b", "-", "size")
    w: float = sj.number_field("w", "s/m", "rate")

    def restitution_squared(self, velocity):
        return jnp.square(self.a + self.b * jnp.cos(self.w * velocity))


def data(seed, points=40):
    """And the χ² of the truth, whose w is up to six times the start's."""
    random = np.random.default_rng(seed)
    velocity = np.sort(random.uniform(0.2, 6, points))
    exact = 0.6 + 0.2 * np.cos(random.uniform(3, 12) * velocity)
    noise = U * random.standard_normal(points)
    measured = cal.RestitutionData(velocity, exact + noise, uncertainty=U)
    return measured, float(np.sum((noise / U) ** 2))


def fitted(measured, **options):
    starts = {name: cal.Parameter(value) for name, value in START.items()}
    return cal.fit(measured, Wave, starts, profiles=False, **options)


def chi_squared(result):
    return float(result.rms**2 * len(result.data) / U**2)


def count_elsewhere(seeds):
    found = [(fitted(measured), truth) for measured, truth in map(data, seeds)]
    return sum(chi_squared(result) > truth + 1e-6 for result, truth in found)


def test_a_lowest_minimum_far_from_the_start_is_found():
    """Of these sets none was by 32 starts around the first."""
    assert count_elsewhere((2, 5)) == 0


def test_an_end_that_one_search_alone_found_and_that_misses_is_doubted():
    """Two waves: the law has no curve through these points, and its minima are one as bad as the next."""
    measured, _ = data(0)
    other = np.random.default_rng(7).uniform(0.2, 0.9, len(measured))
    scattered = cal.RestitutionData(measured.velocity, other, uncertainty=U)
    assert "several-minima" in {doubt.code for doubt in fitted(scattered).warnings}
    assert "several-minima" not in {doubt.code for doubt in fitted(measured).warnings}


def test_one_start_alone_is_searched_where_one_is_asked_for():
    measured, truth = data(2)
    assert chi_squared(fitted(measured, starts=1)) > truth + 100


@pytest.mark.long
def test_the_lowest_minimum_is_found_in_12_sets():
    assert count_elsewhere(range(12)) == 0
