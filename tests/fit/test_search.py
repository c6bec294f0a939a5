"""Known parameters come back from curves that SciPy made, from starts far off; or the fit says that it did not."""

import jax
import numpy as np
import pytest

import calibration as cal
import softjax as sj
from tests.fit_data import TRUTH, pair, twin

NAMES = ("chi", "sigma", "psi")
FAR = (10.0, 0.1, 2.0)
BALANCE = sj.EnergyBalance()
STEPS = sj.ODE(steps=16, solver="dopri5")


def far_off(name, factors):
    """Starts that are not the answer in any parameter."""
    truth = dict(zip(NAMES, TRUTH[name][1:4], strict=True))
    return truth, {
        n: cal.Parameter(value * factor)
        for (n, value), factor in zip(truth.items(), factors, strict=True)
    }


@pytest.mark.parametrize(
    ("route", "name"),
    [*((BALANCE, name) for name in TRUTH), (STEPS, "nylon")],
    ids=lambda x: x if isinstance(x, str) else x.name,
)
def test_all_three_parameters_are_recovered(route, name):
    truth, starts = far_off(name, FAR)
    result = cal.fit(twin(name), None, starts, route=route, profiles=False, seed=1)
    assert result.converged
    for parameter, value in truth.items():
        assert result.values[parameter] == pytest.approx(value, rel=1e-6)
    assert result.rms < 1e-8


@pytest.mark.parametrize("optimiser", ["l-bfgs", "adam", "levenberg-marquardt"])
def test_ten_times_off_in_all_three_gets_there_or_says_so(optimiser):
    arrived = 0
    for name in ("chrome steel", "nylon"):
        truth, starts = far_off(name, (10.0, 10.0, 10.0))
        options = {"route": BALANCE, "optimiser": optimiser, "profiles": False}
        result = cal.fit(twin(name), None, starts, **options)
        there = all(result.values[k] == pytest.approx(v, rel=1e-6) for k, v in truth.items())
        assert there or not result.converged
        arrived += there
    assert arrived  # saying so each time would be no fit


def test_a_search_cut_short_says_so():
    result = cal.fit(twin("nylon"), max_steps=2, starts=1, route=BALANCE)
    assert not result.converged
    assert "not-converged" in {doubt.code for doubt in result.warnings}
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
    for bounds in (None, (0.0, np.inf)):
        said = {"scale": cal.Parameter(1.0, bounds=bounds)}
        result = cal.fit(data, Scaled, said, profiles=False, starts=4)
        assert result.converged
        assert result.standard_errors["scale"] is None
        assert 1e-4 < abs(result.values["scale"]) < 1e4
        assert "rank-deficient" in {one.code for one in result.warnings}
        noise = result.materials[0].noise
        assert noise == pytest.approx(np.std(restitution, ddof=1), rel=1e-6)  # it costs no point
        # ε² = 1/(1 + steeper)
        error = np.std(restitution, ddof=1) / 12**0.5
        slope = 2 / np.mean(restitution) ** 3
        expected = np.mean(restitution) ** -2 - 1
        assert result.values["steeper"] == pytest.approx(expected, rel=1e-6)
        assert result.standard_errors["steeper"] == pytest.approx(slope * error, rel=0.05)
