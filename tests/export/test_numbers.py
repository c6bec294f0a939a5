"""Numbers written for LAMMPS, LIGGGHTS and YADE, read back and integrated by their contact models."""

import json
import math

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import softjax as sj
from tests.cases import RADIUS
from tests.export import codes
from tests.export.laws import MASS, PAIR, STEEL, VELOCITIES

FILES = {"lammps": "in.softjax", "liggghts": "in.softjax", "yade": "softjax_yade.py"}
READERS = {"lammps": codes.lammps_force, "liggghts": codes.liggghts_force, "yade": codes.yade_force}
SPRINGS = {"liggghts": codes.liggghts_spring, "yade": codes.yade_spring}
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
    _, folder = exported(STEEL, code, law=law, tolerance=0.1, steps=400, **options)
    text, report = read(folder, code)
    force = READERS[code](text)
    assert codes.time_step(text) == report["time_step"]
    for velocity in VELOCITIES:
        found = codes.rebound(force, velocity)
        assert found == pytest.approx(at(report, velocity), abs=1e-6)
        expected = float(sj.restitution(STEEL, velocity).coefficient)
        assert abs(found - expected) < (0.0225 if law == "viscoelastic" else 0.068)
    # damping for one mass alone is said to be so: by the code's model with the double mass
    one, other = (codes.rebound(READERS[code](text, m), 1.0, m) for m in (MASS, 2 * MASS))
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


@pytest.mark.parametrize("code", SPRINGS)
@pytest.mark.parametrize("source", ["steel", "from its own"])
def test_a_hysteretic_spring_gives_the_stated_restitution(code, source, exported):
    """k2 grows from k1; a Walton–Braun law that begins so is met exactly, with its own s."""
    spring = sj.WaltonBraun(PAIR, 1e7, 1e7, 300.0)
    law, tolerance = (STEEL, 0.1) if source == "steel" else (spring, 0.01)
    _, folder = exported(law, code, law="walton-braun", tolerance=tolerance, steps=400)
    text, report = read(folder, code)
    k1, k2 = SPRINGS[code](text)
    for velocity in VELOCITIES:
        found = codes.spring_rebound(k1, k2, velocity)
        assert found == pytest.approx(at(report, velocity), abs=1e-6)
        expected = float(sj.restitution(law, velocity).coefficient)
        assert abs(found - expected) < (0.075 if source == "steel" else 1e-6)
    peak = 5.0 * math.sqrt(MASS / k1)
    assert peak == pytest.approx(
        report["largest_overlap_over_radius"] * report["radius"]["value"], rel=1e-6
    )
    # it goes on to grow beyond the fastest impact, to twice its overlap
    assert k2(1.99 * peak) == pytest.approx(k1 + 1.99 * (k2(peak) - k1))
    assert k2(2.5 * peak) == pytest.approx(k2(2.0 * peak))


def test_sizes_that_are_named_have_a_line_for_each_pair(exported):
    """Spheres of two radii: ε of each pair is that of its own contact, at a step for the smallest."""
    law, radii = sj.ViscoelasticHertz(PAIR, 2e-6), (RADIUS, RADIUS / 2)
    alone, _ = exported(law, "lammps", law="viscoelastic", tolerance=0.1, steps=400)
    made, folder = exported(
        law, "lammps", law="viscoelastic", tolerance=0.1, steps=400, sizes=radii
    )
    text, _ = read(folder, "lammps")
    assert made.choice.error == 0
    assert made.time_step == pytest.approx(alone.time_step / 2, rel=0.05)
    assert "all pairs of spheres of radius 0.0127, 0.00635 m" in text
    steel = sj.STAINLESS_STEEL
    for i, j in ((1, 1), (1, 2), (2, 2)):
        contact = sj.Contact.between_spheres(steel, steel, radii[i - 1], radii[j - 1])
        mass, radius = float(contact.mass), float(contact.radius)
        force = codes.lammps_force(text, mass, f"{i} {j}", radius)
        expected = sj.restitution(sj.ViscoelasticHertz(contact, 2e-6), 1.0).coefficient
        assert codes.rebound(force, 1.0, mass) == pytest.approx(float(expected), abs=1e-6)


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
    (wall,) = (line for line in codes.lines_of(text) if line.startswith("fix softjax_wall all "))
    assert "zplane 0.0" in wall
    if code == "lammps":
        assert not any(line.startswith("pair_") for line in codes.lines_of(text))
        (pair,) = (line for line in text.splitlines() if line.startswith("# pair_coeff * * "))
        assert pair.removeprefix("# pair_coeff * * ") in wall
    else:
        assert "it replaces that of a file included before" in text
        assert wall.endswith("wall/gran model hertz primitive type 1 zplane 0.0 limitForce on")
    assert "of a ball on a flat wall" in text
    _, folder = exported(source, code, on_wall=False, **options)
    text, _ = read(folder, code)
    assert not any("wall" in line for line in codes.lines_of(text))
    assert "# fix ID group wall/gran " in text
    assert "# between two balls, as requested:\n" in text
