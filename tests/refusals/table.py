"""What is refused: a name, where the blame lies, words that the one line has, and what was given.

`TABLES` has a section for each way in. The words, separated by |, are what was given and what is
accepted; the sentences around them are free, but for those that `sentences.txt` keeps: `python -m
tests.refusals.table` writes them again, a case joins by a line with its way and name, `CSV files | no rows |`.
"""

import copy
import json
import math
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import calibration as cal
import softjax as sj

# two ε of three flights: the second is in both
LAUNCH = cal.PointErrors(
    np.array([[0, 1, -1], [1, 2, -1]]),
    np.array([[-4.0, 4.0, 0.0], [-4.0, 4.0, 0.0]]),
    np.array([[5.0, 0.0, 0.0], [5.0, 0.0, 0.0]]),
    np.full(3, 1e-3),
    "intervals",
)
TOML = """\
[[material]]
name = "my alloy"
youngs_modulus = 1.93e11
poisson_ratio = 0.35
density = 8030
yield_strength = 3.10e8
radius = 0.0127
data = "m.csv"
"""
CSV = """\
velocity [m/s],restitution,uncertainty
0.12,0.95,0.004
0.5,0.9,0.004
2.0,0.8,0.004
"""
WALL = "[material.wall]\n" + "\n".join(TOML.splitlines()[2:6]) + "\n"
NAN = math.nan


def row(text, line=3, of=CSV):
    """The good file with one line replaced."""
    lines = of.splitlines()
    lines[line - 1] = text
    return "\n".join(lines) + "\n"


def key(line, text):
    return row(text, line, TOML)


def under(header, *rows):
    return "\n".join([header, *rows]) + "\n"


