"""What is told of a fit: numbers rounded to their errors, tables that line up, nothing hidden."""

import math

import pytest

from calibration.commands.fit import INTRO
from calibration.doubt import Doubt
from calibration.estimate import Estimate
from calibration.report import markdown_report, rows, symbols, terminal_report
from calibration.report.rounding import interval, number, with_error
from calibration.report.tables import aligned, markdown, width
from tests.made_fits import material_fit, noisy_data, own_fit, paper_fit, result_of

PRINTED = {"stainless steel": {"chi": 0.1368, "limit_velocity": 340.0, "yield_ratio": 354.75}}


@pytest.mark.parametrize(
    ("value", "error", "shown"),
    [
        (1.7944, 0.052, "1.794 ± 0.052"),
        (1.7944, 0.0996, "1.79 ± 0.10"),  # 0.0996 is 0.10, not 0.100
        (1.7944, 0.5, "1.79 ± 0.50"),
        (350.0, 123.0, "350 ± 120"),
        (12345.6, 7.8, "12345.6 ± 7.8"),
        (1.93e11, 1.23e9, "(1.930 ± 0.012)e11"),
        (2e-5, 3e-6, "(2.00 ± 0.30)e-5"),
        (-3.0, 0.2, "-3.00 ± 0.20"),
        (0.0, 0.1, "0.00 ± 0.10"),
        (0.01, 0.5, "0.01 ± 0.50"),
        (3.0432, 1e-7, "3.0432 ± 1e-07"),  # not more digits than can be meant
        (3.0432, 1e-15, "3.0432 ± 0"),
        (1.7944, None, "1.7944"),
        (None, 0.1, "–"),
        (math.nan, 0.1, "–"),
    ],
)
def test_a_value_is_rounded_to_its_error(value, error, shown):
    assert with_error(value, error) == shown


@pytest.mark.parametrize(
    ("low", "high", "error", "shown"),
    [
        (1.6904, 1.8984, 0.052, "1.690 … 1.898"),
        (None, 1.9, 0.05, "open … 1.900"),
        (0.5, None, None, "0.5 … open"),
        (None, None, 0.1, "–"),
        (3.0432, 3.0432, 1e-16, "–"),
    ],
)
def test_interval_limits_are_rounded_as_the_value_is(low, high, error, shown):
    assert interval(low, high, error) == shown


def test_numbers_without_an_error():
    assert number(0.0150234) == "0.01502"
    assert number(None) == number(math.inf) == "–"


def test_columns_line_up_under_combining_characters():
    lines = aligned(["a", "b"], [["χ̃", "1"], ["longer", "22"]], right=[1])
    assert width("χ̃") == 1
    assert len({width(line) for line in lines}) == 1
    assert lines[2] == "χ̃        1"


def test_markdown_cells_do_not_break_the_table():
    assert markdown(["a|b"], [["c"]]) == ["| a\\|b |", "| --- |", "| c |"]


def test_symbols_have_units_and_owners():
    assert symbols.text("chi") == "χ̃"
    assert symbols.text("yield_strength[nylon]") == "Y[nylon] [Pa]"
    assert symbols.math("chi[my alloy]") == r"$\tilde\chi$, my alloy"
    assert symbols.text("not known") == "not known"


@pytest.mark.parametrize(
    ("estimate", "shown"),
    [
        (Estimate(0.54), "0.54 (fixed)"),
        (Estimate(None, method="undetermined", free=True), "not determined"),
        (Estimate(None), "–"),
        (Estimate(10.0, None, None, None, "wald", True, True), "10 (at its bound)"),
        (Estimate(0.0082094, method="derived"), "0.0082094"),
        (Estimate(1.5, 0.25, 1.0, 2.0, "wald", True), "1.50 ± 0.25"),
    ],
)
def test_an_estimate_says_why_it_has_no_error(estimate, shown):
    assert rows.estimate_text(estimate) == shown


def test_the_terminal_tells_everything_within_its_width():
    text = terminal_report(paper_fit(), PRINTED, INTRO)
    first = text.splitlines()[0]
    assert first.startswith("These data are a published fit of measurements, not measurements")
    for wanted in ("1.794 ± 0.090", "0.1368", "340.32", "354.75", "0.0167", "0.0345", "0.0318"):
        assert wanted in text
    assert max(map(width, text.splitlines())) <= 110
    assert "No doubts were raised." in text


def test_a_second_fit_stands_beside_with_its_time_and_difference():
    other = {
        "optimiser": "optimistix Levenberg–Marquardt",
        "route": "energy balance",
        "values": {"chi": 0.21998 * (1 + 3e-8), "sigma": 0.4355, "psi": 0.5414},
        "largest_difference": 3e-8,
    }
    text = terminal_report(own_fit(beside=other, times={"model": 2.25, "beside": 1.5}))
    assert "3e-08" in text
    assert "1.5 s against 2.2 s" in text
    assert "Levenberg–Marquardt through the energy balance" in text


def test_what_did_not_converge_is_marked():
    lost = Doubt("not-converged", "iterations used up", "my alloy")
    fit = material_fit(noisy_data(), 0.2, 0.4, 0.5, converged=False, warnings=(lost,))
    result = result_of([fit])
    assert "NOT CONVERGED" in terminal_report(result)
    assert "  NO" in terminal_report(result)
    assert "**The fit did not converge. Its values are not to be used.**" in markdown_report(result)


def test_doubts_come_with_cause_and_remedy():
    for text in (terminal_report(own_fit()), markdown_report(own_fit())):
        joined = " ".join(text.split())
        assert "rms 0.02 against a noise of 0.01" in joined
        assert "The law does not follow these data within their noise" in joined


def test_the_report_reads_by_itself():
    pictures = {"Curves": "curves.png"}
    text = markdown_report(own_fit(), pictures, "softjax fit my.toml")
    for wanted in (
        "24 impacts at 0.2 to 30 m/s",
        "uncertainty of the restitution 0.01",
        "![Curves](curves.png)",
        "`softjax fit my.toml`",
        "softjax-contact 0.1.0",
        "0.220 ± 0.011",
        "(sandwich)",
        "1 doubt below",
    ):
        assert wanted in text
    tables = [line for line in text.splitlines() if line.startswith("|")]
    assert all(line.endswith("|") for line in tables)


def test_notes_are_told_once():
    told = rows.notes(paper_fit())
    assert len(told) == 1
    assert "published fit" in told[0]
