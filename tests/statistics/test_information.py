"""Information: closed forms, a fit's own errors, and what simulated calibrations reach."""

from dataclasses import replace

import numpy as np
import pytest

import calibration as cal
import softjax as sj
from tests.cases import fitted
from tests.decay import Decay
from tests.fit_data import eq_17_data, twin

SETS = 600
LAW = fitted("nylon")
STEEL = fitted("stainless steel")
CRITICAL = float(LAW.contact.critical_velocity)
BALANCE = sj.EnergyBalance()
DECAY = Decay(0.95, 0.05)


def above(law: sj.Zhou, highest: float, count: int = 30):
    return np.linspace(2.0, highest, count) * float(law.contact.critical_velocity)


def gauss_newton(curve, start, measured, steps=12):
    """Least squares of many data sets at once, {θ: estimates}: `curve` of ln θ (sets, p) by differences."""
    z = np.repeat(np.log(start)[None], len(measured), axis=0)
    for _ in range(steps):
        middle = curve(z)
        slopes = np.stack(
            [(curve(z + step) - curve(z - step)) / 2e-5 for step in 1e-5 * np.eye(z.shape[1])], -1
        )
        normal = np.einsum("snp,snq->spq", slopes, slopes)
        right = np.einsum("snp,sn->sp", slopes, measured - middle)
        z = z + np.clip(np.linalg.solve(normal, right[..., None])[..., 0], -0.5, 0.5)
    return z


def curve_of(law, names, velocity):
    """ε of many sets of parameters, all impacts in one call."""

    def curve(z):
        values = dict(zip(names, np.exp(z).T[..., None], strict=True))
        return np.asarray(sj.restitution(replace(law, **values), velocity).coefficient)

    return curve


def simulated(law, velocity, noise: float, seed: int):
    """Standard deviation of ln θ over fits of `SETS` noisy data sets that follow the law itself.

    Gauss and Newton's steps in NumPy. Above yield σ stands for both losses, and is told as ε_up.
    """
    random = np.random.default_rng(seed)
    exact = np.asarray(sj.restitution(law, velocity).coefficient)
    drawn = exact + noise * random.standard_normal((SETS, len(velocity)))
    if not isinstance(law, sj.Zhou):
        names = [name for name in ("level", "rate", "dissipation_time") if hasattr(law, name)]
        start = [float(getattr(law, name)) for name in names]
        z = gauss_newton(curve_of(law, names, velocity), start, drawn)
        return dict(zip(names, np.std(z, axis=0, ddof=1), strict=True))
    z = gauss_newton(curve_of(law, ["chi", "sigma"], velocity), [law.chi, law.sigma], drawn, 8)
    critical, limit = law.contact.critical_velocity, law.contact.limit_velocity
    eps_up = np.exp(z[:, 1]) * float(critical / (limit - critical)) ** law.psi  # -ln ε_up
    return {"chi": np.std(z[:, 0], ddof=1), "eps_up": np.std(eps_up, ddof=1)}


VISCOELASTIC = sj.ViscoelasticHertz(LAW.contact, 3e-6)
CASES = {
    "zhou": (STEEL, above(STEEL, 250.0), 0.003),
    "a law of one's own": (DECAY, np.linspace(1.0, 30.0, 12), 0.01),
    "viscoelastic": (VISCOELASTIC, np.linspace(0.5, 20.0, 12), 0.01),
}


@pytest.mark.parametrize(
    "case",
    [
        pytest.param(name, marks=[pytest.mark.long] * (name in ("viscoelastic", "zhou")))
        for name in CASES
    ],
)
def test_promised_errors_are_those_that_simulation_reaches(case):
    law, velocity, noise = CASES[case]
    promised = cal.fisher_information(law, velocity, noise).relative_errors
    reached = simulated(law, velocity, noise, seed=3)
    assert set(promised) == set(reached)
    for name, error in reached.items():
        assert promised[name] == pytest.approx(error, rel=0.1)


def test_information_of_one_number_is_that_of_a_mean():
    """ε = a e^{-bv} with b fixed: n ε²/u² of ln a; a prior adds (a/sd)²."""
    v, u = np.linspace(1.0, 9.0, 9), 0.02
    total = np.sum((0.95 * np.exp(-0.05 * v) / u) ** 2)
    fixed = {"rate": cal.Parameter(free=False)}
    found = cal.fisher_information(DECAY, v, u, parameters=fixed)
    assert found.names == ("level",)
    assert found.relative_errors["level"] == pytest.approx(total**-0.5, rel=1e-9)
    assert found.standard_errors["level"] == pytest.approx(0.95 * total**-0.5, rel=1e-9)
    known = fixed | {"level": cal.Parameter(prior=(0.5, 0.01))}
    with_prior = cal.fisher_information(DECAY, v, u, parameters=known)
    expected = (total + (0.95 / 0.01) ** 2) ** -0.5
    assert with_prior.relative_errors["level"] == pytest.approx(expected, rel=1e-9)
    assert with_prior.truth[0] == pytest.approx(0.95)


