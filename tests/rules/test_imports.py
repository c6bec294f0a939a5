"""What imports what: one direction, no cycles, and nothing heavy before it is asked for."""

import ast
import importlib
import subprocess
import sys
from pathlib import Path

import pytest

import calibration as cal

ROOT = Path(__file__).parents[2]
HEAVY = (
    "diffrax",
    "optimistix",
    "optax",
    "lineax",
    "scipy",
    "matplotlib",
    "rich",
    "pandas",
    "pint",
    "jinja2",
    "blackjax",
    "arviz",
    "xarray",
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
    {"engine.energy", "engine.motion", "engine.damped"},
    {"routes"},
    {"engine.impact"},
    {"restitution"},
    {"history", "many_body"},
]
LEVEL = {name: level for level, names in enumerate(LAYERS) for name in names}
ROUTES = {
    "energy": {"engine.energy", "numerics.quadrature"},
    "ode": {f"engine.{name}" for name in ("motion", "bridge", "encke", "falls", "phase", "damped")},
}


def modules(package):
    """Files of a package by dotted name without the package's own."""
    folder = ROOT / package
    found = {}
    for path in sorted(folder.rglob("*.py")):
        parts = path.relative_to(folder).with_suffix("").parts
        found[".".join(p for p in parts if p != "__init__")] = path
    return found


def imported(path, package):
    """Dotted names that a file imports from the package, wherever in the file."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: a relative import, which this test cannot follow"
            names.add(node.module)
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    own = {name for name in names if name.split(".")[0] == package}
    return {name.removeprefix(package).removeprefix(".") for name in own}


def part(name):
    """The module of softjax that a dotted name belongs to; laws are one."""
    parts = name.split(".")
    return ".".join(parts[:2] if parts[0] in ("engine", "numerics") else parts[:1])


SOFTJAX = modules("softjax")


def edges():
    """Pairs (module, imported module) within softjax, the package's own __init__ left out."""
    known = {part(name) for name in SOFTJAX if name}
    for name, path in SOFTJAX.items():
        for target in imported(path, "softjax"):
            if name and part(target) in known:
                yield part(name), part(target)


def test_every_module_has_a_layer():
    assert {part(name) for name in SOFTJAX if name} <= set(LEVEL)


def test_softjax_imports_downwards():
    assert len(list(edges())) > 20
    for name, target in edges():
        assert LEVEL[target] <= LEVEL[name], f"{name} imports {target}"


def has_no_cycle(edges):
    """Walk the pairs (module, imported module) down; a module met on its own way fails."""
    graph = {}
    for name, target in edges:
        if name != target:
            graph.setdefault(name, set()).add(target)
    seen, path = set(), []

    def visit(name):
        assert name not in path, f"cycle: {[*path, name]}"
        if name not in seen:
            path.append(name)
            for target in graph.get(name, ()):
                visit(target)
            path.pop()
            seen.add(name)

    for name in graph:
        visit(name)
    return True


def test_softjax_has_no_cycle():
    assert has_no_cycle(edges())


def test_a_cycle_would_be_found():
    assert has_no_cycle([("a", "b"), ("a", "c"), ("b", "c"), ("c", "c")])
    with pytest.raises(AssertionError, match=r"cycle: \['a', 'b', 'c', 'a'\]"):
        has_no_cycle([("a", "b"), ("b", "c"), ("c", "a")])


def test_the_two_routes_share_the_law_and_nothing_else():
    for name, target in edges():
        for route, names in ROUTES.items():
            others = set().union(*(v for k, v in ROUTES.items() if k != route))
            assert not (name in names and target in others), f"{name} imports {target}"


def test_one_file_talks_to_diffrax():
    users = [
        name
        for name, path in SOFTJAX.items()
        if any(
            (isinstance(node, ast.Import) and any(a.name.startswith("diffrax") for a in node.names))
            or (isinstance(node, ast.ImportFrom) and (node.module or "").startswith("diffrax"))
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        )
    ]
    assert users == ["engine.bridge"]


def test_softjax_knows_nothing_of_calibration():
    for name, path in SOFTJAX.items():
        assert not imported(path, "calibration"), name


def test_calibration_uses_public_names_alone():
    for name, path in modules("calibration").items():
        public = {"", "laws", "fields", "batching"}
        used = {part(target) for target in imported(path, "softjax")}
        private = {t for t in used - public if f"{t}" in LEVEL}
        assert not private, f"calibration.{name} imports softjax.{private}"


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
sj.restitution(law, 1.0, sj.ODE())
stage()
"""


def test_importing_changes_no_setting_and_nothing_heavy_is_imported_before_it_is_used():
    code = STAGES.replace("HEAVY", repr(HEAVY))
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    imported, used, integrated = done.stdout.splitlines()
    assert imported == used == ""
    assert "diffrax" in integrated


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
CALIBRATION = {name: path for name, path in modules("calibration").items() if name}


# results show themselves: what draws them and reports them is imported when it is asked for
SHOWN = {"fitting.result", "studies.compare"}


def calibration_edges():
    """Pairs (module, imported module); that a package is imported with a module of it is not told."""
    for name, path in CALIBRATION.items():
        for target in imported(path, "calibration") & CALIBRATION.keys():
            shows = name in SHOWN and part(target) in ("plots", "report")
            if not name.startswith(f"{target}.") and not shows:
                yield name, target


def test_every_module_of_calibration_has_its_floor():
    assert {part(name) for name in CALIBRATION} == set(FLOOR)
    assert len(FLOORS) <= 8


def test_calibration_imports_downwards():
    found = list(calibration_edges())
    assert ("fitting.traceable", "fitting.collisions") in found
    assert ("commands.fit", "fitting.result") in found  # inside a function
    for name, target in found:
        assert FLOOR[part(target)] <= FLOOR[part(name)], f"{name} imports {target}"


def test_calibration_has_no_cycle():
    assert has_no_cycle(calibration_edges())
    assert has_no_cycle((part(name), part(target)) for name, target in calibration_edges())


def test_no_module_takes_a_name_from_the_package_it_is_in():
    """The package would have to be whole before its parts."""
    for name, path in CALIBRATION.items():
        package = name.rpartition(".")[0]
        taken = {t for t in imported(path, "calibration") if t.rpartition(".")[0] == package}
        assert not package or taken <= CALIBRATION.keys(), f"{name} imports {taken}"


def test_every_public_name_is_what_it_says_after_every_module_was_imported():
    """A module of a public name would take its place once it is imported."""
    for name in CALIBRATION:
        if name != "__main__":
            importlib.import_module(f"calibration.{name}")
    for name in cal.__all__:
        assert not hasattr(getattr(cal, name), "__path__"), name
        assert type(getattr(cal, name)).__name__ != "module", name
    assert {"fit", "problem", "compare", "read_csv", "read_toml", "LAWS"} <= set(cal.__all__)
    with pytest.raises(AttributeError, match="no attribute 'fitt'"):
        _ = cal.fitt
