"""Each doubt is raised by one data set, and not by its neighbour."""

import re
from dataclasses import replace

import numpy as np
import pytest
from jaxtyping import Array

import calibration as cal
import softjax as sj
from calibration.data.paper import CURVES
from calibration.fitting import doubt
from calibration.fitting.assembly import assemble
from calibration.fitting.component_fit import fit_component
from calibration.fitting.intervals import estimates
from calibration.fitting.minima import MOVED
from calibration.fitting.specs import specs_of
from calibration.fitting.stages import Options
from calibration.fitting.suspicions import shared_doubts
from calibration.report import rows
from tests.fit_data import TRUTH, eq_17_data, twin

QUICK = {"route": sj.EnergyBalance(), "profiles": False, "starts": 8}
Free = cal.Parameter
TWO_STEP = QUICK | {"objective": "two-step"}


def codes(result):
    return {one.code for one in result.warnings}


def at_bound():
    data = twin("nylon", noise=0.002)
    raised = cal.fit(data, None, {"chi": Free(bounds=(0.3, 1.0))}, **QUICK)
    quiet = cal.fit(data, None, {"chi": Free(bounds=(0.1, 1.0))}, **QUICK)
    return raised, quiet


def told(result):
    """The table of parameters, with no number that nobody can read."""
    table = rows.parameter_table(result).rows
    assert not any(re.search(r"e[-+]?\d", cell) for row in table for cell in row)
    return table


def runs_to_zero():
    """With noise as large as this the losses below yield say nothing of ψ."""
    noisy, exact = (twin("nylon", noise=u, seed=2, uncertainty=u) for u in (0.03, 0.0005))
    raised, quiet = (cal.fit(d, **QUICK) for d in (noisy, exact))
    assert raised.values["psi"] == 0.0
    assert raised.materials[0].parameters["psi"].at_bound
    assert ["", "ψ", "0 (at its bound)"] in [row[:3] for row in told(raised)]
    return raised, quiet


def grows_without_bound():
    noisy, exact = (twin("stainless steel", noise=u, uncertainty=u) for u in (0.01, 0.0003))
    raised, quiet = (cal.fit(d, **QUICK) for d in (noisy, exact))
    assert raised.values["sigma"] is None
    assert "grows without bound" in str(raised)
    assert ["", "σ", "not determined"] in [row[:3] for row in told(raised)]
    assert np.all(np.isfinite(raised.band(noisy.velocity).high))
    return raised, quiet


def rank_deficient():
    """σ and ψ asked for from points above yield through Eq. (16) alone; and with points below."""
    asked = {"sigma": Free(), "psi": Free()}
    above = twin("nylon", np.geomspace(1.2, 80, 30), 0.002)
    raised = cal.fit(above, None, asked, **QUICK)
    quiet = cal.fit(twin("nylon", noise=0.002), None, asked, **QUICK)
    assert raised.standard_errors["sigma"] is None
    assert raised.standard_errors["eps_up"] is None or raised.rank == 2
    return raised, quiet


def eps_up_only():
    raised = cal.fit(twin("nylon", np.geomspace(1.2, 80, 30), 0.002), **QUICK)
    quiet = cal.fit(twin("nylon", noise=0.002), **QUICK)
    return raised, quiet


def sigma_psi_not_separate():
    noisy, exact = (twin("chrome steel", noise=noise, seed=1) for noise in (0.02, 0.0005))
    return cal.fit(noisy, **QUICK), cal.fit(exact, **QUICK)


class Falling(sj.HardSphereLaw):
    """ε falls linearly, by two parameters that act almost alike."""

    one: Array = sj.number_field("a", "s/m", "one slope")
    other: Array = sj.number_field("b", "s/m", "other slope")
    curve: float = 1e-3

    def restitution_squared(self, velocity):
        bent = 1 + self.curve * (velocity - 1)
        return (1 - (self.one + self.other * bent) * velocity) ** 2


def ill_conditioned():
    """Two slopes that differ by a millionth of a bend; and by one that shows."""
    velocity = np.linspace(0.1, 1.9, 30)
    noise = 1e-9 * np.random.default_rng(3).standard_normal(30)
    data = cal.RestitutionData(velocity, 1 - 0.1 * velocity + noise)
    start = {"one": Free(0.03), "other": Free(0.03)}
    build = lambda curve: lambda contact, one, other: Falling(one, other, curve)  # noqa: E731
    return (cal.fit(data, build(curve), start, **QUICK) for curve in (1e-6, 1e-1))


def not_converged():
    data = twin("nylon", noise=0.002)
    short = QUICK | {"starts": 1}
    return cal.fit(data, max_steps=1, **short), cal.fit(data, **QUICK)


def model_misfit():
    told = {"noise": 0.004, "uncertainty": 0.004}
    raised = cal.fit(eq_17_data("stainless steel", 40, **told), **TWO_STEP)
    quiet = cal.fit(eq_17_data("chrome steel", 40, **told), **TWO_STEP)
    return raised, quiet


