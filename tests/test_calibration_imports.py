"""Which modules of `calibration` import which: downwards alone, and nothing heavy at first."""

import ast

import pytest

from tests.test_imports import has_no_cycle, loaded_after, modules

# data, parameters → objective → search → uncertainty → result → fit → report, plots → commands
LAYERS = [
    {"errors", "atomic", "progress", "text_file", "toml_lines", "parameters_spec", "commands"},
    {"table", "repeats", "toml_table", "parameters_file", "settings", "bodies", "parameters"},
    {"data", "csv_file"},
    {"material_file", "empirical"},
    {"toml_file", "embedded"},
    {"impacts", "objective", "specs", "assemble", "problem"},
    {"ending", "lbfgs", "adam", "marquardt", "search", "starts", "stages", "batch"},
    {"uncertainty", "profiles", "derived"},
    {"doubt", "minima", "estimate", "material_fit", "result", "result_text", "result_json"},
    {"intervals", "suspicions", "material_summary", "summary", "bands", "line"},
    {"fitting", "coverage"},
    {"report", "plots", "curve", "sensitivities", "compare", "speed"},
    {"cli"},
    {"__main__"},
]
LEVEL = {name: level for level, names in enumerate(LAYERS) for name in names}
CALIBRATION = modules("calibration")


def at_import(path):
    """Dotted names that a file imports from calibration outside of its functions."""
    names = set()
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("calibration"):
            whole = {f"{node.module}.{alias.name}" for alias in node.names}
            names |= {n for n in whole if n.removeprefix("calibration.") in CALIBRATION} or {
                node.module
            }
        elif isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names if alias.name.startswith("calibration")}
    return {name.removeprefix("calibration").removeprefix(".") for name in names} - {""}


def edges():
    """Pairs (module, imported module), each the top-level one."""
    for name, path in CALIBRATION.items():
        for target in at_import(path):
            if name and target in CALIBRATION:
                yield name, target


def test_every_module_has_a_layer():
    assert {name.split(".")[0] for name in CALIBRATION if name} <= set(LEVEL)


def test_imports_go_downwards():
    found = list(edges())
    assert len(found) > 80
    for name, target in found:
        if name.startswith("commands."):
            continue  # a command is the last to be imported
        upper, lower = name.split(".")[0], target.split(".")[0]
        assert LEVEL[lower] <= LEVEL[upper], f"{name} imports {target}"


def test_there_is_no_cycle():
    assert has_no_cycle(edges())


@pytest.mark.parametrize(
    "code", ["import calibration", "from calibration import RestitutionData, read_csv, read_toml"]
)
def test_nothing_heavy_is_imported(code):
    assert loaded_after(code) == set()


def test_every_public_name_is_there():
    import calibration as cal

    assert all(getattr(cal, name) is not None for name in cal.__all__)
    assert {"fit", "read_csv", "read_toml", "RestitutionData"} <= set(cal.__all__)
    # importing a submodule of that name would put it in the name's place
    assert not set(cal.__all__) & {name.split(".")[0] for name in CALIBRATION}
    with pytest.raises(AttributeError, match="no attribute 'fitt'"):
        _ = cal.fitt
