"""The uncertainty budget: inputs that are moved, and what they add to errors, intervals and bands."""

import numpy as np
import pytest
from scipy import special

import calibration as cal
import softjax as sj
from calibration.plots import budget_figure
from tests.shown.capture import as_recorded

PAIR = sj.Contact.between_spheres(sj.STAINLESS_STEEL, sj.STAINLESS_STEEL, 0.0127, 0.0127)
VELOCITY = np.geomspace(0.2, 5, 16)
EXAMPLE = """
[[material]]
name = "ball"
youngs_modulus = "71 ± 1.5 GPa"
poisson_ratio = 0.33
density = 2700
yield_strength = "280(15) MPa"
diameter = "25 mm"
air = false
uncertainty = 0.004
height_offset = "0 ± 0.8 mm"
data = "drops.csv"
[material.wall]
material = "stainless steel"
youngs_modulus_uncertainty = "2 %"
"""


@pytest.fixture(scope="module")
def impacts():
    """Thornton's law with p_y = 2.1 Y, and noise."""
    exact = np.asarray(sj.restitution(sj.Thornton(PAIR, 2.1), VELOCITY).coefficient)
    noise = 0.006 * np.random.default_rng(5).standard_normal(len(VELOCITY))
    return cal.RestitutionData(VELOCITY, exact + noise, contact=PAIR, uncertainty=0.006)


def drops(folder, heights, text=EXAMPLE):
    rebounds = 0.8 * heights**0.93
    rows = [f"{h:.6f},{r:.6f}" for h, r in zip(heights, rebounds, strict=True)]
    table = "\n".join(["drop_height [m],rebound_height [m]", *rows])
    (folder / "drops.csv").write_text(table, encoding="utf-8")
    (folder / "m.toml").write_text(text, encoding="utf-8")
    return cal.read_toml(folder / "m.toml")


@pytest.mark.parametrize(
    ("text", "value", "size"),
    [
        ("115 ± 5 GPa", 115e9, 5e9),
        ("115 GPa +/- 4 %", 115e9, 4.6e9),
        ("115(5) GPa", 115e9, 5e9),
        ("115.20(12) GPa", 115.2e9, 0.12e9),
        ("115.20(1.5) GPa", 115.2e9, 1.5e9),
        ("1.15(5)e11 Pa", 1.15e11, 0.05e11),
        ("1.15e11 ± 5e9", 1.15e11, 5e9),
    ],
)
def test_a_text_states_a_value_and_its_standard_uncertainty(tmp_path, text, value, size):
    (data,) = drops(tmp_path, np.array([0.1, 0.2]), EXAMPLE.replace("71 ± 1.5 GPa", text))
    first = data.inputs.stated[0]
    assert first.name == "youngs_modulus"
    np.testing.assert_allclose([first.value, first.uncertainty], [value, size], rtol=1e-12)


def test_yield_pressure_moves_as_one_over_the_yield_strength(impacts):
    """ε tells p_y alone: p_y/Y is θ/1.05 and θ/0.95 with Y moved by 5 %."""
    result = cal.fit(impacts, "thornton", inputs={"contact.yield_strength": "5 %"})
    theta, part = result.values["yield_factor"], result.budget.inputs[0]
    up, down = theta / 1.05 - theta, theta / 0.95 - theta
    np.testing.assert_allclose(
        [part.up["yield_factor"], part.down["yield_factor"]], [up, down], 1e-6
    )
    size = 0.5 * (down - up)
    alone = cal.fit(impacts, "thornton")
    u = alone.standard_errors["yield_factor"]
    assert result.standard_errors["yield_factor"] == pytest.approx(np.hypot(u, size), 1e-6)
    assert result.statistical_errors["yield_factor"] == pytest.approx(u, 1e-9)
    (low, high), (low_0, high_0) = (r.intervals["yield_factor"] for r in (result, alone))
    assert low == pytest.approx(theta - np.hypot(theta - low_0, 1.959964 * up), 1e-6)
    assert high == pytest.approx(theta + np.hypot(high_0 - theta, 1.959964 * down), 1e-6)
    assert result.covariance[0, 0] == pytest.approx(u**2 + size**2, 1e-6)
    assert result.log_likelihood == alone.log_likelihood
    # the curve follows the points, wherever Y is
    np.testing.assert_allclose(*(r.band(VELOCITY).standard_error for r in (result, alone)), 1e-5)


