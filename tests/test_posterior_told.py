"""What draws are told as: doubts, words, a picture, files of the command."""

from types import SimpleNamespace

import numpy as np
import pytest

import calibration as cal
from calibration.fitting.posterior.diagnostics import doubts_of, summaries
from calibration.fitting.posterior.inference_data import as_arviz, dataset_of, read
from calibration.plots.posterior import posterior_figure
from calibration.report.posterior import known, posterior_section
from tests.command import run
from tests.posterior_cases import az, xarray

DIMS = ("chain", "draw")
ABOUT = {"unit": "-", "prior": "made up", "prior_share": 0.1, "lower": -np.inf, "upper": np.inf}


def made(diverging=0, energy=None, **variables):
    """ArviZ data of made draws; a variable is (draws, what is told of it)."""
    shape = next(iter(variables.values()))[0].shape
    flags = np.arange(np.prod(shape)).reshape(shape) < diverging
    independent = np.random.default_rng(7).standard_normal(shape)
    statistics = {"diverging": flags, "energy": independent if energy is None else energy}
    told = {name: (DIMS, draws, ABOUT | about) for name, (draws, about) in variables.items()}
    attrs = {
        "inference_library": "blackjax",
        "inference_library_version": "1",
        "warmup": 10,
        "seed": 0,
    }
    return as_arviz(
        {
            "posterior": xarray.Dataset(told, attrs=attrs),
            "sample_stats": xarray.Dataset({name: (DIMS, v) for name, v in statistics.items()}),
        }
    )


def normal(draws=1000, seed=0, mean=0.0):
    return mean + np.random.default_rng(seed).standard_normal((4, draws))


def codes(data):
    return [doubt.code for doubt in doubts_of(data)]


def test_good_draws_raise_no_doubt():
    assert codes(made(a=(normal(), {}))) == []


def test_each_way_to_go_wrong_has_a_name_and_a_remedy():
    apart = normal() + np.array([0.0, 0.0, 0.0, 1.0])[:, None]
    assert "r-hat" in codes(made(a=(apart, {})))
    assert codes(made(a=(normal(60), {}))) == ["effective-size"]
    assert codes(made(a=(normal(), {}), diverging=1)) == ["divergences"]
    slow = np.cumsum(normal(), axis=1)  # neighbours differ little, as along a funnel
    assert codes(made(a=(normal(), {}), energy=slow)) == ["funnel"]
    piled = np.abs(normal()) ** 4
    assert codes(made(a=(piled, {"lower": 0.0}))) == ["mass-at-bound"]
    inside = 0.5 + 0.05 * normal()
    assert codes(made(a=(inside, {"lower": 0.0, "upper": 1.0}))) == []
    assert codes(made(a=(normal(), {"prior_share": 0.9}))) == ["follows-prior"]
    (doubt,) = doubts_of(made(a=(normal(), {"prior_share": 0.9})))
    assert "a (made up)" in doubt.cause
    assert "state a prior you stand by" in doubt.remedy


def test_summaries_are_moments_and_central_limits():
    draws = normal(mean=3.0)
    one = summaries(made(a=(draws, {"unit": "s"})), confidence=0.9)["a"]
    assert one.mean == pytest.approx(np.mean(draws))
    assert one.deviation == pytest.approx(np.std(draws, ddof=1))
    assert (one.low, one.high) == pytest.approx(np.quantile(draws, [0.05, 0.95]))
    assert one.r_hat == pytest.approx(float(az.rhat(draws)))
    expected = min(float(az.ess(draws)), float(az.ess(draws, method="tail", prob=(0.05, 0.95))))
    assert one.effective == pytest.approx(expected)
    assert one.unit == "s"


def test_words_say_what_is_known_and_what_is_not():
    data = made(
        chi=(normal(mean=9.0), {"prior_share": 0.05}),
        rate=(normal(), {"prior_share": 0.5}),
        sigma=(normal(), {"prior_share": 0.95}),
    )
    tell, narrow, not_told, together = known(summaries(data))
    assert tell.startswith("The data tell χ̃ = 9.0")
    assert narrow == "The data narrow rate (50 % of its prior's width left)."
    assert not_told == "The data do not tell σ (95 % of its prior's width left)."
    assert "ε_up" in together
    text = "\n".join(line for block in posterior_section(data, 0.95) for line in block)
    assert "4 chains of 1000 draws by NUTS (blackjax 1) after 10 of warm-up each, seed 0" in text
    assert "- **follows-prior**: " in text


