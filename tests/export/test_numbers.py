"""Numbers written for LAMMPS, LIGGGHTS and YADE, read back and integrated by the contact models of their manuals.

Each reader returns the force F(δ, δ') [N] of a damped model, or (k1, k2(δ_max)) of a spring that
unloads along k2; `rebound` integrates it by SciPy. Nothing here knows the writer's formulas.
"""

import ast
import json
import math
import re
from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

import calibration as cal
import softjax as sj
from tests.cases import RADIUS
from tests.export.laws import MASS, PAIR, STEEL, VELOCITIES
from tests.export.test_matrix import LAWS as IN_CODES
from tests.shown.capture import as_recorded

EFFECTIVE = float(PAIR.radius)  # [m]


def rebound(force: Callable, velocity: float, mass: float = MASS) -> float:
    """ε of an impact: M δ'' = -F until δ = 0; a force does not pull."""
    length, time = velocity * 1e-4, 1e-4

    def motion(_, state):
        overlap, rate = state[0] * length, state[1] * velocity
        return state[1], -max(force(max(overlap, 0.0), rate), 0.0) * time / (mass * velocity)

    def parted(_, state):
        return state[0]

    parted.terminal, parted.direction = True, -1
    options = {"method": "DOP853", "rtol": 1e-10, "atol": 1e-13, "max_step": 0.1}
    solution = solve_ivp(motion, (0.0, 50.0), [0.0, 1.0], events=parted, **options)
    assert solution.t_events[0].size
    return -float(solution.y[1, -1])


def spring_rebound(k1: float, k2: Callable, velocity: float, mass: float = MASS) -> float:
    """ε² = k1/k2 at the largest overlap v √(M/k1)."""
    return math.sqrt(k1 / k2(velocity * math.sqrt(mass / k1)))


def lines_of(text: str) -> list[str]:
    """Lines of a script that act."""
    return [line.partition("#")[0].strip() for line in text.splitlines() if line.partition("#")[0]]


def time_step(text: str) -> float:
    (number,) = re.findall(r"(?:timestep|time_step =) ([\d.e-]+)\"?$", text, re.M)
    return float(number)


def ratio(restitution: float) -> float:
    """-ln e/√(π² + ln² e)."""
    return -math.log(restitution) / math.hypot(math.pi, math.log(restitution))


def lammps_force(text: str, mass: float = MASS, types="* *", radius: float = EFFECTIVE) -> Callable:
    """`pair_style granular`: hooke F = k δ, hertz F = k √R δ^{3/2}, less η δ' by the damping model.

    viscoelastic: η = η0 a M, a = √(R δ); coeff_restitution: 2 ξ √(M k) of hooke, √(5/6) 2 ξ √(M S),
    S = 3/2 k a, of hertz. `limit_damping`: no attraction.
    """
    assert "pair_style granular" in lines_of(text)
    start = f"pair_coeff {types} "
    (coefficients,) = (line for line in lines_of(text) if line.startswith(start))
    model, *words = coefficients.removeprefix(start).split()
    k, damping = float(words[0]), float(words[1])
    assert words[2:7] == ["tangential", "linear_nohistory", "0.0", "0.0", "damping"]
    kind, limited = words[7], words[8:]
    assert limited == ["limit_damping"]
    assert kind in ("viscoelastic", "coeff_restitution")
    hertz = {"hertz": True, "hooke": False}[model]

    def force(overlap, rate):
        touch = math.sqrt(radius * overlap) if hertz else 1.0
        eta = damping * touch * mass
        if kind == "coeff_restitution":
            eta = 2 * ratio(damping) * math.sqrt(mass * k * touch * (1.25 if hertz else 1.0))
        return k * touch * overlap + eta * rate

    return force


def liggghts_numbers(text: str) -> tuple[str, dict[str, float]]:
    """The model and the properties of one type of atoms; of two and more they are the same."""
    numbers: dict[str, float] = {}
    kinds = r"(peratomtypepair \d|peratomtype|scalar)"
    for line in lines_of(text):
        for name, kind, values in re.findall(rf"all property/global (\S+) {kinds} ([^\"]+)", line):
            found = {float(value) for value in values.split()}
            assert found == {numbers.setdefault(name, *found)}
            if kind != "scalar":  # as many as there are types, or pairs of them
                (types,) = re.findall(r"softjax_types} == (\d)", line)
                assert len(values.split()) == int(types) ** (1 + ("pair" in kind))
    (model,) = (line for line in lines_of(text) if line.startswith("pair_style gran model "))
    return model.removeprefix("pair_style gran model "), numbers


