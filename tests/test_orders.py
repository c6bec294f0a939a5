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
QUICK = ("thornton", "viscoelastic")
VELOCITY = float(PAIR.critical_velocity) * np.geomspace(2.0, 20.0, 12)
STEPS = {"bosh3": (8, 16, 32), "dopri5": (6, 12, 24)}
ORDER = {"bosh3": 3, "dopri5": 5}


@pytest.mark.parametrize("solver", ORDER)
@pytest.mark.parametrize(
    "name", [n if n in QUICK else pytest.param(n, marks=pytest.mark.long) for n in LAWS]
)
def test_each_doubling_of_the_steps_gains_the_order(name, solver):
    """Of ε, the overlaps and the duration; until rounding is near."""
    exact = _told(LAWS[name], sj.ODE(rtol=1e-13))
    errors = [
        np.max(np.abs(_told(LAWS[name], sj.ODE(steps=n, solver=solver)) - exact), axis=1)
        for n in STEPS[solver]
    ]
    gained = -np.diff(np.log2(np.maximum(errors, 1e-13)), axis=0)
    settled = np.array(errors[1:]) < 1e-11
    assert np.all((gained > ORDER[solver] - 0.7) | settled), (gained, errors)


def _told(law, route):
    hit = sj.restitution(law, VELOCITY, route)
    exact = [hit.plastic_coefficient, hit.peak_overlap, hit.duration]
    return np.array([np.asarray(x) / np.max(np.asarray(x)) for x in exact])
