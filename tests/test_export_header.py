"""The C header of a law against the law: ε, stiffness, energy, sizes, precision, compilers."""

import dataclasses
import math
import subprocess
from functools import lru_cache

import jax.numpy as jnp
import numpy as np
import pytest

import softjax as sj
from calibration.handover.c_header import header_of
from calibration.handover.c_table import table_of
from calibration.handover.impacts import impacts_of
from calibration.handover.steps import table_error
from tests.cases import MATERIALS, fitted, pair
from tests.export_cases import (
    DAMPED,
    INDEPENDENT,
    MASS,
    PAIR,
    STEEL,
    compile_alone,
    compiled,
    compiled_law,
    header,
    largest_error,
    needs_compiler,
    with_sizes,
)

pytestmark = needs_compiler
WIDE = np.geomspace(1e-3, 50, 4096)  # m/s, of which
SOME = slice(1280, 4096, 128)  # from 0.03 m/s
# χ̃ of Table 1, with which nylon gains energy just above yield and has no residual overlap
GAINING = sj.Zhou(pair("nylon"), 0.0160, 0.4355, 0.5414)


class Plastic(sj.RateIndependentLaw):
    """A law that no formula is known of: a class of one's own."""

    contact: sj.Contact
    hardness: float  # [N/m²]

    def loading_force(self, overlap):
        return self.hardness * overlap**2

    def unloading_force(self, overlap, peak_overlap):
        part = jnp.maximum(1 - (peak_overlap - overlap) / (0.3 * peak_overlap), 0)
        return self.hardness * peak_overlap**2 * sj.power_3_2(part)


class Viscous(sj.ViscoelasticHertz):
    """The same with damping, derived from a law that has a formula."""


@lru_cache
def wide(law):
    """ε, at most 1, and the duration of impacts at `WIDE`."""
    hit = sj.restitution(law, WIDE)
    return np.minimum(np.asarray(hit.coefficient), 1.0), np.asarray(hit.duration)


ENDS = ("zero-overlap", "zero-force")
OWN = {
    "plastic": Plastic(PAIR, 1e14),
    "viscous": Viscous(PAIR, 2e-6),
}


@pytest.mark.parametrize("name", INDEPENDENT)
def test_the_rebound_is_that_of_the_law_and_of_second_order_in_the_step(name):
    law = INDEPENDENT[name]
    wanted, duration = wide(law)
    errors = {n: largest_error(law, WIDE, wanted, duration / n) for n in (50, 100, 800)}
    assert errors[100] < 2e-4
    assert 1.8 < np.log(errors[50] / errors[800]) / np.log(16) < 2.2


def damped(name, velocity):
    """ε and about the duration of a damped law; constant ε by its closed forms."""
    law = DAMPED[name]
    if name == "viscoelastic":
        hit = sj.restitution(law, velocity)
        return np.asarray(hit.coefficient), np.asarray(hit.duration)
    fraction = math.log(1 / 0.8) / math.hypot(math.pi, math.log(0.8))
    frequency = math.sqrt(1 - fraction**2)
    angle = math.atan(2 * fraction * frequency / (1 - 2 * fraction**2)) if law.end != ENDS[0] else 0
    peak = (1.25 * MASS * velocity**2 / float(PAIR.stiffness)) ** 0.4
    linear = np.full_like(velocity, math.pi * math.sqrt(MASS / 1e7))
    duration = linear if name.startswith("linear") else 2.94 * peak / velocity
    return math.exp(-fraction / frequency * (math.pi - angle)), duration


@pytest.mark.parametrize("name", DAMPED)
def test_damping_by_the_velocity_half_a_step_before_is_of_first_order(name):
    velocity, phases = np.geomspace(0.05, 5, 16), np.arange(20) / 20
    wanted, duration = damped(name, velocity)
    coarse, fine = (
        largest_error(DAMPED[name], velocity, wanted, duration / n, phases) for n in (400, 4000)
    )
    assert coarse < 1e-3
    assert 0.8 < np.log(coarse / fine) / np.log(10) < 1.4


