"""Which law a scene needs, with its error and its time step; checked by other means than its own."""

import json
import re

import numpy as np
import pytest
from scipy.integrate import quad

import calibration as cal
import softjax as sj
from calibration.handover import lammps, liggghts, yade
from calibration.handover.choice import Order, choose
from calibration.handover.impacts import impacts_of
from calibration.handover.picture import draw_export
from calibration.handover.softer import softened
from calibration.handover.steps import order_of, rebounds
from calibration.handover.substitutes import dashpot_for
from calibration.handover.wanted import wanted_of
from tests.cases import RADIUS, fitted
from tests.export_cases import (
    DAMPED,
    INDEPENDENT,
    MASS,
    PAIR,
    SPRING,
    STEEL,
    compiled,
    compiled_law,
    needs_compiler,
)

RANGE = (0.1, 5.0)
VELOCITY = np.geomspace(*RANGE, 65)  # m/s


@pytest.fixture
def made(tmp_path):
    """Export steel, or another law, over 0.1 to 5 m/s unless told."""

    def export(source=STEEL, /, to="c", **options):
        options = {"velocity_range": RANGE, "tolerance": 0.01} | options
        return cal.export(source, to, tmp_path / "export", **options)

    return export


# errors of the laws that were fitted to steel's curve by a search of another program
MEASURED = {
    (0.9, 1.1): {"linear": 0.0036, "viscoelastic": 0.0013},
    (0.5, 2.0): {"linear": 0.025, "viscoelastic": 0.009},
    (0.1, 5.0): {"linear": 0.067, "viscoelastic": 0.022, "walton-braun": 0.017},
}


@pytest.mark.parametrize(
    "span", [pytest.param(s, marks=[pytest.mark.long] * (s != (0.5, 2.0))) for s in MEASURED]
)
def test_cheaper_laws_come_as_close_as_was_found_elsewhere(span, made):
    export = made(velocity_range=span, law="auto", tolerance=2e-5)
    ladder = ["linear", "hertz-dashpot", "viscoelastic", "walton-braun", "itself"]
    assert [one.key for one in export.tried] == ladder
    errors = {one.key: one.error for one in export.tried}
    for key, error in MEASURED[span].items():
        assert errors[key] == pytest.approx(error, rel=0.06)
    assert errors["itself"] == 0


@pytest.mark.parametrize(
    ("span", "tolerance", "key"),
    [
        ((0.9, 1.1), 0.01, "linear"),
        ((0.5, 2.0), 0.015, "viscoelastic"),
        ((0.1, 5.0), 0.03, "viscoelastic"),
        ((0.1, 5.0), 0.02, "walton-braun"),
        ((0.1, 5.0), 0.01, "itself"),
    ],
)
def test_the_first_law_that_keeps_the_tolerance_is_taken(span, tolerance, key, made):
    export = made(velocity_range=span, tolerance=tolerance)
    assert export.choice.key == key
    assert export.choice.error + export.choice.steps.error == export.choice.total <= tolerance
    assert all(one.total > tolerance for one in export.tried[:-1])


def test_viscoelastic_spheres_are_the_best_of_their_kind():
    wanted = wanted_of(STEEL, velocity_range=RANGE)
    order = Order(0.5, "viscoelastic", None, None, True)
    choice, _ = choose(wanted, lammps, order)
    times = choice.law.dissipation_time * np.linspace(0.7, 1.4, 141)[:, None]
    curves = sj.restitution(sj.ViscoelasticHertz(PAIR, times), wanted.velocity).coefficient
    errors = np.max(np.abs(np.asarray(curves) - wanted.restitution), axis=1)
    assert choice.error == pytest.approx(np.min(errors), abs=2e-4)
    assert choice.error < np.min(errors) + 1e-6


@pytest.mark.parametrize("epsilon", [0.05, 0.3, 0.9, 1.0])
@pytest.mark.parametrize("span", [(1e-4, 2e-4), (50, 100)])
def test_they_are_so_at_slow_and_fast_impacts(epsilon, span):
    """Against all A on a grid; ε falls with v, so that the ends of the range tell."""
    wanted = wanted_of(sj.ConstantRestitution(PAIR, epsilon), velocity_range=span)
    choice, _ = choose(wanted, lammps, Order(0.9, "viscoelastic", 10, None, True))
    times = np.geomspace(1e-14, 1e-2, 40_000)[:, None]
    ends = sj.restitution(sj.ViscoelasticHertz(PAIR, times), np.array(span)).coefficient
    best = np.min(np.max(np.abs(np.asarray(ends) - epsilon), axis=1))
    assert choice.error == pytest.approx(best, rel=1e-2, abs=1e-8)