def effective_modulus(young: float, poisson: float) -> float:
    """Y* of two like bodies [Pa]."""
    return young / (2 * (1 - poisson**2))


def liggghts_force(text: str, mass: float = MASS) -> Callable:
    """`gran`: hooke/stiffness F = k δ + γ M δ'; hertz F = 4/3 Y* √(R δ) δ + 2 √(5/6) β √(S M) δ',

    S = 2 Y* √(R δ), β as `ratio`; `limitForce on`: no attraction.
    """
    model, numbers = liggghts_numbers(text)
    assert model.endswith("limitForce on")
    modulus = effective_modulus(numbers["youngsModulus"], numbers["poissonsRatio"])
    assert numbers["coefficientFriction"] == 0
    if model.startswith("hooke/stiffness"):
        return lambda overlap, rate: numbers["kn"] * overlap + numbers["gamman"] * mass * rate
    assert model.startswith("hertz ")
    beta = ratio(numbers["coefficientRestitution"])

    def force(overlap, rate):
        touch = math.sqrt(EFFECTIVE * overlap)
        dashpot = 2 * math.sqrt(5 / 6) * beta * math.sqrt(2 * modulus * touch * mass)
        return 4 / 3 * modulus * touch * overlap + dashpot * rate

    return force


def luding(k1: float, most: float, depth: float) -> Callable:
    """k2 = k1 + (k_p - k1) δ_max/δ_lim, δ_lim = k_p/(k_p - k1) Φ 2R, and k_p beyond."""
    limit = most / (most - k1) * depth * 2 * EFFECTIVE
    return lambda peak: k1 + (most - k1) * min(peak / limit, 1.0)


def liggghts_spring(text: str, mass: float = MASS) -> tuple[float, Callable]:
    """`hooke/hysteresis`: k1 = 16/15 √R Y* [15 M V²/(16 √R Y*)]^{1/5} of the characteristic V."""
    model, numbers = liggghts_numbers(text)
    assert model == "hooke/hysteresis"
    assert numbers["coefficientRestitution"] == 1.0
    assert numbers["coefficientAdhesionStiffness"] == numbers["coefficientFriction"] == 0.0
    modulus = effective_modulus(numbers["youngsModulus"], numbers["poissonsRatio"])
    scale = 16 / 15 * math.sqrt(EFFECTIVE) * modulus
    k1 = scale * (mass * numbers["characteristicVelocity"] ** 2 / scale) ** 0.2
    most = k1 * numbers["coefficientMaxElasticStiffness"]
    return k1, luding(k1, most, numbers["coefficientPlasticityDepth"])


def yade_calls(text: str) -> dict[str, dict[str, float]]:
    """Numbers that are given by keyword, by the name of what is called."""
    calls = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Call)]
    calls_by_name = {}
    for call in calls:
        numbers = {}
        for keyword in call.keywords:
            value = keyword.value
            if isinstance(value, ast.Call):  # MatchMaker(algo='val', val=…)
                value = next(inner.value for inner in value.keywords if inner.arg == "val")
            if isinstance(value, ast.Constant):
                numbers[keyword.arg] = value.value
        calls_by_name[getattr(call.func, "id", "")] = numbers
    return calls_by_name


def yade_force(text: str, mass: float = MASS) -> Callable:
    """ViscElMat: kn and cn of two bodies in series; MindlinPhys: F = 4/3 E √R δ^{3/2} + c δ',

    c = 2 betan √(M kn), kn = 2 E √(R δ). No attraction in either.
    """
    calls = yade_calls(text)
    if "ViscElMat" in calls:
        material = calls["ViscElMat"]
        assert material["ks"] == material["cs"] == material["frictionAngle"] == 0
        return lambda overlap, rate: material["kn"] / 2 * overlap + material["cn"] / 2 * rate
    material, physics = calls["FrictMat"], calls["Ip2_FrictMat_FrictMat_MindlinPhys"]
    assert material["frictionAngle"] == physics["betas"] == 0
    modulus = effective_modulus(material["young"], material["poisson"])

    def force(overlap, rate):
        touch = math.sqrt(EFFECTIVE * overlap)
        dashpot = 2 * physics["betan"] * math.sqrt(mass * 2 * modulus * touch)
        return 4 / 3 * modulus * touch * overlap + dashpot * rate

    return force