def model_misfit_without_uncertainty():
    raised = cal.fit(eq_17_data("stainless steel", 40, noise=0.003), **TWO_STEP)
    quiet = cal.fit(eq_17_data("chrome steel", 40, noise=0.003), **TWO_STEP)
    return raised, quiet


def residual_runs():
    return model_misfit()


def no_velocity_dependence():
    velocity = np.linspace(1.0, 4.0, 40)
    noise = 0.01 * np.random.default_rng(1).standard_normal(40)
    flat, falling = (0.9 - slope * velocity + noise for slope in (0.0, 0.02))
    return cal.fit(cal.RestitutionData(velocity, flat)), cal.fit(
        cal.RestitutionData(velocity, falling)
    )


def status():
    """Just above yield the law gains energy; farther up it does not."""
    near, far = (twin("chrome steel", np.linspace(low, 25, 30)) for low in (1.005, 1.3))
    return cal.fit(near, **QUICK), cal.fit(far, **QUICK)


def all_below_yield():
    low, high = np.linspace(0.1, 0.9, 20), np.linspace(0.1, 5.0, 20)
    return (cal.fit(eq_17_data("nylon", y=y, noise=0.001), **QUICK) for y in (low, high))


def branch_change():
    name = "nylon"
    right = twin(name, y=np.linspace(0.2, 30, 40))
    strength = 1.25 * float(right.contact.yield_strength)
    wrong = sj.Contact(**{**right.contact.leaves(), "yield_strength": strength})
    specs = {
        "yield_strength": Free(),
        "sigma": TRUTH[name][2],
        "psi": TRUTH[name][3],
    }
    misled = cal.RestitutionData(right.velocity, right.restitution, wrong)
    return (cal.fit(d, None, specs, **QUICK) for d in (misled, right))


def data():
    high, low = np.full(12, 0.95), np.full(12, 0.95)
    high[3] = 1.05
    velocity = np.linspace(1, 2, 12)
    low = low + 0.03 * (-1.0) ** np.arange(12)
    high = high + 0.03 * (-1.0) ** np.arange(12)
    return (cal.fit(cal.RestitutionData(velocity, e)) for e in (high, low))


def two_minima():
    """Imprecise data for a small χ̃ and a prior for a large one, of equal weight; and of unequal."""
    return torn(1.04), torn(2.08)


def torn(*shares):
    """Data sets that each are torn between their points and a prior, with `balanced_spread`'s share.

    Far above, ε no longer falls with χ̃, so that the data's cost levels off and the prior's wins;
    the data draw the far minimum nearer.
    """
    data = twin("nylon", np.linspace(5, 60, 12), uncertainty=0.25)
    losses = {"sigma": TRUTH["nylon"][2], "psi": TRUTH["nylon"][3]}
    spreads = [share * balanced_spread(data, losses) for share in shares]
    chis = [Free(value=2.0, prior=(PRIOR, spread)) for spread in spreads]
    sets = [replace(data, name=f"set {i}") for i in range(len(shares))]
    own = [losses | {"chi": chi} for chi in chis]
    return cal.fit(sets, None, own, **QUICK | {"starts": 32})


PRIOR = 20.0


def balanced_spread(data, losses):
    """The prior's standard deviation at which both minima cost the same."""
    law = lambda chi: sj.Zhou(data.contact, chi, **losses)  # noqa: E731
    far = np.asarray(sj.restitution(law(PRIOR), data.velocity).coefficient)
    misfit = np.sum(((far - data.restitution) / data.uncertainty) ** 2)
    return (PRIOR - TRUTH["nylon"][1]) / np.sqrt(misfit)


def objectives_disagree():
    """Eq. (17) is no law of all of stainless steel's curve, and as good as one of chrome steel's."""
    told = {"noise": 0.003, "uncertainty": 0.003}
    return (cal.fit(twin(name, **told), **QUICK) for name in ("stainless steel", "chrome steel"))


def groups():
    """Three specimens of ten impacts each, one after the other in the file; and shuffled."""
    random = np.random.default_rng(4)
    velocity = np.tile(np.linspace(1, 4, 10), 3)
    offset = np.repeat([0.01, -0.01, 0.004], 10) + 0.001 * random.standard_normal(30)
    mixed = random.permutation(30)
    build = lambda order: cal.RestitutionData(  # noqa: E731
        velocity[order], (1 - 0.05 * velocity + offset)[order]
    )
    return (_falling(build(order)) for order in (np.arange(30), mixed))


def unequal_scatter():
    """The errors grow with the velocity; and are equal."""
    random = np.random.default_rng(4)
    velocity = np.linspace(0.5, 4, 60)
    noise = 0.003 * random.standard_normal(60)
    sizes = velocity**1.5, np.full(60, 2.0)
    build = lambda size: cal.RestitutionData(velocity, 1 - 0.05 * velocity + size * noise)  # noqa: E731
    return (_falling(build(size)) for size in sizes)