@pytest.mark.parametrize(
    "key",
    [
        pytest.param("linear", marks=pytest.mark.long),
        pytest.param("hertz-dashpot", marks=pytest.mark.long),
        "viscoelastic",
        "walton-braun",
    ],
)
def test_what_is_said_of_a_law_is_what_the_library_finds(key):
    """ε, durations and overlaps by closed forms or the energy balance against the ODE's."""
    wanted = wanted_of(STEEL, velocity_range=RANGE)
    choice, _ = choose(wanted, lammps, Order(0.5, key, 100, None, True))
    hit = sj.restitution(choice.law, wanted.velocity, sj.ODE())
    np.testing.assert_allclose(choice.impacts.coefficient, hit.coefficient, atol=1e-8)
    np.testing.assert_allclose(choice.impacts.duration, hit.duration, rtol=1e-6)
    np.testing.assert_allclose(choice.impacts.peak, hit.peak_overlap, rtol=1e-6)


@needs_compiler
@pytest.mark.parametrize("name", [*INDEPENDENT, *DAMPED])
def test_steps_are_those_that_a_code_takes(name):
    """The errors of a time step are those of the C header, and so is their order."""
    law, velocity = (INDEPENDENT | DAMPED)[name], VELOCITY
    impacts = impacts_of(law, velocity)
    step = np.min(impacts.duration) / 50
    phases = np.arange(65) * (5**0.5 - 1) / 2 % 1 / 8
    one = compiled_law(law)
    found = [one.rebounds(v[None], step, p)[0] for v, p in zip(velocity, phases, strict=True)]
    np.testing.assert_allclose(
        rebounds(law, impacts, 50)[0], found, atol=2e-6 if name in INDEPENDENT else 1e-11
    )
    if name != "walton-braun":  # whose error is hardly there, and goes up and down
        assert (1.8 < order_of(law, impacts) < 2.2) == (name in INDEPENDENT)


@needs_compiler
@pytest.mark.parametrize("tolerance", [0.05, 0.03, 0.02, 0.01, 0.003, 3e-4])
def test_each_chosen_law_keeps_its_tolerance_in_c(tolerance, made, tmp_path):
    export = made(tolerance=tolerance)
    source = (tmp_path / "export/softjax_law.h").read_text(encoding="utf-8")
    one, velocity = compiled(source), np.geomspace(*RANGE, 40)
    wanted = np.asarray(sj.restitution(STEEL, velocity).coefficient)
    found = [one.rebounds(velocity, export.time_step, p) for p in np.arange(11) / 11]
    assert (
        np.max(np.abs(np.array(found) - wanted)) <= 1.02 * export.choice.total <= 1.02 * tolerance
    )


@pytest.mark.parametrize(
    "wanted", [0.14, *(pytest.param(e, marks=pytest.mark.long) for e in (0.2, 0.5, 0.8, 0.99, 1.0))]
)
def test_a_dashpot_that_never_pulls_is_set_to_give_what_is_wanted(wanted):
    asked, route = dashpot_for(wanted), sj.ODE(1e-10)
    for law in (
        sj.LinearSpringDashpot(PAIR, 1e7, asked, end="zero-force"),
        sj.HertzDashpot(PAIR, asked, end="zero-force"),
    ):
        found = sj.restitution(law, VELOCITY, route).coefficient
        np.testing.assert_allclose(found, wanted, atol=1e-7)


def test_less_than_critical_damping_leaves_is_told_as_an_error(made):
    export = made(sj.ConstantRestitution(PAIR, 0.05), tolerance=0.1)
    assert export.choice.error == pytest.approx(np.exp(-2) - 0.05, abs=1e-4)


def test_hard_spheres_are_handed_over_as_a_spring_and_a_dashpot(made):
    export = made(sj.ConstantRestitution(PAIR, 0.9), tolerance=1e-3)
    assert [one.key for one in export.tried] == ["linear"]
    assert export.choice.error < 1e-12
    found = sj.restitution(export.law, export.wanted.velocity).coefficient
    np.testing.assert_allclose(found, 0.9, atol=1e-8)