FINITE = "finite number"
# CSV files, read through a material file
CSV_FILES = {
    "empty file": ("m.csv:1", "nothing|header", ""),
    "no rows": ("m.csv:2", "no rows|a point", "# a\nvelocity,restitution"),
    "no header": ("m.csv:1", "no header|names", "1.0,0.9\n"),
    "UTF-16 with half a character": ("m.csv:1", "UTF-16|UTF-8", b"\xff\xfev\x00,"),
    "a NUL": ("m.csv:3", "NUL|UTF-8", "v,e\n1,.5\n2,\0\n"),
    "a spreadsheet": ("m.csv", "spreadsheet|CSV", b"PK\x03\x04\x14\x00"),
    "an old spreadsheet": ("m.csv", "spreadsheet|CSV", b"\xd0\xcf\x11\xe0\xa1\xb1"),
    "a column near to a known one": ("m.csv:2", "velocty [m/s]|did you mean 'velocity'", "# rebounds\n" + row("velocty [m/s],restitution,uncertainty", 1)),
    "unknown unit": ("m.csv:1", "unit|velocity|[kx]|m/s, cm/s, mm/s, km/h", under("v [kx],e", "1,.9")),
    "a unit of a label": ("m.csv:1", "launch|[s]|without", under("v,e,launch [s]", "1,.9,2")),
    "bracket that is not closed": ("m.csv:1", "velocity [m/s|one unit", under("velocity [m/s,e", "1,.9")),
    "more behind a unit": ("m.csv:1", "(corrected)|one unit", under("velocity [m/s] (corrected),e", "1,.9")),
    "column twice": ("m.csv:1", "'v'|'speed [cm/s]'|velocity|once", under("v,e,speed [cm/s]", "1,.9,1")),
    "columns that do not go together": ("m.csv:1", "drop_height, restitution|drop_height with rebound_height", under("drop_height,restitution", "1.0,0.9")),
    "two units": ("m.csv:1", "[m/s]|[cm/s]|one unit", under("velocity [m/s],e", "cm/s,-", "1,.9")),
    "unknown unit in a row of units": ("m.csv:1", "[furlongs a day]|m/s", under("v,e", "furlongs a day,", "1,.9")),
    "too few cells": ("m.csv:3", "cells: 2|line 1: 3", row("0.5,0.9")),
    "a title above the header": ("m.csv:2", "cells: 2|header in line 1: 1|begins with #", under("Drop test", "v,e", "1,.9")),
    "open quotation mark": ("m.csv:3", "quotation mark|close", row('"0.5,0.9,0.1')),
    "a line below a cell over two lines": ("m.csv:4", "velocity|'x'", under("v,e,note", '1,.9,"a', 'b"', "x,.8,c")),
    "a cell without end": ("m.csv:3", "velocity|xxx", row("x" * 70001 + ",1,1")),
    "81 letters and quotation marks": ("m.csv:3", f"velocity|'{'x' * 76}...", row("x" * 79 + ",1,1")),
    "German headings": ("m.csv:1", "'Geschwindigkeit [m/s]', 'Stoßzahl'|velocity with restitution", under("Geschwindigkeit [m/s];Stoßzahl", "1,5;0,9")),
    "velocities in mm/s without a unit": ("m.csv:3", "velocity|400|no unit|assuming velocity in m/s", under("v,e", "300,.95", "400,.92", "500,.9", "900,.8")),
    "too large a file": ("m.csv", "64 MiB|smaller", "#" * 70_000_000),
    "brackets in brackets": ("m.csv:1", "restit", under("velocity (" + "(" * 5000 + ",restitution", "1,1")),
    "a word for a number": ("m.csv:3", f"velocity|'fast'|{FINITE}", row("fast,0.9,0.1")),
    "NaN": ("m.csv:4", f"restitution|'nan'|{FINITE}", row("2.0,nan,0.1", 4)),
    "digits with underscores": ("m.csv:3", f"velocity|'1_0'|{FINITE}", row("1_0,0.9,0.1")),
    "decimal comma between commas": ("m.csv:2", "velocity|'0,5'|decimal mark '.'|;", under("v,e", '"0,5",0.9')),
    "both decimal marks": ("m.csv:3", "restitution|'0.9'|decimal mark ','", under("v;e", "0,5;0,9", "0,6;0.9")),
    "three heights": ("m.csv:1", "rebound_height twice, 'h1' and 'h2'|once", under("h0,h1,h2", "3,2,1")),
    "thousands by points": ("m.csv:2", "drop_height|'1.234,5'|thousands", under("h0;h1", "1.234,5;800")),
    "thousands by spaces": ("m.csv:2", "drop_height|'1 234'|thousands", under("h0;h1", "1 234;800")),
    "percent in the cell": ("m.csv:2", "restitution|'85 %'|header|[%]", under("v,e", "1.0,85 %")),
    "a unit in each cell": ("m.csv:2", "drop_height|'50 mm'|without its unit", under("drop_height,rebound_height", "50 mm,44 mm", "100 mm,85 mm")),
    "heights in mm without a unit": ("m.csv:3", "restitution|no unit in the header, assuming drop_height in m|size and density", under("drop_height,rebound_height", "50,44", "100000,85000")),
    "percent without its unit": ("m.csv:2", "restitution|85|percent|[%]", under("v,e", "1.0,85")),
    "empty cell of an uncertainty": ("m.csv:3", "uncertainty|empty|positive number", row("0.5,0.9,")),
    "empty cells alone": ("m.csv:1", "empty|velocity, restitution", under("v,e", "1,", ",0.9")),
    "gap in a train": ("m.csv:3", "interval|empty|gap", under("interval,u_t", "0.6,1", ",1", "0.5,1")),
    "gap in times": ("m.csv:3", "time|empty|gap", under("time,x", "0.6,1", ",1", "0.9,1")),
    "launch without a label": ("m.csv:3", "launch|empty|label", under("interval,launch", "0.6,1", "0.5,")),
    "zero velocity": ("m.csv:3", "velocity is 0|positive speed", row("0,0.9,0.1")),
    "velocity at the limit": ("m.csv:3", "velocity|341|340.317 m/s|limit_velocity", row("341,0.9,0.1")),
    "negative restitution": ("m.csv:3", "restitution|-0.1|0 or more", row("0.5,-0.1,0.1")),
    "restitution far above one": ("m.csv:4", "restitution|1.51|at most 1", row("2.0,1.51,0.004", 4)),
    "zero uncertainty": ("m.csv:3", "uncertainty is 0|positive number", row("0.5,0.9,0")),
    "an uncertainty whose square is no number": ("m.csv:3", "uncertainty is 1e-300|1e-60 or more", row("0.5,0.9,1e-300")),
    "zero drop height": ("m.csv:3", "drop_height is 0|positive height", under("h0 [cm],h1 [cm]", "10,8", "0,0")),
    "negative rebound height": ("m.csv:2", "rebound_height|-1|0 m or more", under("h0,h1", "1,-1")),
    "heights exchanged": ("m.csv:3", "rebound_height|1.6|drop_height, 1", under("h0,h1", "2,1", "1,1.6")),
    "balls from both sides": ("m.csv:3", "impact_velocity|-0.5|positive speed", under("v_in,v_out", "0.5,-0.4", "-0.5,0.4")),
    "one interval a launch": ("m.csv:1", "launch|1 row|2 adjacent rows", under("interval,launch", "0.6,1", "0.5,2")),
    "two times a launch": ("m.csv:1", "launch|2 row|3 adjacent rows", under("time", "0.6", "0.9")),
    "times that go back": ("m.csv:4", "time|0.1|launch", under("time", "0.2", "0.9", "0.1", "0.7")),
    "a rebound far above its drop without a unit": ("m.csv:2", "rebound_height|9|drop_height, 2|no unit in the header, assuming drop_height in m, rebound_height in m", under("drop_height,rebound_height", "2,9", "4,3")),
    "a new drop without its label": ("m.csv:4", "interval|1.5|launch", under("interval", "1", ".9", "1.5")),
    "a new drop among times": ("m.csv:5", "time|3.4|launch", under("time", "0", "1", "1.9", "3.4")),
    "interval longer than the one before": ("m.csv:4", "restitution|1.6|at most 1", under("interval,launch", "0.6,1", "0.5,1", "0.5,2", "0.8,2")),
}  # fmt: skip

