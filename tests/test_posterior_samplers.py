"""The likelihood in other samplers' hands: the examples that the documentation gives, as they stand."""

import inspect
import textwrap
from itertools import pairwise

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import calibration as cal
from calibration.fitting import traceable
from tests.fit_data import twin
from tests.posterior_cases import az, blackjax, needed


def example(which):
    """The n-th block of code of the module's documentation that follows the two lines at its top."""
    lines = inspect.cleandoc(traceable.__doc__).splitlines()
    starts = [k for k, line in enumerate(lines) if line.startswith("With ")] + [len(lines)]
    first, last = list(pairwise(starts))[which]
    block = [line for line in lines[first + 1 : last] if line.startswith("    ") or not line]
    return textwrap.dedent("\n".join(block))


@pytest.fixture(scope="module")
def data():
    """Impacts above yield alone: they tell χ̃, ε_up and the noise."""
    return twin("nylon", y=np.geomspace(1.3, 60.0, 20), noise=0.01)


@pytest.fixture(scope="module")
def problem(data):
    return cal.problem(data)


@pytest.fixture(scope="module")
def expected(data):
    """Logarithms and their standard errors as the fit finds them."""
    result = cal.fit(data, profiles=False)
    found = {n: (np.log(e.value), e.standard_error / e.value) for n, e in estimates(result)}
    left = result.materials[0].residual_degrees
    return found | {"noise": (np.log(result.materials[0].noise), (2 * left) ** -0.5)}


def estimates(result):
    return [(name, result.estimates[name]) for name in ("chi", "eps_up")]


def check(draws, expected):
    """Within Monte Carlo error and what priors and the normal approximation are off by."""
    for name, (mean, deviation) in expected.items():
        log = np.log(np.asarray(draws[name]))
        error = deviation / float(az.ess(log[None])) ** 0.5
        assert abs(np.mean(log) - mean) < 5 * error + 0.25 * deviation
        assert np.std(log) == pytest.approx(deviation, rel=0.3)


@pytest.mark.long
def test_numpyro_samples_it(problem, expected):
    numpyro = needed("numpyro")
    names = {
        "numpyro": numpyro,
        "dist": numpyro.distributions,
        "MCMC": numpyro.infer.MCMC,
        "NUTS": numpyro.infer.NUTS,
        "jax": jax,
        "problem": problem,
    }
    code = example(0).replace("NUTS(model)", "NUTS(model), progress_bar=False")
    exec(code, names)
    check(names["mcmc"].get_samples(), expected)


def test_blackjax_samples_it(problem, expected):
    names = {
        "jax": jax,
        "jnp": jnp,
        "blackjax": blackjax,
        "problem": problem,
    }
    code = example(1)
    assert "state, info = step(key, state)" in code
    exec(code + "\n    draws.append(state.position)", names | {"draws": (draws := [])})
    every = {name: np.exp([float(one[name]) for one in draws]) for name in expected}
    assert len(draws) == 500
    check(every, expected)
