"""Fixed and bounded parameters, priors, shared values, losses, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import optimize

import calibration as cal
import softjax as sj
from calibration.fitting import stages
from calibration.fitting.law_model import MOVE_YIELD
from calibration.fitting.request import Request
from tests import fit_oracle
from tests.fit_data import TRUTH, eq_17_data, pair, twin

QUICK = {"route": sj.EnergyBalance(), "profiles": False, "starts": 8}
Free = cal.Parameter
TWO_STEP = QUICK | {"objective": "two-step"}


def test_a_number_fixes_and_a_bound_is_kept():
    data = twin("nylon", noise=0.003)
    fixed = cal.fit(data, None, {"psi": 0.5}, **QUICK)
    assert fixed.values["psi"] == 0.5
    assert not fixed.materials[0].parameters["psi"].free
    assert "psi" not in fixed.covariance_names
    bounded = cal.fit(data, None, {"chi": Free(bounds=(0.5, 2.0))}, **TWO_STEP)
    assert bounded.values["chi"] == pytest.approx(0.5, abs=1e-5)
    assert bounded.materials[0].parameters["chi"].at_bound
    assert "at-bound" in {doubt.code for doubt in bounded.warnings}
    free = cal.fit(data, None, {"chi": Free(bounds=(0.01, 2.0))}, **TWO_STEP)
    plain = cal.fit(data, **TWO_STEP)
    assert free.values["chi"] == pytest.approx(plain.values["chi"], rel=1e-7)
    assert free.standard_errors["chi"] == pytest.approx(plain.standard_errors["chi"], rel=1e-6)


def test_a_prior_is_one_more_measurement():
    """Against SciPy: the prior as one more residual."""
    name = "nylon"
    data = twin(name, noise=0.004, uncertainty=0.004)
    numbers = fit_oracle.numbers(data.contact)
    prior = (0.30, 0.01)
    result = cal.fit(data, None, {"chi": Free(prior=prior)}, **QUICK)

    def model(chi, sigma, psi):
        return np.append(fit_oracle.curve(data.velocity, numbers, chi, sigma, psi), chi)

    target = np.append(data.restitution, prior[0])
    told = np.append(data.uncertainty, prior[1])
    values, covariance, _ = fit_oracle.fit(model, TRUTH[name][1:4], target, told)
    for i, parameter in enumerate(("chi", "sigma", "psi")):
        assert result.values[parameter] == pytest.approx(values[i], rel=1e-5)
        error = np.sqrt(covariance[i, i])
        assert result.standard_errors[parameter] == pytest.approx(error, rel=1e-5)


def test_all_that_yield_moves_with_is_told():
    """By the derivatives of the critical velocity in each property of the bodies."""
    contact = pair("nylon")
    moves = {
        name
        for name, value in contact.leaves().items()
        if replace(contact, **{name: 1.001 * value}).critical_velocity != contact.critical_velocity
    }
    assert set(MOVE_YIELD) == moves


@pytest.mark.parametrize("name", MOVE_YIELD)
def test_eps_up_stands_for_the_losses_only_where_yield_stays(name):
    """Points above yield tell σ and ψ apart once yield moves: both are searched."""
    data = eq_17_data("nylon")
    free = Free(prior=(getattr(data.contact, name), 0.05 * float(getattr(data.contact, name))))
    (spec,) = Request((data,), None, {name: free}).specs()
    assert set(spec.model.parameters) == {"chi", "sigma", "psi"}
    (spec,) = Request((data,)).specs()
    assert set(spec.model.parameters) == {"chi", "eps_up", "psi"}


def test_yield_strength_is_recovered_and_points_that_cross_are_told():
    name = "nylon"
    data = twin(name, y=np.linspace(0.2, 30, 40))
    wrong = sj.Contact(
        **{**data.contact.leaves(), "yield_strength": 1.25 * float(data.contact.yield_strength)}
    )
    misled = cal.RestitutionData(data.velocity, data.restitution, wrong, name=name)
    specs = {
        "yield_strength": Free(),
        "sigma": TRUTH[name][2],
        "psi": TRUTH[name][3],
    }
    result = cal.fit(misled, None, specs, **QUICK)
    assert result.values["contact.yield_strength"] == pytest.approx(
        float(data.contact.yield_strength), rel=1e-4
    )
    assert result.values["chi"] == pytest.approx(TRUTH[name][1], rel=1e-3)
    assert "branch-change" in {doubt.code for doubt in result.warnings}
    right = cal.fit(data, None, specs, **QUICK)
    assert "branch-change" not in {doubt.code for doubt in right.warnings}


def test_a_value_shared_by_two_sets_is_one_parameter():
    """The joint fit against SciPy."""
    one, two = (twin("nylon", noise=0.004, seed=s, uncertainty=0.004) for s in (1, 2))
    two = cal.RestitutionData(
        two.velocity[::2], two.restitution[::2], two.contact, 0.004, name="second"
    )
    spec = Free(shared="both")
    result = cal.fit([one, two], None, {"chi": spec}, **QUICK)
    assert result.values["chi[nylon]"] == result.values["chi[second]"]
    assert "chi[both]" in result.covariance_names
    assert result.unloading_line is None
    numbers = fit_oracle.numbers(one.contact)

    def model(chi, s1, p1, s2, p2):
        first = fit_oracle.curve(one.velocity, numbers, chi, s1, p1)
        return np.append(first, fit_oracle.curve(two.velocity, numbers, chi, s2, p2))

    _, chi, sigma, psi, _ = TRUTH["nylon"]
    target = np.append(one.restitution, two.restitution)
    values, covariance, _ = fit_oracle.fit(
        model, [chi, sigma, psi, sigma, psi], target, np.full(len(target), 0.004)
    )
    assert result.values["chi[nylon]"] == pytest.approx(values[0], rel=1e-5)
    assert result.standard_errors["chi[second]"] == pytest.approx(
        np.sqrt(covariance[0, 0]), rel=1e-5
    )
    assert result.band([10.0], "second").standard_error[0] > 0


def test_c1_and_c2_as_parameters_are_the_line_through_all_curves():
    data = cal.paper_materials()
    result = cal.fit(data, None, {"c1": Free(), "c2": Free()}, **TWO_STEP)
    assert result.values["c1"] == pytest.approx(0.03184, abs=6e-6)
    assert result.values["c2"] == pytest.approx(0.004554, abs=6e-7)
    ratio = float(data[2].contact.yield_ratio)
    chi = result.values["c1"] + result.values["c2"] * ratio
    assert result.values["chi[nylon]"] == pytest.approx(chi, rel=1e-9)
    assert float(np.asarray(result.law["nylon"].chi)) == pytest.approx(chi, rel=1e-9)


def latent_fit(data, u, u_v, values):
    """SciPy's fit of Eq. (17) and of every true velocity, its bend over their errors taken out."""
    limit, n = float(data.limit_velocity), len(data)
    curve = lambda v, values: fit_oracle.eq_17(v, limit, *values)  # noqa: E731
    bend = np.zeros(n)

    def residual(x):
        off = curve(x[2:], np.exp(x[:2])) - data.restitution - bend
        return np.concatenate([off / u, (x[2:] - data.velocity) / u_v])

    x = np.concatenate([np.log(values), data.velocity])
    for _ in range(12):
        x = optimize.least_squares(residual, x, method="lm", xtol=1e-14, ftol=1e-14).x
        h = 1e-3 * x[2:]
        down, at, up = (curve(x[2:] + k * h, np.exp(x[:2])) for k in (-1, 0, 1))
        slope, curved = (up - down) / (2 * h), (up - 2 * at + down) / h**2
        bend = 0.5 * curved * u_v**2 * u**2 / (u**2 + (slope * u_v) ** 2)
    return np.exp(x[:2])


