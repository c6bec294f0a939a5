"""YADE: what it makes of its own materials, of those written for it, and the law by its header."""

import json
import math
import shutil
import subprocess

import numpy as np
import pytest
from scipy.optimize import brentq

import calibration as cal
import softjax as sj
from tests.cases import RADIUS
from tests.export.laws import DENSITY, FRACTION, MASS, PAIR, STEEL, VELOCITIES

pytestmark = [
    pytest.mark.codes,
    pytest.mark.skipif(shutil.which("yade") is None, reason="no YADE"),
]
SPRING = 1e7  # N/m
DAMPING = 2 * FRACTION * math.sqrt(SPRING * MASS)
IMPACT = f"""
import json, math, sys
from yade import *
R, DENSITY = {RADIUS!r}, {DENSITY!r}

def impact(v, make, step, steps, wall=False, periodic=False):
    "The restitution of two equal spheres head-on, or of one against a wall."
    O.reset()
    O.periodic = periodic
    if periodic:
        O.cell.setBox(1, 1, 1)
    material, engine = make()
    O.materials.append(material)
    gap = R*(1 + 1e-9)
    a = O.bodies.append(utils.sphere((-gap + periodic, 0, 0), R, material=material))
    if wall:
        O.bodies.append(utils.wall(0, axis=0, sense=0, material=material))
        O.bodies[a].state.vel = (v, 0, 0)
    else:
        b = O.bodies.append(utils.sphere((gap, 0, 0), R, material=material))
        O.bodies[a].state.vel, O.bodies[b].state.vel = (v/2, 0, 0), (-v/2, 0, 0)
    collider = InsertionSortCollider([Bo1_Sphere_Aabb(), Bo1_Wall_Aabb()], verletDist=0.05*R)
    O.engines = [ForceResetter(), collider, engine, NewtonIntegrator(damping=0, gravity=(0, 0, 0))]
    O.dt = step
    O.run(steps, True)
    last = O.bodies[b].state.vel[0] if not wall else 0.0
    return (last - O.bodies[a].state.vel[0])/v
"""
LOOP = "InteractionLoop([Ig2_Sphere_Sphere_ScGeom()], [{physics}], [{law}])"
FRICT = f"FrictMat(young=1.93e11, poisson=0.35, density={DENSITY}, frictionAngle=0)"


def yade(script: str, folder) -> list[float]:
    """The numbers that a script prints behind RESULT."""
    (folder / "script.py").write_text(IMPACT + script, encoding="utf-8")
    command = ["yade", "-n", "-x", "-j1", "script.py"]
    ended = subprocess.run(command, cwd=folder, capture_output=True, text=True, errors="replace")
    lines = [line for line in ended.stdout.splitlines() if line.startswith("RESULT")]
    assert len(lines) == 1, (ended.stdout + ended.stderr)[-2000:]
    return json.loads(lines[0].removeprefix("RESULT"))


def mindlin(**numbers) -> tuple[str, str]:
    options = ", ".join(f"{n}=MatchMaker(algo='val', val={v!r})" for n, v in numbers.items())
    physics = f"Ip2_FrictMat_FrictMat_MindlinPhys({options})"
    return FRICT, LOOP.format(physics=physics, law="Law2_ScGeom_MindlinPhys_Mindlin()")


def other(kind: str, **numbers) -> tuple[str, str]:
    options = ", ".join(f"{name}={value!r}" for name, value in numbers.items())
    material = f"{kind}Mat({options}, density={DENSITY}, frictionAngle=0)"
    physics, law = f"Ip2_{kind}Mat_{kind}Mat_{kind}Phys()", f"Law2_ScGeom_{kind}Phys_Basic()"
    return material, LOOP.format(physics=physics, law=law)


