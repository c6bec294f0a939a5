"""What imports what, in the house and in its tests: one direction, no cycles, nothing heavy early, public names alone.

A test may import a module of `softjax` where an algorithm has a contract of its own (roots, quadrature,
works), with a comment on the import, or a sentence of the file's docstring that names it, to say why.
Oracles may import what they like: they take part in no test of a module.
"""

import ast
import graphlib
import importlib
import subprocess
import sys
from pathlib import Path

import pytest

import calibration as cal

ROOT = Path(__file__).parents[2]
HEAVY = (
    "diffrax optimistix optax lineax scipy matplotlib rich pandas pint jinja2 blackjax arviz xarray"
)

# softjax in layers: a module imports from earlier layers, or from its own where that says so
LAYERS = [
    {"units"},
    {"checks", "engine", "numerics", "numerics.powers", "numerics.roots", "status"},
    {"fields", "numerics.derivatives", "numerics.gauss", "numerics.quadrature"},
    {"materials"},
    {"contact"},
    {"compiling"},
    {"mapping"},
    {"laws"},
    {"engine.bridge"},
    {"engine.outcome", "engine.phase", "engine.falls"},
    {"engine.encke"},
    {"engine.energy", "engine.motion", "engine.in_time"},
    {"routes"},
    {"engine.impact"},
    {"restitution"},
    {"history", "many_body"},
]
LEVEL = {name: level for level, names in enumerate(LAYERS) for name in names}
ROUTES = {
    "energy": {"engine.energy", "numerics.quadrature"},
    "ode": {f"engine.{name}" for name in ("motion", "encke", "falls", "phase")},
    "time": {"engine.in_time"},
}
OF_ALL_ROUTES = {"engine.bridge", "engine.impact", "engine.outcome"}


# calibration in floors: a module imports from lower ones, or from its own; also inside functions
FLOORS = [
    {"lazily", "errors", "rounding", "schema", "options", "output", "console", "observables"},
    {"parameters", "paper", "data"},
    {"fitting", "symbols"},
    {"curves", "studies"},
    {"plots", "report"},
    {"fit_result"},  # shows itself: it asks for pictures and reports, which do not import it
    {"commands", "comparison", "particle_codes", "speed"},
    {"cli", "__main__"},
]
FLOOR = {name: floor for floor, names in enumerate(FLOORS) for name in names}


def modules(package):
    """Files of a package by dotted name without the package's own."""
    found = {}
    for path in sorted((ROOT / package).rglob("*.py")):
        way = path.relative_to(ROOT / package).with_suffix("").parts
        found[".".join(p for p in way if p != "__init__")] = path
    return {name: path for name, path in found.items() if name}


def imported(path, package):
    """Dotted names of a package that a file imports, wherever in it, without the package's own."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        names = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: a relative import, which this test cannot follow"
            names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
        mine = (name for name in names if name.split(".")[0] == package)
        yield from (name.removeprefix(package).removeprefix(".") for name in mine)


def part(name):
    """The module of softjax that a dotted name belongs to; laws are one."""
    parts = name.split(".")
    return ".".join(parts[:2] if parts[0] in ("engine", "numerics") else parts[:1])


SOFTJAX, CALIBRATION = modules("softjax"), modules("calibration")


@pytest.fixture(scope="module")
def edges():
    """Of softjax by its parts, and of calibration; that a package is imported with a module of it is none."""
    inner = {
        (part(name), part(target))
        for name, path in SOFTJAX.items()
        for target in imported(path, "softjax")
        if part(target) in LEVEL
    }
    outer = {
        (name, target)
        for name, path in CALIBRATION.items()
        for target in imported(path, "calibration")
        if target in CALIBRATION and not name.startswith(f"{target}.")
    }
    return inner, outer


def has_no_cycle(edges):
    graph = {}
    for name, target in edges:
        if name != target:
            graph.setdefault(name, set()).add(target)
    graphlib.TopologicalSorter(graph).prepare()


def upwards(edges, levels, of=part):
    return [f"{a} imports {b}" for a, b in edges if levels[of(b)] > levels[of(a)]]


def test_every_module_has_its_layer_and_imports_downwards_in_no_cycle(edges):
    inner, outer = edges
    assert {part(name) for name in SOFTJAX} <= set(LEVEL)
    assert {part(name) for name in CALIBRATION} == set(FLOOR)
    assert len(FLOORS) <= 8
    assert len(inner) > 20
    assert ("fitting.traceable", "fitting.collisions") in outer
    assert ("commands.fit", "fit_result") in outer  # inside a function
    assert ("fit_result", "report.fit") in outer  # inside a method
    assert upwards(inner, LEVEL) == []
    assert upwards(outer, FLOOR) == []
    assert upwards([("cli", "data.air"), ("data.air", "cli")], FLOOR) == ["data.air imports cli"]
    assert len(upwards([("fitting.estimates", up) for up in ("plots", "report.fit")], FLOOR)) == 2
    for each in (inner, outer, {(part(a), part(b)) for a, b in outer}):
        has_no_cycle(each)
    with pytest.raises(graphlib.CycleError):
        has_no_cycle([("a", "b"), ("b", "c"), ("c", "a")])


def test_routes_share_the_law_alone_one_file_talks_to_diffrax_and_calibration_uses_public_names(
    edges,
):
    engines = {name for name in SOFTJAX if name.startswith("engine.")}
    assert engines == OF_ALL_ROUTES.union(*ROUTES.values()) - {"numerics.quadrature"}
    for name, target in edges[0]:
        for route, names in ROUTES.items():
            others = set().union(*(v for k, v in ROUTES.items() if k != route))
            assert not (name in names and target in others), f"{name} imports {target}"
    users = {n for n, path in SOFTJAX.items() if any(True for _ in imported(path, "diffrax"))}
    assert users == {"engine.bridge"}
    assert not any(list(imported(path, "calibration")) for path in SOFTJAX.values())
    for name, path in CALIBRATION.items():
        private = {part(one) for one in imported(path, "softjax")} & set(LEVEL)
        assert private <= {"laws", "fields", "compiling", "many_body", "units"}, (
            f"calibration.{name}"
        )


STAGES = """
import sys
def stage():
    print(*[name for name in HEAVY if name in sys.modules], sep=",")