def test_velocities_with_errors_are_fitted_with_the_curve():
    name, u, u_v = "stainless steel", 0.004, 0.02
    plain = eq_17_data(name, noise=u, uncertainty=u)
    data = eq_17_data(name, noise=u, uncertainty=u, velocity_uncertainty=u_v)
    result = cal.fit(data, "eq-17", **QUICK)
    expected = latent_fit(data, u, u_v, TRUTH[name][2:4])
    found = [result.values["sigma"], result.values["psi"]]
    np.testing.assert_allclose(found, expected, rtol=1e-5)
    error = result.standard_errors["sigma"]
    assert error > 1.02 * cal.fit(plain, "eq-17", **QUICK).standard_errors["sigma"]
    without = optimize.least_squares(  # as if the velocities were exact
        lambda x: (
            fit_oracle.eq_17(data.velocity, float(data.limit_velocity), *x) - data.restitution
        ),
        TRUTH[name][2:4],
    ).x
    assert abs(without[0] - expected[0]) > 1e-4


@pytest.mark.parametrize("loss", ["huber", "soft-l1"])
def test_robust_loss_is_least_squares_without_outliers_and_better_with(loss):
    clean = eq_17_data("nylon", points=40, noise=0.005)
    spoilt = np.array(clean.restitution)
    spoilt[[5, 17, 30]] -= 0.05
    dirty = cal.RestitutionData(clean.velocity, spoilt, clean.contact)
    truth = cal.fit(clean, **TWO_STEP)
    robust = cal.fit(dirty, loss=loss, **TWO_STEP)
    squared = cal.fit(dirty, **TWO_STEP)
    error = truth.standard_errors["chi"]
    assert abs(robust.values["chi"] - truth.values["chi"]) < error
    assert abs(robust.values["chi"] - truth.values["chi"]) < abs(
        squared.values["chi"] - truth.values["chi"]
    )
    same = cal.fit(clean, loss=loss, **TWO_STEP)
    assert abs(same.values["chi"] - truth.values["chi"]) < 0.5 * error
    assert same.standard_errors["chi"] == pytest.approx(error, rel=0.35)
    assert robust.converged
    assert robust.settings["loss"] == loss


