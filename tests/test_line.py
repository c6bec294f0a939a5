"""Eq. (18)'s line through several materials: what it weighs them by, and which it is of."""

import numpy as np
import pytest

import calibration as cal
import softjax as sj
from tests.cases import pair
from tests.fit_data import eq_17_data

NAMES = ("stainless steel", "chrome steel", "nylon")
QUICK = {"objective": "two-step", "optimiser": "levenberg-marquardt", "starts": 1}
QUICK |= {"route": sj.EnergyBalance(), "profiles": False}


def three(names=NAMES):
    """The paper's materials with noise."""
    return [eq_17_data(name, noise=0.01, seed=len(name)) for name in names]


@pytest.mark.parametrize(
    "said", [{}, {"bounds": (0.01, 2.5)}, {"transform": "none"}], ids=["log", "logit", "none"]
)
def test_the_line_weighs_what_is_fitted_on_any_scale(said):
    """NumPy's weighted line through the fitted χ̃ and their standard errors."""
    sets = three()
    result = cal.fit(sets, parameters={"chi": cal.Parameter(**said)}, **QUICK)
    again = cal.fit(
        sets, parameters={"chi": cal.Parameter(**said)}, unloading_line="weighted", **QUICK
    )
    ratio = [float(pair(name).yield_ratio) for name in NAMES]
    chi = [result.values[f"chi[{name}]"] for name in NAMES]
    errors = np.array([result.standard_errors[f"chi[{name}]"] for name in NAMES])
    line, covariance = np.polyfit(ratio, chi, 1, w=1 / errors, cov="unscaled")
    for found in (result.unloading_line.through_chi, vars(again.unloading_line)):
        for name, value, variance in zip(("c2", "c1"), line, np.diag(covariance), strict=True):
            assert found[name].value == pytest.approx(value, rel=1e-9)
            assert found[name].standard_error == pytest.approx(variance**0.5, rel=1e-9)


def test_the_line_knows_whose_each_parameter_is():
    """Sets that share a parameter are one fit; the line through all does not depend on their order."""
    said = {f"psi[{name}]": cal.Parameter(shared="both") for name in ("stainless steel", "nylon")}
    said |= {"psi[chrome steel]": 0.3114}
    first, second = (
        cal.fit(three(names), parameters=said, **QUICK).unloading_line
        for names in (NAMES, ("stainless steel", "nylon", "chrome steel"))
    )
    assert first.c1.value == pytest.approx(second.c1.value, rel=1e-6)
    assert first.c2.value == pytest.approx(second.c2.value, rel=1e-6)


def test_a_law_of_one_s_own_has_no_line():
    """Its `chi` is what its function makes of it."""

    def squared(contact, chi):
        return sj.Zhou(contact, chi=chi**2, sigma=0.4, psi=0.5)

    options = QUICK | {"objective": "model"}
    assert cal.fit(three()[::2], squared, **options).unloading_line is None
