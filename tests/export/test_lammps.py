"""LAMMPS: the input that is written for it, and the plugin alone, among many, over ranks and restarts."""

import dataclasses
import json
import math
import re
from shutil import copy2

import numpy as np
import pytest

import calibration as cal
import softjax as sj
from tests.cases import RADIUS, curve
from tests.export.lammps import (
    MOVES,
    box,
    build,
    impact,
    lammps,
    needs_lammps,
    onto_a_wall,
    output_of,
    rebounds,
)
from tests.export.laws import DENSITY, PAIR, RANGE, STEEL, VELOCITIES
from tests.export.test_numbers import time_step
from tests.physics.own_laws import Borrowed

pytestmark = needs_lammps
PLATE = sj.WaltonBraun(PAIR, 4e7, 1.5 * 4e7, 100.0)
WALL = sj.Contact.with_wall(sj.STAINLESS_STEEL, wall=sj.STAINLESS_STEEL, radius=RADIUS)
LOAD = [
    "include laws",  # ${softjax_law} and ${plate_law}
    "plugin load ./softjaxplugin.so",
    "pair_style softjax",
    "pair_coeff * * ${softjax_law}",
]


def write_names(folder) -> None:
    """The lines that name the laws of a folder, for scripts that include nothing else of its files."""
    texts = [file.read_text(encoding="utf-8") for file in sorted(folder.glob("in.*"))]
    lines = re.findall(r"^variable \w+_law string \w+$", "\n".join(texts), re.M)
    (folder / "laws").write_text("\n".join(lines) + "\n", encoding="utf-8")


@pytest.fixture(scope="module")
def plugin(tmp_path_factory):
    """A plugin of two laws, steel and `plate`, for impacts of 0.1 to 5 m/s at 100 steps."""
    folder = tmp_path_factory.mktemp("plugin")
    options = {"velocity_range": RANGE, "law": "exact", "steps": 100}
    made = cal.export(STEEL, "lammps", folder, types=(1, 1), **options)
    cal.export(PLATE, "lammps", folder, prefix="plate", types=(1, 2), **options)
    build(folder)
    write_names(folder)
    return folder, made


def measured(folder, velocities, wall=None) -> np.ndarray:
    """ε of impacts with in.softjax as it was written, onto a wall that a line states."""
    report = json.loads((folder / "export.json").read_text(encoding="utf-8"))
    steps = 2 * math.ceil(report["contact_duration"]["longest"] / report["time_step"]) + 10
    settings, of = ["include in.softjax", wall or ""], onto_a_wall if wall else impact
    return rebounds((of(v, settings, 2 * steps) for v in velocities), folder)


def with_steps(law, velocity, count):
    return [*LOAD, f"timestep {float(sj.restitution(law, velocity).duration) / count!r}"]


def test_the_plugin_gives_the_restitution_of_the_law(plugin):
    """Across periodic boundaries, at a wall, at its own time step within its tolerance, and at finer ones."""
    folder, made = plugin
    lines = [impact(v, with_steps(STEEL, v, 100), 150, at=1.0) for v in VELOCITIES]
    law = dataclasses.replace(STEEL, contact=WALL)
    wall = ["fix wall all softjax/wall ${softjax_law} zplane 0.0 NULL"]
    lines += [onto_a_wall(v, with_steps(law, v, 100) + wall, 150) for v in VELOCITIES]
    lines += [impact(1.0, with_steps(STEEL, 1.0, 2000), 3000)]
    *found, fine = rebounds(lines, folder)
    expected = [*curve(STEEL, VELOCITIES), *curve(law, VELOCITIES)]
    assert np.max(np.abs(np.array(found) - expected)) < 2e-4
    assert fine == pytest.approx(curve(STEEL, 1.0), abs=3e-7)
    found = measured(folder, made.target.velocity[::16])
    assert np.max(np.abs(found - made.target.restitution[::16])) <= made.choice.total