def test_without_elastic_properties_eq_17_or_a_constant_is_fitted():
    data = eq_17_data("nylon", noise=0.002)
    told = cal.RestitutionData(data.velocity, data.restitution, limit_velocity=data.limit_velocity)
    result = cal.fit(told)
    assert result.settings["law"] == "eq-17"
    assert result.values["sigma"] == pytest.approx(TRUTH["nylon"][2], rel=0.05)
    assert isinstance(result.law, sj.EmpiricalRestitution)
    assert "limit_velocity" not in result.covariance_names
    flat = cal.RestitutionData(np.linspace(1, 3, 12), 0.9 + 0.01 * (-1.0) ** np.arange(12))
    constant = cal.fit(flat)
    assert constant.settings["law"] == "constant"
    assert constant.values["restitution"] == pytest.approx(0.9, abs=1e-9)
    expected = np.std(flat.restitution, ddof=1) / np.sqrt(12)
    assert constant.standard_errors["restitution"] == pytest.approx(expected, rel=1e-6)


def test_sphere_on_wall_and_many_radii_in_one_set():
    material, chi, sigma, psi, _ = TRUTH["nylon"]
    radius = np.repeat([0.005, 0.01], 12)
    wall = sj.Contact.with_wall(material, material, radius)
    velocity = np.tile(np.geomspace(0.3, 30, 12), 2)
    law = sj.Zhou(wall, chi, sigma, psi)
    data = cal.RestitutionData(velocity, sj.restitution(law, velocity).coefficient, wall)
    result = cal.fit(data, **QUICK)
    assert result.values["chi"] == pytest.approx(chi, rel=1e-6)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"optimiser": "bfgs"}, "`optimiser` must be 'l-bfgs'"),
        ({"loss": "cauchy"}, "`loss` must be 'squared'"),
        ({"objective": "both"}, "`objective` must be model, two-step, but is both"),
        ({"objective": "empirical"}, '`objective` must be "model" with law = "eq-17"'),
        ({"law": "two-step"}, "`law` must be left out: that is an objective"),
        ({"law": "hertz-dashpots"}, "did you mean 'hertz-dashpot'"),
        ({"law": 3.0}, "`law` must be a name"),
        ({"law": "thornton", "objective": "two-step"}, "two-step with thornton"),
        ({"starts": 0}, "`starts` must be a whole number >= 1"),
        ({"seed": -1}, "`seed` must be a whole number >= 0"),
        ({"confidence": 95}, "`confidence` must be between 0 and 1"),
        ({"confidence": "0.95"}, "`confidence` must be between 0 and 1, but is 0.95"),
        ({"confidence": None}, "`confidence` must be between 0 and 1"),
        ({"confidence": np.array([0.9, 0.95])}, "`confidence` must be between 0 and 1"),
        ({"loss_scale": "1"}, "`loss_scale` must be positive, but is 1"),
        ({"loss_scale": np.inf}, "`loss_scale` must be positive"),
        ({"loss_scale": True}, "`loss_scale` must be positive"),
        ({"loss": np.array(["huber", "huber"])}, "`loss` must be 'squared'"),
        ({"optimiser": ["adam"]}, "`optimiser` must be 'l-bfgs'"),
        ({"objective": ["model"]}, "`objective` must be model, two-step"),
        ({"profiles": "no"}, "`profiles` must be true or false, but is no"),
        ({"beside": "no"}, "`beside` must be true or false"),
        ({"extra_scatter": None}, "`extra_scatter` must be true or false"),
        ({"scale_uncertainty": np.ones(2)}, "`scale_uncertainty` must be true or false"),
        ({"progress": "bar"}, r"`progress` must be called as progress\(stage, done, total\)"),
        ({"parameters": 3}, "`parameters` must be a mapping"),
        ({"parameters": {3: 1.0}}, "`parameters` must be by the parameters' names, but is 3"),
        ({"parameters": {"form": "second"}}, "`form` must be 'first-order' or 'full'"),
        ({"parameters": {"end": "near"}}, "`option` must be an option of zhou: form, kappa"),
        ({"unloading_line": "both"}, "`unloading_line` must be"),
        ({"parameters": {"chi": [0.2]}}, "must be a calibration.Parameter, or a number"),
        ({"parameters": {"chi[steel]": 1.0}}, "must be named after one of: nylon"),
        ({"parameters": {"chii": 1.0}}, "did you mean 'chi'"),
        ({"parameters": {"restitution": 0.5}}, "`parameter` must be of zhou: chi, sigma, psi"),
        ({"parameters": {"chi": -1.0}}, "`value of chi` must be an unloading factor of zero or"),
        ({"parameters": {"chi": Free(bounds=(-1, 2))}}, r"`bounds of chi` must be within \[0, inf"),
        ({"route": "ode"}, "route"),
    ],
)
def test_what_makes_no_sense_is_refused(changed, message):
    data = eq_17_data("nylon")
    with pytest.raises(ValueError, match=message) as caught:
        cal.fit(data, **changed)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("asked", [{"loss": "huber"}, {"extra_scatter": True}])