def test_each_impact_counts_with_its_own_uncertainty():
    v, u = np.linspace(1.0, 9.0, 9), np.linspace(0.01, 0.05, 9)
    curve = 0.95 * np.exp(-0.05 * v)
    rows = np.stack([curve, -0.05 * v * curve], axis=1) / u[:, None]
    found = cal.fisher_information(DECAY, v, u)
    np.testing.assert_allclose(found.matrix, rows.T @ rows, rtol=1e-9)
    expected = np.sqrt(np.diag(np.linalg.inv(rows.T @ rows)))
    np.testing.assert_allclose(list(found.relative_errors.values()), expected, rtol=1e-8)
    np.testing.assert_allclose(found.uncertainty, u)


def test_information_of_the_model_is_that_of_least_squares():
    """(JᵀWJ)⁻¹ with J by differences of ε, a modulus among the parameters."""
    v = np.linspace(0.2 * CRITICAL, 30 * CRITICAL, 12)
    u = np.linspace(0.001, 0.004, 12)
    modulus = "contact.youngs_modulus"
    found = cal.fisher_information(LAW, v, u, parameters={modulus: cal.Parameter()})
    h, rows = 1e-6, []
    for name in ("chi", "sigma", "psi", modulus):
        values = [sj.restitution(moved(name, 1 + s), v).coefficient for s in (h, -h)]
        rows.append(np.asarray(values[0] - values[1]) / (2 * h) / u)
    assert found.names == ("chi", "sigma", "psi", modulus)
    np.testing.assert_allclose(found.matrix, np.array(rows) @ np.transpose(rows), rtol=1e-5)
    expected = np.sqrt(np.diag(np.linalg.inv(found.matrix)))
    np.testing.assert_allclose(list(found.relative_errors.values()), expected, rtol=1e-5)


def moved(name: str, factor: float) -> sj.Zhou:
    stem, _, leaf = name.rpartition(".")
    if not stem:
        return replace(LAW, **{leaf: getattr(LAW, leaf) * factor})
    contact = replace(LAW.contact, **{leaf: getattr(LAW.contact, leaf) * factor})
    return replace(LAW, contact=contact)


def test_above_yield_the_model_knows_the_losses_only_as_one_number():
    found = cal.fisher_information(LAW, above(LAW, 80.0, 10), 0.003)
    assert found.names == ("chi", "eps_up")
    assert found.symbols == ("χ̃", "ε_up")


def test_an_error_is_the_same_however_the_losses_are_written():
    """Above yield χ̃ is as well known beside σ and ψ, which are not, as beside ε_up."""
    v = above(LAW, 80.0, 20)
    by_eps_up = cal.fisher_information(LAW, v, 0.003).relative_errors
    by_both = cal.fisher_information(LAW, v, 0.003, parameters={"sigma": cal.Parameter()})
    assert by_both.relative_errors["sigma"] is by_both.relative_errors["psi"] is None
    assert by_both.relative_errors["chi"] == pytest.approx(by_eps_up["chi"], rel=1e-6)


def test_directions_are_told_in_words():
    """With ten points below yield at noise 0.01, σ and ψ are still not separate."""
    v = np.concatenate([np.linspace(0.1, 0.9, 10), np.linspace(2, 80, 20)]) * CRITICAL
    words = cal.fisher_information(LAW, v, 0.01).words
    assert "σ and ψ only together" in words[-1]
    assert "will be known to" in words[0]
    better = cal.fisher_information(LAW, v, 0.0005).words
    assert all("will be known" in sentence for sentence in better)


def test_what_impacts_do_not_tell_has_no_error():
    """All at one velocity: a e^{-bv} is known there, a and b only together."""
    found = cal.fisher_information(DECAY, np.full(5, 20.0), 0.01)
    assert found.relative_errors == {"level": None, "rate": None}
    assert (
        found.words[-1]
        == "a and b only together: a^0.71 · b^0.71 is left open (these impacts do not tell it)"
    )
    assert found.to_dict()["standard_errors"] == {"level": None, "rate": None}


