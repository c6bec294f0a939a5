"""Known parameters come back from curves that SciPy made, from starts far off; or the fit says that it did not."""

import jax
import numpy as np
import pytest
from scipy import optimize

import calibration as cal
import softjax as sj
from tests.decay import Decay
from tests.fit_data import TRUTH, pair, twin

NAMES = ("chi", "sigma", "psi")
FAR = (10.0, 0.1, 2.0)
BALANCE = sj.EnergyBalance()


@pytest.mark.parametrize("optimiser", ["l-bfgs", "adam", "levenberg-marquardt"])
def test_ten_times_off_in_all_three_gets_there_or_says_so(optimiser):
    arrived = {}
    cases = [(name, (10.0, 10.0, 10.0)) for name in ("chrome steel", "nylon")]
    for name, factors in [*cases, *((name, FAR) for name in TRUTH if optimiser == "l-bfgs")]:
        truth = dict(zip(NAMES, TRUTH[name][1:4], strict=True))
        starts = zip(truth.items(), factors, strict=True)
        parameters = {n: cal.Parameter(value * factor) for (n, value), factor in starts}
        options = {"route": BALANCE, "optimiser": optimiser, "profiles": False}
        result = cal.fit(twin(name), None, parameters, **options)
        there = all(result.values[k] == pytest.approx(v, rel=1e-6) for k, v in truth.items())
        assert there or not result.converged
        arrived[name, factors] = there
    assert any(arrived[case] for case in cases)  # saying so each time would be no fit
    assert all(there for case, there in arrived.items() if case not in cases)


def test_a_search_cut_short_says_so():
    result = cal.fit(twin("nylon"), max_steps=2, starts=1, route=BALANCE)
    assert not result.converged
    assert "not-converged" in {warning.code for warning in result.warnings}
    assert "NOT CONVERGED" in str(result)
    assert np.isfinite(result.values["chi"])
    assert result.optimiser_report[0].iterations <= 2


def test_a_narrow_valley_is_walked_down():
    """Data that hardly tell σ from ψ: refits arrive, as many as were begun."""
    data = twin("stainless steel", y=np.geomspace(0.02, 200.0, 30), noise=0.005, seed=1)
    result = cal.fit(data, starts=1, profiles=False)
    assert abs(result.correlations[1, 2]) > 0.99
    refits = result.bootstrap(100, seed=0)
    assert refits.values.shape == (100, 3)
    assert np.all(refits.converged)


def test_a_second_fit_of_the_same_shapes_compiles_nothing():
    data = cal.paper_materials(points=39)  # another number of points, padded to the same shape
    cal.fit(data[0], starts=2)
    compiled = []
    jax.monitoring.register_event_duration_secs_listener(
        lambda name, *_, **__: compiled.append(name) if "backend_compile" in name else None
    )
    try:
        cal.fit(data[1], starts=2)
    finally:
        jax.monitoring.clear_event_listeners()
    assert compiled == []


def test_a_parameter_that_moves_nothing_but_rounding_stays_where_it_is():
    """A scale of both forces leaves ε as it is to 1e-13: the others are found, and it has no error."""

    class Scaled(sj.RateIndependentLaw):
        contact: sj.Contact
        scale: float
        steeper: float

        def loading_force(self, overlap):
            return 1e6 * self.scale * overlap

        def unloading_force(self, overlap, peak_overlap):
            back = (1 + self.steeper) * (peak_overlap - overlap)
            return 1e6 * self.scale * (peak_overlap - back)

    random = np.random.default_rng(0)
    restitution = 0.6 + 0.01 * random.standard_normal(12)
    data = cal.RestitutionData(np.geomspace(0.5, 5, 12), restitution, pair("stainless steel"))
    result = cal.fit(data, Scaled, {"scale": cal.Parameter(1.0)}, profiles=False, starts=4)
    assert result.converged
    assert result.standard_errors["scale"] is None
    assert 1e-4 < abs(result.values["scale"]) < 1e4
    assert "rank-deficient" in {warning.code for warning in result.warnings}
    scatter, mean = np.std(restitution, ddof=1), np.mean(restitution)
    assert result.materials[0].noise == pytest.approx(scatter, rel=1e-6)  # it costs no point
    # ε² = 1/(1 + steeper)
    assert result.values["steeper"] == pytest.approx(mean**-2 - 1, rel=1e-6)
    error = 2 / mean**3 * scatter / 12**0.5
    assert result.standard_errors["steeper"] == pytest.approx(error, rel=0.05)