@pytest.mark.parametrize("name", [*INDEPENDENT, *DAMPED])
def test_the_stiffness_is_the_slope_of_the_force(name):
    law = (INDEPENDENT | DAMPED)[name]
    one, width = compiled_law(law), 1e-11
    overlaps = np.geomspace(2e-7, 1e-4, 40)
    rate = 0.1
    for before in ([], [1.001e-4]) if name in INDEPENDENT else ([],):  # loading, unloading
        for at in overlaps:
            force, stiffness = one.forces([*before, at - width, at, at + width], rate)
            low, middle, high = force[-3:]
            if low > 0:
                slope = (high - low) / (2 * width)
                assert stiffness[-2] == pytest.approx(slope, rel=1e-5, abs=3e-14 * high / width)
            elif middle == 0:
                assert stiffness[-2] == 0


def histories(top: float, count: int = 300):
    """Random turning points of an overlap up to `top`, in and out of contact."""
    rng = np.random.default_rng(7)
    for _ in range(count):
        turns = top * rng.uniform(0, 1, rng.integers(2, 12)) ** rng.uniform(0.5, 4)
        yield np.concatenate([[0.0], turns, [0.0]])


@pytest.mark.parametrize("name", [*INDEPENDENT, "gaining"])
def test_no_history_gains_energy(name):
    law = GAINING if name == "gaining" else INDEPENDENT[name]
    one, top = compiled_law(law), 60 * float(law.contact.critical_overlap)
    for turns in histories(top):
        gain, most = one.gained(turns, contact=law.contact)
        assert gain <= 1e-6 * most


def test_without_the_losses_a_history_gains_no_more_than_an_impact_does():
    one, top = compiled_law(GAINING, losses=False), 60 * float(GAINING.contact.critical_overlap)
    velocity = float(GAINING.contact.critical_velocity) * np.geomspace(1, 200, len(WIDE))
    impact = np.max(np.asarray(sj.restitution(GAINING, velocity).plastic_coefficient)) ** 2 - 1
    assert impact > 1e-4  # Eq. (12) with Table 1's χ̃ does gain energy
    parts = [gain / most for gain, most in (one.gained(t, contact=PAIR) for t in histories(top))]
    assert 0 < max(parts) <= 1.01 * impact


@pytest.mark.parametrize("losses", [True, False])
def test_losses_that_are_in_no_force_can_be_left_out(losses):
    hit, velocity = sj.restitution(STEEL, WIDE), WIDE[SOME]
    wanted = np.asarray(hit.coefficient if losses else hit.plastic_coefficient)[SOME]
    step = np.asarray(hit.duration)[SOME] / 1000
    assert largest_error(STEEL, velocity, wanted, step, losses=losses) < 2e-6
    by_macro = compiled_law(STEEL, (f"-DSOFTJAX_LOSSES={int(losses)}",), losses=not losses)
    assert np.max(np.abs(by_macro.rebounds(velocity, step) - wanted)) < 2e-6


def test_where_nothing_is_given_back_the_bodies_stay_in_touch():
    """Eq. (16) without a real root: v_cr near v_lim."""
    contact = dataclasses.replace(PAIR, limit_velocity=1.001 * float(PAIR.critical_velocity))
    law = with_sizes(STEEL, contact)
    hit, some = sj.restitution(law, WIDE), slice(2300, 2900, 100)  # from 0.4 to 2 m/s
    assert np.all(np.asarray(hit.status)[some] & int(sj.Status.NO_REBOUND))
    step = np.asarray(hit.duration)[some] / 400
    found = compiled_law(law).rebounds(WIDE[some], step, contact=contact)
    assert np.all(np.abs(found) < 0.02)  # what the last step of loading leaves


def test_one_header_serves_all_sizes():
    one = compiled_law(STEEL)
    steel = MATERIALS["stainless steel"]
    others = (
        sj.Contact.between_spheres(steel, steel, 1e-3, 4e-3),
        sj.Contact.with_wall(steel, steel, 0.05),
    )
    for contact in others:
        wanted, duration = (each[SOME] for each in wide(with_sizes(STEEL, contact)))
        found = one.rebounds(WIDE[SOME], duration / 1000, contact=contact)
        assert np.max(np.abs(found - wanted)) < 3e-6


def test_two_spheres_make_a_pair(tmp_path):
    check = (
        "softjax_pair p = softjax_spheres(1, 2, 3, 6); return !(p.radius == .75 && p.mass == 1.5);"
    )
    source, program = tmp_path / "program.c", tmp_path / "program"
    source.write_text(f"{header(STEEL)}\nint main(void) {{ {check} }}", encoding="utf-8")
    subprocess.run(["gcc", source, "-o", program, "-lm"], check=True)
    assert subprocess.run([program]).returncode == 0


