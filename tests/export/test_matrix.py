"""All promises of files that are written for LAMMPS, LIGGGHTS and YADE, kept at all starting phases.

Each file runs once in its code: 24 pairs of balls, or balls on a wall, side by side, at three velocities, with
eight parts of a time step before they touch.
"""

import ast
import json
import math
import os
import shutil
import subprocess
from itertools import product

import numpy as np
import pytest

import calibration as cal
import softjax as sj
from tests.cases import RADIUS
from tests.export.lammps import build, impact, needs_lammps, onto_a_wall, rebounds
from tests.export.laws import DENSITY, RANGE, STEEL

STEELS = (sj.STAINLESS_STEEL, sj.STAINLESS_STEEL)
PHASES = (np.arange(8) + 0.5) / 8
WALL = sj.Contact.with_wall(sj.STAINLESS_STEEL, wall=sj.STAINLESS_STEEL, radius=RADIUS)
LIGGGHTS = """
atom_style granular
atom_modify map array
boundary f f f
newton off
communicate single vel yes
hard_particles yes
units si
region box block -0.2 0.2 -0.1 {width} -0.2 0.2 units box
create_box 1 box
neighbor 0.001 bin
neigh_modify delay 0
include in.softjax
{atoms}
set group all diameter {diameter} density {density}
{motions}
fix move all nve/sphere
dump last all custom {steps} out.* id vx vz
dump_modify last sort id format "%d %.16g %.16g"
run {steps}
"""
YADE = """
import json, sys
sys.path.insert(0, ".")
import softjax_yade
from yade import *
ball = softjax_yade.material(density={density})
O.materials.append(ball)
for k, (v, gap) in enumerate({impacts}):
    where = -{radius} - gap
    if {wall}:
        O.bodies.append(utils.sphere((where, k*{width}, 0), {radius}, material=ball))
        O.bodies[-1].state.vel = (v, 0, 0)
    else:
        for side in (1, -1):
            O.bodies.append(utils.sphere((side*(where + gap/2), k*{width}, 0), {radius}, material=ball))
            O.bodies[-1].state.vel = (side*v/2, 0, 0)
if {wall}:
    O.bodies.append(utils.wall(0, axis=0, sense=0, material=ball))
collider = InsertionSortCollider(softjax_yade.bounds(), verletDist=0.05*{radius})
O.engines = [ForceResetter(), collider, softjax_yade.interactions(),
             NewtonIntegrator(damping=0, gravity=(0, 0, 0))]
O.dt = softjax_yade.time_step
O.run({steps}, True)
print("RESULT", json.dumps([b.state.vel[0] for b in O.bodies if isinstance(b.shape, Sphere)]))
"""


def in_lammps(folder, impacts, wall, steps) -> np.ndarray:
    """ε of each impact; so of the other codes."""
    of = onto_a_wall if wall else impact
    return rebounds((of(v, ["include in.softjax"], steps, gap=gap) for v, gap in impacts), folder)


def liggghts(folder, text: str) -> str:
    """What a script prints; empty where it ended well."""
    (folder / "in.matrix").write_text(text, encoding="utf-8")
    environment = {k: v for k, v in os.environ.items() if k != "LD_LIBRARY_PATH"}
    command = ["liggghts", "-in", "in.matrix", "-log", "none"]
    ended = subprocess.run(command, cwd=folder, env=environment, capture_output=True)
    return (ended.stdout + ended.stderr).decode(errors="replace") if ended.returncode else ""


def in_liggghts(folder, impacts, wall, steps) -> np.ndarray:
    atoms, motions = [], []
    for k, (v, gap) in enumerate(impacts):
        places = [f"{s * (RADIUS + gap / 2)!r} {k * 4 * RADIUS} 0" for s in (-1, 1)]
        speeds = [(v / 2, 0), (-v / 2, 0)]
        if wall:
            places, speeds = [f"0 {k * 4 * RADIUS} {RADIUS + gap!r}"], [(0, -v)]
        atoms += [f"create_atoms 1 single {place} units box" for place in places]
        for vx, vz in speeds:
            motions += [f"group one id {len(motions) // 3 + 1}"]
            motions += [f"velocity one set {vx!r} 0 {vz!r} units box", "group one delete"]
    sizes = {"diameter": 2 * RADIUS, "density": DENSITY, "width": len(impacts) * 4 * RADIUS}
    lines = {"atoms": "\n".join(atoms), "motions": "\n".join(motions), "steps": steps}
    assert liggghts(folder, LIGGGHTS.format(**sizes, **lines))[-1500:] == ""
    _, vx, vz = np.loadtxt(folder / f"out.{steps}", skiprows=9).T
    return restitution(vz if wall else vx, impacts, wall)


def restitution(velocity, impacts, wall) -> np.ndarray:
    """ε from the velocities of all balls after it, in the order of their IDs."""
    return (velocity if wall else velocity[1::2] - velocity[::2]) / np.array(impacts)[:, 0]


