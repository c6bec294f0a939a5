"""Contact models of LAMMPS, LIGGGHTS and YADE as their manuals give them, from files read back.

Each reader returns the force F(δ, δ') [N] of a damped model, or (k1, k2(δ_max)) of a spring that
unloads along k2; `rebound` integrates it by SciPy. Nothing here knows the writer's formulas.
"""

import ast
import math
import re
from collections.abc import Callable

from scipy.integrate import solve_ivp

from tests.export.laws import MASS, PAIR

RADIUS, SPHERE = float(PAIR.radius), 2 * float(PAIR.radius)  # effective, and of each ball [m]


def rebound(force: Callable, velocity: float, mass: float = MASS, clamped: bool = True) -> float:
    """ε of an impact: M δ'' = -F until δ = 0; a clamped force does not pull."""
    length, time = velocity * 1e-4, 1e-4

    def motion(_, state):
        overlap, rate = state[0] * length, state[1] * velocity
        value = force(max(overlap, 0.0), rate)
        return state[1], -(max(value, 0.0) if clamped else value) * time / (mass * velocity)

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
    (number,) = re.findall(r"^(?:timestep|time_step =) (\S+)$", text, re.M)
    return float(number)


def ratio(restitution: float) -> float:
    """-ln e/√(π² + ln² e)."""
    return -math.log(restitution) / math.hypot(math.pi, math.log(restitution))


def lammps_force(text: str, mass: float = MASS, types="* *", radius: float = RADIUS) -> Callable:
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
    hertz = {"hertz": True, "hooke": False}[model]

    def force(overlap, rate):
        touch = math.sqrt(radius * overlap) if hertz else 1.0
        eta = {
            "viscoelastic": lambda: damping * touch * mass,
            "coeff_restitution": lambda: (
                2 * ratio(damping) * math.sqrt(mass * k * touch * (1.25 if hertz else 1.0))
            ),
        }[kind]()
        return k * touch * overlap + eta * rate

    return force


def liggghts_numbers(text: str) -> tuple[str, dict[str, float]]:
    """The model and the properties of one type of atoms."""
    numbers = {}
    kinds = r"(peratomtypepair 1|peratomtype|scalar)"
    for line in lines_of(text):
        setting = re.fullmatch(rf"fix \S+ all property/global (\S+) {kinds} (\S+)", line)
        if setting:
            numbers[setting[1]] = float(setting[3])
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
        touch = math.sqrt(RADIUS * overlap)
        dashpot = 2 * math.sqrt(5 / 6) * beta * math.sqrt(2 * modulus * touch * mass)
        return 4 / 3 * modulus * touch * overlap + dashpot * rate

    return force


def luding(k1: float, most: float, depth: float) -> Callable:
    """k2 = k1 + (k_p - k1) δ_max/δ_lim, δ_lim = k_p/(k_p - k1) Φ 2R, and k_p beyond."""
    limit = most / (most - k1) * depth * 2 * RADIUS
    return lambda peak: k1 + (most - k1) * min(peak / limit, 1.0)


def liggghts_spring(text: str, mass: float = MASS) -> tuple[float, Callable]:
    """`hooke/hysteresis`: k1 = 16/15 √R Y* [15 M V²/(16 √R Y*)]^{1/5} of the characteristic V."""
    model, numbers = liggghts_numbers(text)
    assert model == "hooke/hysteresis"
    assert numbers["coefficientRestitution"] == 1.0
    assert numbers["coefficientAdhesionStiffness"] == numbers["coefficientFriction"] == 0.0
    modulus = effective_modulus(numbers["youngsModulus"], numbers["poissonsRatio"])
    scale = 16 / 15 * math.sqrt(RADIUS) * modulus
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
        touch = math.sqrt(RADIUS * overlap)
        dashpot = 2 * physics["betan"] * math.sqrt(mass * 2 * modulus * touch)
        return 4 / 3 * modulus * touch * overlap + dashpot * rate

    return force


def yade_spring(text: str) -> tuple[float, Callable]:
    material = yade_calls(text)["LudingMat"]
    assert material["kc"] == material["ks"] == material["G0"] == material["frictionAngle"] == 0
    return material["k1"], luding(material["k1"], material["kp"], material["PhiF"])
