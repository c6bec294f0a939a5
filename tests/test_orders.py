"""The error of every law's ODE falls as the order of the solver."""

import numpy as np
import pytest

import softjax as sj
from tests.cases import fitted, pair

PAIR = pair("nylon")
LAWS = {
    "zhou": fitted("nylon"),
    "zhou full": fitted("nylon", form="full"),
    "thornton": sj.Thornton(PAIR, 1.6),
    "walton-braun": sj.WaltonBraun(PAIR, 1e6, 2e6, growth=3e3),
    "linear-dashpot": sj.LinearSpringDashpot(PAIR, 1e6, 0.7),
    "linear-dashpot to zero force": sj.LinearSpringDashpot(PAIR, 1e6, 0.7, end="zero-force"),
    "hertz-dashpot": sj.HertzDashpot(PAIR, 0.7),
    "hertz-dashpot to zero force": sj.HertzDashpot(PAIR, 0.7, end="zero-force"),
    "viscoelastic": sj.ViscoelasticHertz(PAIR, 2e-5),
}
VELOCITY = float(PAIR.critical_velocity) * np.geomspace(8.0, 20.0, 12)
STEPS = {"bosh3": (12, 24, 48), "dopri5": (8, 16, 32)}
ORDER = {"bosh3": 3, "dopri5": 5}


@pytest.mark.long
@pytest.mark.parametrize("solver", ORDER)
@pytest.mark.parametrize("name", LAWS)
def test_the_error_falls_as_the_order(name, solver):
    """Of ε, the largest overlap and the duration, by regression or by the last doubling."""
    exact = _told(LAWS[name], sj.ODE(rtol=1e-13))
    routes = [sj.ODE(steps=n, solver=solver) for n in STEPS[solver]]
    errors = np.array([np.max(np.abs(_told(LAWS[name], r) - exact), axis=1) for r in routes])
    errors = np.maximum(errors, 1e-16)
    order = -np.polyfit(np.log(STEPS[solver]), np.log(errors), 1)[0]
    order = np.maximum(order, np.log2(errors[-2] / errors[-1]))  # few steps may not show it yet
    settled = errors[-1] < 1e-12  # rounding, where nothing falls any more
    assert np.all((order > ORDER[solver] - 0.6) | settled), (order, errors)


def _told(law, route):
    hit = sj.restitution(law, VELOCITY, route)
    exact = [hit.plastic_coefficient, hit.peak_overlap, hit.duration]
    return np.array([np.asarray(x) / np.max(np.asarray(x)) for x in exact])
