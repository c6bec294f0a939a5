"""The oracle against what is not its own: known digits, limits, quadrature, an ODE solver."""

import pytest
from mpmath import mp, mpf
from scipy.integrate import solve_ivp

from tests.oracles import write
from tests.oracles import zhou_mp as zhou

FORMS = ("first-order", "full")
STEEL = {
    "E": "1.93e11", "nu": "0.35", "rho": "8030", "Y": "3.1e8", "R": "0.0127", "chi": "1.7944",
    "sigma": "3.0432", "psi": "0.54", "v": "0.5", "area": "zhou", "kappa": "consistent",
}  # fmt: skip

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
def test_orientation_values(line: str) -> None:
    form, d, X, y, *expected = line.split()
    x_m = zhou.peak(form, d, y)
    found = (x_m, zhou.residual(form, d, X, x_m), mp.sqrt(zhou.plastic_squared(form, d, X, y)))
    for value, digits in zip(found, expected, strict=True):
        assert abs(value - mpf(digits)) <= mpf("0.6e-14") * abs(mpf(digits))


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("d", ["1e-12", "6.3e-5", "0.02", "1.5", "20"])
def test_works_are_integrals_of_the_forces(form: str, d: str) -> None:
    y = 1 + (min(zhou.y_max(form, d), mpf(1000)) - 1) * mpf("0.9")
    x_m, X = zhou.peak(form, d, y), "3"
    x_star = zhou.residual(form, d, X, x_m)
    with mp.workdps(40):
        loaded = mp.quad(lambda x: zhou.loading(form, d, x), [0, 1, (1 + x_m) / 2, x_m])
        returned = mp.quad(lambda x: zhou.unloading(form, d, X, x_m, x), [x_star, x_m])
        assert abs(loaded / (2 * y**2 / 5) - 1) < mpf("1e-25")
        assert abs(returned / loaded - zhou.plastic_squared(form, d, X, y)) < mpf("1e-18")


@pytest.mark.parametrize(
    ("form", "d", "X", "y"), [(FORMS[0], 2.7e-3, 5.36, 25.0), (FORMS[1], 1.5, 3.0, 1.5)]
)
def test_duration_against_an_ode_solver(form: str, d: float, X: float, y: float) -> None:
    x_m = zhou.peak(form, d, y)
    x_star = zhou.residual(form, d, X, x_m)

    def until(event, force, start):
        event.terminal, event.direction = True, -1
        motion = lambda t, u: [u[1], -1.25 * float(force(max(u[0], 0.0)))]  # noqa: E731
        settings = {"method": "DOP853", "rtol": 1e-9, "atol": 1e-11, "events": event}
        return solve_ivp(motion, [0, 50], start, **settings)

    down = until(lambda t, u: u[1], lambda x: zhou.loading(form, d, min(x, x_m)), [0.0, y])
    back = until(
        lambda t, u: u[0] - float(x_star),
        lambda x: zhou.unloading(form, d, X, x_m, x),
        [float(x_m), 0.0],
    )
    assert -back.y[1, -1] / y == pytest.approx(
        float(mp.sqrt(zhou.plastic_squared(form, d, X, y))), abs=1e-7
    )
    assert down.t[-1] + back.t[-1] == pytest.approx(float(zhou.duration(form, d, X, y)), rel=1e-7)


@pytest.mark.parametrize("form", FORMS)
def test_limits_at_yield_and_below(form: str) -> None:
    with mp.workdps(60):
        d = mpf("0.0067")
        jump = {"first-order": 1 + 2 * d / 3, "full": (1 - (2 * d / 3) ** 2.5) / (1 - 2 * d / 3)}
        just_above = zhou.plastic_squared(form, d, 7, 1 + mpf("1e-30"))
        assert abs(just_above - jump[form]) < mpf("1e-25")
    assert abs(zhou.duration(form, d, 7, 1) - mpf("2.94327518")) < mpf("1e-8")
    assert zhou.plastic_squared(form, d, 7, 1) == 1
    assert zhou.peak(form, d, zhou.y_max(form, d) * mpf("1.000001")) is None


@pytest.mark.parametrize("form", FORMS)
def test_equal_spheres_of_any_radius_rebound_alike(form: str) -> None:
    names = ("R", "v", "rho")
    slopes = zhou.log_sensitivities(STEEL | {"form": form}, names, zhou.equal_spheres)
    assert abs(slopes["R"]["eps"]) < mpf("1e-60")
    # v_cr and v_lim both go as rho^(-1/2): a denser body is as a faster one
    assert mp.almosteq(slopes["rho"]["eps"], slopes["v"]["eps"] / 2)
    # an overlap is a length: at fixed velocity it goes with the radius
    overlap = zhou.coefficient(zhou.equal_spheres(STEEL | {"form": form}))["residual_overlap"]
    assert abs(slopes["R"]["residual_overlap"] / overlap - 1) < mpf("1e-12")


def test_zero_next_to_the_peak_ends_contact() -> None:
    """Full form, d > 3.5: the unloading force may be positive at 0 and yet dip below zero."""
    x_m = zhou.peak("full", 20, "1.05")
    x_star = zhou.residual("full", 20, 30, x_m)
    assert zhou.unloading("full", 20, 30, x_m, 0) > 0
    assert zhou.unloading("full", 20, 30, x_m, x_star * mpf("0.99")) < 0
    assert zhou.unloading("full", 20, 30, x_m, (x_star + x_m) / 2) > 0


def test_conditions_coincide_and_keep_their_values() -> None:
    pair = zhou.equal_spheres(STEEL | {"form": "first-order"})

    def flags(**change: str) -> tuple[set[str], float, float]:
        result = zhou.coefficient(pair | change, lasts=False)
        return result["flags"], float(result["eps"]), float(result["eps_squared"])

    assert flags(v="0") == ({"ELASTIC", "ZERO_VELOCITY"}, 1.0, 1.0)
    assert flags(v="1000") == (
        {"NO_TURNING_POINT", "BEYOND_EXPANSION", "ABOVE_LIMIT_VELOCITY"},
        0,
        0,
    )
    # Eq. (17) has no value at the limit velocity, Eq. (16) has
    names, eps, _ = flags(v_lim="0.5")
    assert names == {"ABOVE_LIMIT_VELOCITY"}
    assert eps > 0
    # v_cr beyond the limit velocity: nothing elastic comes back
    names, eps, square = flags(v_lim="0.001")
    assert names == {"ABOVE_LIMIT_VELOCITY", "NO_REBOUND"}
    assert eps == 0
    assert -1 < square < 0
    assert flags(v="0.002", v_lim="0.001") == ({"ELASTIC", "ABOVE_LIMIT_VELOCITY"}, 0, 0)


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