def _falling(data):
    line = lambda contact, one, other: Falling(one, other, -1.0)  # noqa: E731
    return cal.fit(data, line, {"one": Free(0.03), "other": Free(0.03)}, **QUICK)


def plausibility():
    """A radius of 12.7 told in metres; and in millimetres."""
    steel = CURVES[0].material
    pairs = (sj.Contact.between_spheres(steel, steel, r, r) for r in (12.7, 0.0127))
    velocity = np.linspace(1, 4, 20)
    noise = 0.003 * np.random.default_rng(4).standard_normal(20)
    build = lambda pair: cal.RestitutionData(velocity, 1 - 0.05 * velocity + noise, pair)  # noqa: E731
    return (_falling(build(pair)) for pair in pairs)


CASES = {
    "groups": groups,
    "unequal-scatter": unequal_scatter,
    "plausibility": plausibility,
    "at-bound": at_bound,
    "at-bound, at zero": runs_to_zero,
    "at-bound, at infinity": grows_without_bound,
    "rank-deficient": rank_deficient,
    "eps-up-only": eps_up_only,
    "sigma-psi-not-separate": sigma_psi_not_separate,
    "ill-conditioned": ill_conditioned,
    "not-converged": not_converged,
    "model-misfit": model_misfit,
    "model-misfit, no u": model_misfit_without_uncertainty,
    "residual-runs": residual_runs,
    "no-velocity-dependence": no_velocity_dependence,
    "status": status,
    "all-below-yield": all_below_yield,
    "branch-change": branch_change,
    "data": data,
    "several-minima": two_minima,
    "objectives-disagree": objectives_disagree,
}


@pytest.mark.parametrize("case", CASES)
def test_raised_by_one_and_not_by_its_neighbour(case):
    code = case.split(",")[0]
    raised, quiet = CASES[case]()
    assert code in codes(raised)
    assert code not in codes(quiet)
    (one, *_) = (doubt for doubt in raised.warnings if doubt.code == code)
    assert one.cause
    assert one.remedy.endswith((".", "?"))
    assert str(one) in str(raised)
    assert code in raised.to_json()


@pytest.mark.long
def test_each_data_set_has_minima_of_its_own():
    """What another set's minima cost does not enter, and each is told once."""
    alone, both, one = torn(1.04), torn(1.04, 1.04), torn(2.08, 1.04)
    (cause,) = (w.cause for w in alone.warnings if w.code == "several-minima")
    for result, names in ((both, ["set 0", "set 1"]), (one, ["set 1"])):
        told = [w for w in result.warnings if w.code == "several-minima"]
        assert sorted(w.material for w in told) == names
        assert {w.cause for w in told} == {cause}


@pytest.mark.parametrize("share", [0.2, 1.0])
def test_a_place_along_the_valley_is_no_other_minimum(share):
    """Where a search has said that it converged, as far off as a standard error allows."""
    data = eq_17_data("stainless steel", noise=0.004)
    (component,) = assemble(specs_of([data], "eq-17", None, None), None)
    fitted = fit_component(component, Options(starts=1))
    (stage,) = fitted.stages
    step = np.linalg.cholesky(fitted.uncertainty.covariance[0])[:, 0]
    assert np.max(np.abs(share * step)) > MOVED
    place = stage.found._replace(z=stage.found.z + share * step)
    others = replace(fitted, stages=(replace(stage, others=(place,)),))
    found = shared_doubts(others, estimates(fitted, {}, 0.95), {})
    assert not [one for one in found if one.code == "several-minima"]


def test_what_to_do_about_a_law_that_misses_is_told():
    for code in ("residual-runs", "model-misfit"):
        assert "`softjax compare` tries other laws" in doubt.REMEDIES[code]


def test_every_doubt_has_a_case_here():
    tested = {case.split(",")[0] for case in CASES} | {"extrapolation"}
    assert tested == set(doubt.REMEDIES)


def test_extrapolation_is_told_outside_the_data_only():
    result = cal.fit(eq_17_data("nylon", noise=0.002), **QUICK)
    velocity = result.data.velocity
    assert result.extrapolation(velocity) is None
    told = result.extrapolation([velocity[0], 2 * velocity[-1]])
    assert told.code == "extrapolation"
    assert "1 velocities" in told.cause


def test_bounces_of_a_ball_without_dependence_say_so():
    """Bounces as a golf ball's: ε near 0.896, scattered, over 1 to 4 m/s."""
    random = np.random.default_rng(11)
    velocity = random.uniform(1.2, 4.2, 150)
    restitution = 0.896 + 0.012 * random.standard_normal(150)
    result = cal.fit(cal.RestitutionData(velocity, restitution, name="ball"))
    assert result.values["restitution"] == pytest.approx(0.896, abs=0.003)
    assert "no-velocity-dependence" in codes(result)
