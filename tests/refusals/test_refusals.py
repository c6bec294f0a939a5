"""Every refusal names the place, what was given and what is accepted, in one line; the published schemas refuse the same."""

import copy
import dataclasses
import inspect
import json
import os
import tomllib

import jsonschema
import pytest

import calibration as cal
import softjax as sj
from tests import records
from tests.command import run
from tests.refusals.table import (
    CASES,
    CSV,
    FILE,
    TOML,
    WALL,
    changed,
    genuine,
    loaded,
    made,
    refusal,
    written,
)
from tests.shown.capture import as_recorded

LONGEST = 420  # characters beside the folder


@pytest.mark.parametrize(("way", "name"), CASES)
def test_a_refusal_names_place_value_and_what_is_accepted(way, name, tmp_path):
    where, words, *_ = CASES[way, name]
    error = refusal(way, name, tmp_path)
    assert isinstance(error, ValueError), "accepted"
    assert str(copy.copy(error)) == str(error)  # as pickle makes it again
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
    if f"{way} | {name}" in records.sentences(FILE, columns=2):
        records.as_sentence(FILE, f"{way} | {name}", line)


def test_the_files_that_the_cases_spoil_are_good(tmp_path):
    """A result that was saved loads back the same, with its bodies; and each whole sentence is of a case."""
    assert records.sentences(FILE, columns=2).keys() <= {" | ".join(case) for case in CASES}
    (data,) = cal.read_problem(written(tmp_path, TOML, CSV)).datasets
    assert len(data) == 3
    result = loaded(tmp_path, json.dumps(genuine()))
    assert json.loads(result.to_json()) == genuine()
    assert [body.radius for body in result.materials[0].data.bodies] == [0.0127, None]


def test_arguments_of_public_names_have_the_defaults_that_are_recorded():
    """A default decides about results as any argument does; *, where only a keyword may be stated."""
    called = {}
    for package, name in [(p, n) for p in (sj, cal) for n in p.__all__]:
        of = called[name] = getattr(package, name)
        bases = of.__mro__ if inspect.isclass(of) else ()
        mine = [
            base for base in bases if base.__module__.split(".")[0] in ("softjax", "calibration")
        ]
        members = {member for base in mine for member in vars(base) if member[0] != "_"}
        called |= {f"{name}.{member}": getattr(of, member) for member in members}
    lines = []
    for name, of in called.items():
        is_class = inspect.isclass(of) and dataclasses.is_dataclass(of)
        if is_class or inspect.isfunction(of) or inspect.ismethod(of):
            arguments = inspect.signature(of).parameters.values()
            marks = {p.name: "*" * (p.kind is p.KEYWORD_ONLY) + p.name for p in arguments}
            stated = {marks[p.name]: p.default for p in arguments if p.default is not p.empty}
            texts = [f"{k}={'a function' if callable(x) else x!r}" for k, x in stated.items()]
            lines += [f"{name}: {', '.join(texts)}"] if texts else []
    as_recorded("defaults", {"public names": "\n\n".join(sorted(lines))}, exactly=True)


READERS = [cal.read_csv, cal.read_toml, cal.read_problem, cal.FitResult.load]


def said(read, path):
    with pytest.raises(cal.InputError) as caught:
        read(path)
    assert str(caught.value).replace("\n", "").isprintable()
    return str(caught.value)


@pytest.mark.parametrize("read", READERS)
def test_what_is_no_regular_file_is_not_opened(read, tmp_path):
    os.mkfifo(tmp_path / "pipe")  # nobody writes: to open it is to wait for ever
    for path in (tmp_path / "pipe", "/dev/zero"):
        assert said(read, path).startswith(f"{path}: is a device or a pipe; ")
    assert said(read, tmp_path).startswith(f"{tmp_path}: is a directory; ")
    missing = tmp_path / "missing"
    assert said(read, missing).startswith(f"{missing}: no such file; ")


