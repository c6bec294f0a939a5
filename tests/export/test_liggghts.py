"""LIGGGHTS: what it makes of its own input, and of the input that is written for it."""

import math
import os
import re
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
    pytest.mark.skipif(shutil.which("liggghts") is None, reason="no LIGGGHTS"),
]


def impact(velocity: float, settings: list[str], steps: int) -> str:
    """Two equal spheres head-on, whose ε is printed; `settings` tell force and time step."""
    velocity, gap = float(velocity), RADIUS * (1 + 1e-9)
    lines = [
        "atom_style granular",
        "atom_modify map array",
        "boundary f f f",
        "newton off",
        "communicate single vel yes",
        "units si",
        "hard_particles yes",
        "region box block -0.2 0.2 -0.2 0.2 -0.2 0.2 units box",
        "create_box 1 box",
        "neighbor 0.001 bin",
        "neigh_modify delay 0",
        *settings,
        f"create_atoms 1 single {-gap!r} 0 0 units box",
        f"create_atoms 1 single {gap!r} 0 0 units box",
        f"set group all density {DENSITY} diameter {2 * RADIUS}",
        "group a id 1",
        "group b id 2",
        f"velocity a set {velocity / 2} 0 0 units box",
        f"velocity b set {-velocity / 2} 0 0 units box",
        "fix move all nve/sphere",
        f"run {steps}",
        "variable one equal vx[1]",
        "variable two equal vx[2]",
        f"variable e equal (v_two-v_one)/{velocity}",
        'print "RESULT ${e}"',
    ]
    return "\n".join(lines) + "\n"


def onto_a_wall(velocity: float, settings: list[str], steps: int) -> str:
    """The same of one sphere that falls on a wall at z = 0 without gravity."""
    text = impact(velocity, settings, steps)
    first, second = re.findall(r"^create_atoms .*\n", text, re.M)
    text = text.replace(first, f"create_atoms 1 single 0 0 {RADIUS * (1 + 1e-9)!r} units box\n")
    text = re.sub(r"^(group|velocity|variable) .*\n", "", text.replace(second, ""), flags=re.M)
    fall, rise = f"velocity all set 0 0 {-velocity} units box\n", "variable up equal vz[1]\n"
    text = text.replace("fix move", f"{fall}fix move")
    return text.replace("print", f"{rise}variable e equal v_up/{velocity}\nprint")


def rebounds(folder, velocities, settings, steps, impact=impact) -> np.ndarray:
    """ε of impacts; `settings` and `steps` of each."""
    environment = {k: v for k, v in os.environ.items() if k != "LD_LIBRARY_PATH"}
    found = []
    for velocity, own, count in zip(velocities, settings, steps, strict=True):
        (folder / "in.test").write_text(impact(velocity, own, count), encoding="utf-8")
        command = ["liggghts", "-in", "in.test", "-log", "none"]
        ended = subprocess.run(command, cwd=folder, env=environment, capture_output=True)
        said = ended.stdout.decode(errors="replace")
        printed = re.findall(r"^RESULT (\S+)", said, re.M)
        assert printed, said[-1000:]
        found.append(float(printed[0]))
    return np.array(found)


every_law = pytest.mark.parametrize("law", ["linear", "hertz-dashpot", "walton-braun"])


@every_law
def test_input_that_is_written_keeps_its_tolerance(law, tmp_path):
    tolerance = 0.08
    made = cal.export(
        STEEL, "liggghts", tmp_path, velocity_range=(0.1, 5), law=law, tolerance=tolerance
    )
    velocity = made.target.velocity[::16]
    steps = 2 * math.ceil(max(made.duration) / made.time_step) + 10
    found = rebounds(tmp_path, velocity, [["include in.softjax"]] * 5, [steps] * 5)
    assert np.max(np.abs(found - made.target.restitution[::16])) <= tolerance
    given = made.choice.impacts.coefficient[::16]
    assert np.max(np.abs(found - given)) <= made.choice.steps.error + 1e-4


@every_law
def test_what_was_wanted_of_a_wall_comes_out_at_a_wall(law, tmp_path):
    steel = sj.STAINLESS_STEEL
    wall = sj.Contact.with_wall(steel, wall=steel, radius=RADIUS)
    asked = sj.Zhou(wall, STEEL.chi, STEEL.sigma, STEEL.psi)
    options = {"velocity_range": (0.5, 2), "law": law, "tolerance": 0.08, "on_wall": True}
    made = cal.export(asked, "liggghts", tmp_path, **options)
    velocity, given = made.target.velocity[::16], made.choice.impacts.coefficient[::16]
    steps = 2 * math.ceil(max(made.duration) / made.time_step) + 10
    lines = [["include in.softjax"]] * 5
    found = rebounds(tmp_path, velocity, lines, [steps] * 5, onto_a_wall)
    assert np.max(np.abs(found - given)) <= made.choice.steps.error + 1e-4