# material files, read by `cal.read_toml`; with their data where it is another
TOML_FILES = {
    "no TOML": ("m.toml:5", "TOML|key = value", key(5, "density == 8030")),
    "text without quotation marks": ("m.toml:2", "TOML|quotation marks", key(2, "name = my alloy")),
    "a TOML that is not UTF-8": ("m.toml:2", "UTF-8", key(2, 'name = "Ø"').encode("latin-1")),
    "several faults of parameters": ("m.toml:10", "chi|true or false|FOLDER/m.toml:11: sigma is \"0,5\"|FOLDER/m.toml:12: value of psi", TOML + "[material.parameters]\nchi = { free = 1 }\nsigma = \"0,5\"\npsi = { value = \"a\" }\n"),
    "an empty TOML": ("m.toml:1", "no material|[[material]]", ""),
    "one table for an array": ("m.toml:1", "material|[[material]]", TOML.replace("[[", "[", 1).replace("]]", "]", 1)),
    "unknown key": ("m.toml:3", "'young_modulus'|did you mean 'youngs_modulus'", key(3, "young_modulus = 1e11")),
    "a setting of the fit among the bodies": ("m.toml:3", "'extra_scatter'|it belongs under [fit]", key(3, "extra_scatter = true")),
    "unknown key of a wall": ("m.toml:14", "'x'|youngs_modulus", TOML + WALL + "x = 1\n"),
    "unknown table": ("m.toml:9", "'fits'|did you mean 'fit'", TOML + "[fits]\nx = 1\n"),
    "missing property": ("m.toml:1", "density|missing|yield_strength", key(5, "")),
    "zero density": ("m.toml:5", "density is 0|positive number", key(5, "density = 0.0")),
    "text for a number": ("m.toml:5", 'density|"8030"|[kg/m³]', key(5, 'density = "8030"')),
    "truth for a number": ("m.toml:5", "density|true|[kg/m³]", key(5, "density = true")),
    "a whole number beyond floats": ("m.toml:5", "density|999|positive number", key(5, "density = " + "9" * 400)),
    "a number of 5000 digits": ("m.toml:8", "TOML", key(5, "density = " + "9" * 5000)),
    "yield strength in MPa": ("m.csv:3", "velocity is 0.5|0.3403|units of velocity and yield strength", key(6, "yield_strength = 310")),
    "a wall's yield strength in MPa": ("m.csv:3", "velocity is 0.5|0.3403|yield strength", TOML + WALL.replace("3.10e8", "310")),
    "one velocity beyond": ("m.csv:4", "velocity|2|1.1204 m/s|√(3 Y/ρ)", key(6, "yield_strength = 3360")),
    "Poisson's ratio": ("m.toml:4", "poisson_ratio|0.51|(-1, 0.5]", key(4, "poisson_ratio = 0.51")),
    "Poisson's ratio of -1": ("m.toml:4", "poisson_ratio|-1|(-1, 0.5]", key(4, "poisson_ratio = -1")),
    "no radius": ("m.csv:1", "radius or diameter is missing|with the bodies|diameter", key(7, "")),
    "radius and diameter": ("m.toml:7", "radius, diameter", key(7, "radius = 0.01\ndiameter = 0.02")),
    "one radius, one diameter": ("m.toml:7", "radius_1, diameter_2", key(7, "radius_1 = 0.01\ndiameter_2 = 0.02")),
    "a wall and two radii": ("m.toml:7", "wall|radius|diameter", key(7, "radius_1 = 0.01\nradius_2 = 0.02") + '[material.wall]\nmaterial = "nylon"\n'),
    "wall and second body": ("m.toml:14", "wall|second|either", TOML + WALL + "[material.second]\nmaterial = 'nylon'\n"),
    "unknown area": ("m.toml:9", "area|\"herz\"|\"zhou\"|did you mean 'hertz'", TOML + 'area = "herz"\n'),
    "no contact of these sizes": ("m.toml:1", "contact|other", key(7, "radius = 1e-200\nplausibility = false")),
    "a material without a source": ("m.toml:2", 'material|"AISI 304"|"stainless steel", "chrome steel", "nylon"', '[[material]]\nmaterial = "AISI 304"\nradius = 0.01\ndata = "m.csv"\n'),
    "a known material and a property": ("m.toml:3", "density|material|either", '[[material]]\nmaterial = "nylon"\ndensity = 8000\nradius = 0.01\ndata = "m.csv"\n'),
    "two of one name": ("m.toml:10", "'my alloy'|name", TOML + TOML),
    "a name that is a number": ("m.toml:2", "name is 3|text", key(2, "name = 3")),
    "a name too long for a table": ("m.toml:2", "name is|nnn|at most 200 characters", key(2, f'name = "{"n" * 201}"')),
    "no data": ("m.toml:1", "data|missing|CSV", key(8, "")),
    "missing data file": ("m.toml:8", "n.csv|not there|CSV", key(8, 'data = "n.csv"')),
    "a directory for a data file": ("", "is a directory|file", key(8, 'data = "."')),
    "a data file beyond names": ("m.toml:8", "aaa|CSV", key(8, f'data = "{"a" * 5000}"')),
    "uncertainty twice": ("m.csv:1", "uncertainty|column|once", TOML + "uncertainty = 0.01\n"),
    "negative uncertainty": ("m.toml:9", "uncertainty|-0.01|positive number", TOML + "uncertainty = -0.01\n"),
    "gravity without a use": ("m.toml:9", "gravity|velocities", TOML + "gravity = 9.81\n"),
    "an uncertainty of what was not measured": ("m.toml:9", "interval_uncertainty|velocity and restitution", TOML + 'interval_uncertainty = "1 ms"\n'),
    "an uncertainty without a unit beside centimetres": ("m.toml:9", 'height_uncertainty|0.2|"0.2 m" or "0.2 cm"', TOML + "height_uncertainty = 0.2\n", under("h0 [cm],h1 [cm]", "50,32")),
    "a column of uncertainties without a unit beside centimetres": ("m.csv:1", "height_uncertainty|[cm]|`height_uncertainty [m]` or `height_uncertainty [cm]`", TOML, under("h0 [cm],h1 [cm],height_uncertainty", "50,32,0.2")),
    "a density that lets air move the ball": ("m.csv:2", "restitution|corrected for air|density|2.7 kg/m³|m.toml:5", key(5, "density = 2.7"), under("h0,h1", "2,1.5")),
    "a ball lighter than air": ("m.csv:1", "density of the ball|0.5 kg/m³|air, 1.2 kg/m³|m.toml:5", key(5, "density = 0.5"), under("h0,h1", "2,1.5")),
    "a sign of plus or minus": ("m.toml:9", 'velocity_uncertainty|"± 1 mm/s"|its unit, "1.5 m/s"', TOML + 'velocity_uncertainty = "± 1 mm/s"\n'),
    "a decimal comma in a quantity": ("m.toml:7", 'radius|"12,7 mm"|positive number [m]|decimal point and its unit, "1.5 m"', key(7, 'radius = "12,7 mm"')),
    "a decimal comma in a number": ("m.toml:4", "no valid TOML|a point, 0.33, no comma", key(4, "poisson_ratio = 0,35")),
    "a ratio in quotation marks": ("m.toml:4", 'poisson_ratio|"0.35"|without quotation marks', key(4, 'poisson_ratio = "0.35"')),
    "uncertainties of contact times without a unit": ("m.csv:1", "contact_time_uncertainty|[us]", TOML, under("v,e,contact_time [us],u_tc", "1,0.9,40,2")),
    "uncertainties without a unit beside percent": ("m.csv:1", "uncertainty|[%]|`uncertainty [-]` or `uncertainty [%]`", TOML, under("v,e [%],u(e)", "1,90,2")),
    "an uncertainty without a unit beside percent": ("m.toml:9", 'uncertainty|0.4|"0.4 -" or "0.4 %"', TOML + "uncertainty = 0.4\n", under("v,e [%]", "1,90")),
    "repeats": ("m.toml:9", 'average_repeats|"yes"|true|false|"pooled"', TOML + 'average_repeats = "yes"\n'),
    "repeats of a train": ("m.toml:9", "average|repeats|sequences", TOML + "average_repeats = true\n", under("interval", "0.5", "0.45", "0.4")),
    "fit as a value": ("m.toml:1", "fit is 3|table", "fit = 3\n" + TOML),
    "unknown unit of a property": ("m.toml:3", "youngs_modulus|193 gpa|Pa, kPa, MPa, GPa|did you mean 'GPa'", key(3, 'youngs_modulus = "193 gpa"')),
    "another dimension": ("m.toml:7", "radius|12.7 ms|m, cm, mm", key(7, 'radius = "12.7 ms"')),
    "percent of nothing": ("m.toml:7", "radius|5 %|[m]", key(7, 'radius = "5 %"')),
    "a quantity beyond floats": ("m.toml:7", "radius|1e999 mm|[m]", key(7, 'radius = "1e999 mm"')),
    "escape sequences": ("m.toml:3", r"\x1b[31m\nred\u202e|known", key(3, r'"\u001b[31m\nred\u202E" = 1')),
    "a key without end": ("m.toml:3", "kkkkkkkk|known", key(3, "k" * 20000 + " = 1")),
    "a key below a text of many lines": ("m.toml:15", "'x'|known", 'parameters = { chi = 1.0 } # [no]\n' + key(2, 'name = """\n[material]\nx = 1 # "\n\\""""') + "# [[material]]\n\n'x' = 'a # = b'\n"),
    "a key below a list of many lines": ("m.toml:7", "'x'|known", '[[material]]\ndata = "m.csv"\nparameters = { chi = { prior = [ # ]\n  1.0, # [\n  2.0,\n] } }\nx = 1\n'),
    "a key of the second material": ("m.toml:18", "'x'|known", TOML + "\n" + TOML.replace("my", "no") + "  x\t= 1\n"),
    "several faults at once": ("m.toml:4", "poisson_ratio|FOLDER/m.toml:5: density|FOLDER/m.toml:10: unknown key 'seeds'", key(4, "poisson_ratio = 0.51").replace("density = 8030", "density = -1") + "[fit]\nseeds = 1\n"),
    "a TOML of 3 MB": ("m.toml", "2 MiB|smaller", "#" * 3_000_000),
}  # fmt: skip