def test_the_budget_is_that_of_free_inputs_with_priors(impacts):
    E, Y = float(PAIR.youngs_modulus), float(PAIR.yield_strength)
    by_moves = cal.fit(
        impacts,
        "thornton",
        inputs={"contact.youngs_modulus": "2 %", "contact.yield_strength": "3 %"},
    )
    priors = {
        "contact.youngs_modulus": cal.Parameter(E, prior=(E, 0.02 * E)),
        "contact.yield_strength": cal.Parameter(Y, prior=(Y, 0.03 * Y)),
    }
    exact = cal.fit(impacts, "thornton", priors)
    sizes = [r.standard_errors["yield_factor"] for r in (by_moves, exact)]
    assert sizes[0] == pytest.approx(sizes[1], rel=0.01)
    assert by_moves.statistical_errors["yield_factor"] < 0.3 * sizes[0]
    shares = by_moves.budget.shares("yield_factor")
    assert next(iter(shares)) == "contact.yield_strength"
    assert sum(shares.values()) == pytest.approx(1)
    figure = budget_figure(by_moves)
    (ax,) = figure.axes
    names = [label.get_text() for label in ax.get_yticklabels()]
    lengths = dict(zip(names, (bar.get_width() for bar in ax.patches), strict=True))
    combined = 100 * sizes[0] / by_moves.values["yield_factor"]
    assert max(lengths, key=lengths.get) == names[-1]  # the largest on top
    assert np.linalg.norm([*lengths.values()]) == pytest.approx(combined, rel=0.01)
    as_recorded("budget", {"budget.png": figure})
    assert budget_figure(cal.fit(impacts, "thornton", profiles=False)) is None


def test_a_scale_of_velocities_moves_a_dissipation_time_as_a_power(impacts):
    """ε of the viscoelastic sphere is a function of A v^(1/5): v larger by 1 % is A smaller by 0.2 %."""
    exact = np.asarray(sj.restitution(sj.ViscoelasticHertz(PAIR, 4e-6), VELOCITY).coefficient)
    data = cal.RestitutionData(VELOCITY, exact, contact=PAIR, uncertainty=0.005)
    result = cal.fit(data, "viscoelastic", inputs={"velocity_scale": 0.01})
    A, part = result.values["dissipation_time"], result.budget.inputs[0]
    changes = [part.up["dissipation_time"], part.down["dissipation_time"]]
    np.testing.assert_allclose(changes, [A * (1.01**-0.2 - 1), A * (0.99**-0.2 - 1)], rtol=1e-4)


def test_a_zero_of_heights_is_a_refit_of_shifted_heights(tmp_path):
    heights = np.array([0.05, 0.1, 0.2, 0.4, 0.8, 1.5])
    (data,) = drops(tmp_path, heights)
    result = cal.fit(data, "constant")
    h, r = heights, 0.8 * heights**0.93
    part = next(p for p in result.budget.inputs if p.name == "height_offset")
    here = np.mean(np.sqrt(r / h))
    changes = [np.mean(np.sqrt((r + s) / (h + s))) - here for s in (8e-4, -8e-4)]
    np.testing.assert_allclose([part.up["restitution"], part.down["restitution"]], changes, 1e-4)
    assert {p.name for p in result.budget.inputs} == {
        "youngs_modulus",
        "yield_strength",
        "height_offset",
        "wall.youngs_modulus",
    }


def test_bodies_of_one_steel_move_together(tmp_path):
    """E* of two bodies of one E: 1/E* moves twice as far, not √2 times."""
    heights = np.array([0.05, 0.1, 0.2, 0.4, 0.8, 1.5])
    own = EXAMPLE.replace('material = "stainless steel"\nyoungs_modulus_uncertainty = "2 %"', "{}")
    plate = 'youngs_modulus = "71 ± 1.5 GPa"\npoisson_ratio = 0.33\ndensity = 2700\nyield_strength = 28e7\n'
    sizes = []
    for text, count in ((plate, 2), (plate + "correlated = true", 1), ('material = "ball"', 1)):
        (data,) = drops(tmp_path, heights, own.format(text))
        result = cal.fit(data, "thornton")
        parts = [p for p in result.budget.inputs if p.name.endswith("youngs_modulus")]
        assert len(parts) == count
        sizes.append(np.sqrt(sum(p.of("yield_factor") ** 2 for p in parts)))
    np.testing.assert_allclose(sizes[1:], 2**0.5 * sizes[0], rtol=2e-3)


