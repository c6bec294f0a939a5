"""Zhou's law with a free yield strength: ε jumps where the critical velocity passes a point's.

Expected is what SciPy finds between each two neighbouring jumps, of the law as `sj.restitution` has it.
"""

from dataclasses import replace
from functools import cache

import jax
import numpy as np
import pytest
from scipy.optimize import least_squares

import calibration as cal
import softjax as sj

STRENGTH = "contact.yield_strength"
TRUTH = {"chi": 0.1, "sigma": 0.4355, "psi": 0.5414, STRENGTH: 1.0}  # the last over the true one
NOISE = 0.004
NAMES = tuple(TRUTH)


@cache
def contact():
    """Two soft spheres, E/Y = 9.9."""
    pair = sj.Contact.between_spheres(sj.NYLON, sj.NYLON, 0.0127, 0.0127)
    return replace(pair, yield_strength=float(pair.youngs_modulus) / 9.9)


def law_of(chi, sigma, psi, strength):
    pair = replace(contact(), yield_strength=strength * contact().yield_strength)
    return sj.Zhou(pair, chi, sigma, psi)


@jax.jit
def curve(values, velocity):
    return sj.restitution(law_of(*values), velocity).coefficient


slopes = jax.jit(jax.jacfwd(curve))


def data(seed):
    """26 points across the critical velocity."""
    random = np.random.default_rng(seed)
    spread = np.geomspace(0.4, 2.5, 26) * np.exp(0.02 * random.standard_normal(26))
    velocity = np.sort(spread) * float(contact().critical_velocity)
    exact = np.asarray(curve(np.array([*TRUTH.values()]), velocity))
    measured = exact + NOISE * random.standard_normal(26)
    return cal.RestitutionData(velocity, measured, contact(), uncertainty=NOISE)


def fitted(measured, **options):
    """From the truth."""
    size = float(contact().yield_strength)
    starts = {name: cal.Parameter(value) for name, value in TRUTH.items()}
    return cal.fit(measured, sj.Zhou, starts | {STRENGTH: cal.Parameter(size)}, **options)


def chi_squared(measured, values):
    off = np.asarray(curve(np.array(values), measured.velocity)) - measured.restitution
    return float(np.sum((off / NOISE) ** 2))


def found_by(result):
    values = [result.values[name] for name in NAMES]
    return [*values[:3], values[3] / float(contact().yield_strength)]


def by_brute_force(measured, near=0.5):
    """The lowest χ² of all that a continuous search finds between two jumps, strengths within a factor."""
    jumps = (measured.velocity / float(contact().critical_velocity)) ** 0.4
    ends = np.log(np.array([near, *jumps[(jumps > near) & (jumps < 1 / near)], 1 / near]))
    lowest = np.inf
    for low, high in zip(ends[:-1] + 1e-9, ends[1:] - 1e-9, strict=True):

        def off(z):
            at = curve(np.exp(z), measured.velocity)
            return (np.asarray(at) - measured.restitution) / NOISE

        def per(z):
            return np.asarray(slopes(np.exp(z), measured.velocity)) * np.exp(z) / NOISE

        start = np.append(np.log([TRUTH[name] for name in NAMES[:3]]), 0.5 * (low + high))
        wide = np.array([6.0, 4.0, 3.0])
        bounds = (np.append(start[:3] - wide, low), np.append(start[:3] + wide, high))
        lowest = min(lowest, 2 * least_squares(off, start, per, bounds).cost)
    return lowest


def test_no_start_is_better_than_the_fit_and_no_branch_is_better():
    """Branches held as a start has them, or walked across one by one, end elsewhere in most sets."""
    for seed in (5,):
        measured = data(seed)
        result = fitted(measured, profiles=False)
        own = chi_squared(measured, found_by(result))
        assert result.converged
        assert own <= chi_squared(measured, [*TRUTH.values()])
        assert own == pytest.approx(by_brute_force(measured, 0.85), abs=0.05)


def test_an_interval_of_the_strength_ends_where_the_cost_does():
    """χ² with the strength at the ends, all else by SciPy, is the limit's there or jumps over it."""
    measured = data(3)
    result = fitted(measured)
    best = chi_squared(measured, found_by(result))
    size = float(contact().yield_strength)
    profile = result.profiles[STRENGTH]
    for end, outward in zip(result.intervals[STRENGTH], (-1, 1), strict=True):
        inside, beyond = (
            at_strength(measured, end / size * (1 + outward * s)) for s in (-1e-6, 1e-6)
        )
        assert inside - best <= profile.threshold + 1e-3
        assert beyond - best >= profile.threshold - 1e-3


def at_strength(measured, strength):
    def off(z):
        at = curve(np.append(np.exp(z), strength), measured.velocity)
        return (np.asarray(at) - measured.restitution) / NOISE

    start = np.log([TRUTH[name] for name in NAMES[:3]])
    return 2 * least_squares(off, start, bounds=(start - 5, start + 5), xtol=1e-12).cost


@pytest.mark.long
def test_the_lowest_cost_of_all_branches_is_found_in_60_sets():
    worse = above = 0
    for seed in range(60):
        measured = data(seed)
        own = chi_squared(measured, found_by(fitted(measured, profiles=False)))
        worse += own > by_brute_force(measured) + 1.0
        above += own > chi_squared(measured, [*TRUTH.values()])
    assert above == 0
    assert worse <= 1


@pytest.mark.long
def test_intervals_of_the_strength_hold_it_in_40_sets():
    """At least 34 of 40: fewer are the case once in 1000 where 95 % hold."""
    size, inside, narrow = float(contact().yield_strength), 0, 0
    for seed in range(40):
        low, high = fitted(data(seed)).intervals[STRENGTH]
        inside += low <= size <= high
        narrow += high < 1.3 * low
    assert inside >= 34
    assert narrow >= 34
