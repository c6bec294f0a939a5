"""MuJoCo by the stiffness and the damping ratio of the C header of a linear spring, as the page of particle codes has it."""

import importlib.util
import math
import os
import re
from pathlib import Path

import numpy as np
import pytest

import calibration as cal
import softjax as sj
from tests.cases import RADIUS
from tests.export.laws import DENSITY, PAIR, RANGE

pytestmark = pytest.mark.skipif(
    "SOFTJAX_TEST_EXTRAS" not in os.environ and importlib.util.find_spec("mujoco") is None,
    reason="no MuJoCo: pip install softjax-contact[export-test]",
)
PAGES = Path(__file__).parents[2] / "notebooks" / "reference"
WALL = sj.Contact.with_wall(sj.STAINLESS_STEEL, wall=sj.STAINLESS_STEEL, radius=RADIUS)
BALL = f'<freejoint/><geom type="sphere" size="{RADIUS}" density="{DENSITY}"/>'
OTHER = {
    "a wall": '<geom type="plane" size="1 1 1"/>',
    "a ball": f'<body pos="0 0 {-RADIUS}">{BALL}</body>',
}
SCENE = """<mujoco>
<option timestep="{step!r}" gravity="0 0 0" integrator="Euler"/>
<default><geom {settings}/></default>
<worldbody>{other}<body pos="0 0 {height!r}">{ball}</body></worldbody>
</mujoco>"""


@pytest.mark.parametrize("other", OTHER)
def test_solref_of_the_header_gives_the_stated_restitution(other, tmp_path):
    """ε of 0.80 to 0.81 where 0.8 ± 0.011 is stated, at 20 steps in a contact and at all beginnings."""
    import mujoco

    contact = WALL if other == "a wall" else PAIR
    law, options = sj.ConstantRestitution(contact, 0.8), {"law": "linear", "tolerance": 0.02}
    made = cal.export(law, "c", tmp_path, velocity_range=RANGE, gravity=0.0, **options)
    text = (tmp_path / "softjax_law.h").read_text(encoding="utf-8")
    pattern = r"define SOFTJAX_(STIFFNESS|DAMPING) \(\(softjax_real\)(\S+?)\)"
    found = {name: float(value) for name, value in re.findall(pattern, text)}
    rate = math.sqrt(found["STIFFNESS"] / float(contact.mass))  # √(K/M) [1/s]
    page = (PAGES / "particle_codes.md").read_text(encoding="utf-8")
    (row,) = (line for line in page.splitlines() if line.startswith("| MuJoCo |"))
    settings = dict(re.findall(r'`(\w+) = "(.*?)"`', row))
    assert settings["solref"] == "-K/M -2ξ√(K/M)"
    settings["solref"] = f"{-(rate**2)!r} {-2 * found['DAMPING'] * rate!r}"
    of_geoms = " ".join(f'{name}="{value}"' for name, value in settings.items())
    obtained = []
    for phase in (np.arange(8) / 8).tolist():
        for velocity in (0.1, 5.0):
            gap = (phase + 0.01) * velocity * made.time_step
            numbers = {"step": made.time_step, "settings": of_geoms, "height": RADIUS + gap}
            scene = SCENE.format(other=OTHER[other], ball=BALL, **numbers)
            model = mujoco.MjModel.from_xml_string(scene)
            state = mujoco.MjData(model)
            state.qvel[-4] = -velocity
            for _ in range(3 * made.choice.steps.count):
                mujoco.mj_step(model, state)
            below = 0.0 if other == "a wall" else state.qvel[2]
            obtained.append((state.qvel[-4] - below) / velocity)
    off = np.max(np.abs(np.array(obtained) - 0.8))
    assert 0.3 * made.choice.total < off <= made.choice.total + 1e-4