def in_yade(folder, impacts, wall, steps) -> np.ndarray:
    scene = {"impacts": impacts, "wall": wall, "steps": steps}
    found = yade(folder, YADE.format(density=DENSITY, radius=RADIUS, width=4 * RADIUS, **scene))
    return restitution(-found if wall else found, impacts, wall)


def yade(folder, text: str) -> np.ndarray:
    """The numbers of the line RESULT … that a script prints."""
    (folder / "script.py").write_text(text, encoding="utf-8")
    command = ["yade", "-n", "-x", "-j1", "script.py"]
    ended = subprocess.run(command, cwd=folder, capture_output=True, text=True, errors="replace")
    lines = [line for line in ended.stdout.splitlines() if line.startswith("RESULT")]
    assert len(lines) == 1, (ended.stdout + ended.stderr)[-2000:]
    return np.array(json.loads(lines[0].removeprefix("RESULT")))


RUN = {"lammps": in_lammps, "liggghts": in_liggghts, "yade": in_yade}
LAWS = {
    "lammps": ("linear", "hertz-dashpot", "viscoelastic", "walton-braun", "exact"),
    "liggghts": ("linear", "hertz-dashpot", "walton-braun"),
    "yade": ("linear", "hertz-dashpot", "walton-braun"),
}
MARKS = {"lammps": [needs_lammps]}
for name in ("liggghts", "yade"):
    MARKS[name] = [pytest.mark.skipif(shutil.which(name) is None, reason=f"no {name}")]


@pytest.mark.codes
@pytest.mark.long
@pytest.mark.parametrize(
    ("code", "law", "wall"),
    [
        pytest.param(code, law, wall, marks=MARKS[code])
        for code, laws in LAWS.items()
        for law in laws
        for wall in (False, True)
        if (code, law, wall) != ("yade", "walton-braun", True)  # refused
    ],
)
def test_what_is_written_keeps_its_promise(code, law, wall, tmp_path):
    source = sj.Zhou(WALL, STEEL.chi, STEEL.sigma, STEEL.psi) if wall else STEEL
    options = {"velocity_range": RANGE, "law": law, "tolerance": 0.08, "on_wall": wall}
    if law == "exact":
        options["tolerance"] = 0.005
    made = cal.export(source, code, tmp_path, **options)
    if made.choice.backend.name == "header":
        build(tmp_path)
    some = slice(None, None, 32)
    cases = list(product(made.target.velocity[some].tolist(), PHASES.tolist()))
    impacts = [(v, phase * v * made.time_step) for v, phase in cases]
    steps = 2 * math.ceil(max(made.duration) / made.time_step) + 10
    found = RUN[code](tmp_path, impacts, wall, steps).reshape(-1, len(PHASES))
    given, expected = made.choice.impacts.coefficient[some], made.target.restitution[some]
    assert np.max(np.abs(found - given[:, None])) <= made.choice.steps.error + 1e-4
    assert np.max(np.abs(found - expected[:, None])) <= made.choice.total + 1e-4 <= 0.0801


BALLS, PLATE = {"types": (1, 1), "prefix": "balls"}, {"types": (1, 2), "prefix": "plate"}
HERTZ = {"law": "hertz-dashpot"}
SOFT = sj.Contact.with_wall(sj.NYLON, wall=sj.NYLON, radius=RADIUS)
TOGETHER = {  # files by their contact and options, in the order in which they are included, and what is said
    "balls and a plate": ([(None, BALLS), (WALL, PLATE)], ""),
    "a plate and balls": ([(WALL, PLATE), (None, BALLS)], ""),
    "by Hertz": ([(WALL, PLATE | HERTZ), (None, BALLS | HERTZ)], ""),
    "the same types": ([(None, BALLS), (WALL, PLATE | {"types": (1, 1)})], "Reuse of compute ID"),
    "all first": ([(None, {}), (WALL, PLATE)], "Reuse of compute ID"),
    "all last": ([(WALL, PLATE), (None, {})], "Reuse of compute ID"),
    "all twice": ([(None, {}), (WALL, {"prefix": "plate"})], "Reuse of compute ID"),
    "another model": ([(None, BALLS), (WALL, PLATE | HERTZ)], "softjax: other model than"),
    "other bodies": ([(None, BALLS | HERTZ), (SOFT, PLATE | HERTZ)], "softjax: other bodies than"),
}