def test_inputs_that_data_do_not_have_are_refused(impacts, tmp_path):
    for name in ("youngs_modulus", "height_offset", "contact.poisson_ratio"):
        with pytest.raises(ValueError, match=r"inputs.*contact\."):
            cal.fit(impacts, "thornton", inputs={name: 1.0})
    with pytest.raises(ValueError, match="yield_strength_uncertainty"):
        cal.fit(impacts, "thornton", inputs={"contact.yield_strength": -1.0})
    with pytest.raises(ValueError, match=r"time_scale.*no time is measured"):
        drops(
            tmp_path,
            np.array([0.1, 0.2]),
            EXAMPLE.replace('height_offset = "0 ± 0.8 mm"', 'time_scale = "1 ± 0.01"'),
        )
    with pytest.raises(ValueError, match=r"m.toml:5.*stated once"):
        drops(
            tmp_path,
            np.array([0.1]),
            EXAMPLE.replace("poisson", 'youngs_modulus_uncertainty = "1 GPa"\npoisson'),
        )


def test_a_saved_budget_is_read_again(impacts, tmp_path):
    result = cal.fit(impacts, "thornton", inputs={"contact.mass": "1 %"})
    result.save(tmp_path / "fit.json")
    again = cal.FitResult.load(tmp_path / "fit.json")
    assert again == result
    assert again.budget == result.budget
    np.testing.assert_array_equal(*(r.band([0.5, 2.0]).low for r in (again, result)))
    frame = again.budget.to_frame()
    assert list(frame["input"]) == ["contact.mass"]
    assert frame["unit"][0] == "kg"


PLATE = (
    'youngs_modulus = "{plate} GPa"\npoisson_ratio = 0.3\ndensity = 7850\nyield_strength = "2 GPa"'
)
ALLOY = """
[[material]]
name = "alloy {k}"
youngs_modulus = "{modulus} GPa"
poisson_ratio = 0.33
density = 8500
yield_strength = "{strength} MPa"
diameter = "20 mm"
uncertainty = 0.0005
data = "{k}.csv"
[material.wall]
{wall}
"""
STRENGTHS = (220, 300, 400)


def alloys(folder, moduli=("105",) * 3, plate="210"):
    """A file of three alloys of one line, dropped on one plate."""
    text = ""
    for k, strength in enumerate(STRENGTHS):
        wall = PLATE.format(plate=plate)
        text += ALLOY.format(k=k, modulus=moduli[k], strength=strength, wall=wall)
        alloy = sj.Material(1.05e11, 0.33, 8500.0, 1e6 * strength)
        contact = sj.Contact.with_wall(alloy, sj.Material(2.1e11, 0.3, 7850.0, 2e9), 0.01)
        chi = 0.05 + 0.004 * float(contact.yield_ratio)
        law = sj.Zhou(contact, chi, 0.4 + 0.1 * k, 0.5)
        v = np.round(float(contact.critical_velocity) * np.geomspace(1.5, 60, 12), 5)
        noise = 0.0005 * np.random.default_rng(k).standard_normal(12)
        e = np.round(np.asarray(sj.restitution(law, v).coefficient) + noise, 5)
        rows = [f"{x},{y}" for x, y in zip(v, e, strict=True)]
        (folder / f"{k}.csv").write_text("\n".join(["velocity [m/s],restitution", *rows]), "utf-8")
    (folder / "alloys.toml").write_text(text, "utf-8")
    return cal.read_toml(folder / "alloys.toml")