# material files, read by `cal.read_problem`
SAID = TOML + "[material.parameters]\n"
BARE = '[[material]]\nname = "bare"\ndata = "m.csv"\n[material.parameters]\n'
PROBLEMS = {
    "unknown field of a parameter": ("m.toml:10", "start of chi is unknown|known are value, free", SAID + "chi = { start = 1.0 }\n"),
    "value out of its bounds": ("m.toml:11", "value of chi|3|[1, 2]", SAID + "[material.parameters.chi]\nvalue = 3.0\nbounds = [1.0, 2.0]\n"),
    "bounds the wrong way round": ("m.toml:10", "bounds of sigma|[2.0, 1.0]", SAID + "sigma = { bounds = [2.0, 1.0] }\n"),
    "prior without a width": ("m.toml:10", "prior of sigma|[2.0, 0.0]|positive", SAID + "sigma = { prior = [2.0, 0.0] }\n"),
    "prior of one number": ("m.toml:10", "prior of sigma|2|[mean, standard deviation]", SAID + "sigma = { prior = 2.0 }\n"),
    "unknown transform": ("m.toml:10", "transform of sigma|sqrt|\"log\", \"logit\" or \"none\"", SAID + 'sigma = { transform = "sqrt" }\n'),
    "bounds of what is fixed": ("m.toml:10", "bounds of psi|free is false", SAID + "psi = { free = false, value = 0.5, bounds = [0.1, 1.0] }\n"),
    "free as a word": ("m.toml:10", "free of psi|no|true or false", SAID + 'psi = { free = "no" }\n'),
    "text for a parameter": ("m.toml:10", 'psi|"half"|number|{ free = true }', SAID + 'psi = "half"\n'),
    "chi beside its line": ("m.toml:10", "chi|c1|c2", SAID + "chi = 1.0\n[parameters]\nc1 = { value = 0.0 }\n"),
    "a prior half in GPa": ("m.toml:10", 'prior of youngs_modulus is 1, without a unit next to "193 GPa"|"1 Pa" or "1 GPa"', SAID + 'youngs_modulus = { prior = ["193 GPa", 1] }\n'),
    "a prior in GPa without its unit": ("m.toml:10", "youngs_modulus is 193 Pa|100 times outside|unit", SAID + "youngs_modulus = { prior = [193, 2] }\n"),
    "a start in MPa without its unit": ("m.toml:10", "contact.yield_strength is 60 Pa|unit", SAID + '"contact.yield_strength" = { value = 60 }\n'),
    "unknown objective": ("m.toml:10", "objective|\"twostep\"|did you mean 'two-step'", TOML + '[fit]\nobjective = "twostep"\n'),
    "half a seed": ("m.toml:10", "seed is 1.5|whole number", TOML + "[fit]\nseed = 1.5\n"),
    "no starts": ("m.toml:10", "starts is 0|greater than or equal to 1", TOML + "[fit]\nstarts = 0\n"),
    "31 degrees of freedom": ("m.toml:11", "noise_dof is 31|a number in [2, 30]", TOML + '[fit]\nnoise = "student-t"\nnoise_dof = 31\n'),
    "confidence in percent": ("m.toml:10", "confidence is 95|1", TOML + "[fit]\nconfidence = 95\n"),
    "tolerance of the energy balance": ("m.toml:11", 'rtol|route "ode"', TOML + '[fit]\nroute = "energy balance"\nrtol = 1e-6\n'),
    "an objective that is a law": ("m.toml:10", 'objective|empirical|"model" or "two-step"', TOML + '[fit]\nobjective = "empirical"\n'),
}  # fmt: skip

