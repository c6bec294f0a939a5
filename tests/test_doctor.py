"""`softjax doctor` and `softjax --version`: what a report of a fault brings."""

import platform
from importlib import metadata

import jax
import pytest

from calibration.commands import doctor
from tests.command import run


@pytest.fixture(scope="module")
def errors():
    return doctor.self_check()


def test_the_self_check_holds_against_digits_computed_elsewhere(errors):
    assert errors.keys() == doctor.LARGEST.keys()
    assert all(errors[name] < most for name, most in doctor.LARGEST.items())


def test_versions_devices_and_settings_are_told(errors, monkeypatch, tmp_path):
    monkeypatch.setattr(doctor, "self_check", lambda: errors)
    code, out, err = run("doctor", "--no-cache")
    assert (code, err) == (0, "")
    told = dict(line.split(":", 1) for line in out.splitlines() if ":" in line)
    assert told["jax"].strip() == jax.__version__
    assert told["softjax-contact"].strip() == metadata.version("softjax-contact")
    assert told["Python"].split()[0] == platform.python_version()
    assert told["float64"].strip() == "on"
    assert told["compiled programs"].strip().startswith("not kept")
    assert "self-check passed" in out


@pytest.mark.parametrize("name", doctor.LARGEST)
def test_an_error_too_large_is_told_by_words_and_code(errors, name, monkeypatch):
    broken = {**errors, name: 2 * doctor.LARGEST[name]}
    monkeypatch.setattr(doctor, "self_check", lambda: broken)
    code, out, _ = run("doctor", "--no-cache")
    assert code == 1
    assert "self-check FAILED" in out
    code, out, err = run("doctor", "--no-cache", "--quiet")
    assert (code, out) == (1, "")
    assert "failed" in err


def test_the_version_is_that_of_the_distribution(capsys):
    with pytest.raises(SystemExit) as end:
        run_version()
    assert end.value.code == 0
    assert capsys.readouterr().out == f"softjax-contact {metadata.version('softjax-contact')}\n"


def run_version():
    from calibration import cli

    cli.main(["--version"])