@pytest.fixture(scope="module")
def fits():
    """With stated errors and priors, two data sets together, and a law of one's own."""
    prior = {"chi": cal.Parameter(prior=(0.2, 0.01))}
    one = twin("nylon", noise=0.003, seed=1, uncertainty=0.003)
    two = twin("stainless steel", noise=0.003, seed=2, uncertainty=0.004)
    options = {"route": BALANCE, "profiles": False}
    shared = {"psi": cal.Parameter(0.54, shared=True)}
    return {
        "model": cal.fit(one, parameters=prior, **options),
        "together": cal.fit([one, two], parameters=shared, **options),
        "own": cal.fit(
            cal.RestitutionData(np.linspace(1, 9, 9), 0.9 - 0.03 * np.linspace(1, 9, 9)), Decay
        ),
    }


@pytest.mark.parametrize(
    ("name", "material"),
    [("model", None), ("together", "nylon"), ("own", None)],
)
def test_of_a_fit_without_further_shots_it_is_the_fits_own_covariance(name, material, fits):
    """Priors, shared parameters and uncertainties are the fit's own."""
    result = fits[name]
    found = cal.fisher_information(result, material=material)
    assert set(found.names) <= set(result.values)
    for label, error in found.standard_errors.items():
        assert error == pytest.approx(result.standard_errors[label], rel=1e-4)


def test_further_shots_add_to_what_a_fit_knows(fits):
    """Of least squares: the inverse covariances of old and new impacts add up."""
    result = fits["own"]
    law, noise = result.law, result.materials[0].noise
    new = np.array([20.0, 25.0, 30.0])
    together = cal.fisher_information(result, new)
    alone = cal.fisher_information(law, new, noise)
    before = cal.fisher_information(result)
    np.testing.assert_allclose(together.matrix, before.matrix + alone.matrix, rtol=1e-6)
    assert together.uncertainty[-1] == pytest.approx(noise)
    finer = cal.fisher_information(result, new, 0.1 * noise)
    np.testing.assert_allclose(finer.matrix, before.matrix + 100 * alone.matrix, rtol=1e-6)


class Idle(Decay):
    """A field that acts on nothing."""

    idle: float = sj.number_field("i", within="(0, inf)", default=1.0)


def test_what_a_fit_did_not_determine_is_no_parameter_of_its_plan():
    v = np.linspace(1.0, 9.0, 9)
    data = cal.RestitutionData(v, 0.9 * np.exp(-0.05 * v), uncertainty=0.01)
    result = cal.fit(data, Idle, profiles=False)
    assert result.standard_errors["idle"] is None
    assert cal.fisher_information(result).names == ("level", "rate")
    told = cal.fisher_information(Idle(0.9, 0.05), v)  # of a law it is, and left open
    assert told.relative_errors["idle"] is None
    assert told.relative_errors["rate"] is not None


def test_where_a_fit_knows_nothing_nothing_is_planned():
    """Without points below yield the law below is not known."""
    data = twin("nylon", y=np.geomspace(1.3, 80, 20), noise=0.003, seed=1)
    result = cal.fit(data, route=BALANCE, profiles=False)
    assert cal.fisher_information(result, [2.0]).names == ("chi", "eps_up")
    with pytest.raises(ValueError, match="where this fit knows the law"):
        cal.fisher_information(result, [0.5 * CRITICAL])


def test_an_impact_without_rebound_tells_nothing():
    """Far above what a soft, lossy contact gives back: ε = 0 whatever χ̃ is."""
    law = fitted("nylon", chi=3.0, sigma=3.0)
    v = np.linspace(1.0, 20.0, 12)
    coefficient = np.asarray(sj.restitution(law, np.append(v, 180.0)).coefficient)
    assert coefficient[-1] == 0
    assert np.all(coefficient[:-1] > 0)
    with_it = cal.fisher_information(law, np.append(v, 180.0), 0.01)
    np.testing.assert_allclose(with_it.matrix, cal.fisher_information(law, v, 0.01).matrix)


@pytest.mark.parametrize(
    ("changed", "named"),
    [
        ({"law": "steel"}, "law"),
        ({"law": fitted("nylon", chi=np.array([0.1, 0.2]))}, "chi"),
        ({"law": fitted("nylon", sigma=0.0)}, "sigma"),
        ({"velocity": []}, "velocity"),
        ({"velocity": [1.0, -1.0, 2.0, 3.0]}, "velocity"),
        ({"velocity": [1.0, 1e4, 2.0, 3.0]}, "velocity"),
        ({"uncertainty": 0.0}, "uncertainty"),
        ({"uncertainty": [0.1, 0.2]}, "velocity"),
        ({"objective": "both"}, "objective"),
        ({"objective": "two-step"}, "`objective` must be model: information and designs"),
        ({"material": "nylon"}, "material"),
        ({"parameters": {"colour": 1.0}}, "parameter"),
        ({"parameters": {"psi": 0.7}}, "the law's own, 0.5414"),
        ({"parameters": dict.fromkeys(("chi", "sigma", "psi"), cal.Parameter(free=False))}, "none"),
    ],
)
def test_what_makes_no_sense_is_named(changed, named):
    arguments = {"law": LAW, "velocity": [0.5, 1.0, 5.0, 20.0, 40.0]} | changed
    with pytest.raises(ValueError, match=named) as caught:
        cal.fisher_information(**arguments)
    assert "\n" not in str(caught.value)


