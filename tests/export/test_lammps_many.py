"""The LAMMPS plugin among many spheres: momentum, processors, restarts, what it refuses."""

import dataclasses
import re
import subprocess

import numpy as np
import pytest

import calibration as cal
import softjax as sj
from tests.cases import RADIUS
from tests.export.lammps import (
    ENVIRONMENT,
    MOVES,
    NEEDED,
    SPHERES,
    build,
    impact,
    lammps,
    needs_lammps,
    onto_a_wall,
)
from tests.export.laws import DENSITY, PAIR, STEEL
from tests.physics.own_laws import Borrowed

pytestmark = needs_lammps
long = pytest.mark.long
LOAD = ["plugin load ./softjaxplugin.so", "pair_style softjax", "pair_coeff * * softjax"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """With the plugin of steel, built."""
    folder = tmp_path_factory.mktemp("plugin")
    cal.export(STEEL, "lammps", folder, velocity_range=(0.1, 5), law="exact", steps=100)
    build(folder)
    return folder


def gas(settings, steps: int = 800) -> list[str]:
    """4096 spheres at a volume fraction of 0.43 with relative velocities of metres a second."""
    momentum = "".join(f" $(vcm(all,{axis})*mass(all):%.17g)" for axis in "xyz")
    return [
        *SPHERES,
        "boundary p p p",
        "newton off",
        "lattice sc 0.0270",
        "region box block 0 16 0 16 0 16",
        "create_box 1 box",
        "create_atoms 1 box",
        f"set group all diameter {2 * RADIUS} density {DENSITY}",
        "velocity all create 1.0 12345 dist uniform rot no",
        "velocity all scale 5.0e21",
        *settings,
        *MOVES,
        "timestep 1e-6",
        "neighbor 2e-3 bin",
        "run 0",
        f'print "RESULT{momentum}"',
        f"run {steps}",
        f'print "RESULT{momentum}"',
        "compute touching all contact/atom",
        "compute contacts all reduce sum c_touching",
        "run 0",
        'print "RESULT $(c_contacts)"',
        "write_dump all custom gas.dump id x y z vx vy vz modify sort id format float %20.15g",
    ]


def states(folder) -> np.ndarray:
    """Positions and velocities in the order of their IDs."""
    return np.loadtxt(folder / "gas.dump", skiprows=9)[:, 1:]


@pytest.fixture(scope="module")
def alone(folder):
    """The gas by one process."""
    before, after, contacts = lammps(gas(LOAD), folder)
    return before, after, contacts, states(folder)


def test_a_gas_conserves_its_momentum(alone):
    before, after, contacts, state = alone
    assert contacts[0] > 100
    speed = np.sqrt(np.mean(np.sum(state[:, 3:] ** 2, axis=1)))
    assert 0.1 < speed < 5
    mass = DENSITY * 4 / 3 * np.pi * RADIUS**3
    assert np.max(np.abs(after - before)) < 1e-10 * 4096 * mass * speed


def test_a_gas_is_the_same_by_two_processes(alone, folder):
    _, _, contacts = lammps(gas(LOAD), folder, ranks=2)
    assert contacts == alone[2]
    np.testing.assert_allclose(states(folder), alone[3], atol=1e-9)


def crossing(drift: float) -> list[str]:
    """Two spheres meet where processors do, at x = 0, and drift across meanwhile."""
    duration = float(sj.restitution(STEEL, 1.0).duration)
    start = -drift * duration / 2  # so that half of the contact is on each side
    gap = RADIUS * (1 + 1e-9)
    return [
        *SPHERES,
        "processors * 1 1",
        "boundary p p p",
        "newton off",
        "region box block -.1 .1 -.1 .1 -.1 .1",
        "create_box 1 box",
        f"create_atoms 1 single {start - gap!r} 0 0",
        f"create_atoms 1 single {start + gap!r} 0 0",
        f"set group all diameter {2 * RADIUS} density {DENSITY}",
        f"set atom 1 vx {drift + 0.5!r}",
        f"set atom 2 vx {drift - 0.5!r}",
        *LOAD,
        *MOVES,
        f"timestep {duration / 400!r}",
        "neighbor 1e-4 bin",
        "neigh_modify every 1 delay 0 check yes",
        "run 600",
        "variable e equal vx[2]-vx[1]",
        'print "RESULT $(v_e:%.15g)"',
    ]


@pytest.mark.parametrize(
    "drift", [300.0, *(pytest.param(d, marks=long) for d in (0.0, -300.0))]
)  # at 300 both change their processor
def test_a_contact_that_crosses_the_boundary_of_two_processes(drift, folder):
    wanted = float(sj.restitution(STEEL, 1.0).coefficient)
    (found,) = lammps(crossing(drift), folder, ranks=2)
    assert found[0] == pytest.approx(wanted, abs=1e-5)


def in_periodic_box(velocity: float) -> list[str]:
    """Two spheres before their impact, near a boundary that they drift across during it."""
    gap, drift = RADIUS * (1 + 1e-9), 20.0
    return [
        *SPHERES,
        "boundary p p p",
        "newton off",
        "region box block -.1 .1 -.1 .1 -.1 .1",
        "create_box 1 box",
        f"create_atoms 1 single {-gap!r} 0.0995 0",
        f"create_atoms 1 single {gap!r} 0.0995 0",
        f"set group all diameter {2 * RADIUS} density {DENSITY}",
        f"set group all vy {drift}",
        f"set atom 1 vx {velocity / 2 + drift!r}",
        f"set atom 2 vx {-velocity / 2 + drift!r}",
    ]


@pytest.mark.parametrize(  # loading, at the peak, unloading
    "at", [pytest.param(20, marks=long), pytest.param(45, marks=long), 75]
)
def test_a_restart_in_mid_contact_changes_nothing(at, folder):
    velocity, told = 5.0, 'print "RESULT $(vx[1]:%.17g) $(vx[2]:%.17g) $(x[1]:%.17g)"'
    duration = float(sj.restitution(STEEL, velocity).duration)
    law = [*LOAD, *MOVES, f"timestep {duration / 100!r}", "neighbor 1e-4 bin"]
    law += ["neigh_modify every 1 delay 0 check yes"]
    start = [*in_periodic_box(velocity), *law]
    (whole,) = lammps([*start, "run 150", told], folder)
    lammps([*start, f"run {at}", "write_restart mid.restart"], folder)  # between runs
    lammps([*start, f"restart {at} during.*", f"run {at + 3}"], folder)  # and during one
    for name in ("mid.restart", f"during.{at}"):
        again = ["atom_modify map array", "newton off", f"read_restart {name}", *law]
        (found,) = lammps([*again, f"run {150 - at}", told], folder)
        np.testing.assert_allclose(found, whole, rtol=0, atol=1e-13)


def output_of(lines, folder) -> str:
    """What LAMMPS prints of a run."""
    (folder / "in.run").write_text("\n".join(lines) + "\n", encoding="utf-8")
    command = [NEEDED[2], "-in", "in.run", "-log", "none"]
    ended = subprocess.run(command, cwd=folder, env=ENVIRONMENT, capture_output=True, text=True)
    assert ended.returncode == 0
    return ended.stdout + ended.stderr


def error_of(lines, folder) -> str:
    """What LAMMPS says where it stops."""
    (folder / "in.error").write_text("\n".join(lines) + "\n", encoding="utf-8")
    command = [NEEDED[2], "-in", "in.error", "-log", "none"]
    ended = subprocess.run(command, cwd=folder, env=ENVIRONMENT, capture_output=True, text=True)
    assert ended.returncode != 0
    return ended.stdout + ended.stderr


def test_it_will_not_load_into_another_version(folder, tmp_path):
    cal.export(STEEL, "lammps", tmp_path, velocity_range=(0.1, 5), law="exact", steps=100)
    build(tmp_path, LAMMPS_VERSION="20220101")
    said = error_of(impact(1.0, LOAD, 1), tmp_path)
    assert "softjax plugin was built for LAMMPS 20220101" in said


def test_a_periodic_box_of_less_than_two_diameters_is_refused(folder):
    lines = impact(1.0, [*LOAD, "timestep 1e-6"], 1, at=1.0)
    small = [line.replace("block -1 1 -1 1", f"block -1 1 -0.02 {RADIUS}") for line in lines]
    assert "longer than two diameters" in error_of(small, folder)


@long
def test_a_table_is_of_one_pair_of_sizes(tmp_path):
    options = {"velocity_range": (0.1, 5), "law": "exact", "steps": 100}
    law = Borrowed(PAIR, sj.Thornton(PAIR, 2.8))
    cal.export(law, "lammps", tmp_path, **options)
    build(tmp_path)
    settings = [*LOAD, "timestep 1e-6"]
    (found,) = lammps(impact(1.0, settings, 300), tmp_path)
    wanted = float(sj.restitution(law, 1.0).coefficient)
    assert found[0] == pytest.approx(wanted, abs=1e-3)
    said = error_of(impact(1.0, [*settings, "set group all diameter 0.026"], 300), tmp_path)
    assert "a table for one pair of sizes" in said


SCENE = {  # prefix: law, its types and velocities
    "ball_ball": STEEL,
    "ball_plate": sj.WaltonBraun(PAIR, 4e7, 1.5 * 4e7, 100.0),
}


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    """Two laws of one folder in one plugin."""
    folder = tmp_path_factory.mktemp("scene")
    for k, (prefix, law) in enumerate(SCENE.items(), 1):
        options = {"law": "exact", "steps": 100, "prefix": prefix, "types": (1, k)}
        cal.export(law, "lammps", folder, velocity_range=(0.1, 5), **options)
    build(folder)
    return folder


def test_two_pairs_of_materials_have_their_own_laws(scene):
    """Between types by `pair_coeff`, at a wall by the wall's own law."""
    text = [(scene / f"in.{prefix}").read_text(encoding="utf-8") for prefix in SCENE]
    assert "\npair_coeff 1 1 ball_ball\n" in text[0]
    assert "\npair_coeff 1 2 ball_plate\n" in text[1]
    steps = min(float(re.search(r"^timestep (\S+)", one, re.M)[1]) for one in text)
    both = ["include in.ball_ball", "include in.ball_plate", "pair_coeff 2 2 ball_ball"]
    lines = impact(1.0, [*both, f"timestep {steps}"], 400)
    lines = [line.replace("create_box 1", "create_box 2") for line in lines]
    for second, law in (("1", STEEL), ("2", SCENE["ball_plate"])):
        typed = [line.replace(f"create_atoms 1 single {RADIUS * (1 + 1e-9)!r}", f"create_atoms {second} single {RADIUS * (1 + 1e-9)!r}") for line in lines]  # fmt: skip
        (found,) = lammps(typed, scene)
        wanted = float(sj.restitution(law, 1.0).coefficient)
        assert found[0] == pytest.approx(wanted, abs=3e-4)
    wall = onto_a_wall(1.0, [*LOAD, "fix floor all softjax/wall ball_plate zplane 0.0 NULL", f"timestep {steps}"], 400)  # fmt: skip
    (found,) = lammps([line.replace("* * softjax", "* * ball_ball") for line in wall], scene)
    one = SCENE["ball_plate"]
    heavy = dataclasses.replace(one, contact=sj.Contact.with_wall(sj.STAINLESS_STEEL, wall=sj.STAINLESS_STEEL, radius=RADIUS))  # fmt: skip
    assert found[0] == pytest.approx(float(sj.restitution(heavy, 1.0).coefficient), abs=3e-4)
    said = error_of(impact(1.0, [*LOAD[:2], "pair_coeff * * brass", "timestep 1e-6"], 1), scene)
    assert "No law brass in this softjax plugin; it has ball_ball ball_plate" in said


def pouring(settings) -> list[str]:
    """An empty box, into which spheres of two sizes are poured onto a floor."""
    return [
        *SPHERES,
        "boundary p p f",
        "newton off",
        "region box block -.15 .15 -.15 .15 0 .6",
        "create_box 1 box",
        "region above block -.15 .15 -.15 .15 .05 .35",
        *settings,
        "fix move all nve/sphere",
        "fix down all gravity 9.81 vector 0 0 -1",
        f"fix pour all pour 200 1 4711 region above vol 0.2 50 dens {DENSITY} {DENSITY} "
        f"vel -.5 .5 -.5 .5 -2 diam poly 2 {2 * RADIUS} 0.5 {RADIUS} 0.5",
        "neighbor 2e-3 bin",
        "thermo 100000",
        "run 20000",
        'print "RESULT $(atoms) $(bound(all,zmin))"',
    ]


def test_a_box_is_filled_by_pouring(scene):
    """From nothing, with spheres larger than those that are there: none is lost, none falls through."""
    laws = ["plugin load ./softjaxplugin.so", "pair_style softjax", "pair_coeff * * ball_ball"]
    wall = "fix floor all softjax/wall ball_plate zplane 0.0 NULL"
    lines = pouring([*laws, wall, "timestep 4e-6"])
    (found,) = lammps(lines, scene)
    assert found[0] == 200
    assert 0.9 * RADIUS / 2 < found[1] < 0.3
    ended = output_of(lines, scene)
    assert "impacts were outside the velocities of their softjax law" in ended
    assert "times the one that a softjax law was tested with" in ended


@pytest.mark.parametrize(("line", "told"), [("units si", "units cgs"), ("newton off", "newton on")])
def test_what_the_plugin_cannot_do_is_refused(line, told, folder):
    lines = impact(1.0, [*LOAD, "timestep 1e-6"], 1)
    assert line in lines
    said = error_of([told if one == line else one for one in lines], folder)
    assert f"The laws of softjax need {line}" in said