def yade_spring(text: str) -> tuple[float, Callable]:
    material = yade_calls(text)["LudingMat"]
    assert material["kc"] == material["ks"] == material["G0"] == material["frictionAngle"] == 0
    return material["k1"], luding(material["k1"], material["kp"], material["PhiF"])


FILES = {"lammps": "in.softjax", "liggghts": "in.softjax", "yade": "softjax_yade.py"}
READERS = {"lammps": lammps_force, "liggghts": liggghts_force, "yade": yade_force}
SPRINGS = {"liggghts": liggghts_spring, "yade": yade_spring}
SOFT = {"overlap": 0.05, "radius": RADIUS}
DASHPOTS = [
    ("lammps", "linear", SOFT),
    ("lammps", "hertz-dashpot", {}),
    ("lammps", "viscoelastic", SOFT),
    ("liggghts", "linear", {}),
    ("liggghts", "hertz-dashpot", {}),
    ("yade", "linear", {}),
    ("yade", "hertz-dashpot", SOFT),
]


def read(folder, code: str) -> tuple[str, dict]:
    text = (folder / FILES[code]).read_text(encoding="utf-8")
    return text, json.loads((folder / "export.json").read_text(encoding="utf-8"))


def at(report: dict, velocity: float, of: str = "exported") -> float:
    curve = report["curve"]
    return float(CubicSpline(np.log(curve["velocity"]), curve[of])(math.log(velocity)))


OF_MASS = {("lammps", "viscoelastic"), ("liggghts", "linear"), ("yade", "linear")}


@pytest.mark.parametrize(("code", "law", "options"), DASHPOTS)
def test_a_dashpot_gives_the_stated_restitution(code, law, options, exported):
    """Within its stated error of the requested law: 0.068 where ε is constant, 0.022 viscoelastic."""
    made, folder = exported(STEEL, code, law=law, tolerance=0.1, **options)
    as_recorded(f"{code} {law}", {"printed": str(made)})
    text, report = read(folder, code)
    force = READERS[code](text)
    assert time_step(text) == report["time_step"]
    for velocity in VELOCITIES:
        found = rebound(force, velocity)
        assert found == pytest.approx(at(report, velocity), abs=1e-6)
        expected = float(sj.restitution(STEEL, velocity).coefficient)
        assert abs(found - expected) < (0.0225 if law == "viscoelastic" else 0.068)
    # damping for one mass alone is said to be so: by the code's model with the double mass
    one, other = (rebound(READERS[code](text, m), 1.0, m) for m in (MASS, 2 * MASS))
    assert (abs(one - other) > 1e-3) == ((code, law) in OF_MASS)
    assert ("Its damping is for that mass" in text) == ((code, law) in OF_MASS)
    # ½ k δ² = ½ M v² at Zhou's largest overlap, or Hertz's k; softer by the square, by μ^{5/2}
    factor = report["softer"]["overlaps"]
    assert (factor > 1) == ("overlap" in options)
    if law == "linear":
        zhou = float(sj.restitution(STEEL, 5.0).peak_overlap)
        assert force(zhou, 0.0) * zhou == pytest.approx(MASS * 25 / factor**2, rel=1e-9)
    else:
        stiffness = 4 / 3 * 1.93e11 / (2 * (1 - 0.35**2)) * math.sqrt(RADIUS / 2)
        assert force(1e-5, 0.0) == pytest.approx(stiffness * 1e-5**1.5 / factor**2.5, rel=1e-9)