# the same, read by `cal.read_problem` and fitted: what the law refuses has its line too
FITS = {
    "unknown parameter": ("m.toml:10", "parameter is xi|chi, sigma, psi", SAID + "xi = 1.0\n"),
    "value out of range": ("m.toml:10", "value of psi is 0|positive", SAID + "psi = 0\n"),
    "bounds out of range": ("m.toml:10", "bounds of sigma|[-1, 1]|[0, inf", SAID + "sigma = { bounds = [-1.0, 1.0] }\n"),
    "logit without bounds": ("m.toml:10", "transform of sigma|logit|bounds", SAID + 'sigma = { transform = "logit" }\n'),
    "fixed without a value": ("m.toml:10", "value of psi|missing", SAID + "psi = { free = false }\n"),
    "chi without elastic properties": ("m.toml:5", "chi|restitution", BARE + "chi = 1.0\n"),
}  # fmt: skip

# tables from Python and further arguments of `from_table`; {} where there are none
PLAIN = {"velocity": [1.0, 2.0], "restitution": [0.9, 0.8]}
SPEEDS = {"v_in": [1.0, 2.0], "v_out": [0.9, 1.6]}
HEIGHTS = {"drop_height": [1.0, 2.0], "rebound_height": [0.9, 1.6]}
TRAIN = {"interval": [1.0, 0.9, 0.8]}
COLUMNS = {
    "no columns": ("set of columns", "empty", {}, {}),
    "a file": ("table", "named columns|read_csv|file.csv", "file.csv", {}),
    "a column that nobody knows": ("set of columns", "'colour'|not known", {"colour": [1.0]}, {}),
    "a slip of the pen": ("column", "did you mean 'restitution'", {"v": [1.0], "restituion": [0.9]}, {}),
    "columns of other lengths": ("restitution", "as long as `velocity`|1", {"v": [1.0, 2.0], "e": [0.9]}, {}),
    "an infinite velocity": ("velocity[0]", "inf|positive speed", {"v": [math.inf], "e": [0.9]}, {}),
    "a row below one that is left out": ("velocity[3]", "-3|positive speed", {"v": [1.0, NAN, 2.0, -3.0], "e": [0.5] * 4}, {}),
    "an uncertainty that is missing": ("uncertainty[2]", "empty|positive", {"v": [1.0, NAN, 2.0], "e": [0.5] * 3, "uncertainty": [0.1, NAN, NAN]}, {}),
    "more speed after than before": ("rebound_velocity[0]", "1.3|impact_velocity, 1", {"v_in": [1.0], "v_out": [1.3]}, {}),
    "no speed before": ("impact_velocity[0]", "0|positive speed", {"v_in": [0.0], "v_out": [0.1]}, {}),
    "one sign among others": ("rebound_velocity[1]", "-0.9|0 m/s or more", {"v_in": [1.0, 1.0], "v_out": [0.9, -0.9]}, {}),
    "uncertainty as both": ("column", "uncertainty twice|once", PLAIN | {"uncertainty": [0.1, 0.1]}, {"uncertainty": 0.1}),
    "group as both": ("group", "column|once", PLAIN | {"group": ["a", "b"]}, {"group": ["a", "b"]}),
    "of both velocities and of one": ("impact_velocity_uncertainty", "once|velocity_uncertainty", SPEEDS, {"velocity_uncertainty": 0.1, "impact_velocity_uncertainty": 0.1}),
    "two names of the timing": ("interval_uncertainty", "once|timing_uncertainty", TRAIN, {"interval_uncertainty": 0.1, "timing_uncertainty": 0.1}),
    "a timing of zero": ("interval_uncertainty[0]", "0|positive time", TRAIN, {"interval_uncertainty": 0.0}),
    "a negative timing": ("interval_uncertainty[0]", "-1|positive time", TRAIN, {"interval_uncertainty": -1.0}),
    "a timing in millimetres": ("unit of interval_uncertainty", "[mm]|s, ms, us", TRAIN, {"interval_uncertainty": "1 mm"}),
    "groups of another length": ("group", "as long as `interval`, 3", TRAIN, {"group": ["a"]}),
    "percent of a time": ("timing_uncertainty", "percent|s, ms", {"time": [0, 1, 1.9]}, {"timing_uncertainty": "1 %"}),
    "an uncertainty without a unit next to centimetres": ("height_uncertainty", '"0.2 m" or "0.2 cm"|[cm]', {"h0 [cm]": [50], "h1 [cm]": [32]}, {"height_uncertainty": 0.2}),
    "no gravity": ("gravity", "0|positive acceleration", TRAIN, {"gravity": 0.0}),
    "a word for gravity": ("gravity", "strong|positive acceleration", TRAIN, {"gravity": "strong"}),
}  # fmt: skip

