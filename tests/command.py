"""Command lines run in this process, and a material file to run them on."""

import contextlib
import io
from dataclasses import replace

import numpy as np

import calibration as cal
import softjax as sj
from calibration import cli
from tests.cases import RADIUS, pair

BODIES = """[[material]]
name = "alloy"
youngs_modulus = 2.5e9
poisson_ratio = 0.3
density = 1140
yield_strength = 4.0e7
radius = 0.0127
"""
ALLOY = f"""
[fit]
{{settings}}
{BODIES.replace('"alloy"', '"my alloy"')}data = "my_alloy.csv"
[material.parameters]
{{below}}
"""


def run(*argv) -> tuple[int, str, str]:
    """Exit code, standard output and standard error of one command line."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            code = cli.main([str(word) for word in argv])
        except SystemExit as stop:  # of help, and of what the parser refuses
            code = int(stop.code or 0)
    return code, out.getvalue(), err.getvalue()


def noisy(uncertainty=0.01, name="my alloy", yield_strength=4.0e7) -> cal.RestitutionData:
    """24 impacts over two decades on both sides of first yield."""
    body = replace(sj.NYLON, yield_strength=yield_strength)
    contact = sj.Contact.between_spheres(body, body, RADIUS, RADIUS, area="zhou")
    velocity = np.geomspace(0.2, 30.0, 24)
    y = velocity / (float(pair("nylon").limit_velocity) - velocity)
    noise = 0.01 * np.random.default_rng(5).standard_normal(24)
    measured = np.exp(-0.4355 * y**0.5414) + noise  # Eq. (17)
    return cal.RestitutionData(velocity, measured, contact, uncertainty, name)


def write_alloy(folder, settings="", below="", second=False, uncertainty=0.01):
    """The material file of `noisy`, and of a harder alloy where there is a second; its path."""
    data = noisy(uncertainty)
    header, column = "velocity [m/s],restitution", ""
    if uncertainty is not None:
        header, column = header + ",uncertainty", f",{uncertainty!r}"
    points = zip(data.velocity.tolist(), data.restitution.tolist(), strict=True)
    lines = [header, *(f"{v!r},{e!r}{column}" for v, e in points)]
    (folder / "my_alloy.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    text = ALLOY.format(settings=settings, below=below)
    if second:
        other = ALLOY.partition("{settings}")[2].replace("my alloy", "another")
        text += other.replace("4.0e7", "6.0e7").format(below=below)
    path = folder / "alloy.toml"
    path.write_text(text, encoding="utf-8")
    return path
