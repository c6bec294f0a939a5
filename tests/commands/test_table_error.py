"""What the header of a look-up table says of linear interpolation holds between all rows."""

import re

import numpy as np
import pytest

import softjax as sj
from tests.cases import fitted, pair
from tests.command import run

ALLOY = pair("nylon")
# options, the law, and lowest and highest velocity [m/s]
TABLES = {
    "a step at yield": ("", fitted("nylon"), 0.1, 60),
    "an end of ε": ("--sigma 3 --chi 0.22 --psi 0.54", sj.Zhou(ALLOY, 0.22, 3.0, 0.54), 0.1, 300),
    "a larger χ̃": ("--chi 6 --sigma 0.4 --psi 0.54", sj.Zhou(ALLOY, 6.0, 0.4, 0.54), 0.5, 300),
    "from rest to the limit velocity": (
        "--law eq-17 --sigma 0.4 --psi 0.54",
        sj.EmpiricalRestitution(ALLOY.limit_velocity, 0.4, 0.54),
        0,
        400,
    ),
    "a kink": ("--law thornton", sj.Thornton(ALLOY), 0.1, 60),
}


def table_of(at):
    """Velocity and restitution of the rows, and the promised error."""
    path = at / "results" / "curve.txt"
    promised = re.search(r"errs by about (\S+) at most", path.read_text(encoding="utf-8"))
    return *np.loadtxt(path)[:, :2].T, float(promised[1])


def largest_error(law, velocity, coefficient, low, high):
    """Over 8192 random velocities, by the program of the table; those within a step's two rows are in both."""
    random = np.random.default_rng(3)
    some = random.uniform(low, high, (64, 128))
    gap = random.integers(len(velocity) - 1, size=(32, 128))
    some[32:] = velocity[gap] + random.uniform(0, 1, gap.shape) * np.diff(velocity)[gap]
    law_says = [sj.restitution(law, each).coefficient for each in some]
    return np.max(np.abs(np.interp(some, velocity, coefficient) - law_says))


@pytest.mark.parametrize("name", TABLES)
def test_no_velocity_errs_by_more(name, at):
    """Fails where the law is compared at three places between two rows: by up to a third, of two digits."""
    options, law, low, high = TABLES[name]
    words = ("--from", low, "--to", high, "--points", 11, "--spacing", "lin", "--table")
    code, _, error = run("curve", "nylon", *options.split(), *words)
    assert code == 0, error
    velocity, coefficient, promised = table_of(at)
    assert np.all(np.diff(velocity) > 0)
    found = largest_error(law, velocity, coefficient, low, high)
    assert found / 1.1 <= promised <= 1.06 * found + 1e-12


@pytest.mark.parametrize("seed", [4, 6])
def test_velocities_of_the_users_own(seed, at):
    """Rows are theirs alone: a step, or the end of ε, lies anywhere between two of them."""
    random = np.random.default_rng(seed)
    velocity = np.unique(np.concatenate([[0.1, 300.0], random.uniform(0.1, 300, 10)]))
    np.savetxt(at / "v.csv", velocity)
    chi, sigma = random.uniform(0.1, 3), random.uniform(0.3, 3)
    law = sj.Zhou(ALLOY, chi, sigma, 0.54)
    words = ("--chi", chi, "--sigma", sigma, "--psi", 0.54, "--velocities", "v.csv", "--table")
    assert run("curve", "nylon", *words)[0] == 0
    rows, coefficient, promised = table_of(at)
    assert np.array_equal(rows, velocity)
    found = largest_error(law, rows, coefficient, 0.1, 300)
    assert found / 1.1 <= promised <= 1.06 * found + 1e-12
