"""Malformed material files, each with what is to be told of it (see `malformed_csv`)."""

from tests.malformed_csv import TOML, Case

BARE = '[[material]]\nname = "bare"\ndata = "m.csv"\n'
PARAMETERS = TOML + "[material.parameters]\n"


def _toml(line: int, text: str) -> str:
    """The good TOML file with one line replaced."""
    lines = TOML.splitlines()
    lines[line - 1] = text
    return "\n".join(lines) + "\n"


TOML_CASES = {
    "no TOML": Case("m.toml:5: no valid TOML", "key = value", _toml(5, "density == 8030")),
    "text without quotation marks": Case(
        "m.toml:2: no valid TOML", "text in quotation marks", _toml(2, "name = my alloy")
    ),
    "key twice": Case("m.toml:7: no valid TOML", "key = value", _toml(7, "density = 1.0")),
    "not UTF-8": Case("m.toml:2: is not UTF-8", "UTF-8", _toml(2, 'name = "Ø"').encode("latin-1")),
    "empty file": Case("m.toml:1: no material", "[[material]]", ""),
    "one table for an array": Case(
        "m.toml:1: material is not an array",
        "[[material]]",
        TOML.replace("[[", "[", 1).replace("]]", "]", 1),
    ),
    "unknown key": Case(
        "m.toml:3: unknown key 'young_modulus'",
        "did you mean 'youngs_modulus'?",
        _toml(3, "young_modulus = 1.93e11"),
    ),
    "unknown table": Case(
        "m.toml:9: unknown key 'fits'", "did you mean 'fit'?", TOML + '[fits]\nloss = "huber"\n'
    ),
    "missing property": Case("m.toml:1: density is missing", "yield_strength", _toml(5, "")),
    "negative modulus": Case(
        "m.toml:3: youngs_modulus is -1", "a positive number [Pa]", _toml(3, "youngs_modulus = -1")
    ),
    "text for a number": Case(
        'm.toml:5: density is "8030"', "a positive number [kg/m³]", _toml(5, 'density = "8030"')
    ),
    "truth for a number": Case("m.toml:5: density is true", "[kg/m³]", _toml(5, "density = true")),
    "NaN property": Case("m.toml:6: yield_strength is nan", "[Pa]", _toml(6, "yield_strength=nan")),
    "Poisson's ratio": Case(
        "m.toml:4: poisson_ratio is 0.51", "in (-1, 0.5]", _toml(4, "poisson_ratio = 0.51")
    ),
    "no radius": Case("m.toml:1: radii given are none", "radius, or radius_1", _toml(7, "")),
    "three radii": Case(
        "m.toml:7: radii given are radius, radius_1",
        "radius_1 and radius_2",
        _toml(7, "radius = 0.01; radius_1 = 0.02".replace("; ", "\n")),
    ),
    "unknown area": Case(
        'm.toml:9: area is "herz"',
        '"zhou" or "hertz" (did you mean \'hertz\'?)',
        TOML + 'area = "herz"\n',
    ),
    "wall and second body": Case(
        "m.toml:14: both a wall and a second body",
        "only one is possible",
        TOML
        + "[material.wall]\n"
        + "\n".join(TOML.splitlines()[2:6])
        + "\n[material.second]\ndensity = 1.0\n",
    ),
    "wall without a property": Case(
        "m.toml:10: youngs_modulus is missing",
        "a body has",
        TOML + "\n[material.wall]\ndensity = 1.0\n",
    ),
    "no data": Case("m.toml:1: data is missing", "name of a CSV file", _toml(8, "")),
    "missing data file": Case(
        "m.toml:8: data file", "name of a CSV file", _toml(8, 'data = "n.csv"')
    ),
    "number for a file": Case("m.toml:8: data is 3", "a text", _toml(8, "data = 3")),
    "two of one name": Case(
        "m.toml:10: a second material is named 'my alloy'", "a name of its own", TOML + TOML
    ),
    "uncertainty twice": Case(
        "m.csv:1: uncertainty is both a column and a number",
        "given once",
        TOML + "uncertainty = 0.01\n",
    ),
    "negative uncertainty": Case(
        "m.toml:9: uncertainty is -0.01", "a positive number", TOML + "uncertainty = -0.01\n"
    ),
    "gravity without a use": Case(
        "m.csv:1: gravity is given", "left out where velocities", TOML + "gravity = 9.81\n"
    ),
    "repeats": Case(
        'm.toml:9: average_repeats is "yes"',
        'true or false or "pooled"',
        TOML + 'average_repeats = "yes"\n',
    ),
    "unknown parameter": Case(
        "m.toml:10: unknown key 'xi'", "known here are chi, sigma, psi", PARAMETERS + "xi = 1.0\n"
    ),
    "unknown field of a parameter": Case(
        "m.toml:10: unknown key 'start'", "free, value", PARAMETERS + "chi = { start = 1.0 }\n"
    ),
    "value out of range": Case(
        "m.toml:10: psi is 0", "it must be a positive number", PARAMETERS + "psi = 0\n"
    ),
    "value out of its bounds": Case(
        "m.toml:11: value of chi is 3",
        "within its bounds, [1, 2]",
        PARAMETERS + "[material.parameters.chi]\nvalue = 3.0\nbounds = [1.0, 2.0]\n",
    ),
    "bounds the wrong way round": Case(
        "m.toml:10: bounds of sigma is [2.0, 1.0]",
        "lowest below highest",
        PARAMETERS + "sigma = { bounds = [2.0, 1.0] }\n",
    ),
    "bounds out of range": Case(
        "m.toml:10: bounds of sigma is [-1.0, 1.0]",
        "within [0, inf]",
        PARAMETERS + "sigma = { bounds = [-1.0, 1.0] }\n",
    ),
    "prior without a width": Case(
        "m.toml:10: prior of sigma is [2.0, 0.0]",
        "positive standard deviation",
        PARAMETERS + "sigma = { prior = [2.0, 0.0] }\n",
    ),
    "prior of one number": Case(
        "m.toml:10: prior of sigma is 2",
        "two numbers, [mean, standard deviation]",
        PARAMETERS + "sigma = { prior = 2.0 }\n",
    ),
    "unknown transform": Case(
        "m.toml:10: transform of sigma is sqrt",
        "one of log, logit, none",
        PARAMETERS + 'sigma = { transform = "sqrt" }\n',
    ),
    "logit without bounds": Case(
        "m.toml:10: transform of sigma is logit",
        "both bounds given",
        PARAMETERS + 'sigma = { transform = "logit" }\n',
    ),
    "bounds of what is fixed": Case(
        "m.toml:10: bounds of psi is given",
        "left out where free is false",
        PARAMETERS + "psi = { free = false, value = 0.5, bounds = [0.1, 1.0] }\n",
    ),
    "fixed without a value": Case(
        "m.toml:10: value of psi is missing", "given where", PARAMETERS + "psi = { free = false }\n"
    ),
    "free as a word": Case(
        "m.toml:10: free of psi is no", "true or false", PARAMETERS + 'psi = { free = "no" }\n'
    ),
    "text for a parameter": Case(
        'm.toml:10: psi is "half"', "a number, or a table", PARAMETERS + 'psi = "half"\n'
    ),
    "chi without elastic properties": Case(
        "m.toml:5: chi without elastic properties",
        "give youngs_modulus",
        BARE + "[material.parameters]\nchi = 1.0\n",
    ),
    "chi beside its line": Case(
        "m.toml:10: chi beside c1 and c2",
        "only one is possible",
        PARAMETERS + "chi = 1.0\n[parameters]\nc1 = { value = 0.0 }\n",
    ),
    "unknown objective": Case(
        'm.toml:10: objective is "twostep"',
        "did you mean 'two-step'?",
        TOML + '[fit]\nobjective = "twostep"\n',
    ),
    "unknown setting": Case(
        "m.toml:11: unknown key 'seeds'",
        "did you mean 'seed'?",
        TOML + "[fit]\nstarts = 8\nseeds = 1\n",
    ),
    "half a seed": Case(
        "m.toml:10: seed is 1.5", "a whole number of 0 or more", TOML + "[fit]\nseed = 1.5\n"
    ),
    "no starts": Case("m.toml:10: starts is 0", "of 1 or more", TOML + "[fit]\nstarts = 0\n"),
    "tolerance of the energy balance": Case(
        "m.toml:11: rtol beside the energy balance",
        'route = "ode" only',
        TOML + '[fit]\nroute = "energy balance"\nrtol = 1e-6\n',
    ),
    "fit as a value": Case("m.toml:1: fit is 3", "a table: [fit]", "fit = 3\n" + TOML),
    "a number of 5000 digits": Case(
        "m.toml:8: no valid TOML", "key = value", _toml(5, "density = " + "9" * 5000)
    ),
    "a whole number beyond floats": Case(
        "m.toml:5: density is 9999", "a positive number", _toml(5, "density = " + "9" * 400)
    ),
    "no contact of these sizes": Case(
        "m.toml:1: no contact of these bodies", "other sizes", _toml(7, "radius = 1e-200")
    ),
}