def test_every_law_of_every_code_has_a_reader_here_and_an_impact_in_its_code(tmp_path):
    """A new code or law, as refusals list them, has a row in each of these lists."""

    def listed(to, law) -> set[str]:
        with pytest.raises(ValueError, match="must be") as refusal:
            cal.export(STEEL, to, tmp_path, velocity_range=(1.0, 2.0), law=law)
        (names,) = re.findall(r"must be (?:one of )?([\w, -]+), but", str(refusal.value))
        return set(names.split(", ")) - {"auto"}

    codes = listed("none", "auto") - {"c"}
    assert codes == set(FILES) == set(READERS) == set(IN_CODES)
    read_here = {code: {law for of, law, _ in DASHPOTS if of == code} for code in codes}
    for code in SPRINGS:
        read_here[code].add("walton-braun")
    read_here["lammps"] |= {"walton-braun", "exact"}  # by its plugin
    for code in codes:
        assert listed(code, "none") == read_here[code] == set(IN_CODES[code])


def test_liggghts_takes_no_coefficient_of_0_05_or_less(exported):
    """e of a full contact from ε of one that never pulls: ln ε = -2 ξ arccos ξ/√(1 - ξ²)."""
    options = {"law": "hertz-dashpot", "tolerance": 0.3, "steps": 400}

    def written(coefficient):
        xi = ratio(coefficient)
        epsilon = math.exp(-2 * xi * math.acos(xi) / math.sqrt(1 - xi**2))
        _, folder = exported(sj.ConstantRestitution(PAIR, epsilon), "liggghts", **options)
        return liggghts_numbers(read(folder, "liggghts")[0])[1]["coefficientRestitution"]

    assert written(0.06) == pytest.approx(0.06)
    with pytest.raises(ValueError, match=r"no coefficientRestitution of 0\.045; above 0\.05, or"):
        written(0.045)


SPRUNG = {  # law, requested law, tolerance, largest error of ε
    "steel": (STEEL, "walton-braun", 0.1, 0.075),
    "from its own": (sj.WaltonBraun(PAIR, 1e7, 1e7, 300.0), "walton-braun", 0.01, 1e-6),
    "from above its own": (sj.WaltonBraun(PAIR, 1e7, 1.1e7, 1000.0), "auto", 0.05, 0.045),
}


@pytest.mark.parametrize("code", SPRINGS)
@pytest.mark.parametrize("source", SPRUNG)
def test_a_hysteretic_spring_gives_the_stated_restitution(code, source, exported):
    """k2 grows from k1; a Walton–Braun law that begins so is met exactly, with its own s."""
    law, key, tolerance, most = SPRUNG[source]
    made, folder = exported(law, code, law=key, tolerance=tolerance)
    assert made.choice.key == "walton-braun"
    if source == "steel":
        as_recorded(f"{code} walton-braun", {"printed": str(made)})
    text, report = read(folder, code)
    k1, k2 = SPRINGS[code](text)
    for velocity in VELOCITIES:
        found = spring_rebound(k1, k2, velocity)
        assert found == pytest.approx(at(report, velocity), abs=1e-6)
        expected = float(sj.restitution(law, velocity).coefficient)
        assert abs(found - expected) < most
    peak = 5.0 * math.sqrt(MASS / k1)
    stated = report["largest_overlap_over_radius"] * report["radius"]["value"]
    assert peak == pytest.approx(stated, rel=1e-6)
    # it goes on to grow beyond the fastest impact, to twice its overlap
    assert k2(1.99 * peak) == pytest.approx(k1 + 1.99 * (k2(peak) - k1))
    assert k2(2.5 * peak) == pytest.approx(k2(2.0 * peak))


@pytest.mark.parametrize("code", SPRINGS)
def test_a_softer_hysteretic_spring_rebounds_alike(code, exported):
    """k1 and k2 fall by the square of the factor by which overlaps grow."""
    law, key, tolerance, _ = SPRUNG["steel"]
    stiff, before = exported(law, code, law=key, tolerance=tolerance)
    soft, folder = exported(law, code, law=key, tolerance=tolerance, **SOFT)
    factor = soft.overlap * RADIUS / (stiff.overlap * EFFECTIVE)
    assert factor > 3
    (k1, k2), (soft_k1, soft_k2) = (SPRINGS[code](read(f, code)[0]) for f in (before, folder))
    assert soft_k1 == pytest.approx(k1 / factor**2, rel=1e-6)
    for velocity in VELOCITIES:
        found = spring_rebound(soft_k1, soft_k2, velocity)
        assert found == pytest.approx(spring_rebound(k1, k2, velocity), abs=1e-6)


