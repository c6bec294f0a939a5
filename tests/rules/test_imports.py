"""What imports what: one direction, no cycles, and nothing heavy before it is needed."""

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
    {"checks", "engine", "numerics", "numerics.powers", "numerics.roots", "status"},
    {"fields", "numerics.derivatives", "numerics.gauss", "numerics.quadrature"},
    {"materials"},
    {"contact"},
    {"batching"},
    {"laws"},
    {"engine.bridge"},
    {"engine.outcome", "engine.phase", "engine.falls"},
    {"engine.encke"},
    {"engine.energy", "engine.motion"},
    {"routes"},
    {"engine.impact"},
    {"restitution"},
    {"history", "many_body"},
]
LEVEL = {name: level for level, names in enumerate(LAYERS) for name in names}
ROUTES = {
    "energy": {"engine.energy", "numerics.quadrature"},
    "ode": {f"engine.{name}" for name in ("motion", "bridge", "encke", "falls", "phase")},
}


# calibration in floors: a module imports from lower ones, or from its own; also inside functions
FLOORS = [
    {"lazily", "errors", "rounding", "schema", "options", "output", "console", "observables"},
    {"parameters", "paper", "data"},
    {"fitting", "symbols"},
    {"curves", "studies"},
    {"plots"},
    {"report"},
    {"commands", "speed", "particle_codes"},
    {"cli", "__main__"},
]
FLOOR = {name: floor for floor, names in enumerate(FLOORS) for name in names}
# results show themselves: what draws them and reports them is imported when it is needed
SHOWN = {"fitting.result", "studies.compare"}


def modules(package):
    """Files of a package by dotted name without the package's own."""
    paths = sorted((ROOT / package).rglob("*.py"))
    names = (path.relative_to(ROOT / package).with_suffix("").parts for path in paths)
    found = {
        ".".join(p for p in way if p != "__init__"): path
        for way, path in zip(names, paths, strict=True)
    }
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
EDGES = {
    (part(name), part(target))
    for name, path in SOFTJAX.items()
    for target in imported(path, "softjax")
    if part(target) in LEVEL
}
CALIBRATION_EDGES = {  # that a package is imported with a module of it is not listed
    (name, target)
    for name, path in CALIBRATION.items()
    for target in imported(path, "calibration")
    if target in CALIBRATION and not name.startswith(f"{target}.")
    if not (name in SHOWN and part(target) in ("plots", "report"))
}


def has_no_cycle(edges):
    graph = {}
    for name, target in edges:
        if name != target:
            graph.setdefault(name, set()).add(target)
    graphlib.TopologicalSorter(graph).prepare()


def upwards(edges, levels, of=part):
    return [f"{a} imports {b}" for a, b in edges if levels[of(b)] > levels[of(a)]]


def test_every_module_has_its_layer_and_imports_downwards_in_no_cycle():
    assert {part(name) for name in SOFTJAX} <= set(LEVEL)
    assert {part(name) for name in CALIBRATION} == set(FLOOR)
    assert len(FLOORS) <= 8
    assert len(EDGES) > 20
    assert ("fitting.traceable", "fitting.collisions") in CALIBRATION_EDGES
    assert ("commands.fit", "fitting.result") in CALIBRATION_EDGES  # inside a function
    assert upwards(EDGES, LEVEL) == []
    assert upwards(CALIBRATION_EDGES, FLOOR) == []
    assert upwards([("cli", "data.air"), ("data.air", "cli")], FLOOR) == ["data.air imports cli"]
    for edges in (EDGES, CALIBRATION_EDGES, {(part(a), part(b)) for a, b in CALIBRATION_EDGES}):
        has_no_cycle(edges)
    with pytest.raises(graphlib.CycleError):
        has_no_cycle([("a", "b"), ("b", "c"), ("c", "a")])


def test_routes_share_the_law_alone_one_file_talks_to_diffrax_and_calibration_uses_public_names():
    for name, target in EDGES:
        for route, names in ROUTES.items():
            others = set().union(*(v for k, v in ROUTES.items() if k != route))
            assert not (name in names and target in others), f"{name} imports {target}"
    users = {n for n, path in SOFTJAX.items() if any(True for _ in imported(path, "diffrax"))}
    assert users == {"engine.bridge"}
    assert not any(list(imported(path, "calibration")) for path in SOFTJAX.values())
    for name, path in CALIBRATION.items():
        private = {part(one) for one in imported(path, "softjax")} & set(LEVEL)
        assert private <= {"laws", "fields", "batching", "many_body"}, f"calibration.{name}"


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
