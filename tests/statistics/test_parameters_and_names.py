"""Which parameters the data determine, and names that mean one thing only."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy import optimize

import calibration as cal
import softjax as sj
from tests import fit_oracle
from tests.decay import Decay
from tests.fit_data import pair

QUICK = {"profiles": False, "starts": 1}
STEEL = pair("stainless steel")
V_CR = float(STEEL.critical_velocity)
YIELD = float(STEEL.yield_strength)


def drops(lowest, contact=STEEL):
    """Zhou's law with noise of 0.004, from so many critical velocities on."""
    random = np.random.default_rng(4)
    v = np.geomspace(lowest * V_CR, 400 * V_CR, 26)
    law = sj.Zhou(contact, chi=1.8, sigma=3.0, psi=0.54)
    e = np.asarray(sj.restitution(law, v).coefficient) + 0.004 * random.standard_normal(26)
    return cal.RestitutionData(v, e, contact, uncertainty=0.004)


def with_yield(**options):
    return {"contact.yield_strength": cal.Parameter(**options)}


def test_a_prior_on_yield_keeps_what_the_points_above_it_determine():
    """ε_up in place of σ and ψ, with the values and errors of SciPy's least squares."""
    data = drops(20)
    result = cal.fit(data, "zhou", with_yield(prior=(YIELD, 0.05 * YIELD)), **QUICK)
    names = ("chi", "eps_up", "contact.yield_strength")
    assert result.covariance_names == names
    assert result.condition_number < 100
    assert result.rank == 3
    numbers = fit_oracle.numbers(STEEL)

    def off(x):
        chi, up, share = x
        contact = numbers | {"Y": share * YIELD}
        critical = V_CR * share**2.5
        psi = 0.5  # any: all points are above yield
        sigma = -np.log(up) / (critical / (contact["v_lim"] - critical)) ** psi
        curve = fit_oracle.curve(data.velocity, contact, chi, sigma, psi)
        return np.append((curve - data.restitution) / 0.004, (share - 1) / 0.05)

    scale = (1, 0.01, 0.05)
    best = optimize.least_squares(off, (1.8, 0.98, 1.0), "3-point", x_scale=scale)
    steps = 0.1 * np.diag(best.jac.T @ best.jac) ** -0.5
    curved = fit_oracle.hessian(lambda x: 0.5 * np.sum(off(x) ** 2), best.x, steps)
    errors = np.sqrt(np.diag(np.linalg.inv(curved)))
    unit = np.array([1.0, 1.0, YIELD])
    found = np.array([result.values[name] for name in names])
    of_found = np.array([result.standard_errors[name] for name in names])
    assert np.max(np.abs(found / unit - best.x) / errors) < 1e-2
    np.testing.assert_allclose(of_found, errors * unit, rtol=1e-3)


@pytest.mark.parametrize(
    ("keywords", "lowest"),
    [
        ({"prior": (YIELD, 0.05 * YIELD)}, 1.5),  # five deviations up v_cr is 1.75 times as high
        ({"bounds": (0.5 * YIELD, 3 * YIELD)}, 12),  # v_cr reaches 3^2.5 = 15.6 times as high
        ({"value": YIELD}, 20),
    ],
)
def test_sigma_and_psi_stay_where_yield_may_reach_the_points(keywords, lowest):
    result = cal.fit(drops(lowest), "zhou", with_yield(**keywords), **QUICK, max_steps=2)
    assert {"sigma", "psi"} <= set(result.covariance_names)


def test_a_yield_strength_that_is_fixed_decides_which_points_are_above_it():
    """v_cr goes with Y to the power 2.5: below it χ̃ does not show, above it σ and ψ do not."""
    few = QUICK | {"max_steps": 2}
    above = cal.fit(drops(2), "zhou", {"contact.yield_strength": YIELD}, **few)
    assert "eps_up" in above.covariance_names
    below = cal.fit(drops(2), "zhou", {"contact.yield_strength": 20 * YIELD}, **few)
    assert below.covariance_names == ("sigma", "psi")
    assert below.values["chi"] is None
    around, higher = V_CR * np.array([0.99, 1.01]), 20**2.5
    np.testing.assert_array_equal(above.determined(around), [False, True])
    np.testing.assert_array_equal(below.determined(higher * around), [True, False])
    np.testing.assert_array_equal(np.isnan(above.band(around).coefficient), [True, False])


def test_what_the_data_do_not_determine_is_said_without_nan():
    parameters = with_yield(prior=(YIELD, 0.05 * YIELD)) | {"sigma": cal.Parameter(2.0)}
    result = cal.fit(drops(20), "zhou", parameters, **QUICK)
    assert np.isnan(result.standard_errors["sigma"])  # it is free; a table has no error of it
    said_once = ("sigma-psi-not-separate", "rank-deficient", "collinear")
    found = [warning.code for warning in result.warnings if warning.code in said_once]
    assert found == ["sigma-psi-not-separate"]
    assert "nan" not in str(result).lower()