import jax
before = dict(jax.config.values)
import softjax as sj
assert dict(jax.config.values) == before
stage()
sj.enable_x64()
assert jax.config.jax_enable_x64
steel = sj.STAINLESS_STEEL
law = sj.Zhou(sj.Contact.between_spheres(steel, steel, 0.0127, 0.0127), 1.8, 3.0, 0.54)
assert sj.restitution(law, [0.001, 0.1, 1.0]).coefficient.shape == (3,)
import calibration
from calibration import RestitutionData, read_csv, read_toml
stage()
jax.eval_shape(lambda v: sj.restitution(law, v, sj.ODE()).coefficient, 1.0)
stage()
"""


def test_importing_changes_no_setting_and_nothing_heavy_is_imported_before_it_is_used():
    code = STAGES.replace("HEAVY", repr(HEAVY.split()))
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    imported, used, integrated = done.stdout.splitlines()
    assert imported == used == ""
    assert "diffrax" in integrated


def test_every_public_name_is_what_it_says_and_no_module_takes_one_from_its_own_package():
    """A package would have to be whole before its parts; a module of a public name would take its place."""
    for name, path in CALIBRATION.items():
        package = name.rpartition(".")[0]
        names = {t for t in imported(path, "calibration") if t.rpartition(".")[0] == package}
        assert not package or names <= CALIBRATION.keys(), f"{name} imports {names}"
    for name in CALIBRATION:
        if name != "__main__":
            importlib.import_module(f"calibration.{name}")
    for name in cal.__all__:
        assert not hasattr(getattr(cal, name), "__path__"), name
        assert type(getattr(cal, name)).__name__ != "module", name


TESTS = ROOT / "tests"
PACKAGES = ("calibration", "softjax")
PUBLIC = {f"calibration.{name}" for name in ("cli", "observables", "paper", "plots")} | {*PACKAGES}


def behind(text: str) -> list[str]:
    tree, lines = ast.parse(text), text.splitlines()
    docstring = ast.get_docstring(tree) or ""

    def says_why(module, line):
        explained = "#" in lines[line - 1] or (line > 1 and lines[line - 2].strip().startswith("#"))
        return module.startswith("softjax.") and (module in docstring or explained)

    found = sorted({(line, module) for module, line in used(tree) if _is_hidden(module)})
    return [f"line {line}: {module}" for line, module in found if not says_why(module, line)]


def used(tree: ast.Module):
    names = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                names[alias.asname or alias.name] = alias.name
                yield alias.name, node.lineno
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module, node.lineno
            yield from ((f"{node.module}.{alias.name}", node.lineno) for alias in node.names)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value.rstrip("."), node.lineno
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            yield f"{names.get(node.value.id, '')}.{node.attr}", node.lineno


def _is_hidden(name: str) -> bool:
    """Whether a name is a module behind the public ones: a file or folder that no public name hides."""
    package, _, inner = name.partition(".")
    if package not in PACKAGES or name in PUBLIC or not inner.replace(".", "").isidentifier():
        return False
    place = TESTS.parent / name.replace(".", "/")
    return inner not in importlib.import_module(package).__all__ and (
        place.is_dir() or place.with_suffix(".py").exists()
    )


def test_no_test_reaches_behind_the_public_names():
    files = [path for path in TESTS.rglob("*.py") if path.parent.name not in ("oracles", "rules")]
    assert len(files) > 50
    found = {
        str(path.relative_to(TESTS)): behind(path.read_text(encoding="utf-8")) for path in files
    }
    assert {name: lines for name, lines in found.items() if lines} == {}


WAYS = {  # texts of a test, and the module behind that each uses; none where that is allowed
    "from calibration import fitting": "calibration.fitting",
    "from calibration.fitting.run import run": "calibration.fitting.run",
    "import calibration as cal\ncal.fitting.run": "calibration.fitting",
    "def f():\n    from calibration.data import checks": "calibration.data",
    "import_module(f'calibration.commands.{name}')": "calibration.commands",
    "from calibration.fitting import rows  # a reason is none here": "calibration.fitting",
    "from softjax.engine import energy": "softjax.engine",
    "import calibration as cal\nimport softjax as sj\ncal.fit\nsj.restitution": None,
    "from calibration import fit, cli\nfrom calibration.cli import main": None,
    "from softjax.engine.energy import x  # works are compared with quadrature": None,
    "# roots have a contract of their own\nfrom softjax.numerics import search": None,
    '"""Tests `softjax.engine.energy` as it is."""\nfrom softjax.engine import energy': None,
}


@pytest.mark.parametrize("text", WAYS)
def test_ways_behind_are_noticed_and_reasons_let_through(text):
    found = {line.partition(": ")[2] for line in behind(text)}
    assert WAYS[text] in found if WAYS[text] else not found