@pytest.mark.parametrize("law", ["linear", "walton-braun"])
@pytest.mark.parametrize("code", ["lammps", "liggghts", "yade", "c"])
def test_a_stiffness_that_the_law_states_is_kept(code, law, exported):
    """By the dashpot's share of the largest overlap it was written 1.8 times as large."""
    source = sj.LinearSpringDashpot(PAIR, 1e6, 0.3)
    if law == "walton-braun":
        source = sj.WaltonBraun(PAIR, 1e6, 1e6, 30.0)
    options = {"law": law, "tolerance": 0.1, "steps": 400, "gravity": 0.0}
    made, folder = exported(source, code, **options)
    assert made.choice.error < 1e-9
    if (code, law) in {("lammps", "walton-braun"), ("c", "walton-braun"), ("c", "linear")}:
        text = (folder / "softjax_law.h").read_text(encoding="utf-8")
        (stiffness,) = re.findall(r"define SOFTJAX_(?:LOADING_)?STIFFNESS \(\(\w+\)(\S+)\)", text)
        assert float(stiffness) == pytest.approx(1e6, rel=1e-12)
        return
    text, _ = read(folder, code)
    if law == "linear":
        assert READERS[code](text)(1e-5, 0.0) == pytest.approx(10.0, rel=1e-12)
    else:
        assert SPRINGS[code](text)[0] == pytest.approx(1e6, rel=1e-12)


def test_sizes_that_are_named_have_a_line_for_each_pair(exported):
    """Spheres of two radii: ε of each pair is that of its own contact, at a step for the smallest."""
    law, radii = sj.ViscoelasticHertz(PAIR, 2e-6), (RADIUS, RADIUS / 2)
    options = {"law": "viscoelastic", "tolerance": 0.1, "steps": 400}
    alone, _ = exported(law, "lammps", **options)
    made, folder = exported(law, "lammps", **options, sizes=radii)
    text, _ = read(folder, "lammps")
    assert made.choice.error == 0
    assert made.time_step == pytest.approx(alone.time_step / 2, rel=0.05)
    assert "all pairs of spheres of radius 0.0127, 0.00635 m" in text
    steel = sj.STAINLESS_STEEL
    for i, j in ((1, 1), (1, 2), (2, 2)):
        contact = sj.Contact.between_spheres(steel, steel, radii[i - 1], radii[j - 1])
        mass, radius = float(contact.mass), float(contact.radius)
        force = lammps_force(text, mass, f"{i} {j}", radius)
        expected = sj.restitution(sj.ViscoelasticHertz(contact, 2e-6), 1.0).coefficient
        assert rebound(force, 1.0, mass) == pytest.approx(float(expected), abs=1e-6)


@pytest.mark.parametrize(
    ("code", "law"), [("lammps", "viscoelastic"), ("liggghts", "hertz-dashpot")]
)
def test_the_line_of_a_wall_has_the_same_numbers_and_acts_where_a_wall_was_measured(
    code, law, exported
):
    steel = sj.STAINLESS_STEEL
    contact = sj.Contact.with_wall(steel, wall=steel, radius=RADIUS)
    source = sj.Zhou(contact, STEEL.chi, STEEL.sigma, STEEL.psi)
    options = {"law": law, "tolerance": 0.1, "steps": 400}
    _, folder = exported(source, code, on_wall=True, **options)
    text, _ = read(folder, code)
    (wall,) = (line for line in lines_of(text) if line.startswith("fix softjax_wall all "))
    assert "zplane 0.0" in wall
    if code == "lammps":
        assert not any(line.startswith("pair_") for line in lines_of(text))
        (pair,) = (line for line in text.splitlines() if line.startswith("# pair_coeff * * "))
        assert pair.removeprefix("# pair_coeff * * ") in wall
    else:
        assert "LIGGGHTS has one law for balls and walls" in text
        assert wall.endswith("wall/gran model hertz primitive type 1 zplane 0.0 limitForce on")
    assert "of a ball on a flat wall" in text
    _, folder = exported(source, code, on_wall=False, **options)
    text, _ = read(folder, code)
    assert not any("wall" in line for line in lines_of(text))
    assert "# fix ID group wall/gran " in text
    assert "# between two balls, as requested:\n" in text
