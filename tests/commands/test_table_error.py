"""What the header of a look-up table says of linear interpolation holds between all rows."""

import re

import numpy as np
import pytest

import softjax as sj
from tests.cases import fitted, pair
from tests.command import run

ALLOY = pair("nylon")
# options, the law, and velocities [m/s]: the lowest and the highest, or each
TABLES = {
    "a step at yield": ("", fitted("nylon"), [0.1, 60]),
    "an end of ε": ("--sigma 3 --chi 0.22 --psi 0.54", sj.Zhou(ALLOY, 0.22, 3.0, 0.54), [0.1, 300]),
    "a larger χ̃": ("--chi 6 --sigma 0.4 --psi 0.54", sj.Zhou(ALLOY, 6.0, 0.4, 0.54), [0.5, 300]),
    "from rest to the limit velocity": (
        "--law eq-17 --sigma 0.4 --psi 0.54",
        sj.EmpiricalRestitution(ALLOY.limit_velocity, 0.4, 0.54),
        [0, 400],
    ),
    "a kink": ("--law thornton", sj.Thornton(ALLOY), [0.1, 60]),
}
for seed in (4, 6):  # a step, or the end of ε, lies anywhere between two of the user's own
    random = np.random.default_rng(seed)
    velocity = np.unique([0.1, 300.0, *random.uniform(0.1, 300, 10)])
    chi, sigma = random.uniform(0.1, 3), random.uniform(0.3, 3)
    words = f"--chi {chi} --sigma {sigma} --psi 0.54"
    TABLES[f"own {seed}"] = (words, sj.Zhou(ALLOY, chi, sigma, 0.54), velocity)


def largest_error(law, velocity, coefficient):
    """Over 8192 random velocities, by the program of the table; those within a step's two rows are in both."""
    random = np.random.default_rng(3)
    some = random.uniform(velocity[0], velocity[-1], (64, 128))
    gap = random.integers(len(velocity) - 1, size=(32, 128))
    some[32:] = velocity[gap] + random.uniform(0, 1, gap.shape) * np.diff(velocity)[gap]
    law_says = [sj.restitution(law, each).coefficient for each in some]
    return np.max(np.abs(np.interp(some, velocity, coefficient) - law_says))


@pytest.mark.parametrize("name", TABLES)
def test_no_velocity_errs_by_more(name, at):
    """Fails where the law is compared at three places between two rows: by up to a third, of two digits."""
    options, law, given = TABLES[name]
    words = ["--from", given[0], "--to", given[-1], "--points", 11, "--spacing", "lin"]
    if len(given) > 2:
        np.savetxt(at / "v.csv", given)
        words = ["--velocities", "v.csv"]
    code, _, error = run("curve", "nylon", *options.split(), *words, "--table")
    assert code == 0, error
    path = at / "results" / "curve.txt"
    promised = re.search(r"errs by about (\S+) at most", path.read_text(encoding="utf-8"))[1]
    velocity, coefficient = np.loadtxt(path)[:, :2].T
    assert np.all(np.diff(velocity) > 0)
    assert len(given) == 2 or np.array_equal(velocity, given)
    found = largest_error(law, velocity, coefficient)
    assert found / 1.1 <= float(promised) <= 1.06 * found + 1e-12