@pytest.mark.parametrize("name", INDEPENDENT)
def test_single_precision(name):
    wanted, duration = (each[SOME] for each in wide(INDEPENDENT[name]))
    one = compiled_law(INDEPENDENT[name], ("-DSOFTJAX_REAL=float",))
    assert one.library.size_of_real() == 4
    assert np.max(np.abs(one.rebounds(WIDE[SOME], duration / 100) - wanted)) < 3e-4


@pytest.mark.parametrize("language", ["c", "c++"])
@pytest.mark.parametrize(
    "name",
    [*INDEPENDENT, *DAMPED, *(pytest.param(name, marks=pytest.mark.long) for name in OWN)],
)
def test_it_compiles_by_itself_without_a_warning(name, language, tmp_path):
    text = header((INDEPENDENT | DAMPED | OWN)[name])
    for real in ("double", "float") if name not in OWN else ("double",):  # numbers in a table
        assert compile_alone(f"#define SOFTJAX_REAL {real}\n{text}", language, tmp_path) == ""


def test_it_may_be_included_twice_and_beside_another(tmp_path):
    text = header(STEEL)
    other = header(fitted("nylon", "full"), prefix="nylon")
    assert compile_alone(text + text + other + other, "c", tmp_path) == ""
    assert "softjax" not in other.lower()


def test_a_softer_law_has_the_same_restitution_at_longer_steps():
    wanted, duration = (each[SOME] for each in wide(STEEL))
    one = compiled_law(STEEL, stretch=3.0)
    found = one.rebounds(WIDE[SOME], 3 * duration / 1000)
    assert np.max(np.abs(found - wanted)) < 2e-6
    overlap = 20 * float(PAIR.critical_overlap)
    stiff = compiled_law(STEEL).forces([overlap])[0]
    np.testing.assert_allclose(one.forces([3 * overlap])[0], stiff / 3, rtol=1e-12)


def test_a_law_of_ones_own_goes_by_a_table_whose_error_is_told():
    law, velocity = OWN["plastic"], np.geomspace(0.02, 5, 128)
    made = header_of(law, "test", fastest=5.0)
    one, hit = compiled(made.source), sj.restitution(law, velocity)
    found = one.rebounds(velocity, np.asarray(hit.duration) / 800)
    table = table_of(law, 5.0)
    interpolation = table_error(law, table, impacts_of(law, velocity))
    assert np.max(np.abs(found - hit.coefficient)) < interpolation + 1e-5 < 1e-3
    rng, top = np.random.default_rng(3), float(hit.peak_overlap[-1])
    off = []
    for peak in 1.1 * top * rng.uniform(0.05, 1, 200):
        overlaps = np.array([peak, *peak * rng.uniform(0.7, 1, 5)])
        wanted = np.maximum(law.unloading_force(overlaps, peak), 0)
        found = one.forces(overlaps)[0]
        np.testing.assert_allclose(
            table.unloading_force(overlaps, peak), found, rtol=1e-6, atol=1e-6
        )
        off.extend(np.abs(found - wanted) / float(law.loading_force(1.1 * top)))
    assert 0.2 * made.interpolation_error < max(off) < 1.5 * made.interpolation_error < 1e-4


def test_a_damped_law_of_ones_own_too():
    law, velocity = OWN["viscous"], np.geomspace(0.1, 5, 128)
    made = header_of(law, "test", fastest=5.0)
    one, hit = compiled(made.source), sj.restitution(law, velocity)
    found = one.rebounds(velocity, np.asarray(hit.duration) / 3000)
    assert np.max(np.abs(found - hit.coefficient)) < 3e-4
    rng, top = np.random.default_rng(3), float(hit.peak_overlap[-1])
    overlap, rate = 1.1 * top * rng.uniform(0, 1, 2000), rng.uniform(-5, 5, 2000)
    wanted = np.maximum(np.asarray(law.force(overlap, rate)), 0)
    off = np.max(np.abs(one.forces(overlap, rate)[0] - wanted)) / float(law.force(1.1 * top, 5.5))
    assert 0.1 * made.interpolation_error < off < 1.5 * made.interpolation_error < 1e-4
