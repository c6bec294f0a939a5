"""LAMMPS: what it makes of its own input, and of the input that is written for it."""

import json
import math
import re

import numpy as np
import pytest

import calibration as cal
import softjax as sj
from tests.cases import RADIUS
from tests.export.lammps import build, impact, needs_lammps, onto_a_wall, rebounds
from tests.export.laws import PAIR, STEEL, VELOCITIES

pytestmark = needs_lammps
TIME = 2e-6  # s
long = pytest.mark.long


def measured(folder, velocities, wall=None):
    """ε of impacts with in.softjax as it was written, onto a wall that a line tells."""
    report = json.loads((folder / "export.json").read_text(encoding="utf-8"))
    steps = 2 * math.ceil(report["contact_duration"]["longest"] / report["time_step"]) + 10
    settings, of = ["include in.softjax", wall or ""], onto_a_wall if wall else impact
    return rebounds((of(v, settings, 2 * steps) for v in velocities), folder)


@long
@pytest.mark.parametrize(
    ("law", "tolerance"), [("linear", 0.08), ("hertz-dashpot", 0.08), ("viscoelastic", 0.03)]
)
def test_input_that_is_written_keeps_its_tolerance(law, tolerance, tmp_path):
    made = cal.export(
        STEEL, "lammps", tmp_path, velocity_range=(0.1, 5), law=law, tolerance=tolerance
    )  # fmt: skip
    velocity = made.target.velocity[::16]
    found = measured(tmp_path, velocity)
    assert np.max(np.abs(found - made.target.restitution[::16])) <= tolerance
    given = made.choice.impacts.coefficient[::16]
    assert np.max(np.abs(found - given)) <= made.choice.steps.error + 1e-6


@long
@pytest.mark.parametrize("law", ["hertz-dashpot", "linear"])
def test_the_line_that_is_written_for_a_wall(law, tmp_path):
    made = cal.export(
        STEEL, "lammps", tmp_path, velocity_range=(0.1, 5), law=law, tolerance=0.1, steps=400
    )
    text = (tmp_path / "in.softjax").read_text(encoding="utf-8")
    (line,) = re.findall(r"^# (fix ID .*)$", text, re.M)
    found = measured(tmp_path, VELOCITIES, line.replace("fix ID group", "fix wall all"))
    np.testing.assert_allclose(found, made.choice.impacts.coefficient[0], atol=1e-3)


@long
def test_what_was_wanted_of_a_wall_comes_out_at_a_wall(tmp_path):
    """Its damping is told for the mass of a ball on a wall, and its line acts as it stands."""
    steel = sj.STAINLESS_STEEL
    wall = sj.Contact.with_wall(steel, wall=steel, radius=RADIUS)
    law, options = sj.ViscoelasticHertz(wall, TIME), {"velocity_range": (0.1, 5), "steps": 400}
    made = cal.export(law, "lammps", tmp_path, on_wall=True, tolerance=0.01, **options)
    found = measured(tmp_path, VELOCITIES, "# as it was written")
    wanted = sj.restitution(law, np.array(VELOCITIES)).coefficient
    assert made.choice.key == "viscoelastic"
    np.testing.assert_allclose(found, wanted, atol=1e-3)


@pytest.fixture(scope="module")
def plugin(tmp_path_factory):
    """A folder with the plugin of steel, built, for impacts of 0.1 to 5 m/s at 100 steps."""
    folder = tmp_path_factory.mktemp("plugin")
    made = cal.export(STEEL, "lammps", folder, velocity_range=(0.1, 5), law="exact", steps=100)
    build(folder)
    return folder, made


LOAD = ["plugin load ./softjaxplugin.so", "pair_style softjax", "pair_coeff * * softjax"]


def with_steps(law, velocity, count):
    """Settings for a number of steps in this impact's contact."""
    duration = float(sj.restitution(law, velocity).duration)
    return [*LOAD, f"timestep {duration / count!r}"]


@pytest.mark.parametrize(
    "options",
    [
        pytest.param({}, marks=long),
        {"at": 1.0},
    ],
    ids=["plain", "periodic"],
)
def test_the_plugin_gives_the_restitution_of_the_law(plugin, options):
    lines = [impact(v, with_steps(STEEL, v, 100), 150, **options) for v in VELOCITIES]
    found = rebounds(lines, plugin[0])
    wanted = [float(sj.restitution(STEEL, v).coefficient) for v in VELOCITIES]
    assert np.max(np.abs(found - wanted)) < 2e-4


def test_the_plugin_keeps_the_tolerance_at_its_time_step_and_more_at_finer_ones(plugin):
    folder, made = plugin
    found = measured(folder, made.target.velocity[::16])
    assert np.max(np.abs(found - made.target.restitution[::16])) <= made.choice.total
    (fine,) = rebounds([impact(1.0, with_steps(STEEL, 1.0, 2000), 3000)], folder)
    assert fine == pytest.approx(float(sj.restitution(STEEL, 1.0).coefficient), abs=3e-7)


def test_a_sphere_bounces_off_a_wall(plugin):
    wall = sj.Contact.with_wall(sj.STAINLESS_STEEL, wall=sj.STAINLESS_STEEL, radius=RADIUS)
    law = sj.Zhou(wall, STEEL.chi, STEEL.sigma, STEEL.psi)
    extra = ["fix wall all softjax/wall softjax zplane 0.0 NULL"]
    lines = [onto_a_wall(v, with_steps(law, v, 100) + extra, 150) for v in VELOCITIES]
    found = rebounds(lines, plugin[0])
    wanted = [float(sj.restitution(law, v).coefficient) for v in VELOCITIES]
    assert np.max(np.abs(found - wanted)) < 2e-4


@long
@pytest.mark.parametrize("law", ["exact", "walton-braun"])
def test_other_laws_by_the_plugin_keep_their_tolerance(law, tmp_path):
    source = STEEL if law == "walton-braun" else sj.ViscoelasticHertz(PAIR, 2e-6)
    made = cal.export(
        source, "lammps", tmp_path, velocity_range=(0.1, 5), law=law, tolerance=0.02, overlap=0.03
    )
    assert made.choice.backend.name == "header"
    build(tmp_path)
    found = measured(tmp_path, made.target.velocity[::16])
    assert np.max(np.abs(found - made.target.restitution[::16])) <= made.choice.total <= 0.02
