"""The oracle against digits of other code, and what the stored answers are.

Its forces, works and durations are held to SciPy's through the library in `physics`.
"""

import pytest
from mpmath import mp, mpf

from tests.oracles import write
from tests.oracles import zhou_mp as zhou

# form, d, X, y, then peak overlap, residual overlap, ε_p, from other code in 40-digit arithmetic
ORIENTATION = """
first-order 6.3e-5  640  1.5 1.38316264536192 0.104851623761796 0.98707820496367
first-order 6.3e-5  640  250 82.9694609992926 31.1455251233123 0.856206183529395
full        6.3e-5  640  250 82.9693766512144 31.1454180489435 0.856207589426904
first-order 2.7e-3  5.36 25  13.2236523303197 1.49310978562765 0.973077876160826
full        2.7e-3  5.36 25  13.2230226169831 1.49283613455876 0.9731302040906
first-order 6.73e-3 7.6  80  35.3103668464788 12.3395408865264 0.841650713075325
full        6.73e-3 7.6  80  35.2174790268749 12.2244525276861 0.84545462322109
first-order 6.73e-3 0.55 40  19.6850448643677 0.0 0.995388270881036
"""


@pytest.mark.parametrize("line", ORIENTATION.strip().splitlines())
def test_orientation_values(line):
    form, d, X, y, *expected = line.split()
    x_m = zhou.peak(form, d, y)
    found = (x_m, zhou.residual(form, d, X, x_m), mp.sqrt(zhou.plastic_squared(form, d, X, y)))
    for value, digits in zip(found, expected, strict=True):
        assert abs(value - mpf(digits)) <= mpf("0.6e-14") * abs(mpf(digits))


STEEL = {
    "E": "1.93e11", "nu": "0.35", "rho": "8030", "Y": "3.1e8", "R": "0.0127", "chi": "1.7944",
    "sigma": "3.0432", "psi": "0.54", "area": "zhou", "kappa": "consistent", "form": "first-order",
}  # fmt: skip
BEYOND = {"ABOVE_LIMIT_VELOCITY", "NO_TURNING_POINT", "BEYOND_EXPANSION"}
SPECIAL = [  # v, v_lim, flags, and ε where the conditions tell it
    ("0", None, {"ELASTIC", "ZERO_VELOCITY"}, 1),
    ("1000", None, BEYOND, 0),
    ("0.5", "0.5", {"ABOVE_LIMIT_VELOCITY"}, None),  # Eq. (16) goes on where Eq. (17) ends
    ("0.5", "0.001", {"ABOVE_LIMIT_VELOCITY", "NO_REBOUND"}, 0),  # below v_cr: all is lost
    ("0.002", "0.001", {"ELASTIC", "ABOVE_LIMIT_VELOCITY"}, 0),
]


@pytest.mark.parametrize(("v", "v_lim", "flags", "eps"), SPECIAL)
def test_conditions_coincide_and_keep_their_values(v, v_lim, flags, eps):
    inputs = zhou.equal_spheres(STEEL | {"v": v})
    found = zhou.coefficient(inputs | ({"v_lim": v_lim} if v_lim else {}), lasts=False)
    assert found["flags"] == flags
    assert found["eps"] == eps if eps is not None else found["eps"] > 0
    assert (found["eps_squared"] < 0) == ("NO_REBOUND" in flags)


LONG = pytest.mark.long
SOLVED = [
    ("reference.json", "boxes", 160, write.box),
    ("reference.json", "curves", 20, write.of_contact),
    pytest.param("reference.json", "materials", 3, write.of_spheres, marks=LONG),
    ("hard_cases.json", None, 0, write.hard),
    pytest.param("hard_cases.json", None, 120, write.hard, marks=LONG),
    ("turning_point.json", "float64", 3, write.turning),
]


@pytest.mark.parametrize(("file", "section", "k", "solve"), SOLVED)
def test_stored_records_are_what_the_script_gives(file, section, k, solve):
    records = write.stored(write.HERE / file)
    record = (records[section] if section else records)[k]
    found = solve(record)
    assert (record | found if isinstance(found, dict) else found) == record
    if file == "hard_cases.json":
        assert all(row["reason"] for row in records)
