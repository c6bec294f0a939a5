"""What holds for all impacts by Zhou's law, over wide boxes of all inputs.

Hypothesis draws the seed of a batch of fixed size.
"""

import jax
import numpy as np
from hypothesis import strategies as st

import softjax as sj
from tests import laws
from tests.cases import EPS, mostly_long, pair, same_flags
from tests.drawn import drawn
from tests.laws import SYMBOLS, graded

SIZE = 5 * laws.SIZE
NAMES = ("E", "R", "M", "Y", "v_lim", "chi", "sigma", "psi", "v")
AREA = {"zhou": np.pi ** (2 / 3), "hertz": 1.0}
seeds = st.integers(0, 2**32 - 1)
over_forms = mostly_long("form, area", [("first-order", "zhou"), ("full", "hertz")])


def sample(seed, area):
    """E/Y 2…1e6, X 1e-6…1e8, R 1 nm…1 km, y = v/v_cr from 0 to beyond the last turning point."""
    rng = np.random.default_rng(seed)
    power = lambda *ends: 10 ** rng.uniform(*np.log10(ends), SIZE)  # noqa: E731
    some_of = lambda *kinds: np.choose(rng.integers(len(kinds), size=SIZE), kinds)  # noqa: E731
    ratio, Y, R, X, zero = power(2, 1e6), power(1e4, 1e10), power(1e-9, 1e3), power(1e-6, 1e8), 0.0
    E, M = ratio * Y, 4 / 3 * np.pi * power(1, 3e4) * R**3
    losses = some_of(X, X, X, zero) / ratio, some_of(power(1e-3, 100), zero), power(0.05, 3)
    overlap = R * (np.pi * AREA[area] / (2 * ratio)) ** 2  # Eq. (5)
    v_cr = np.sqrt(16 / 15 * E * np.sqrt(R) / M) * overlap**1.25
    y_end = (
        1 + AREA[area] * R / (1.5 * overlap)
    ) ** 1.25  # of the order of the last one that turns
    above = 1 + power(1e-9, 1), y_end ** rng.uniform(0, 1.2, SIZE), power(1, 100)
    y = some_of(zero, power(1e-290, 1), power(1e-3, 1), *above)
    values = (E, R, M, Y, v_cr * power(0.1, 1e7), *losses, y * v_cr)
    return dict(zip(NAMES, values, strict=True)), y


def solve(inputs, form, area):
    """The result, and slopes of ε by name, times the number itself: by the program of the derivatives' tests."""
    law = sj.Zhou(pair("nylon", area), 1.8, 3.0, 0.5, form=form)
    values = [np.split(inputs[symbol], SIZE // laws.SIZE) for symbol in SYMBOLS.values()]
    rows = (dict(zip(SYMBOLS, row, strict=True)) for row in zip(*values, strict=True))
    hits = ((hit, slopes[:, 0]) for _, hit, (slopes, *_) in (graded(law, row) for row in rows))
    hit, slopes = jax.tree.map(lambda *parts: np.concatenate(parts, axis=-1), *hits)
    return hit, dict(zip(SYMBOLS.values(), slopes, strict=True))


@over_forms
@drawn(12, seed=seeds)
def test_finite_flagged_right_and_falling(form, area, seed):
    inputs, y = sample(seed, area)
    hit, slopes = solve(inputs, form, area)
    for leaf in jax.tree.leaves((hit, slopes)):
        assert np.all(np.isfinite(leaf))
    eps, plastic = hit.coefficient, hit.plastic_coefficient
    assert np.all((eps >= 0) & (eps <= plastic * (1 + 1e-15)))
    assert np.all(hit.residual_overlap <= hit.peak_overlap)
    has = {flag: (hit.status & int(flag)) > 0 for flag in sj.Status if flag}
    lost = has[sj.Status.NO_TURNING_POINT]
    yields, answered = y > 1, (y > 1) & ~lost
    assert not np.any(has[sj.Status.SOLVER_FAILED] | has[sj.Status.INVALID_INPUT])
    assert np.array_equal(has[sj.Status.ELASTIC], ~yields)
    assert np.array_equal(has[sj.Status.ZERO_VELOCITY], y == 0)
    assert np.array_equal(has[sj.Status.ABOVE_LIMIT_VELOCITY], inputs["v"] >= inputs["v_lim"])
    assert np.array_equal(
        has[sj.Status.NO_RESIDUAL_OVERLAP], answered & (hit.residual_overlap == 0)
    )
    assert np.array_equal(has[sj.Status.NO_REBOUND], answered & (eps == 0))
    clear = np.abs(plastic - 1) > 1e-13
    assert np.array_equal((has[sj.Status.ENERGY_GAIN] & clear), answered & clear & (plastic > 1))
    assert np.all(eps[lost] == 0)
    assert np.all(sum(np.abs(slope) for slope in slopes.values())[eps == 0] == 0)
    # the full form's ε_p rises again towards its end, seen from d x_m = 1.107 on
    beyond = hit.peak_overlap > AREA[area] * inputs["R"] / 1.5
    claimed = same_flags(hit.status, 0) & (inputs["chi"] * inputs["E"] >= inputs["Y"])
    claimed &= (form == "first-order") | ~beyond
    assert np.any(claimed)
    assert np.all(slopes["v"][claimed] <= 1e-13)


@over_forms
@drawn(6, seed=seeds)
def test_continuous_in_velocity(form, area, seed):
    """A step of v changes ε² by no more than the slopes at its ends allow, but at yield."""
    inputs, _ = sample(seed, area)
    step = 1e-9
    results, slopes = zip(
        *(solve(inputs | {"v": inputs["v"] * (1 + h)}, form, area) for h in (0, step)), strict=True
    )
    ends = int(sj.Status.ELASTIC | sj.Status.NO_TURNING_POINT)
    same = (results[0].status & ends) == (results[1].status & ends)
    change = np.abs(results[1].coefficient ** 2 - results[0].coefficient ** 2)
    squares = [
        {name: 2 * r.coefficient * np.abs(x) for name, x in s.items()}
        for r, s in zip(results, slopes, strict=True)
    ]
    allowed = 2 * step * np.maximum(squares[0]["v"], squares[1]["v"]) + 1e-12
    allowed += 8 * EPS * sum(sum(one.values()) for one in squares)  # rounding of the inputs
    assert np.all(change[same] <= allowed[same])
    assert same.mean() > 0.9
