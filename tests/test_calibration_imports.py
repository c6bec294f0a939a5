"""Which modules of `calibration` import which: downwards alone, and nothing heavy at first.

An import inside a function counts as one at the top of a file.
"""

import pytest

from tests.test_imports import has_no_cycle, imported, loaded_after, modules, part

FLOORS = [
    {"lazily", "errors", "rounding", "choices", "progress", "atomic"}
    | {"cache", "signals", "terminal"},
    {"parameters", "data"},
    {"problem_file", "fitting"},
    {"report", "coverage"},
    {"curve", "studies"},
    {"plots"},
    {"commands", "speed", "handover"},
    {"cli", "__main__"},
]
FLOOR = {name: floor for floor, names in enumerate(FLOORS) for name in names}
CALIBRATION = {name: path for name, path in modules("calibration").items() if name}


def edges():
    """Pairs (module, imported module); that a package is imported with a module of it is not told."""
    for name, path in CALIBRATION.items():
        for target in imported(path, "calibration") & CALIBRATION.keys():
            if not name.startswith(f"{target}."):
                yield name, target


def test_every_module_has_its_floor():
    assert {part(name) for name in CALIBRATION} == set(FLOOR)
    assert len(FLOORS) <= 8


def test_imports_go_downwards():
    found = list(edges())
    assert ("fitting.traceable", "fitting.collisions") in found
    assert ("commands.fit", "fitting.door") in found  # inside a function
    for name, target in found:
        assert FLOOR[part(target)] <= FLOOR[part(name)], f"{name} imports {target}"


def test_no_import_goes_in_a_circle():
    assert has_no_cycle(edges())
    assert has_no_cycle((part(name), part(target)) for name, target in edges())


def test_no_module_takes_a_name_from_the_package_it_is_in():
    """The package would have to be whole before its parts."""
    for name, path in CALIBRATION.items():
        package = name.rpartition(".")[0]
        taken = {t for t in imported(path, "calibration") if t.rpartition(".")[0] == package}
        assert not package or taken <= CALIBRATION.keys(), f"{name} imports {taken}"


@pytest.mark.parametrize(
    "code", ["import calibration", "from calibration import RestitutionData, read_csv, read_toml"]
)
def test_nothing_heavy_is_imported(code):
    assert loaded_after(code) == set()


def test_every_public_name_is_what_it_says_after_every_module_was_imported():
    """A module of a public name would take its place once it is imported."""
    import importlib

    import calibration as cal

    for name in CALIBRATION:
        if name != "__main__":
            importlib.import_module(f"calibration.{name}")
    for name in cal.__all__:
        assert not hasattr(getattr(cal, name), "__path__"), name
        assert type(getattr(cal, name)).__name__ != "module", name
    assert {"fit", "problem", "compare", "read_csv", "read_toml", "LAWS"} <= set(cal.__all__)
    with pytest.raises(AttributeError, match="no attribute 'fitt'"):
        _ = cal.fitt
