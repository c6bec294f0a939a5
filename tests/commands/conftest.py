"""Pictures are named and not drawn: what they show is tested elsewhere; and a fit that several tests use."""

import numpy as np
import pytest

import calibration as cal
import softjax as sj
from tests.cases import fitted
from tests.shown.capture import drawn


@pytest.fixture(scope="module", autouse=True)
def without_drawing():
    with drawn():
        yield


@pytest.fixture(scope="session")
def above_yield(tmp_path_factory):
    """A fit that determines nothing below first yield, and its file."""
    law, velocity = fitted("nylon"), np.geomspace(1.5, 60.0, 24)
    noise = 0.003 * np.random.default_rng(4).normal(size=24)
    measured = np.asarray(sj.restitution(law, velocity).coefficient) + noise
    data = cal.RestitutionData(velocity, measured, law.contact, 0.003, name="my\nnylon")
    result = cal.fit(data, profiles=False, starts=4)
    path = tmp_path_factory.mktemp("fit") / "fit.json"
    result.save(path)
    return result, str(path)
