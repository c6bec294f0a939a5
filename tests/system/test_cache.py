"""What is compiled for one command serves the next; `softjax doctor`; what is shipped says the same everywhere."""

import os
import platform
import re
import subprocess
import sys
import tomllib
from importlib import metadata, resources
from pathlib import Path

import jax
import pytest

import calibration as cal
from tests.command import run

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
CITATION = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
WORDS = ["curve", "nylon", "--law", "constant", "--set", "restitution=0.9", "--points", "3"]


def command(folder, *words):
    """What a command in a process of its own writes as curve.csv, with its caches below `folder`."""
    plain = {k: v for k, v in os.environ.items() if k != "JAX_COMPILATION_CACHE_DIR"}
    done = subprocess.run(
        [sys.executable, "-m", "calibration", *words, "--format", "csv", "--out", folder / "out"],
        env=plain | {"XDG_CACHE_HOME": str(folder), "HOME": str(folder)},
        capture_output=True,
        check=True,
    )
    assert done.stderr == b""
    return (folder / "out" / "curve.csv").read_text()


def programs(folder):
    """Files that JAX keeps below a folder, and what is in them."""
    return {path: path.read_bytes() for path in folder.rglob("*-cache") if path.is_file()}


@pytest.mark.skipif(sys.platform != "linux", reason="the folder of Linux")
def test_programs_are_kept_unless_not_wanted_and_written_again_where_cut_short(tmp_path):
    """JAX notes when an entry was used where it bounds its cache, and there alone."""
    first = command(tmp_path, *WORDS)
    kept = programs(tmp_path / "softjax")
    assert kept
    assert kept == programs(tmp_path)
    noted = {path.name.removesuffix("-atime") for path in tmp_path.rglob("*-atime")}
    assert noted == {path.name.removesuffix("-cache") for path in kept}
    for path, data in kept.items():
        path.write_bytes(data[: len(data) // 2])
        path.with_name(path.name.replace("-cache", "-atime")).unlink()
    assert command(tmp_path, *WORDS) == first
    again = programs(tmp_path)
    assert again.keys() == kept.keys()
    assert all(len(again[path]) > 0.9 * len(kept[path]) for path in kept)


def test_who_has_a_cache_keeps_it_and_without_a_place_nothing_fails(at, monkeypatch):
    """All tests have one, by the environment."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(at / "home"))
    assert run(*WORDS, "--format", "csv", "--quiet") == (0, "", "")
    assert not (at / "home").exists()
    monkeypatch.delenv("JAX_COMPILATION_CACHE_DIR")
    assert run("--no-cache", *WORDS, "--format", "csv", "--quiet") == (0, "", "")
    assert not (at / "home").exists()
    (at / "home").write_text("", encoding="utf-8")
    assert run(*WORDS, "--format", "csv", "--quiet") == (0, "", "")


PROCESSOR = "processor : {k}\nmodel name : {name}\nflags : fpu vme\ncpu MHz : {k}00\n"


def test_each_kind_of_processor_has_its_programs_in_a_bounded_folder(at, monkeypatch):
    """Machines of a cluster share a home; how many cores there are, and how fast now, is no matter."""
    read, config = Path.read_text, {}
    monkeypatch.setattr(jax.config, "update", config.__setitem__)
    monkeypatch.setenv("XDG_CACHE_HOME", str(at / "home"))
    monkeypatch.delenv("JAX_COMPILATION_CACHE_DIR")
    folders = []
    for name, count in (("A64", 1), ("A64", 3), ("B64", 3)):
        cores = "\n".join(PROCESSOR.format(k=k, name=name) for k in reversed(range(count)))
        of = {"/proc/cpuinfo": cores}
        monkeypatch.setattr(
            Path, "read_text", lambda path, of=of, **k: of.get(str(path)) or read(path, **k)
        )
        assert run(*WORDS, "--format", "csv", "--quiet") == (0, "", "")
        folders.append(Path(config.pop("jax_compilation_cache_dir")))
    one, same, other = folders
    assert one == same != other
    assert one.parent == other.parent == at / "home" / "softjax"
    assert {*one.parent.iterdir()} == {one, other}
    assert config == {
        "jax_enable_x64": True,
        "jax_compilation_cache_max_size": 2**28,
        "jax_persistent_cache_min_compile_time_secs": 0,
        "jax_persistent_cache_min_entry_size_bytes": -1,
    }


@pytest.mark.long
def test_time_integration_is_kept_too(tmp_path):
    """diffrax's checks would keep it from being kept; the largest program by far."""
    words = ("curve", "nylon", "--route", "ode", "--points", "3")
    command(tmp_path, *words)
    kept = programs(tmp_path)
    assert max(map(len, kept.values())) > 100_000
    command(tmp_path, *words)
    assert programs(tmp_path) == kept


def test_doctor_has_versions_and_checks_itself_by_narrow_limits(at, monkeypatch):
    """Each error is below its own limit, which no error of the physics would pass."""
    code, out, error = run("doctor", "--no-cache")
    assert (code, error) == (0, "")
    rows = (line.split(":", 1) for line in out.splitlines() if ":" in line)
    entries = {name: text.strip() for name, text in rows}
    assert entries["jax"] == jax.__version__
    assert entries["softjax-contact"] == metadata.version("softjax-contact")
    assert entries["Python"].split()[0] == platform.python_version()
    assert (entries["float64"], entries["compiled programs"]) == ("on", "not stored")
    assert "self-check passed" in out
    limits = {"energy balance": "1e-13", "its slopes": "1e-09", "time integration": "1e-08"}
    for name, most in limits.items():
        found, allowed = (part.split()[-1] for part in entries[name].split(","))
        assert allowed == most
        assert 0 < float(found) <= float(most)
    assert run("doctor", "--quiet") == (0, "", "")
    monkeypatch.setattr(jax, "jacfwd", lambda _: lambda theta: 0 * theta[:1, None])
    assert run("doctor", "--quiet") == (1, "", "softjax doctor: the self-check failed\n")
    assert "self-check FAILED" in run("doctor")[1]
    assert list(at.iterdir()) == []
    out = subprocess.check_output([sys.executable, "-m", "calibration", "--version"], text=True)
    assert out == f"softjax-contact {metadata.version('softjax-contact')}\n"


def test_types_are_told_and_the_stubs_name_all_that_is_public():
    for package in ("softjax", "calibration"):
        assert resources.files(package).joinpath("py.typed").is_file()
    stub = resources.files("calibration").joinpath("__init__.pyi").read_text(encoding="utf-8")
    assert stub.count("\nfrom ") == len(cal.__all__) > 5
    for name in cal.__all__:
        assert f" import {name} as {name}\n" in stub
        assert getattr(cal, name) is vars(cal)[name]
    with pytest.raises(AttributeError, match="module 'calibration' has no attribute 'ft'"):
        cal.ft  # noqa: B018
    assert {*cal.__all__, "__doc__"} <= {*dir(cal)}


def test_version_authors_dependencies_and_python_are_told_alike():
    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert re.search(r"^## (\S+?),? ", changes, re.M)[1] == PROJECT["version"]
    assert re.search(rf"^version: {re.escape(PROJECT['version'])}$", CITATION, re.M)
    authors = CITATION.partition("authors:\n")[2].partition("references:")[0]
    assert authors.strip() == "- name: The softjax authors"
    for name in PROJECT["dependencies"]:
        assert re.fullmatch(r"[a-z0-9]+>=[\d.]+", name), name
    versions = [c.rpartition(" ")[2] for c in PROJECT["classifiers"] if ":: 3." in c]
    assert versions[0] == PROJECT["requires-python"].removeprefix(">=")