# arguments of `RestitutionData` that are not those of two good points
ARGUMENTS = {
    "a velocity of zero": ("velocity[1]", "0|positive speed", {"velocity": [1.0, 0.0]}),
    "one velocity too few": ("restitution", "as long as `velocity`, 1|2", {"velocity": [1.0]}),
    "a single number": ("velocity", "one-dimensional|()", {"velocity": 1.0}),
    "no points": ("velocity", "one-dimensional|(0,)", {"velocity": []}),
    "truth values": ("velocity", "real numbers", {"velocity": [True, False]}),
    "a word for a limit": ("limit_velocity", "fast|positive", {"limit_velocity": "fast"}),
    "no number": ("restitution[1]", "nan|0 or more", {"restitution": [0.5, NAN]}),
    "one uncertainty of two": ("uncertainty", "as long as `velocity`, 2|1", {"uncertainty": [0.1]}),
    "a word for an uncertainty": ("uncertainty", "small|number", {"uncertainty": "small"}),
    "a negative uncertainty of v": ("velocity_uncertainty[0]", "-1|0 m/s or more", {"velocity_uncertainty": -1.0}),
    "a blank name": ("name", "' '|200", {"name": " "}),
    "a name of 201 letters": ("name", "200", {"name": "x" * 201}),
    "a number for a name": ("name", "3|200", {"name": 3}),
    "one label of two": ("group", "as long as `velocity`, 2|1", {"group": ["a"]}),
    "a text for labels": ("group", "ab|each point", {"group": "ab"}),
    "no label": ("group[1]", "empty|label", {"group": ["a", None]}),
    "degrees of one": ("degrees", "2|velocity", {"degrees": [1.0]}),
    "no degrees": ("degrees", "0|positive", {"degrees": 0}),
    "errors of three": ("errors", "3|as many points as `velocity`, 2", {"errors": cal.PointErrors.alone(3)}),
    "uncertainty beside other errors": ("uncertainty", "errors", {"uncertainty": 0.1, "errors": cal.PointErrors.alone(2, np.array([0.2, 0.2]))}),
    "a launch in two groups": ("group", "'a' and 'b'|share an error", {"group": ["a", "b"], "errors": LAUNCH}),
    "a material for a contact": ("contact", "softjax.Contact", {"contact": sj.NYLON}),
}  # fmt: skip

