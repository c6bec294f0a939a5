"""`curve`, `export` and `sensitivity` of a material file: a free parameter has a start and no value."""

import numpy as np
import pytest

import softjax as sj
from tests.command import BODIES, run

COMMANDS = {
    "curve": ("--points", "5", "--format", "csv"),
    "export": ("--to", "c", "--tolerance", "0.05"),
    "sensitivity": ("--points", "5"),
}
GIVEN = ("--sigma", "1", "--psi", "0.5")


@pytest.fixture
def file(at):
    """Write a material file with these parameters; χ̃ stands on line 9."""

    def write(chi):
        text = f"{BODIES}[material.parameters]\n{chi}\n"
        (at / "my.toml").write_text(text, encoding="utf-8")
        return "my.toml"

    return write


@pytest.mark.parametrize("command", COMMANDS)
def test_a_start_is_refused(command, file, at):
    for chi, said in (
        ("chi = { value = 0.1, bounds = [0.01, 10.0] }", "chi is free, and its value a start"),
        ("chi = { prior = [0.1, 0.05] }", "chi is free"),
    ):
        code, out, error = run(command, file(chi), *GIVEN, *COMMANDS[command], "--out", "results")
        accepted = "give --chi X, fix it by a plain number, or read its fit by --fit"
        assert (code, out, error) == (2, "", f"my.toml:9: {said}; {accepted}\n")
        assert not (at / "results").exists()
    code, _, error = run(
        command, "my.toml", "--chi", "0.2", *GIVEN, *COMMANDS[command], "--out", "results"
    )
    assert code == 0, error


def test_a_field_with_a_default_is_free_too(file):
    """Thornton's yield factor is 1 unless told; a file that leaves it to a fit does not say so."""
    words = ("curve", file("yield_factor = { value = 1.2 }"), "--law", "thornton", "--points", "5")
    code, _, error = run(*words)
    assert code == 2
    assert "my.toml:9: yield_factor is free" in error
    assert "--set yield_factor=X" in error
    assert run(*words, "--set", "yield_factor=1.2", "--format", "csv")[0] == 0
    of_another = ("curve", file("chi = { value = 0.1 }"), *words[2:])
    assert run(*of_another, "--format", "csv")[0] == 0


def test_a_fixed_parameter_is_taken(file, at):
    words = ("--from", "2", "--to", "20", "--points", "5", "--format", "npy", "--out", "results")
    alloy = sj.Material(2.5e9, 0.3, 1140.0, 4.0e7)
    pair = sj.Contact.between_spheres(alloy, alloy, 0.0127, 0.0127)
    for chi in ("chi = 0.2", "chi = { value = 0.2, free = false }"):
        assert run("curve", file(chi), *GIVEN, *words)[0] == 0
        made = np.load(at / "results/curve.npy")
        expected = sj.restitution(sj.Zhou(pair, 0.2, 1.0, 0.5), made["velocity"]).coefficient
        assert np.allclose(made["restitution"], expected, rtol=1e-12, atol=0)