END = "zero-force"  # of all its contacts
# Λ of ln 0.8 = -(2 Λ/π) atan2(π, Λ): so much is lost at zero overlap where 0.8 is left at zero force
FOR_0_8 = math.exp(
    -brentq(lambda x: math.log(0.8) + 2 * x / math.pi * math.atan2(math.pi, x), 0, 9)
)
LINEAR = math.pi * math.sqrt(MASS / SPRING)
# material and engine, the law that they make, a contact's time (None: Hertz's), ε of another script
ROWS = {
    "en": (
        mindlin(en=0.8, es=0.8),
        sj.HertzDashpot(PAIR, FOR_0_8, end=END),
        None,
        0.79994,
    ),
    "betan": (
        mindlin(betan=FRACTION * math.sqrt(5 / 6), betas=0.0),
        sj.HertzDashpot(PAIR, 0.8, end=END),
        None,
        0.80811,
    ),
    "tc and en": (
        other("ViscEl", tc=1e-4, en=0.8, et=0.8),
        sj.LinearSpringDashpot(PAIR, MASS * (math.pi**2 + math.log(0.8) ** 2) / 1e-8, 0.8, end=END),
        1e-4,
        0.8082,
    ),
    "kn and cn": (
        other("ViscEl", kn=2 * SPRING, cn=2 * DAMPING, ks=0.0, cs=0.0),
        sj.LinearSpringDashpot(PAIR, SPRING, 0.8, end=END),
        LINEAR,
        0.8082,
    ),
    "luding": (
        other("Luding", k1=1e7, kp=1e7 / 0.64, kc=0.0, ks=0.0, PhiF=0.1, G0=0.0),
        # s = (k_p/k1 - 1)²/(k_p/k1 Φ 2R)
        sj.WaltonBraun(PAIR, 1e7, 1e7, 0.36**2 / (0.64 * 0.1 * 2 * float(PAIR.radius))),
        LINEAR,
        None,
    ),
}


def test_what_yade_makes_of_its_materials_is_predicted(tmp_path):
    script = "found = []\n"
    for (material, engine), _, time, _ in ROWS.values():
        for v in VELOCITIES:
            peak = (1.25 * MASS * v**2 / float(PAIR.stiffness)) ** 0.4
            step = (time or 2.943 * peak / v) / 2000
            make = f"lambda: ({material}, {engine})"
            script += f"found.append(impact({v!r}, {make}, {step!r}, 5000))\n"
    found = np.reshape(yade(script + "print('RESULT', json.dumps(found))\n", tmp_path), (-1, 3))
    for (name, (_, law, _, told)), epsilon in zip(ROWS.items(), found, strict=True):
        wanted = sj.restitution(law, np.array(VELOCITIES)).coefficient
        np.testing.assert_allclose(epsilon, wanted, atol=3e-4, err_msg=name)
        if told is not None:
            np.testing.assert_allclose(epsilon, told, atol=2e-4, err_msg=name)


def as_written(made, **where: bool) -> str:
    """Impacts with the module that was written, at every 16th velocity."""
    steps = 2 * math.ceil(max(made.duration) / made.time_step) + 10
    if made.choice.carrier.name == "header":
        engine = "PyRunner(command='softjax_yade.push()', iterPeriod=1, initRun=True)"
        make = f"lambda: (FrictMat(density={DENSITY}), {engine})"
    else:
        make = f"lambda: (softjax_yade.material(density={DENSITY}), softjax_yade.interactions())"
    return f"""
sys.path.insert(0, ".")
import softjax_yade
found = [impact(v, {make}, softjax_yade.time_step, {steps}, **{where})
         for v in {made.wanted.velocity[::16].tolist()}]
print("RESULT", json.dumps(found))
"""


@pytest.mark.parametrize(
    ("law", "tolerance"),
    [("linear", 0.08), ("hertz-dashpot", 0.08), ("walton-braun", 0.08), ("itself", 0.005)],
)
def test_what_is_written_keeps_its_tolerance(law, tolerance, tmp_path):
    made = cal.export(
        STEEL, "yade", tmp_path, velocity_range=(0.1, 5), law=law, tolerance=tolerance
    )
    found = np.array(yade(as_written(made), tmp_path))
    assert np.max(np.abs(found - made.wanted.restitution[::16])) <= tolerance
    given = made.choice.impacts.coefficient[::16]
    assert np.max(np.abs(found - given)) <= made.choice.steps.error + 1e-4


@pytest.mark.long
def test_the_header_against_a_wall_and_across_a_boundary(tmp_path):
    wall = sj.Contact.with_wall(sj.STAINLESS_STEEL, wall=sj.STAINLESS_STEEL, radius=RADIUS)
    law = sj.Zhou(wall, STEEL.chi, STEEL.sigma, STEEL.psi)
    for one, where in ((law, {"wall": True}), (STEEL, {"periodic": True})):
        options = {"velocity_range": (0.1, 5), "law": "itself", "tolerance": 0.005}
        made = cal.export(one, "yade", tmp_path, **options)
        found = np.array(yade(as_written(made, **where), tmp_path))
        assert np.max(np.abs(found - made.wanted.restitution[::16])) <= 0.005
