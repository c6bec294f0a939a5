"""What is told of a fit: numbers rounded to their errors, tables that line up, nothing hidden."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

import calibration as cal
import softjax as sj
from calibration.data.bodies import Body
from calibration.fitting.doubt import Doubt
from calibration.fitting.estimate import Estimate
from calibration.report import markdown_report, rows, symbols, terminal_report
from calibration.report.bodies import bodies_table
from calibration.report.tables import aligned, markdown, width
from calibration.rounding import interval, number, with_error
from tests.cases import pair

VELOCITY = np.geomspace(0.5, 20.0, 24)
EXACT = 1 / np.sqrt(1.1 + 0.02 * VELOCITY)  # Walton and Braun's law
NOISE = np.random.default_rng(5).standard_normal(24)


def made(name="my alloy", noise=0.01, **told):
    return cal.RestitutionData(VELOCITY, EXACT + noise * NOISE, pair("nylon"), name=name, **told)


@pytest.fixture(scope="module")
def own():
    return cal.fit(made(uncertainty=0.01), "walton-braun")


@pytest.fixture(scope="module")
def zhou():
    return cal.fit(made(), objective="two-step", route=sj.EnergyBalance(), starts=4)


def cells(table, column):
    return [row[table.header.index(column)] for row in table.rows]


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


def test_symbols_units_and_words_are_those_of_the_law(own):
    model = own.material().model
    assert symbols.text("chi") == "χ̃"
    assert symbols.text("contact.yield_strength") == "Y [Pa]"
    assert symbols.text("growth", model) == "s [1/m]"
    assert symbols.math("contact.yield_strength") == "$Y$ [Pa]"
    assert symbols.text("not known") == "not known"
    assert symbols.words("not known") == ""
    assert rows.meanings(own)[-1].startswith("s: growth of the unloading stiffness")


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


def test_every_parameter_has_its_value_error_and_kind_of_interval(own, zhou):
    table = rows.parameter_table(own)
    assert cells(table, "parameter") == ["k1 [N/m]", "k20 [N/m]", "s [1/m]"]
    value, error = own.values["growth"], own.standard_errors["growth"]
    assert cells(table, "value ± std. error")[2] == with_error(value, error)
    assert cells(table, "95 % interval")[2] == interval(*own.intervals["growth"], error)
    assert cells(table, "kind") == ["", "profile", "profile"]
    table = rows.parameter_table(zhou)
    kinds = dict(zip(cells(table, "parameter"), cells(table, "kind"), strict=True))
    # σ and ψ of 24 points: t of 22; χ̃ hangs on the same noise
    assert kinds == {
        **{"χ̃": "sandwich, ν = 22", "σ": "profile, ν = 22", "ψ": "profile, ν = 22"},
        **{"v_cr [m/s]": "", "ε_up": "derived"},
    }
    for text in (terminal_report(zhou), markdown_report(zhou)):
        for words in ("χ̃: unloading factor", "ε_up: restitution at first yield", "sandwich"):
            assert words in text


def test_an_interval_of_another_confidence_says_so(own):
    request = replace(own.request, confidence=0.8)
    assert "80 % interval" in rows.parameter_table(replace(own, request=request)).header


def test_the_goodness_of_fit_comes_with_its_probability(own):
    table = rows.quality_table(own)
    law = own.law
    k1, k20 = law.loading_stiffness, law.unloading_stiffness
    growth = law.growth * np.sqrt(float(law.contact.mass) / k1)
    chi_squared = np.sum(
        ((1 / np.sqrt(k20 / k1 + growth * VELOCITY) - own.data.restitution) / 0.01) ** 2
    )
    assert cells(table, "ν") == ["22"]
    assert cells(table, "χ²/ν") == [f"{chi_squared / 22:.3g}"]
    assert cells(table, "P") == [f"{stats.chi2.sf(chi_squared, 22):.3g}"]
    assert "scatter" not in table.header  # it is stated
    assert any(line.startswith("P: probability of a χ²") for line in rows.quality_words(own))


def test_scatter_that_was_found_is_told_and_that_of_groups():
    group = np.repeat(list("abcd"), 6)
    offsets = np.repeat([0.02, -0.01, -0.03, 0.02], 6)
    data = cal.RestitutionData(
        VELOCITY, EXACT + offsets + 0.002 * NOISE, pair("nylon"), name="groups", group=group
    )
    result = cal.fit(data, "constant", profiles=False)
    table = rows.quality_table(result)
    assert cells(table, "scatter") == [f"{result.material().noise:.3g}"]
    assert cells(table, "between groups") == [f"{result.material().group_deviation:.3g}"]
    assert "χ²/ν" not in table.header
    assert "in 4 groups" in markdown_report(result)


def test_the_scatter_of_times_is_told_in_milliseconds(tmp_path):
    rng = np.random.default_rng(2)
    trains = [0.5 * (1 + 0.1 * k) * 0.9 ** np.arange(6) for k in range(5)]
    lines = [
        f"{t + 2e-4 * rng.standard_normal():.9f},{k}" for k, own in enumerate(trains) for t in own
    ]
    file = tmp_path / "bounces.csv"
    file.write_text("\n".join(["interval [s],launch", *lines]) + "\n", encoding="utf-8")
    result = cal.fit(cal.read_csv(file), "constant", profiles=False)
    (told,) = cells(rows.quality_table(result), "of times [ms]")
    assert float(told) == pytest.approx(0.2, rel=0.4)  # as the intervals were made


def test_priors_bounds_and_what_is_shared_are_told(own):
    said = {
        "growth": cal.Parameter(prior=(0.5, 0.1), bounds=(0, 2)),
        "unloading_stiffness": cal.Parameter(shared="both"),
        "yield_strength": 4e7,
    }
    assert rows.told(own) == []
    request = replace(own.request, parameters=[said])
    assert rows.told(replace(own, request=request)) == [
        "s [1/m]: prior 0.5 ± 0.1, between 0 and 2",
        "k20 [N/m]: one value for the group both",
    ]


def test_each_stage_names_its_material_and_its_time(zhou):
    table = rows.optimiser_table(zhou)
    assert cells(table, "material") == ["my alloy"] * 2
    assert cells(table, "stage") == ["Eq. (17)", "model"]
    assert cells(table, "seconds")[0] == number(zhou.times["Eq. (17)[my alloy]"], 2)
    both = cal.fit(
        [made("a", uncertainty=0.01), made("b", uncertainty=0.01)], "walton-braun", profiles=False
    )
    assert cells(rows.optimiser_table(both), "material") == ["a", "b"]
    assert set(both.times) == {"model[a]", "model[b]", "total"}


def test_very_many_searches_are_summed_up_on_a_terminal(own):
    stage = own.optimiser_report[0]
    many = tuple(replace(stage, materials=(f"alloy {k}",)) for k in range(13))
    times = {one.label: 0.5 for one in many}
    result = replace(own, optimiser_report=many, times=times)
    total = f"13 searches, {13 * stage.evaluations} evaluations, 6.5 s"
    assert total in terminal_report(result).splitlines()
    assert len(rows.optimiser_table(result).rows) == 13


def test_where_nothing_is_known_of_the_curve_is_told(own):
    part = replace(own.material(), known_from=0.8352)
    report = markdown_report(replace(own, materials=(part,)))
    assert "Nothing is known of the curve below the critical velocity, 0.8352 m/s" in report
    assert "Nothing is known" not in markdown_report(own)


def test_everything_stays_within_the_width_of_a_terminal(zhou):
    other = {
        "optimiser": "optimistix Levenberg–Marquardt",
        "route": "energy balance",
        "values": {"chi": zhou.values["chi"] * (1 + 3e-8)},
        "largest_difference": 3e-8,
        "seconds": 1.5,
    }
    text = terminal_report(replace(zhou, beside=other), {"my alloy": {"chi": 0.0161234}})
    assert max(map(width, text.splitlines())) <= 110
    for wanted in ("0.016123", "3e-08", "1.5 s against", "Levenberg–Marquardt through the energy"):
        assert wanted in text


def test_what_did_not_converge_is_marked(own):
    lost = Doubt("not-converged", "iterations used up", "my alloy")
    material = replace(own.material(), converged=False, warnings=(lost,))
    result = replace(own, materials=(material,), warnings=(lost,))
    assert "NOT CONVERGED" in terminal_report(result)
    assert cells(rows.quality_table(result), "converged") == ["NO"]
    report = markdown_report(result)
    assert "**The fit did not converge. Its values are not to be used.**" in report
    assert "iterations used up" in report
    assert lost.remedy in report


def test_the_report_reads_by_itself(own):
    doubt = Doubt("model-misfit", "rms 0.02 against a noise of 0.01", "my alloy")
    one = replace(own, warnings=(doubt,))
    text = markdown_report(one, {"Curves": "curves.png"}, "softjax fit my.toml")
    for wanted in (
        "24 impacts at 0.5 to 20 m/s",
        "uncertainty of the restitution 0.01",
        "![Curves](curves.png)",
        "`softjax fit my.toml`",
        "softjax-contact 0.1.0",
        "1 doubt below",
        "- **model-misfit** (my alloy): rms 0.02 against a noise of 0.01.",
    ):
        assert wanted in text
    tables = [line for line in text.splitlines() if line.startswith("|")]
    assert all(line.endswith("|") for line in tables)
    assert " ".join(terminal_report(one).split()).count("rms 0.02 against a noise of 0.01") == 1


def test_the_bodies_are_told_each_by_itself_or_the_pair(own):
    ball, wall = Body("sphere", sj.NYLON, 0.01), Body("wall", sj.STAINLESS_STEEL, None)
    mass = f"{sj.NYLON.density * 4 / 3 * math.pi * 1e-6:.4g}"
    nylon = ["0.01", mass, "2.5e+09", "0.3", "1140", "4e+07"]
    steel = ["–", "–", "1.93e+11", "0.35", "8030", "3.1e+08"]
    both = [
        (["my alloy", "sphere", *nylon], ["", "wall", *steel]),
        (["my alloy", "two equal spheres", *nylon],),
    ]
    for bodies, expected in zip(
        ((ball, wall), (ball, ball._replace(name="second"))), both, strict=True
    ):
        fit = replace(own.material(), data=replace(own.data, bodies=bodies))
        result = replace(own, materials=(fit,))
        assert bodies_table(result).rows == [*expected]
        assert f"## Bodies\n\n{markdown(*bodies_table(result)[:2])[0]}" in markdown_report(result)
    ((name, body, radius, *_),) = bodies_table(own).rows
    assert (name, body) == ("my alloy", "the pair, effective")
    assert radius == f"{own.data.contact.radius:.4g}"
    free = replace(own.material(), data=replace(own.data, contact=None))
    assert "## Bodies" not in markdown_report(replace(own, materials=(free,)))


def test_a_law_without_a_name_is_shown_as_it_is():
    law = lambda contact, yield_factor: sj.Thornton(contact, yield_factor)  # noqa: E731
    told = {"yield_factor": cal.Parameter(1.2, bounds=(0.5, 5.0))}
    text = markdown_report(cal.fit(made(), law, told, profiles=False, starts=1))
    assert "&#60;lambda&#62;: the law against all points" in text
    assert "\nlaw &#60;lambda&#62;, objective model" in text
    assert "<lambda>" not in text


def test_words_of_code_in_a_doubt_stay_code(own):
    doubt = Doubt("objectives-disagree", "chi[a`b] is 2 by `model`, 1 by `two-step`", "my alloy")
    text = markdown_report(replace(own, warnings=(doubt,)))
    assert "chi[a&#96;b] is 2 by `model`, 1 by `two-step`." in text
    (misfit, told) = (Doubt("model-misfit", "large"), Doubt("data", "odd", advice="<b>Look</b>."))
    text = markdown_report(replace(own, warnings=(misfit, told)))
    assert "`softjax compare` tries other laws.*" in text
    assert "*&#60;b&#62;Look&#60;/b&#62;.*" in text


def test_notes_are_told_once(own):
    note = "column x is not used"
    noted, plain = (replace(own.material(), data=made(remarks=said)) for said in ([note], []))
    assert rows.notes(replace(own, materials=(noted, noted))) == [note]
    assert rows.notes(replace(own, materials=(noted, plain))) == [f"my alloy: {note}"]