class Cubic(sj.HardSphereLaw):
    """ε = 1/2 + a + b x/5 + c x²/10 + d x³/20, x = v - 2.5."""

    a: float
    b: float
    c: float
    d: float

    def restitution_squared(self, velocity):
        x = velocity - 2.5
        return (0.5 + self.a + self.b * x / 5 + self.c * x**2 / 10 + self.d * x**3 / 20) ** 2


@pytest.mark.parametrize("seed", [13, 42])
def test_a_bound_is_left_where_the_cost_falls_inwards(seed):
    """Linear in all, so that SciPy has the one minimum; the first steps lead to other bounds."""
    v, random = np.linspace(0.5, 5, 24), np.random.default_rng(seed)
    powers = np.stack([np.ones(24), (v - 2.5) / 5, (v - 2.5) ** 2 / 10, (v - 2.5) ** 3 / 20], 1)
    e = 0.5 + powers @ random.uniform(-0.1, 0.35, 4) + 0.01 * random.standard_normal(24)
    data = cal.RestitutionData(v, np.maximum(e, 0.0), uncertainty=0.02)
    starts = zip("abcd", random.uniform(0.01, 0.29, 4), strict=True)
    parameters = {n: cal.Parameter(x, bounds=(0.0, 0.3), transform="none") for n, x in starts}
    result = cal.fit(data, Cubic, parameters, profiles=False, starts=1)
    expected = optimize.lsq_linear(powers, data.restitution - 0.5, (0, 0.3), tol=1e-14).x
    assert result.converged
    np.testing.assert_allclose([result.values[n] for n in "abcd"], expected, atol=1e-6)


class Losses(sj.HardSphereLaw):
    """ε = 0.95 - a x/10 - b (1 - x)²/10 - 0.3 c/(1 + c) x^1.5, x = v/5."""

    a: float = sj.number_field("a", "-", "one loss", within="(0, inf)")
    b: float = sj.number_field("b", "-", "another", within="(0, inf)")
    c: float = sj.number_field("c", "-", "a third", within="(0, inf)")

    def restitution_squared(self, velocity):
        return losses(velocity, self.a, self.b, self.c) ** 2


def losses(v, a, b, c):
    return 0.95 - 0.02 * a * v - 0.1 * b * (1 - v / 5) ** 2 - 0.3 * c / (1 + c) * (v / 5) ** 1.5


def test_of_two_losses_that_went_to_nothing_the_one_that_is_there_comes_back():
    """While c was too large neither was needed; b is not, and stays at its end."""
    v = np.linspace(0.25, 5, 20)
    e = losses(v, 1.0, -0.1, 1.0) + 0.001 * np.random.default_rng(0).standard_normal(20)
    parameters = {"a": cal.Parameter(0.1), "b": cal.Parameter(1.0), "c": cal.Parameter(np.exp(8))}
    data = cal.RestitutionData(v, e, uncertainty=0.002)
    result = cal.fit(data, Losses, parameters, profiles=False, starts=1)
    off = lambda x: losses(v, *x) - e  # noqa: E731
    best = optimize.least_squares(off, [1, 0.1, 1], bounds=(0, np.inf), xtol=1e-15, ftol=1e-15)
    assert result.converged
    assert result.rms == pytest.approx(np.sqrt(2 * best.cost / 20), rel=1e-6)
    assert result.values["a"] == pytest.approx(best.x[0], rel=1e-3)
    assert [w.cause[:2] for w in result.warnings if w.code == "at-bound"] == ["b "]


def test_each_data_set_s_steps_are_limited_by_themselves():
    """One that goes far shortens no step of another: the second is there before the first has arrived."""
    v, noise = np.linspace(0.5, 5, 24), 0.001 * np.random.default_rng(1).standard_normal((2, 24))
    curves = {"up": 0.6 + 0.02 * v, "down": 0.9 * np.exp(-0.1 * v)}
    sets = [
        cal.RestitutionData(v, curve + off, name=name, uncertainty=0.01)
        for (name, curve), off in zip(curves.items(), noise, strict=True)
    ]
    parameters = {"level": cal.Parameter(0.8, shared=True), "rate[down]": cal.Parameter(1.0)}
    parameters["rate[up]"] = cal.Parameter(0.01)
    few, result = (
        cal.fit(sets, Decay, parameters, profiles=False, starts=1, max_steps=n) for n in (8, 200)
    )
    assert result.converged
    assert not few.converged
    assert few.values["rate[down]"] == pytest.approx(result.values["rate[down]"], rel=0.05)
