"""Bands, sensitivities and designs from draws that were made here, against NumPy on the same draws."""

import json

import numpy as np
import pytest

import calibration as cal
import softjax as sj
from calibration.fitting.posterior.inference_data import as_arviz, write
from tests.command import run
from tests.decay import Decay
from tests.posterior_cases import level, xarray

VELOCITY = np.array([0.7, 1.5, 3.9])
MEASURED = np.linspace(0.5, 4.0, 12)


def drawn(**variables):
    """ArviZ data of 2 chains of 300 draws of each (mean, standard deviation)."""
    random = np.random.default_rng(0)
    dims = ("chain", "draw")
    made = {n: (dims, m + s * random.standard_normal((2, 300))) for n, (m, s) in variables.items()}
    return as_arviz({"posterior": xarray.Dataset(made)})


def values_of(data, name):
    return np.ravel(np.asarray(data["posterior"][name]))


@pytest.fixture(scope="module")
def decay():
    errors = 0.02 * np.random.default_rng(0).standard_normal(len(MEASURED))
    data = cal.RestitutionData(MEASURED, 0.92 * np.exp(-0.3 * MEASURED) + errors)
    return cal.fit(data, Decay, profiles=False)


@pytest.fixture(scope="module")
def draws():
    return drawn(level=(0.92, 0.02), rate=(0.3, 0.04), noise=(0.05, 0.002))


def test_a_band_of_draws_is_their_quantiles(decay, draws):
    rates = values_of(draws, "rate")[:, None]
    curves = values_of(draws, "level")[:, None] * np.exp(-rates * VELOCITY)
    found = decay.band(VELOCITY, confidence=0.8, draws=draws)
    np.testing.assert_allclose(found.coefficient, np.mean(curves, axis=0), rtol=1e-12)
    np.testing.assert_allclose(found.low, np.quantile(curves, 0.1, axis=0), rtol=1e-12)
    np.testing.assert_allclose(found.high, np.quantile(curves, 0.9, axis=0), rtol=1e-12)
    np.testing.assert_allclose(found.standard_error, np.std(curves, axis=0, ddof=1), rtol=1e-10)
    plain = decay.band(VELOCITY, confidence=0.8)
    assert np.all(np.abs(plain.low - found.low) > 1e-3)


def test_one_more_measurement_has_the_noise_of_the_draws(decay, draws):
    curve = decay.band(VELOCITY, draws=draws).standard_error
    more = decay.band(VELOCITY, kind="prediction", draws=draws).standard_error
    np.testing.assert_allclose(more, np.hypot(curve, 0.05), rtol=0.1)


def test_draws_of_another_fit_are_refused(decay):
    other = drawn(restitution=(0.9, 0.01))
    with pytest.raises(
        ValueError, match="`draws` must be of the posterior of this fit, but is with"
    ):
        decay.band(VELOCITY, draws=other)


def test_a_band_of_draws_has_a_confidence_too(decay, draws):
    for confidence in (95, 0):
        with pytest.raises(ValueError, match="`confidence` must be between 0 and 1"):
            decay.band(VELOCITY, confidence=confidence, draws=draws)


def test_a_fit_at_draws_has_their_laws(decay, draws):
    fits = decay.at_draws(draws, 3)
    which = [0, 300, 599]
    np.testing.assert_array_equal([f.law.rate for f in fits], values_of(draws, "rate")[which])
    np.testing.assert_array_equal([f.law.level for f in fits], values_of(draws, "level")[which])
    with pytest.raises(ValueError, match="`count` must be a whole number from 1 to 600"):
        decay.at_draws(draws, 601)


def log_variance(shots, levels, rates, noise, measured_noise):
    """ln of the variance of ln rate with these shots beside the measured ones, averaged over draws."""
    total = []
    for a, b in zip(levels, rates, strict=True):
        rows = [
            np.stack([np.ones(len(v)), -b * v], axis=1) * (a * np.exp(-b * v) / u)[:, None]
            for v, u in ((np.asarray(shots), noise), (MEASURED, measured_noise))
        ]
        jacobian = np.concatenate(rows)
        total.append(np.log(np.linalg.inv(jacobian.T @ jacobian)[1, 1]))
    return np.mean(total)


