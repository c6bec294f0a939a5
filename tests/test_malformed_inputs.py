"""Malformed input files: each is refused in one line that names the file, the line and the cure.

The cases stand in `malformed_csv` and `malformed_toml`; `written` puts one into a directory.
"""

from pathlib import Path

import pytest

from calibration.errors import InputError
from calibration.problem_file import read_problem, read_toml
from tests.malformed_csv import CSV_CASES, Case
from tests.malformed_toml import PARAMETERS, TOML_CASES

CASES = {f"csv: {name}": case for name, case in CSV_CASES.items()} | {
    f"toml: {name}": case for name, case in TOML_CASES.items()
}


def written(case: Case, directory: Path) -> Path:
    """Put the case's files into a directory; the path of the TOML file."""
    files = {"m.toml": case.toml, "m.csv": case.csv}
    for name, content in files.items():
        if content is not None:
            raw = content if isinstance(content, bytes) else content.encode()
            (directory / name).write_bytes(raw)
    return directory / "m.toml"


def test_the_files_that_the_cases_spoil_are_good(tmp_path):
    (data,) = read_toml(written(Case("", ""), tmp_path))
    assert len(data) == 3
    written(Case("", "", PARAMETERS + "psi = 0.5\n"), tmp_path)
    assert read_problem(tmp_path / "m.toml").parameters[0]["psi"].value == 0.5


@pytest.mark.parametrize("name", CASES)
def test_malformed_input_is_told_in_one_line(name, tmp_path):
    case = CASES[name]
    with pytest.raises(InputError) as caught:
        read_problem(written(case, tmp_path))
    message = str(caught.value)
    assert message.startswith(f"{tmp_path}/{case.start}"), message
    _, accepted = message.removeprefix(str(tmp_path)).split("; ", 1)
    assert case.says in accepted, message
    assert "\n" not in message
    assert len(message.removeprefix(str(tmp_path))) < 300


def test_there_are_thirty():
    assert len({case.start for case in CASES.values()}) >= 30


def test_a_missing_material_file_is_told_without_a_line(tmp_path):
    with pytest.raises(InputError) as caught:
        read_problem(tmp_path / "n.toml")
    assert str(caught.value).startswith(f"{tmp_path}/n.toml: no such file; ")
    assert caught.value.line is None
    with pytest.raises(InputError, match="cannot be read"):
        read_problem(tmp_path)