def test_a_fit_has_parameters_of_its_own_and_has_to_be_one_by_the_likelihood(fits):
    with pytest.raises(ValueError, match="`parameters` must be left out"):
        cal.fisher_information(fits["own"], parameters={"level": 0.9})
    data = eq_17_data("nylon", noise=0.003, seed=1)
    by_two = cal.fit(data, objective="two-step", route=BALANCE, profiles=False)
    with pytest.raises(ValueError, match=r"`objective` must be model: .*but is two-step"):
        cal.optimal_velocities(by_two, 3, (5.0, 60.0))


@pytest.mark.parametrize("law", ["zhou", "viscoelastic"])
def test_a_plan_of_a_fit_needs_one_contact(law):
    contact = sj.Contact.with_wall(sj.NYLON, sj.STAINLESS_STEEL, np.linspace(0.005, 0.02, 8))
    data = cal.RestitutionData(np.linspace(1, 8, 8), np.linspace(0.95, 0.88, 8), contact, 0.01)
    fit = cal.fit(data, law, profiles=False)
    for plan in (cal.fisher_information, lambda one: cal.optimal_velocities(one, 3, (1.0, 8.0))):
        with pytest.raises(ValueError, match="`contact` must be one for all impacts"):
            plan(fit)


def decays(count: int, noise: float, **options) -> list[cal.RestitutionData]:
    """Data sets of laws of one kind, some more alike than their noise."""
    random, v = np.random.default_rng(3), np.linspace(1.0, 12.0, 12)
    rates = 0.04 * (1 + 0.05 * random.standard_normal(count))
    curves = [0.85 * np.exp(-rate * v) + noise * random.standard_normal(12) for rate in rates]
    pairs = zip("abcdefgh", curves, strict=False)
    return [cal.RestitutionData(v, e, None, noise, name, **options) for name, e in pairs]


def agrees_with_its_fit(result: cal.FitResult, material: str | None = None, rel: float = 1e-4):
    found = cal.fisher_information(result, material=material)
    own = {name: result.standard_errors[name] for name in found.names}
    assert found.standard_errors == pytest.approx(own, rel=rel)
    return found


def test_what_a_fit_pooled_holds_its_plan_together():
    result = cal.fit(decays(6, 0.03), Decay, {"rate": cal.Parameter(shared="pooled")})
    found = agrees_with_its_fit(result, "b")
    alone = cal.fisher_information(cal.fit(decays(6, 0.03), Decay), material="b")
    assert found.standard_errors["rate[b]"] < 0.9 * alone.standard_errors["rate[b]"]


def test_errors_of_velocities_count_in_a_plan_as_in_its_fit():
    (data,) = decays(1, 0.01, velocity_uncertainty=0.5)
    agrees_with_its_fit(cal.fit(data, Decay, profiles=False))


def test_a_shared_parameter_that_is_not_determined_joins_no_plans():
    shared = {"idle": cal.Parameter(1.0, shared=True)}
    result = cal.fit(decays(2, 0.01), Idle, shared, profiles=False)
    for name in ("a", "b"):
        found = cal.fisher_information(result, material=name)
        own = [result.standard_errors[f"{one}[{name}]"] for one in ("level", "rate")]
        assert list(found.standard_errors.values()) == pytest.approx(own, rel=1e-4)
        assert found.taken_as_known[0].startswith("idle is not determined")


@pytest.mark.long
def test_a_parameter_at_the_open_end_of_its_range_leaves_the_others_known():
    """ψ at 0, where Eq. (17) has no value."""
    random, v = np.random.default_rng(5), np.geomspace(0.3, 40.0, 24)
    curve = np.asarray(sj.restitution(sj.Zhou(LAW.contact, 0.22, 0.44, 0.54), v).coefficient)
    curve = np.clip(curve + 0.004 * random.standard_normal(24), 0, 1)
    data = cal.RestitutionData(v, curve, LAW.contact, 0.004)
    told = {"contact.youngs_modulus": cal.Parameter(prior=(1.37e9, 1e8))}
    result = cal.fit(data, parameters=told, profiles=False)
    assert result.values["psi"] == 0
    agrees_with_its_fit(result)