@pytest.mark.skipif(os.geteuid() == 0, reason="root reads everything")
def test_what_may_not_be_read(tmp_path):
    (tmp_path / "a.csv").write_text("v,e\n1,0.9\n")
    (tmp_path / "a.csv").chmod(0)
    assert "Permission denied" in said(cal.read_csv, tmp_path / "a.csv")


def test_a_path_that_is_not_utf_8_is_told_by_its_codes(tmp_path):
    path = os.fsdecode(os.fsencode(tmp_path) + b"/st\xfc.csv")
    assert r"st\udcfc.csv: no such file" in said(cal.read_csv, path)


LARGE = {  # of at most 2 MiB, which a reader that looks at each key again for each would not end
    "keys": ("".join(f"a{i:05d} = 1\n" for i in range(20_000)), "m.toml:1: unknown key 'a00000'"),
    "tables": ("[[material]]\n" * 20_000, "m.toml:1: data is missing"),
    "text": ('a = """' + "\\n" * 500_000 + '"""', "m.toml:1: unknown key 'a'"),
    "array": ("a = [" + "1,\n" * 30_000 + "]", "m.toml:1: unknown key 'a'"),
    "quotes": ('"""\\"' * 200_000, "m.toml:1: "),
}


@pytest.mark.parametrize("name", LARGE)
def test_large_material_files(name, tmp_path):
    text, words = LARGE[name]
    (tmp_path / "m.toml").write_text(text)
    assert words in said(cal.read_toml, tmp_path / "m.toml")


KINDS = [  # refusals that a single entry deserves, whatever stands beside it
    *("unknown key", "unknown key of a wall", "unknown table", "zero density"),
    *("truth for a number", "Poisson's ratio", "Poisson's ratio of -1", "unknown area"),
    *("a name that is a number", "repeats", "fit as a value"),
]
RESULTS = [
    *("fits: []", "data velocity: {}", "data restitution 2: -0.5"),
    *("rms: 1.0", "rms: True", "confidence: 5", "n: 2.5", "another format"),
]


@pytest.fixture(scope="module")
def schemas(tmp_path_factory):
    """Validators of both schemas, as the command writes them."""
    out = tmp_path_factory.mktemp("schemas")
    assert run("doctor", "--schema", out)[0] == 0
    tables = {path.name: json.loads(path.read_text("utf-8")) for path in out.iterdir()}
    assert set(tables) == {"material_file.schema.json", "fit.schema.json"}
    for table in tables.values():
        jsonschema.Draft202012Validator.check_schema(table)
    return {name: jsonschema.Draft202012Validator(table) for name, table in tables.items()}


SAID = "[fit]\nlaw = 'zhou'\nconfidence = 0.9\n[parameters]\nsigma = { bounds = [0, 1] }\nxi = 1\n"


@pytest.mark.parametrize("text", [TOML, TOML + WALL, SAID + TOML.replace("0.0127", '"12.7 mm"')])
def test_material_files_that_are_read_are_valid(text, schemas, tmp_path):
    assert schemas["material_file.schema.json"].is_valid(tomllib.loads(text))
    assert len(cal.read_problem(written(tmp_path, text, CSV)).datasets) == 1


@pytest.mark.parametrize("name", KINDS)
def test_material_files_that_are_not_valid_are_refused(name, schemas, tmp_path):
    text = made(CASES["TOML files", name][2], TOML).decode()
    assert not schemas["material_file.schema.json"].is_valid(tomllib.loads(text))
    assert refusal("TOML files", name, tmp_path) is not None


def test_a_result_is_valid(schemas):
    schemas["fit.schema.json"].validate(genuine())


@pytest.mark.parametrize("name", RESULTS)
def test_results_that_are_not_valid_are_refused(name, schemas, tmp_path):
    _, _, place, value = CASES["results", name]
    way = [int(part) if part.isdigit() else part for part in place.split(".")]
    assert not schemas["fit.schema.json"].is_valid(changed(genuine(), way, value))
    assert refusal("results", name, tmp_path) is not None