def test_the_error_of_the_dissipated_energy(made):
    """Of impacts even in ln v, by quadrature."""
    export = made(law="linear", tolerance=0.2)

    def lost(law):
        def integrand(log_v):
            v = np.exp(log_v)
            return v**2 * (1 - float(sj.restitution(law, v).coefficient) ** 2)

        return quad(integrand, *np.log(RANGE), epsrel=1e-4)[0]

    assert export.energy_error == pytest.approx(lost(export.law) / lost(STEEL) - 1, abs=0.01)
    assert export.energy_error < -0.2


def test_a_softer_spring_is_told_with_its_price(made):
    stiff, soft = made(), made(overlap=0.05, radius=RADIUS)
    times = 0.05 * RADIUS / (stiff.overlap * stiff.wanted.radius)
    assert soft.choice.stretch == pytest.approx(times)
    assert soft.overlap == pytest.approx(0.05)
    assert soft.time_step == pytest.approx(times * stiff.time_step)
    np.testing.assert_allclose(soft.duration, times * stiff.duration)
    assert re.search(rf"softer +overlaps and time step {times:.3g} times, forces 1/", str(soft))


@pytest.mark.parametrize(
    "name", ["linear, no pull", "hertz, no pull", "viscoelastic", "walton-braun"]
)
def test_a_softer_law_gives_the_same_restitution(name):
    law = (DAMPED | INDEPENDENT)[name]
    soft = softened(law, 2.5)
    before, after = sj.restitution(law, VELOCITY), sj.restitution(soft, VELOCITY)
    np.testing.assert_allclose(after.coefficient, before.coefficient, atol=1e-9)
    np.testing.assert_allclose(after.peak_overlap, 2.5 * before.peak_overlap, rtol=1e-7)


def test_the_steps_asked_for_are_taken(made):
    export = made(law="itself", steps=40)
    assert export.choice.steps.count == 40
    assert export.time_step == pytest.approx(min(export.duration) / 40)


@pytest.mark.parametrize(
    ("law", "options", "told"),
    [
        (STEEL, {"to": "fortran"}, "c, lammps, liggghts, yade"),
        (STEEL, {"tolerance": 0}, r"in \(0, 1\)"),
        (STEEL, {"law": "viscoelastc"}, "did you mean 'viscoelastic'"),
        (STEEL, {"steps": 1}, "2 or more"),
        (STEEL, {"overlap": 1e-4}, r"above 0\.0143"),
        (STEEL, {"overlap": float("nan")}, r"above 0\.0143.* and 100 at most, but is nan"),
        (STEEL, {"overlap": float("inf")}, "100 at most, but is inf"),
        (STEEL, {"overlap": 1e200}, "100 at most"),  # a stiffness that no float tells
        (STEEL, {"prefix": "9a"}, "a name in C"),
        (STEEL, {"prefix": "ours", "to": "lammps"}, "left out with lammps"),
        (STEEL, {"version": 20250722}, "left out with c"),
        (STEEL, {"to": "lammps", "version": 2025}, "20220623 or later"),
        (STEEL, {"velocity_range": None}, "lowest, highest"),
        (STEEL, {"velocity_range": (2, 1)}, "0 < lowest"),
        (STEEL, {"to": "liggghts", "law": "zhou"}, "no law like Zhou's"),
        (STEEL, {"to": "yade", "law": "viscoelastic"}, "no viscoelastic spheres"),
        (STEEL, {"velocity_range": (1, 1e6)}, "has a turning point"),
        (INDEPENDENT["thornton"], {"to": "liggghts", "law": "thornton"}, "thornton_ning"),
        (INDEPENDENT["walton-braun"], {"to": "yade", "law": "walton-braun"}, "a constant k2 > k1"),
        (sj.EmpiricalRestitution(340.0, 3.0, 0.5), {}, "one with a contact"),
        (sj.ConstantRestitution(None, 0.9), {}, "one with a contact"),
        (sj.ConstantRestitution(PAIR, 0.9), {"law": "itself"}, "linear"),
        (3.0, {}, "a contact law"),
    ],
)
def test_what_cannot_be_handed_over_is_refused(law, options, told, made):
    with pytest.raises(ValueError, match=told) as error:
        made(law, **options)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("options", [{"to": "liggghts"}, {"law": "linear"}, {"steps": 10}])
def test_where_nothing_keeps_the_tolerance_the_best_is_named(options, made, tmp_path):
    with pytest.raises(ValueError, match=r"no law tried keeps the tolerance 0\.001") as error:
        made(tolerance=0.001, **options)
    assert not (tmp_path / "export").exists()
    needed = float(re.search(r"--tolerance (\S+) writes it", str(error.value))[1])
    assert made(**options | {"tolerance": needed}).choice.total <= needed
    with pytest.raises(ValueError, match="no law tried"):
        made(**options | {"tolerance": 0.9 * needed})