def test_names_in_the_report_are_shown_as_they_are():
    """Between two of them their stars would be emphasis, and what looks like a tag would vanish."""
    names = ("yield_factor[a*b]", "yield_factor[c*d]", "yield_factor[<i>]")
    data = made(**{name: (normal(), {"prior_share": 0.9}) for name in names})
    text = "\n".join(line for block in posterior_section(data, 0.95) for line in block)
    assert text.count("a&#42;b]") == text.count("&#60;i&#62;]") == 3  # table, words and doubt
    assert "a*b" not in text
    assert "<i>" not in text


def test_the_picture_holds_the_draws_and_the_fit():
    draws = {"a": normal(mean=5.0), "b": np.exp(3 * normal(seed=1))}

    estimates = {"a": cal.Estimate(5.1, 1.0, 3.0, 7.5), "b": cal.Estimate(1.0, None, None, 9.0)}
    fit_result = SimpleNamespace(estimates=estimates)
    diverging = np.zeros((4, 1000), bool)
    diverging[0, :3] = True
    figure = posterior_figure(draws, diverging, fit_result)
    of_a, pair, of_b = figure.axes
    assert of_b.get_xscale() == pair.get_yscale() == "log"
    assert of_a.get_xscale() == pair.get_xscale() == "linear"
    low, high = np.quantile(draws["a"], [0.002, 0.998])
    heights = sum(patch.get_height() for patch in of_a.patches)
    assert heights == np.sum((draws["a"] >= low) & (draws["a"] <= high))
    assert [line.get_xdata()[0] for line in of_a.lines] == [5.1, 3.0, 7.5]
    assert [line.get_xdata()[0] for line in of_b.lines] == [1.0, 9.0]
    shown, diverged, fit = pair.lines
    np.testing.assert_array_equal(shown.get_xdata(), draws["a"].ravel()[::2])
    np.testing.assert_array_equal(shown.get_ydata(), draws["b"].ravel()[::2])
    np.testing.assert_array_equal(diverged.get_ydata(), draws["b"][0, :3])
    assert (fit.get_xdata()[0], fit.get_ydata()[0]) == (5.1, 1.0)
    labels = {text.get_text() for text in figure.legends[0].get_texts()}
    assert labels == {"draws", "diverged", "fit", "the fit's interval"}


@pytest.fixture(scope="module")
def command(tmp_path_factory):
    """A fit of a constant with draws: its exit code, its output and its directory."""
    folder = tmp_path_factory.mktemp("posterior")
    errors = 0.02 * np.random.default_rng(0).standard_normal(12)
    rows = [f"{v},{0.8 + error}" for v, error in enumerate(errors, 1)]
    (folder / "a.csv").write_text("velocity [m/s],restitution\n" + "\n".join(rows))
    (folder / "a.toml").write_text('[[material]]\nname = "balls"\ndata = "a.csv"\n')
    out = folder / "results"
    file = folder / "a.toml"
    return *run("fit", file, "--law", "constant", "--posterior", "200", "--out", out), out


def test_the_command_writes_draws_picture_and_words(command):
    code, printed, err, out = command
    assert (code, err) == (0, "")
    assert {"posterior.nc", "posterior.png"} <= {path.name for path in out.iterdir()}
    data = read(out / "posterior.nc")
    posterior = dataset_of(data, "posterior")
    assert dict(posterior.sizes) == {"chain": 4, "draw": 200}
    assert posterior.attrs["warmup"] == 200
    assert abs(float(posterior["restitution"].mean()) - 0.8) < 0.02
    report = (out / "report.md").read_text(encoding="utf-8")
    assert "## Posterior" in report
    assert "--posterior 200" in report
    assert "![Draws from the posterior, and the fit with its intervals](posterior.png)" in report
    assert "Posterior:\n" in printed
    assert "width / prior's" in printed


def test_the_command_refuses_what_has_no_posterior_before_it_fits(tmp_path):
    code, out, err = run("fit", "--posterior", "--out", tmp_path / "results")
    assert code == 2
    assert (
        err == "`objective` must be model for a posterior: it has a likelihood, but is two-step\n"
    )
    assert not (tmp_path / "results").exists()
    assert out == ""