def test_a_fit_whose_weights_have_not_settled_says_so(asked, monkeypatch):
    """It is one search after its first weights, each ending at a minimum of its own."""
    made = {"uncertainty": np.linspace(0.001, 0.02, 30)} if "extra_scatter" in asked else {}
    data = eq_17_data("nylon", noise=0.01, **made)
    assert cal.fit(data, "walton-braun", **QUICK, **asked).converged
    monkeypatch.setattr(stages, "ROUNDS", 1)
    result = cal.fit(data, "walton-braun", **QUICK, **asked)
    assert not result.converged
    assert result.optimiser_report[0].reason == stages.UNSETTLED
    assert "not-converged" in {one.code for one in result.warnings}


@pytest.mark.parametrize(
    ("asked", "name"),
    [
        ({"count": 2.5}, "count"),
        ({"count": "9"}, "count"),
        ({"count": 0}, "count"),
        ({"seed": "x"}, "seed"),
        ({"seed": None}, "seed"),
    ],
)
def test_a_bootstrap_of_no_count_is_refused(asked, name):
    result = cal.fit(eq_17_data("nylon"), "constant", profiles=False)
    with pytest.raises(ValueError, match=f"`{name}` must be a whole number >= "):
        result.bootstrap(**({"count": 3} | asked))


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"laws": 3}, "`law` must be a name"),
        ({"parameters": 3}, "`parameters` must be a mapping"),
        ({"parameters": {"constant": 3}}, "`parameters` must be a mapping"),
        ({"seed": "x"}, "`seed` must be a whole number"),
    ],
)
def test_a_comparison_of_no_laws_is_refused(asked, message):
    with pytest.raises(ValueError, match=message):
        cal.compare(eq_17_data("nylon"), **({"laws": ["constant"]} | asked))


def test_data_that_do_not_fit_together_are_refused():
    data = eq_17_data("nylon")
    with pytest.raises(ValueError, match="different names"):
        cal.fit([data, data])
    hertz = twin("chrome steel", area="hertz")
    with pytest.raises(ValueError, match="`area` must be the same"):
        cal.fit([data, hertz], None, {"chi": Free(shared=True)})
    with pytest.raises(ValueError, match="`data` must be"):
        cal.fit("nylon.csv")
    few = cal.RestitutionData(data.velocity[:2], data.restitution[:2], pair("nylon"))
    with pytest.raises(ValueError, match="more points than free parameters"):
        cal.fit(few)


def test_progress_is_told_from_start_to_end():
    told = []
    cal.fit(eq_17_data("nylon", noise=0.003), progress=lambda *args: told.append(args), starts=8)
    stages = [stage for stage, _, _ in told]
    assert set(stages) == {"fit", "profiles"}
    for stage in set(stages):
        own = [(done, total) for name, done, total in told if name == stage]
        assert own[0][0] == 0
        assert own[-1][0] == own[-1][1]