def test_two_pairs_of_materials_have_their_own_laws(plugin):
    """Between types by `pair_coeff`, at a wall by the wall's own law."""
    folder, _ = plugin
    text = [(folder / name).read_text(encoding="utf-8") for name in ("in.softjax", "in.plate")]
    steps = [time_step(one) for one in text]
    assert steps[0] != steps[1]
    one, other = ["include in.softjax"], ["include in.plate"]
    at_step = ["pair_coeff 2 2 ${softjax_law}", 'print "RESULT $(dt:%.17g)"']
    scripts = [of_types(1, 1, [*one, *other, *at_step]), of_types(1, 2, [*other, *one, *at_step])]
    wall = [
        *LOAD,
        "fix floor all softjax/wall ${plate_law} zplane 0.0 NULL",
        f"timestep {min(steps)}",
    ]
    scripts.append(onto_a_wall(1.0, wall, 400))
    heavy = dataclasses.replace(PLATE, contact=WALL)
    expected = [curve(law, 1.0) for law in (STEEL, PLATE, heavy)]
    found = rebounds(scripts, folder)
    np.testing.assert_allclose(found[[1, 3, 4]], expected, atol=3e-4)
    np.testing.assert_allclose(found[[0, 2]], min(steps), rtol=1e-12)  # in either order


def of_types(first: int, second: int, settings) -> list[str]:
    """An impact of two spheres of these types, of two."""
    lines = [line.replace("create_box 1", "create_box 2") for line in impact(1.0, settings, 400)]
    for k, kind in zip(
        [k for k, one in enumerate(lines) if "create_atoms" in one], (first, second), strict=True
    ):
        lines[k] = lines[k].replace("create_atoms 1", f"create_atoms {kind}")
    return lines


TAKEN = "have the law of another file; export each with --types"
SECOND = {  # the files that are included, by their options, and what is said
    "all twice": ([{}, {"prefix": "b"}], f"some types {TAKEN}"),
    "all after a pair": ([{"types": (1, 2)}, {"prefix": "b"}], f"some types {TAKEN}"),
    "a pair after all": ([{}, {"prefix": "b", "types": (1, 2)}], f"types 1 2 {TAKEN}"),
    "one pair": ([{"types": (2, 1)}, {"prefix": "b", "types": (1, 2)}], f"types 1 2 {TAKEN}"),
    "two pairs": ([{"types": (1, 1)}, {"prefix": "b", "types": (1, 2)}], ""),
    "walls": ([{"on_wall": True}, {"on_wall": True}], "fix softjax_wall is of another file"),
    "two walls": ([{"on_wall": True}, {"on_wall": True, "prefix": "b"}], ""),
    "balls and a wall": ([{}, {"on_wall": True, "prefix": "b"}], ""),
    "a wall and balls": ([{"on_wall": True, "prefix": "b"}, {}], ""),
}


@pytest.mark.parametrize("case", SECOND)
def test_no_file_sets_what_another_one_set(case, tmp_path):
    """The second one of `* *` and `1 2`, in either order, and the second wall acted for both."""
    files, said = SECOND[case]
    lines = []
    for k, (options, restitution) in enumerate(zip(files, (0.9, 0.8), strict=True)):
        law = sj.ConstantRestitution(PAIR, restitution)
        cal.export(
            law, "lammps", tmp_path / str(k), velocity_range=RANGE, tolerance=0.05, **options
        )
        lines.append(f"include {k}/in.{options.get('prefix', 'softjax')}")
    code, out = output_of([*of_types(1, 1, lines)[:-4]], tmp_path)
    if said:
        assert code != 0
        assert f"Unknown command: softjax: {said}" in out
    else:
        assert code == 0, out[-2000:]


def test_a_stale_or_foreign_library_does_not_answer(plugin, tmp_path):
    """A law of other numbers under the same prefix: 0.913 for 0.898 of another folder, 0.897 for 0.954 of before."""
    folder = plugin[0]
    cal.export(PLATE, "lammps", tmp_path, velocity_range=RANGE, law="exact", steps=100)
    copy2(folder / "softjaxplugin.so", tmp_path)  # of before
    code, out = output_of(impact(1.0, ["include in.softjax"], 1), tmp_path)
    assert code != 0
    assert "which has plate_" in out
    assert "build it again by build.sh" in out
    other = ["include in.softjax", f"shell cd {tmp_path}", "include in.softjax"]
    code, out = output_of(impact(1.0, [*LOAD, *other[1:]], 1), folder)
    assert code != 0
    assert "laws of one script go into one folder, each with a --prefix" in out