@pytest.mark.codes
@MARKS["liggghts"][0]
@pytest.mark.parametrize("case", TOGETHER)
def test_files_of_liggghts_go_together_or_say_why_not(case, tmp_path):
    """Balls of 0.9 and a plate of 0.5, of one file a pair of types: the second file acted for both."""
    files, said = TOGETHER[case]
    lines, errors = [], {}
    for contact, options in files:
        law = sj.ConstantRestitution(contact or STEEL.contact, 0.5 if contact else 0.9)
        settings = {"law": "linear", "velocity_range": (0.1, 5.0), "tolerance": 0.02} | options
        on_wall = contact is not None
        made = cal.export(law, "liggghts", tmp_path, **settings, gravity=0.0, on_wall=on_wall)
        lines.append(f"include {made.files[0]}")
        errors[law.restitution] = made.choice.total + 1e-4
    steps = math.ceil(2 * max(made.duration) / made.time_step)
    places = [(-RADIUS - 1e-7, 3 * RADIUS), (RADIUS + 1e-7, 3 * RADIUS), (0.0, RADIUS + 1e-7)]
    speeds = [(0.5, 0.0), (-0.5, 0.0), (0.0, -1.0)]
    atoms = "\n".join(f"create_atoms 1 single {x!r} 0 {z!r} units box" for x, z in places)
    motions = [
        f"group g{k} id {k}\nvelocity g{k} set {vx} 0 {vz} units box"
        for k, (vx, vz) in enumerate(speeds, 1)
    ]
    scene = LIGGGHTS.replace("create_box 1", "create_box 2").replace(
        "include in.softjax", "\n".join(["variable softjax_types index 2", *lines])
    )
    numbers = {"diameter": 2 * RADIUS, "density": DENSITY, "width": 0.1, "steps": steps}
    text = scene.format(**numbers, atoms=atoms, motions="\n".join(motions))
    # of a scene before
    out = liggghts(tmp_path, text + "clear" + text.replace("out.", "again."))
    if said:
        assert said in out
        return
    assert out[-1500:] == ""
    for name in ("out", "again"):
        _, vx, vz = np.loadtxt(tmp_path / f"{name}.{steps}", skiprows=9).T
        assert abs(vx[1] - vx[0] - 0.9) <= errors[0.9]
        assert abs(vz[2] - 0.5) <= errors[0.5]


FOLLOWED = """
deepest, steps = 0.0, 0
for _ in range({steps}):
    O.step()
    ball_at, other_at = O.bodies[1].state.pos[2], O.bodies[0].state.pos[2]
    deepest = max(deepest, {reach} - (ball_at - other_at))
    steps += O.forces.f(1)[2] > 0
import json
print("RESULT", json.dumps([deepest, steps * O.dt]))
"""


@pytest.mark.codes
@MARKS["yade"][0]
@pytest.mark.parametrize("law", ["linear", "hertz-dashpot"])
@pytest.mark.parametrize("wall", [True, False])
def test_overlaps_and_contact_times_in_yade_are_those_stated(law, wall, tmp_path):
    """With the modulus of two balls they were 1.149 times as large at a wall, which has the ball's radius there."""
    source = sj.ConstantRestitution(WALL, 0.8)
    if not wall:
        source = sj.ConstantRestitution(sj.Contact.between_spheres(*STEELS, RADIUS, RADIUS), 0.8)
    options = {"law": law, "on_wall": wall, "tolerance": 0.02, "steps": 400, "gravity": 0.0}
    made = cal.export(source, "yade", tmp_path, velocity_range=(0.5, 2.0), **options)
    example = ast.get_docstring(ast.parse((tmp_path / "softjax_yade.py").read_text("utf-8")))
    example = example.replace("gravity=(0, 0, -9.81)", "gravity=(0, 0, 0)")
    impacts, middle = made.choice.impacts, 32  # 1 m/s, which the example has
    gap = 0.1 * RADIUS
    steps = round((gap / 1.0 + 2 * impacts.duration[middle]) / made.time_step)
    reach = RADIUS if wall else 2 * RADIUS
    deepest, duration = yade(tmp_path, example + FOLLOWED.format(steps=steps, reach=reach))
    assert deepest == pytest.approx(impacts.peak[middle], rel=0.01)
    assert duration == pytest.approx(impacts.duration[middle], rel=0.01)


AFTER = """
O.run(round(2*0.1*{radius}/{speed}/O.dt), True)
import json
print("RESULT", json.dumps([b.state.vel[2] for b in O.bodies] + [ball.density, O.bodies[1].shape.radius]))
"""


@pytest.mark.codes
@MARKS["yade"][0]
@pytest.mark.parametrize("law", ["linear", "hertz-dashpot"])
@pytest.mark.parametrize("wall", [True, False])
def test_the_example_of_the_file_runs_as_pasted(law, wall, tmp_path):
    """A nylon ball, 0.1 R away from a wall or from a like ball, rebounds at ε."""
    contact = sj.Contact.with_wall(sj.NYLON, wall=sj.NYLON, radius=0.004)
    if not wall:
        contact = sj.Contact.between_spheres(sj.NYLON, sj.NYLON, 0.004, 0.004)
    options = {"velocity_range": (1.0, 4.0), "law": law, "on_wall": wall, "tolerance": 0.02}
    made = cal.export(sj.ConstantRestitution(contact, 0.8), "yade", tmp_path, **options)
    example = ast.get_docstring(ast.parse((tmp_path / "softjax_yade.py").read_text("utf-8")))
    *velocity, density, radius = yade(tmp_path, example + AFTER.format(radius=0.004, speed=2.0))
    assert density == pytest.approx(float(sj.NYLON.density), rel=1e-6)
    assert radius == pytest.approx(0.004, rel=1e-6)
    found = (velocity[1] - velocity[0]) / 2.0  # gravity adds 0.1 % to the speed
    assert found == pytest.approx(0.8, abs=made.choice.total + 1e-3)