def decays(count, **options):
    random = np.random.default_rng(count)
    v = np.linspace(0.5, 4.0, 12)
    sets = []
    for name in "abc"[:count]:
        e = 0.92 * np.exp(-0.08 * v) + 0.01 * random.standard_normal(12)
        sets.append(cal.RestitutionData(v, e, name=name, **options))
    return sets


def test_a_group_may_have_the_name_of_one_of_its_data_sets_and_of_no_other(tmp_path):
    """Its parameter and that of the data set would both be "rate[a]"."""
    parameters = {f"rate[{name}]": cal.Parameter(shared="a") for name in "bc"}
    with pytest.raises(ValueError, match=r"`shared of rate` must be .*no data set.*, but is a$"):
        cal.fit(decays(3), Decay, parameters, **QUICK)
    parameters = {f"rate[{name}]": cal.Parameter(shared="a") for name in "ab"}
    result = cal.fit(decays(3), Decay, parameters, **QUICK)
    assert len(set(result.covariance_names)) == len(result.covariance_names) == 5
    assert result.values["rate[a]"] == result.values["rate[b]"] != result.values["rate[c]"]
    result.save(tmp_path / "fit.json")
    loaded = cal.FitResult.load(tmp_path / "fit.json", law=Decay)
    assert loaded == result
    for name in ("leave_one_out", "bootstrap", "posterior"):
        message = (
            f"`result` must be fitted here for {name}: fit the data again by cal.fit, but is loaded"
        )
        with pytest.raises(ValueError, match=message):
            getattr(loaded, name)()


CLASHES = {
    "noise": (lambda noise=0.9: Decay(noise, 0.1), {}, {}),
    "scale": (lambda scale=0.9: Decay(scale, 0.1), {"uncertainty": 0.01}, {"scale_uncertainty": True}),
    "group": (lambda group=0.9: Decay(group, 0.1), {"group": [*"aaabbbcccddd"]}, {}),
}  # fmt: skip


@pytest.mark.parametrize("name", CLASHES)
def test_a_parameter_may_have_the_name_of_an_error_that_the_data_do_not_have(name):
    """theta[name] was read as both."""
    law, options, parameters = CLASHES[name]
    words = rf"^`parameter` must be named otherwise: .*but is {name}$"
    with pytest.raises(ValueError, match=words):
        cal.problem(decays(1, **options), law, **parameters)
    stated = decays(1, uncertainty=0.01)
    problem = cal.problem(stated, law)
    assert (problem.names, problem.noises) == ((name,), ())
    off = (0.8 * np.exp(-0.1 * stated[0].velocity) - stated[0].restitution) / 0.01
    np.testing.assert_allclose(problem.residuals({name: 0.8}), off, rtol=1e-9)
    assert set(cal.fit(stated, law, **QUICK).values) == {name}


class Singular(sj.HardSphereLaw):
    """A law whose force solves a system that has no solution."""

    level: float = sj.number_field("a", "-", "level", within="(0, inf)")

    def restitution_squared(self, velocity):
        np.linalg.solve(np.zeros((2, 2)), np.ones(2))
        return jnp.asarray(self.level) * velocity


def test_a_failure_inside_a_law_is_no_refusal_of_the_data():
    """It goes on as what it is, not as "another law is needed"."""
    with pytest.raises(np.linalg.LinAlgError, match="Singular"):
        cal.compare(decays(1)[0], ["constant", Singular])


RATIO = float(STEEL.yield_ratio)
UNLOADING = {
    "chi": ({"chi": 1.8}, 1.8),
    "line": ({"c1": 0.03, "c2": 0.0045}, 0.03 + 0.0045 * RATIO),
    "half a line": ({"c1": 0.03}, None),
    "a guess": ({"chi": cal.Parameter(1.8)}, None),
}


@pytest.mark.parametrize("stated", UNLOADING)
def test_what_is_stated_of_unloading_holds_where_no_point_yields(stated):
    parameters, chi = UNLOADING[stated]
    v = np.linspace(0.1, 0.95, 12) * V_CR
    data = cal.RestitutionData(v, 1 - 0.1 * v / V_CR, STEEL, uncertainty=0.01)
    result = cal.fit(data, None, parameters, **QUICK)
    assert result.values["chi"] == (None if chi is None else pytest.approx(chi, rel=1e-12))
    assert "χ̃" in str(result)
    assert result.determined([0.5 * V_CR, 2 * V_CR]).tolist() == [True, chi is not None]