def test_a_design_over_draws_is_the_best_on_average(decay):
    """Slow and fast decays want other velocities; the local design knows of neither."""
    wide = drawn(level=(0.92, 0.01), rate=(0.6, 0.15))
    fits = decay.at_draws(wide, 8)
    told = {"criterion": "c", "target": "rate", "uncertainty": 0.01, "seed": 0}
    found = cal.optimal_velocities(fits, 4, (0.2, 8.0), **told)
    local = cal.optimal_velocities(decay, 4, (0.2, 8.0), **told)
    levels, rates = ([getattr(f.law, n) for f in fits] for n in ("level", "rate"))
    noise = decay.materials[0].noise
    scores = {
        name: log_variance(shots, levels, rates, 0.01, noise)
        for name, shots in (("draws", found.velocity), ("local", local.velocity))
    }
    assert scores["draws"] < scores["local"] - 0.01
    random = np.random.default_rng(0)
    for shots in random.uniform(0.2, 8.0, (200, 4)):
        assert scores["draws"] < log_variance(shots, levels, rates, 0.01, noise) + 1e-3


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A fit of a constant and draws, as the commands read them; and the draws."""
    folder = tmp_path_factory.mktemp("draws")
    cal.fit(level(), sj.ConstantRestitution, profiles=False).save(folder / "fit.json")
    data = drawn(restitution=(0.8, 0.03), noise=(0.05, 0.002))
    write(data, folder / "posterior.nc")
    return folder, values_of(data, "restitution")


def test_the_curve_s_band_is_that_of_the_draws(files):
    folder, values = files
    given = ("--fit", folder / "fit.json", "--posterior", folder / "posterior.nc")
    where = (
        "--from",
        "1",
        "--to",
        "2",
        "--points",
        "3",
        "--format",
        "csv",
        "--out",
        folder / "out",
    )
    assert run("curve", *given, *where)[0] == 0
    rows = (folder / "out" / "curve.csv").read_text().splitlines()
    assert rows[0].startswith("velocity [m/s],restitution,restitution_low,restitution_high")
    _, *numbers = (float(cell) for cell in rows[1].split(",")[:4])
    expected = [np.mean(values), *np.quantile(values, [0.025, 0.975])]
    np.testing.assert_allclose(numbers, expected, rtol=1e-12)


def test_sensitivities_have_the_limits_of_the_draws(files):
    """θ ∂ε/∂θ of a constant is ε itself."""
    folder, values = files
    given = ("--fit", folder / "fit.json", "--posterior", folder / "posterior.nc")
    code, out, _ = run("sensitivity", *given, "--out", folder / "local")
    assert code == 0
    table = json.loads((folder / "local" / "sensitivity.json").read_text())["local"]["limits"]
    chosen = values[np.linspace(0, 599, 200).round().astype(int)]
    low, high = np.quantile(chosen, [0.025, 0.975])
    np.testing.assert_allclose(table["restitution"], [[low] * 3, [high] * 3], rtol=1e-12)
    assert f"{low:.4f} … {high:.4f}" in out
    assert "95 % of draws at v [m/s]" in out


def test_a_design_of_the_command_is_over_draws(files):
    folder, _ = files
    given = ("--fit", folder / "fit.json", "--posterior", folder / "posterior.nc")
    told = ("--study", "design", "--shots", "2", "--out", folder / "design")
    code, out, _ = run("sensitivity", *given, *told)
    assert code == 0
    assert "on average over 16 draws of the posterior: c-optimal" in out
    table = json.loads((folder / "design" / "sensitivity.json").read_text())
    assert table["design"]["draws"] == 16


@pytest.mark.parametrize("command", ["curve", "sensitivity"])
def test_draws_without_their_fit_are_refused(command, files):
    code, _, err = run(
        command, "nylon", "--posterior", files[0] / "posterior.nc", "--out", files[0]
    )
    assert code == 2
    assert "`--posterior` must be given with --fit, whose draws they are" in err
