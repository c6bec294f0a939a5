"""What is compiled for one command serves the next, and nobody else's machine."""

import os
import subprocess
import sys

import jax
import pytest

from calibration import cache


@pytest.fixture
def settings(monkeypatch, tmp_path):
    """What is set of JAX, in a home of its own."""
    told = {}
    monkeypatch.setattr(jax.config, "update", lambda name, value: told.update({name: value}))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.delenv("JAX_COMPILATION_CACHE_DIR", raising=False)
    monkeypatch.setattr(sys, "platform", "linux")
    return told


def test_everything_is_kept_in_the_users_folder(settings, tmp_path):
    folder = cache.keep_compilations()
    assert folder.parent == tmp_path / "softjax"
    assert folder.is_dir()
    assert settings["jax_compilation_cache_dir"] == str(folder)
    assert settings["jax_persistent_cache_min_compile_time_secs"] == 0
    assert settings["jax_persistent_cache_min_entry_size_bytes"] == -1


@pytest.mark.parametrize("what", ["_processor", "version"])
def test_another_processor_or_version_has_another_folder(what, settings, monkeypatch):
    first = cache.cache_folder()
    owner = cache if what == "_processor" else cache.importlib.metadata
    monkeypatch.setattr(owner, what, lambda *name: "another")
    assert cache.cache_folder() != first


def test_who_has_a_cache_keeps_it(settings, monkeypatch):
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", "elsewhere")
    assert cache.keep_compilations() is None
    assert settings == {}


def test_without_a_place_nothing_is_kept_and_nothing_fails(settings, monkeypatch, tmp_path):
    (tmp_path / "softjax").write_text("", encoding="utf-8")
    assert cache.keep_compilations() is None
    assert settings == {}


def test_what_was_used_longest_ago_makes_room(settings, monkeypatch, tmp_path):
    """Of what JAX compiled; whatever else lies there is the user's."""
    other = tmp_path / "softjax" / "older version"
    other.mkdir(parents=True)
    for age, name in enumerate(("new-cache", "old-cache", "oldest-cache", "notes")):
        (other / name).write_bytes(bytes(100))
        os.utime(other / name, (1e9 - age, 1e9 - age))
    monkeypatch.setattr(cache, "LARGEST", 250)
    cache.keep_compilations()
    assert {path.name for path in other.iterdir()} == {"new-cache", "old-cache", "notes"}


def command(tmp_path, *words) -> int:
    """How many programs are kept after a command in a process of its own."""
    kept = {k: v for k, v in os.environ.items() if k != "JAX_COMPILATION_CACHE_DIR"}
    subprocess.run(
        [sys.executable, "-m", "calibration", *words, "--quiet", "--out", str(tmp_path / "out")],
        env=kept | {"XDG_CACHE_HOME": str(tmp_path)},
        check=True,
    )
    return len(list(tmp_path.glob("softjax/*/*-cache")))


def test_a_command_keeps_its_programs_unless_told_not_to(tmp_path):
    words = ("curve", "nylon", "--law", "constant", "--set", "restitution=0.9", "--points", "3")
    assert command(tmp_path, *words, "--no-cache") == 0
    assert command(tmp_path, *words) > 0


@pytest.mark.long
def test_time_integration_is_kept_too(tmp_path):
    """diffrax's checks would keep it from being kept; the largest program by far."""
    words = ("curve", "nylon", "--route", "ode", "--points", "3")
    count = command(tmp_path, *words)
    sizes = [path.stat().st_size for path in tmp_path.glob("softjax/*/*-cache")]
    assert max(sizes) > 100_000
    assert command(tmp_path, *words) == count
