"""Every refusal names the place, what was given and what is accepted, in one line."""

import json

import pytest

import calibration as cal
from tests.refusals.__main__ import sentence, sentences
from tests.refusals.table import CASES, CSV, TOML, genuine, loaded, refusal, written

LONGEST = 420  # characters beside the folder


@pytest.mark.parametrize(("way", "name"), CASES)
def test_a_refusal_names_place_value_and_what_is_accepted(way, name, tmp_path):
    where, words, *_ = CASES[way, name]
    error = refusal(way, name, tmp_path)
    assert isinstance(error, ValueError), "accepted"
    line = str(error).replace(str(tmp_path), "FOLDER")
    assert line.replace("\n", "").isprintable()
    assert len(line) < LONGEST
    if isinstance(error, cal.InputError):
        file, _, number = where.partition(":")
        assert line.startswith(f"FOLDER/{where}: " if file else "FOLDER"), line
        assert error.line == (int(number) if number else None)
        assert error.problem
        assert error.accepted
    else:
        assert f"`{where}`" in line, line
    for word in words.split("|"):
        assert word in line, line


def test_the_files_that_the_cases_spoil_are_good(tmp_path):
    """And a result that was saved loads back the same, with its bodies."""
    (data,) = cal.read_problem(written(tmp_path, TOML, CSV)).datasets
    assert len(data) == 3
    result = loaded(tmp_path, json.dumps(genuine()))
    assert json.loads(result.to_json()) == genuine()
    assert [body.radius for body in result.materials[0].data.bodies] == [0.0127, None]


@pytest.mark.parametrize(("way", "name"), sentences())
def test_whole_sentences(way, name, tmp_path):
    """As `sentences.txt` has them, which `python -m tests.refusals` writes again."""
    assert sentence(way, name, tmp_path) == sentences()[way, name]