# entries of a fit.json: the place, and what is put there; nothing takes it out
RESULTS = {
    "another format": ("fit.json", "format 2|format 1", "format", 2),
    "no format": ("fit.json", "without a format|format 1", "format", ...),
    "fits: []": ("fit.json", "fits", "fits", []),
    "data velocity: {}": ("fit.json", "fits[0].data.velocity|a table", "fits.0.data.velocity", {}),
    "data restitution 2: -0.5": ("fit.json", "fits[0].data.restitution|-0.5", "fits.0.data.restitution.2", -0.5),
    "data degrees: -3.0": ("fit.json", "fits[0].data.degrees|-3", "fits.0.data.degrees", -3.0),
    "rms: 1.0": ("fit.json", "fits[0].rms|1.0|number", "fits.0.rms", "1.0"),
    "rms: 10**400": ("fit.json", "fits[0].rms|finite number", "fits.0.rms", 10**400),
    "rms: True": ("fit.json", "fits[0].rms|number", "fits.0.rms", True),
    "variances group: -1e-4": ("fit.json", "fits[0].variances.group|-0.0001", "fits.0.variances.group", -1e-4),
    "covariance names: ['x']": ("fit.json", "covariance.matrix|of 1", "covariance.names", ["x", "y"]),
    "labels: {'x': 'y'}": ("fit.json", "fits[0].labels|x", "fits.0.labels", {"x": "y"}),
    "law: os.system": ("law", "os.system|law", "fits.0.law", "os.system"),
    "known: [1]": ("fit.json", "fits[0].known|1", "fits.0.known", [1]),
    "material: long": ("fit.json", "fits[0].material|xxx", "fits.0.material", "x" * 10_000),
    "confidence: 5": ("fit.json", "confidence|5|less than 1", "confidence", 5),
    "request confidence: 5": ("fit.json", "confidence|5|less than 1", "request.options.confidence", 5),
    "request route: {'name': 'rk4'}": ("fit.json", "route|rk4|a name", "request.options.route", "rk4"),
    "request route: {'name': 'energy bal": ("fit.json", "rtol|less than or equal to 0.1", "request.options.rtol", 1),
    "freedom 0 relative 0 0: -1e-3": ("fit.json", "freedom[0].relative|variance", "freedom.0.relative.0.0", -1e-3),
    "covariance matrix 0: [1, 2]": ("fit.json", "covariance.matrix|[1, 2]|square", "covariance.matrix.0", [1, 2]),
    "covariance_of_predictions 0 0: -1e-9": ("fit.json", "covariance_of_predictions", "covariance_of_predictions.0.0", -1e-9),
    "covariance: nothing": ("fit.json", "covariance|missing", "covariance", ...),
    "n: 2.5": ("fit.json", "fits[0].n|2.5|whole", "fits.0.n", 2.5),
    "warnings: [{'code': 'x'}]": ("fit.json", "warnings[0].code|x|at-bound", "warnings", [{"code": "x"}]),
}  # fmt: skip