def test_a_spring_whose_stiffness_grows_from_the_start_is_said_to_yade():
    law = sj.WaltonBraun(PAIR, SPRING, SPRING, 300.0)
    wanted = wanted_of(law, velocity_range=RANGE)
    choice, _ = choose(wanted, yade, Order(0.01, "walton-braun", None, None, True))
    assert choice.error < 1e-6
    assert choice.law.growth == pytest.approx(300.0 * _scaled(choice, law), rel=1e-4)
    assert "kp" in yade.functors_of(choice.law, 0.3, 1e-4)["material"]
    model, properties = liggghts.model_of(choice.law, 0.3, 1e-4)
    assert model == "hooke/hysteresis"
    assert properties["coefficientMaxElasticStiffness"][1] > 1


def _scaled(choice, law):
    """b = s √(M/k1) is what ε tells."""
    return np.sqrt(choice.law.loading_stiffness / law.loading_stiffness)


def test_json_says_all_that_the_text_says(made, tmp_path):
    export = made(tolerance=0.02)
    report = json.loads((tmp_path / "export/export.json").read_text(encoding="utf-8"))
    assert (report["to"], report["law"]) == ("c", "walton-braun")
    assert report["largest_error"] == report["error_of_law"] + report["error_of_time_step"] <= 0.02
    given, wanted = (np.array(report["curve"][name]) for name in ("given", "wanted"))
    assert np.max(np.abs(given - wanted)) == pytest.approx(report["error_of_law"])
    velocity = np.array(report["curve"]["velocity"])
    assert (velocity[0], velocity[-1]) == pytest.approx(RANGE)
    np.testing.assert_allclose(wanted, sj.restitution(STEEL, velocity).coefficient)
    law = report["parameters"]
    rebuilt = sj.WaltonBraun(
        PAIR, *(law[n] for n in ("loading_stiffness", "unloading_stiffness", "growth"))
    )
    np.testing.assert_allclose(given, sj.restitution(rebuilt, velocity).coefficient)
    spring = (
        law["loading_stiffness"]
        * (report["largest_overlap_over_radius"] * report["radius"]["value"]) ** 2
    )
    assert spring == pytest.approx(MASS * 25, rel=1e-6)  # ½ k δ² = ½ M v²
    assert report["time_step"] == pytest.approx(
        report["contact_duration"]["shortest"] / report["steps_in_shortest_contact"]
    )
    assert set(report["files"]) == {p.name for p in (tmp_path / "export").iterdir()}
    assert f"{report['steps_in_shortest_contact']} in the shortest contact" in str(export)


def test_the_picture_shows_the_curves_and_the_tolerance(made):
    export = made(tolerance=0.02)
    figure = draw_export(export)
    curve, errors = figure.axes
    assert (curve.get_legend(), errors.get_legend()) == (None, None)  # it would lie on a line
    assert len(figure.legends[0].get_texts()) == 4
    drawn = {line.get_label(): line.get_ydata() for line in curve.lines}
    wanted = drawn["wanted, Zhou"]
    np.testing.assert_array_equal(wanted, export.wanted.restitution)
    (given,) = (values for label, values in drawn.items() if label.startswith("c: Walton"))
    off = errors.lines[0].get_ydata()
    np.testing.assert_allclose(off, given - wanted)
    assert {float(line.get_ydata()[0]) for line in errors.lines[1:]} == {-0.02, 0.02}
    assert errors.get_xscale() == "log"


def test_a_fit_is_handed_over_with_its_bodies_and_its_range(tmp_path):
    velocity = np.geomspace(1.5, 20, 24)
    law = fitted("nylon")
    exact = np.asarray(sj.restitution(law, velocity).coefficient)
    data = cal.RestitutionData(velocity, exact, law.contact, 0.003, name="nylon")
    result = cal.fit(data, profiles=False)
    export = cal.export(result, "c", tmp_path / "a", tolerance=0.02)
    assert export.wanted.name == "nylon"
    assert export.wanted.range == pytest.approx((1.5, 20))
    assert type(export.wanted.law) is sj.Zhou
    below = 0.5 * float(law.contact.critical_velocity)
    with pytest.raises(ValueError, match="within what the fit knows"):
        cal.export(result, "c", tmp_path / "a", velocity_range=(below, 20.0))
