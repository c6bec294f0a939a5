"""YADE: what it makes of its own materials, of those written for it, and the law by its header."""

import json
import math
import shutil
import subprocess

import numpy as np
import pytest

import calibration as cal
import softjax as sj
from tests.cases import RADIUS
from tests.export.laws import DENSITY, STEEL

pytestmark = [
    pytest.mark.codes,
    pytest.mark.skipif(shutil.which("yade") is None, reason="no YADE"),
]
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


def yade(script: str, folder) -> list[float]:
    """The numbers that a script prints behind RESULT."""
    (folder / "script.py").write_text(IMPACT + script, encoding="utf-8")
    command = ["yade", "-n", "-x", "-j1", "script.py"]
    ended = subprocess.run(command, cwd=folder, capture_output=True, text=True, errors="replace")
    lines = [line for line in ended.stdout.splitlines() if line.startswith("RESULT")]
    assert len(lines) == 1, (ended.stdout + ended.stderr)[-2000:]
    return json.loads(lines[0].removeprefix("RESULT"))


def as_written(made, **where: bool) -> str:
    """Impacts with the module that was written, at every 16th velocity."""
    steps = 2 * math.ceil(max(made.duration) / made.time_step) + 10
    if made.choice.backend.name == "header":
        engine = "PyRunner(command='softjax_yade.push()', iterPeriod=1, initRun=True)"
        make = f"lambda: (FrictMat(density={DENSITY}), {engine})"
    else:
        make = f"lambda: (softjax_yade.material(density={DENSITY}), softjax_yade.interactions())"
    return f"""
sys.path.insert(0, ".")
import softjax_yade
found = [impact(v, {make}, softjax_yade.time_step, {steps}, **{where})
         for v in {made.target.velocity[::16].tolist()}]
print("RESULT", json.dumps(found))
"""


@pytest.mark.parametrize(
    ("law", "tolerance"),
    [("linear", 0.08), ("hertz-dashpot", 0.08), ("walton-braun", 0.08), ("exact", 0.005)],
)
def test_what_is_written_keeps_its_tolerance(law, tolerance, tmp_path):
    made = cal.export(
        STEEL, "yade", tmp_path, velocity_range=(0.1, 5), law=law, tolerance=tolerance
    )
    found = np.array(yade(as_written(made), tmp_path))
    assert np.max(np.abs(found - made.target.restitution[::16])) <= tolerance
    given = made.choice.impacts.coefficient[::16]
    assert np.max(np.abs(found - given)) <= made.choice.steps.error + 1e-4


@pytest.mark.long
def test_the_header_against_a_wall_and_across_a_boundary(tmp_path):
    wall = sj.Contact.with_wall(sj.STAINLESS_STEEL, wall=sj.STAINLESS_STEEL, radius=RADIUS)
    law = sj.Zhou(wall, STEEL.chi, STEEL.sigma, STEEL.psi)
    for one, where in ((law, {"wall": True}), (STEEL, {"periodic": True})):
        options = {"velocity_range": (0.1, 5), "law": "exact", "tolerance": 0.005}
        made = cal.export(one, "yade", tmp_path, **options)
        found = np.array(yade(as_written(made, **where), tmp_path))
        assert np.max(np.abs(found - made.target.restitution[::16])) <= 0.005