def test_a_next_material_has_the_inputs_of_those_that_it_is_predicted_from(tmp_path):
    """By hand: the file with the plate's E, which all share, or that of an alloy moved, read and fitted again."""

    def line_of(*texts, **options):
        return cal.fit(alloys(tmp_path, *texts), profiles=False, **options).unloading_line

    line, alone = line_of(("105", "105 ± 4", "105"), "210 ± 20"), line_of()
    next_alloy = sj.Material(1.05e11, 0.33, 8500.0, 2.6e8)
    contact = sj.Contact.with_wall(next_alloy, sj.Material(2.1e11, 0.3, 7850.0, 2e9), 0.01)
    v = float(contact.critical_velocity) * np.array([0.5, 3.0, 30.0])

    def numbers(of):
        mean = np.mean(special.logit([m.eps_up for m in of.materials]))
        through = [of.through_chi[name].value for name in ("c1", "c2")]
        values = [of.c1.value, of.c2.value, *through, of.unloading_factor(contact).value, mean]
        return np.array([*values, *of.band(contact, v).coefficient[1:]])

    by_hand = [
        [line_of(("105",) * 3, "230"), line_of(("105",) * 3, "190")],
        [line_of(("105", "109", "105")), line_of(("105", "101", "105"))],
    ]
    changes = np.array([[numbers(of) - numbers(alone) for of in pair] for pair in by_hand])
    size = np.sqrt(np.sum((0.5 * (changes[:, 0] - changes[:, 1])) ** 2, axis=0))
    down, up = (np.sqrt(np.sum(f(changes, axis=1) ** 2, axis=0)) for f in (np.min, np.max))

    def errors(of):
        both = of.c1, of.c2, *of.through_chi.values(), of.unloading_factor(contact)
        return np.array(
            [one.standard_error for one in both] + [*of.band(contact, v).standard_error[1:]]
        )

    shown = np.arange(8) != 5  # without the mean logit
    added = np.sqrt(errors(line) ** 2 - errors(alone) ** 2)
    weights = np.isin(np.arange(7), (2, 3))  # which of the line through χ̃ are moved by hand, too
    np.testing.assert_allclose(added[~weights], size[shown][~weights], rtol=1e-2)
    np.testing.assert_allclose(added[weights], size[shown][weights], rtol=0.1)
    assert [len(part.members) for part in line.budget.inputs] == [3, 1]
    np.testing.assert_allclose(numbers(line), numbers(alone), rtol=1e-6)
    np.testing.assert_allclose(line.statistical_covariance, alone.covariance, rtol=1e-6)
    # what an input moves to one side widens that side
    of_chi, before = (of.unloading_factor(contact) for of in (line, alone))
    z, value = 1.959964, before.value
    low = np.exp(-np.hypot(np.log(value / before.low), z * down[4] / value))
    high = np.exp(np.hypot(np.log(before.high / value), z * up[4] / value))
    np.testing.assert_allclose([of_chi.low, of_chi.high], [value * low, value * high], rtol=1e-4)
    band, bare = line.band(contact, v), alone.band(contact, v)
    e = bare.coefficient[1:]
    np.testing.assert_allclose(
        [e - band.low[1:], band.high[1:] - e],
        [np.hypot(e - bare.low[1:], z * down[6:]), np.hypot(bare.high[1:] - e, z * up[6:])],
        rtol=1e-3,
    )
    ends = line.remarks(contact)[2].partition("interval ")[2].partition(":")[0]
    logit = np.mean(special.logit([m.eps_up for m in alone.materials]))
    found = alone.remarks(contact)[2].partition("interval ")[2].partition(":")[0]
    wider = [
        logit + sign * np.hypot(special.logit(float(end)) - logit, z * move)
        for sign, end, move in zip((-1, 1), found.split(" to "), (down[5], up[5]), strict=True)
    ]
    np.testing.assert_allclose([float(x) for x in ends.split(" to ")], special.expit(wider), 1e-3)
    again = cal.fit(alloys(tmp_path), profiles=False, inputs={"wall.youngs_modulus": "20 GPa"})
    again.save(tmp_path / "fit.json")
    loaded = cal.FitResult.load(tmp_path / "fit.json").unloading_line
    assert loaded == again.unloading_line
    assert len(loaded.budget.inputs) == 1