def gas(steps: int = 600) -> list[str]:
    """1000 spheres at a volume fraction of 0.43 with relative velocities of metres a second."""
    momentum = "".join(f" $(vcm(all,{axis})*mass(all):%.17g)" for axis in "xyz")
    return [
        *box("p p p", "0 10 0 10 0 10", ["lattice sc 0.0270"]),
        "create_atoms 1 box",
        f"set group all diameter {2 * RADIUS} density {DENSITY}",
        "velocity all create 1.0 12345 dist uniform rot no",
        "velocity all scale 5.0e21",
        *LOAD,
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
    return np.loadtxt(folder / "gas.dump", skiprows=9)[:, 1:]


def test_a_gas_conserves_its_momentum_and_is_the_same_by_two_processes(plugin):
    folder, _ = plugin
    before, after, contacts = lammps(gas(), folder)
    alone = states(folder)
    assert contacts[0] > 30
    speed = np.sqrt(np.mean(np.sum(alone[:, 3:] ** 2, axis=1)))
    assert 0.1 < speed < 5
    mass = DENSITY * 4 / 3 * np.pi * RADIUS**3
    assert np.max(np.abs(after - before)) < 1e-10 * 1000 * mass * speed
    _, _, by_two = lammps(gas(), folder, ranks=2)
    assert by_two == contacts
    np.testing.assert_allclose(states(folder), alone, atol=1e-9)


def meeting(x: float, y: float, velocity: float, drift_x: float, drift_y: float) -> list[str]:
    """Two spheres just before their impact in a periodic box, that drift meanwhile."""
    gap = RADIUS * (1 + 1e-9)
    return [
        *box("p p p", "-.1 .1 -.1 .1 -.1 .1"),
        f"create_atoms 1 single {x - gap!r} {y} 0",
        f"create_atoms 1 single {x + gap!r} {y} 0",
        f"set group all diameter {2 * RADIUS} density {DENSITY} vy {drift_y}",
        f"set atom 1 vx {drift_x + velocity / 2!r}",
        f"set atom 2 vx {drift_x - velocity / 2!r}",
        *LOAD,
        *MOVES,
        "neighbor 1e-4 bin",
        "neigh_modify every 1 delay 0 check yes",
    ]


STATED = 'print "RESULT $(vx[1]:%.17g) $(vx[2]:%.17g) $(x[1]:%.17g)"'


@pytest.mark.parametrize(
    ("at", "ranks"),  # loading and unloading
    [(20, 2), (75, 1), *(pytest.param(*row, marks=pytest.mark.long) for row in ((20, 1), (75, 2)))],
)
def test_a_restart_in_mid_contact_changes_nothing(at, ranks, plugin):
    """By one process, or of two, of which the first has no contact, the second two spheres that touch."""
    folder, step = plugin[0], f"timestep {float(sj.restitution(STEEL, 5.0).duration) / 100!r}"
    place = (0, 0.0995, 5.0, 20.0, 20.0) if ranks == 1 else (0.05, 0, 5.0, 0.0, 0.0)
    start = [f"processors {ranks} 1 1", *meeting(*place), step]
    (whole,) = lammps([*start, "run 150", STATED], folder, ranks)
    lammps([*start, f"run {at}", "write_restart mid.restart"], folder, ranks)  # between runs
    lammps([*start, f"restart {at} during.*", f"run {at + 3}"], folder, ranks)  # and during one
    law = start[start.index(LOAD[0]) :]
    for name in ("mid.restart", f"during.{at}"):
        again = ["atom_modify map array", "newton off", f"read_restart {name}", *law]
        (found,) = lammps([*again, f"run {150 - at}", STATED], folder, 3 - ranks)
        np.testing.assert_allclose(found, whole, rtol=0, atol=1e-13)


POUR = (
    f"fix more all pour 200 1 4711 region above vol 0.2 50 dens {DENSITY} {DENSITY} "
    f"vel -.5 .5 -.5 .5 -2 diam poly 2 {2 * RADIUS} 0.5 {RADIUS} 0.5"
)
LARGER = (
    f'"create_atoms 1 single 0 0 .1" "set atom $(atoms) diameter {2 * RADIUS} density {DENSITY}"'
)
FILLED = {  # how, and how many spheres there are in the end
    "pour": ([POUR, "run 20000"], 200),
    "creation during a run": (
        [
            f"create_atoms 1 single 0 0 {RADIUS / 2 + 1e-5}",
            f"set group all diameter {RADIUS} density {DENSITY}",
            f"run 5000 every 5000 {LARGER}",
            "run 35000",
        ],
        2,
    ),
}


@pytest.mark.parametrize("how", FILLED)
def test_a_box_is_filled(how, plugin):
    """From nothing or by smaller spheres: none is lost, none falls through; warnings at the end."""
    fills, count = FILLED[how]
    lines = [
        *box("p p f", "-.15 .15 -.15 .15 0 .6"),
        "region above block -.13 .13 -.13 .13 .05 .35",
        *LOAD,
        "fix floor all softjax/wall ${plate_law} zplane 0.0 NULL",
        "timestep 4e-6",
        *MOVES,
        "fix down all gravity 9.81 vector 0 0 -1",
        "neighbor 2e-3 bin",
        *fills,
        "write_dump all custom filled.dump x y z radius modify format float %20.15g",
    ]
    code, out = output_of(lines, plugin[0])
    assert code == 0, out[-2000:]
    *place, radius = np.loadtxt(plugin[0] / "filled.dump", skiprows=9).T
    assert len(radius) == count
    assert np.all(place[2] > 0.9 * radius)
    assert np.min(place[2]) < 0.3
    apart = np.array([np.subtract.outer(one, one) for one in place])
    apart[:2] -= 0.3 * np.round(apart[:2] / 0.3)
    least = 0.9 * np.add.outer(radius, radius)[np.triu_indices(count, 1)]
    assert np.all(np.linalg.norm(apart, axis=0)[np.triu_indices(count, 1)] > least)
    assert "impacts were outside the velocities of their softjax law" in out
    assert "times the one that a softjax law was tested with" in out


ACROSS = "fix floor all softjax/wall ${softjax_law} zplane 0.0 NULL\npair_style softjax"


@pytest.mark.parametrize(
    ("line", "other", "message"),
    [
        ("units si", "units cgs", "The laws of softjax need units si"),
        ("newton off", "newton on", "The laws of softjax need newton off"),
        ("block -1 1 -1 1", f"block -1 1 -0.02 {RADIUS}", "longer than two diameters"),
        ("run 1", "minimize 1e-4 1e-6 10 10", "need time: run, not minimize"),
        ("* * ${softjax_law}", "* * brass", "No law brass in the softjax plugin that was loaded"),
        ("pair_style softjax", ACROSS, "Fix softjax/wall cannot be across a periodic axis"),
    ],
)
def test_what_the_plugin_cannot_do_is_refused(line, other, message, plugin):
    text = "\n".join(impact(1.0, [*LOAD, "timestep 1e-6"], 1, at=1.0))
    assert line in text
    code, output = output_of(text.replace(line, other).splitlines(), plugin[0])
    assert code != 0
    assert message in output


@pytest.mark.long
def test_a_table_is_of_one_pair_of_sizes(tmp_path):
    law = Borrowed(PAIR, sj.Thornton(PAIR, 2.8))
    cal.export(law, "lammps", tmp_path, velocity_range=RANGE, law="exact", steps=100)
    build(tmp_path)
    write_names(tmp_path)
    settings = [*LOAD, "timestep 1e-6"]
    (found,) = lammps(impact(1.0, settings, 300), tmp_path)
    assert found[0] == pytest.approx(curve(law, 1.0), abs=1e-3)
    larger = impact(1.0, [*settings, "set group all diameter 0.026"], 300)
    assert "a table for one pair of sizes" in output_of(larger, tmp_path)[1]