# a fit.json that is none
NO_RESULTS = {
    "nested lists": ("fit.json:1", "recursion", "[" * 100_000),
    "a bracket in line 2": ("fit.json:2", "JSON", '{\n"fits": [}'),
    "a NaN": ("fit.json", "fits|nan|list", '{"format": 1, "fits": NaN}'),
    "5000 digits": ("fit.json:1", "out of range", '{"fits": 1' + "0" * 5000 + "}"),
    "half a character": ("fit.json:1", "hex escape", '{"fits": "\\ud800"}'),
    "a result that is not UTF-8": ("fit.json:1", "UTF-8", b'{"fits": "\xfc"}'),
    "26 MB": ("fit.json", "24 MiB", b" " * 26_000_000),
    "many lists": ("fit.json", "fits[0]|[]", '{"format": 1, "fits": [' + "[]," * 20_000 + "[]]}"),
}  # fmt: skip


def good_fields():
    return {"velocity": [1.0, 2.0], "restitution": [0.9, 0.8]}


def written(folder: Path, toml, csv=CSV) -> Path:
    """Put a pair of files into a folder; the path of the TOML file."""
    for name, content in {"m.toml": toml, "m.csv": csv}.items():
        (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    return folder / "m.toml"


@cache
def genuine() -> dict:
    """A result with bodies and groups, as a table: all kinds of entries, little to compute."""
    noise = 0.01 * np.random.default_rng(2).standard_normal(8)
    rows = zip(np.geomspace(0.5, 5.0, 8), 0.8 + noise, "aaabbbcc", strict=True)
    csv = "v,e,group\n" + "".join(f"{v},{e},{g}\n" for v, e, g in rows)
    with tempfile.TemporaryDirectory() as folder:
        data = cal.read_toml(written(Path(folder), TOML + WALL, csv))
    return json.loads(cal.fit(data, "constant").to_json())


def changed(table: dict, way, value) -> dict:
    """A copy with one entry set, or taken out where the value is `...`."""
    table = copy.deepcopy(table)
    *above, last = way
    inner: Any = table
    for part in above:
        inner = inner[part]
    if value is ...:
        del inner[last]
    else:
        inner[last] = value
    return table


def crafted(folder: Path, place: str, value):
    way = [int(part) if part.isdigit() else part for part in place.split(".")]
    return loaded(folder, json.dumps(changed(genuine(), way, value)))


def loaded(folder: Path, content):
    raw = content if isinstance(content, bytes) else content.encode("utf-8", "surrogatepass")
    (folder / "fit.json").write_bytes(raw)
    return cal.FitResult.load(folder / "fit.json")


def fitted(path):
    problem = cal.read_problem(path)
    return cal.fit(problem.datasets, parameters=problem.parameters)


# how each section is given to the library
WAYS = {
    "CSV files": (CSV_FILES, lambda folder, csv: cal.read_toml(written(folder, TOML, csv))),
    "TOML files": (TOML_FILES, lambda folder, *files: cal.read_toml(written(folder, *files))),
    "problems": (PROBLEMS, lambda folder, toml: cal.read_problem(written(folder, toml))),
    "fits": (FITS, lambda folder, toml: fitted(written(folder, toml))),
    "tables": (COLUMNS, lambda _, table, more: cal.RestitutionData.from_table(table, **more)),
    "arguments": (ARGUMENTS, lambda _, changes: cal.RestitutionData(**(good_fields() | changes))),
    "results": (RESULTS, crafted),
    "no results": (NO_RESULTS, loaded),
}
CASES = {(way, name): case for way, (cases, _) in WAYS.items() for name, case in cases.items()}


def refusal(way: str, name: str, folder: Path) -> Exception | None:
    """What the library says to a case, None where it accepts it."""
    _, _, *given = CASES[way, name]
    try:
        WAYS[way][1](folder, *given)
    except (cal.InputError, cal.DataError) as error:
        return error
    return None


FILE = Path(__file__).with_name("sentences.txt")


def sentences() -> dict[tuple[str, str], str]:
    """The sentences that are kept, by way and name."""
    parts = (line.split(" | ", 2) for line in FILE.read_text(encoding="utf-8").splitlines())
    return {(way, name.removesuffix(" |")): "".join(rest) for way, name, *rest in parts}


def sentence(way: str, name: str, folder: Path) -> str:
    """What is said now; the folder by a word."""
    return str(refusal(way, name, folder)).replace(str(folder), "FOLDER")


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as place:
        lines = [
            f"{way} | {name} | {sentence(way, name, Path(place))}" for way, name in sentences()
        ]
    FILE.write_text("\n".join(lines) + "\n", encoding="utf-8")
