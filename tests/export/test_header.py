"""The C header of a law against the law: ε, stiffness, energy, sizes, precision, compilers."""

import dataclasses
import math
import subprocess
from functools import lru_cache

import jax.numpy as jnp
import numpy as np
import pytest

import softjax as sj
from tests.cases import MATERIALS, pair
from tests.export.laws import (
    DAMPED,
    INDEPENDENT,
    LAWS,
    MASS,
    PAIR,
    STEEL,
    compiled,
    compiler_says,
    needs_compiler,
)

pytestmark = needs_compiler
FRACTION = math.log(1 / 0.8) / math.hypot(math.pi, math.log(0.8))  # of critical damping, for 0.8
WIDE = np.geomspace(1e-3, 50, 128)  # m/s, of which
SOME = slice(40, 128, 4)  # from 0.03 m/s
# χ̃ of Table 1, with which nylon gains energy just above yield and has no residual overlap
GAINING = sj.Zhou(pair("nylon"), 0.0160, 0.4355, 0.5414)


class Own(sj.RateIndependentLaw):
    """A user's law: a spring that is stiffer beyond a kink and leaves a dent, of the larger a share the deeper it was pressed."""

    contact: sj.Contact
    kink: float
    returned: float
    dent: float  # [1/m]

    def loading_force(self, overlap):
        return 1e7 * (overlap + 3 * jnp.maximum(overlap - self.kink, 0))

    def unloading_force(self, overlap, peak_overlap):
        stays = self.dent * peak_overlap / (1 + self.dent * peak_overlap)
        return self.returned * self.loading_force((overlap - stays * peak_overlap) / (1 - stays))

    def breakpoints(self):
        return (self.kink,)


KINKED, DENTED = Own(PAIR, 2e-5, 0.99, 0.0), Own(PAIR, 1.0, 1.0, 1e4)  # ε² = 0.99 of the first
BOTH = Own(PAIR, 5e-6, 0.9, 1e5)  # whose ε has a kink, which no table holds well


@lru_cache
def wide(law):
    """ε, at most 1, and the duration of impacts at `WIDE`."""
    hit = sj.restitution(law, WIDE)
    return np.minimum(np.asarray(hit.coefficient), 1.0), np.asarray(hit.duration)


@pytest.mark.parametrize("name", INDEPENDENT)
def test_the_rebound_is_that_of_the_law_and_of_second_order_in_the_step(name, in_c):
    code, (expected, duration) = in_c(INDEPENDENT[name]), wide(INDEPENDENT[name])
    errors = {n: code.largest_error(WIDE, expected, duration / n) for n in (50, 100, 800)}
    assert errors[100] < 2e-4
    assert 1.8 < np.log(errors[50] / errors[800]) / np.log(16) < 2.2
    single = in_c(INDEPENDENT[name], ("-DSOFTJAX_REAL=float",))
    assert single.library.size_of_real() == 4
    found = single.rebounds(WIDE[SOME], duration[SOME] / 100)
    assert np.max(np.abs(found - expected[SOME])) < 3e-4


def damped(name, velocity):
    """ε and about the duration of a damped law; constant ε by its closed forms."""
    law = DAMPED[name]
    if name == "viscoelastic":
        hit = sj.restitution(law, velocity)
        return np.asarray(hit.coefficient), np.asarray(hit.duration)
    frequency = math.sqrt(1 - FRACTION**2)
    pulls = law.end == "zero-overlap"
    angle = 0 if pulls else math.atan(2 * FRACTION * frequency / (1 - 2 * FRACTION**2))
    peak = (1.25 * MASS * velocity**2 / float(PAIR.stiffness)) ** 0.4
    linear = np.full_like(velocity, math.pi * math.sqrt(MASS / 1e7))
    duration = linear if name.startswith("linear") else 2.94 * peak / velocity
    return math.exp(-FRACTION / frequency * (math.pi - angle)), duration


@pytest.mark.parametrize("name", DAMPED)
def test_damping_by_the_velocity_half_a_step_before_is_of_first_order(name, in_c):
    velocity, phases = np.geomspace(0.05, 5, 12), np.arange(20) / 20
    code, (expected, duration) = in_c(DAMPED[name]), damped(name, velocity)
    steps = (duration / 400, duration / 4000)
    coarse, fine = (code.largest_error(velocity, expected, step, phases) for step in steps)
    assert coarse < 1e-3
    assert 0.8 < np.log(coarse / fine) / np.log(10) < 1.4


@pytest.mark.parametrize("name", LAWS)
def test_the_stiffness_is_the_slope_of_the_force(name, in_c):
    code, width = in_c(LAWS[name]), 1e-11
    for before in ([], [1.001e-4]) if name in INDEPENDENT else ([],):  # loading, unloading
        for at in np.geomspace(2e-7, 1e-4, 40):
            force, stiffness = code.forces([*before, at - width, at, at + width], 0.1)
            low, middle, high = force[-3:]
            if low > 0:
                slope = (high - low) / (2 * width)
                assert stiffness[-2] == pytest.approx(slope, rel=1e-5, abs=3e-14 * high / width)
            elif middle == 0:
                assert stiffness[-2] == 0


def histories(top: float, count: int = 100):
    """Random turning points of an overlap up to `top`, in and out of contact."""
    rng = np.random.default_rng(7)
    for _ in range(count):
        turns = top * rng.uniform(0, 1, rng.integers(2, 12)) ** rng.uniform(0.5, 4)
        yield np.concatenate([[0.0], turns, [0.0]])


@pytest.mark.parametrize("name", [*INDEPENDENT, "gaining"])
def test_no_history_gains_energy(name, in_c, exported):
    law = GAINING if name == "gaining" else INDEPENDENT[name]
    code, top = in_c(law), 60 * float(law.contact.critical_overlap)
    for turns in histories(top):
        gain, most = code.gained(turns, contact=law.contact)
        assert gain <= 1e-6 * most
    if name == "gaining":  # without the losses, ε is above 1
        made, _ = exported(GAINING, law="exact", steps=50, tolerance=0.5, losses=False)
        hit = sj.restitution(GAINING, made.target.velocity)
        gain = float(np.max(hit.plastic_coefficient)) ** 2 - 1
        assert made.to_dict()["energy_gain"] == pytest.approx(gain, rel=1e-9)
        assert f"{gain:.2g} of the impact's energy" in str(made)


@pytest.mark.parametrize("losses", [True, False])
def test_losses_that_are_in_no_force_can_be_left_out(losses, in_c):
    """By the option, and by the macro of a header that was written otherwise."""
    hit, velocity = sj.restitution(STEEL, WIDE), WIDE[SOME]
    expected = np.asarray(hit.coefficient if losses else hit.plastic_coefficient)[SOME]
    step = np.asarray(hit.duration)[SOME] / 1000
    assert in_c(STEEL, losses=losses).largest_error(velocity, expected, step) < 2e-6
    by_macro = in_c(STEEL, (f"-DSOFTJAX_LOSSES={int(losses)}",), losses=not losses)
    assert np.max(np.abs(by_macro.rebounds(velocity, step) - expected)) < 2e-6


def test_one_header_serves_all_sizes_and_where_nothing_rebounds_the_bodies_stay_in_touch(
    in_c, tmp_path, header
):
    """1/R = 1 + 1/3 and 1/M = 1/2 + 1/6; Eq. (16) without a real root: v_cr near v_lim."""
    contact = dataclasses.replace(PAIR, limit_velocity=1.001 * float(PAIR.critical_velocity))
    law = dataclasses.replace(STEEL, contact=contact)
    hit, some = sj.restitution(law, WIDE), slice(71, 90, 3)  # from 0.4 to 2 m/s
    assert np.all(np.asarray(hit.status)[some] & int(sj.Status.NO_REBOUND))
    step = np.asarray(hit.duration)[some] / 400
    found = in_c(law, velocity_range=(0.4, 2.0)).rebounds(WIDE[some], step, contact=contact)
    assert np.all(np.abs(found) < 0.02)  # what the last step of loading leaves
    steel = MATERIALS["stainless steel"]
    contact = sj.Contact.between_spheres(steel, steel, 1e-3, 4e-3)
    expected, duration = wide(dataclasses.replace(STEEL, contact=contact))
    found = in_c(STEEL).rebounds(WIDE[SOME], duration[SOME] / 1000, contact=contact)
    assert np.max(np.abs(found - expected[SOME])) < 3e-6
    check = "softjax_pair p = softjax_spheres(1, 2, 3, 6); return p.radius != .75 || p.mass != 1.5;"
    source, program = tmp_path / "program.c", tmp_path / "program"
    source.write_text(f"{header(STEEL)}\nint main(void) {{ {check} }}", encoding="utf-8")
    subprocess.run(["gcc", source, "-o", program, "-lm"], check=True)
    assert subprocess.run([program]).returncode == 0


def test_headers_compile_by_themselves_without_a_warning(tmp_path, header):
    """In single precision; in C included twice, and beside others of other prefixes."""
    text = ""
    for k, law in enumerate((*LAWS.values(), KINKED)):
        of_law = header(law).replace("softjax", f"law{k}").replace("SOFTJAX", f"LAW{k}")
        text += f"#define LAW{k}_REAL float\n{of_law}"
    other = header(DAMPED["linear"], prefix="nylon")
    assert "nylon_force(" in other
    assert "softjax" not in other.lower()
    assert compiler_says(text + other + other, "c", tmp_path) == ""
    assert compiler_says(text, "c++", tmp_path) == ""


def test_a_users_law_goes_by_a_table_that_gains_no_energy(exported, in_c):
    """An impact returns ε² of its energy but for the sums of both works: 6e-6 of it were seen, at the kink."""
    velocity = np.geomspace(0.1, 5, 128)
    for law, least in ((BOTH, 0.5), (KINKED, 0.0)):
        made, _ = exported(law, "c", law="exact", steps=50, tolerance=0.5)
        code, hit = in_c(law), sj.restitution(law, velocity)
        found = code.rebounds(velocity, np.asarray(hit.duration) / 800)
        off = np.max(np.abs(found - hit.coefficient))
        assert least * made.choice.error < off < made.choice.error < 1e-3
    overlaps = 0.7 * float(hit.peak_overlap[-1]) * np.linspace(1, 0.3, 9)
    expected = 0.99e7 * (4 * overlaps - 6e-5)
    np.testing.assert_allclose(code.forces(overlaps)[0][1:], expected[1:], rtol=2e-3)
    for top in np.linspace(1e-5, 8e-5, 20):
        gain, most = code.gained([0.0, top, 0.0], contact=PAIR)
        assert gain == pytest.approx(-0.01 * most, abs=2e-5 * most)
    overlaps = 5e-5 * np.array([1, 0.9, 0.7, 0.5, 0.36, 0.32, 0.1])  # a third of 50 µm stays
    expected = np.maximum(1.5e7 * (overlaps - 5e-5 / 3), 0)
    found = in_c(DENTED).forces(overlaps)[0]
    np.testing.assert_allclose(found[1:], expected[1:], atol=2e-3 * expected[0])


@pytest.mark.parametrize("name", [*INDEPENDENT, "kinked"])
def test_below_the_range_the_restitution_of_its_end_is_held(name, exported):
    """Within the stated error; faster impacts are as they were, but where they load again a dashpot pushes."""
    law, velocity = (INDEPENDENT | {"kinked": KINKED})[name], np.geomspace(1e-3, 0.0999, 12)
    made, folder = exported(law, "c", law="exact", tolerance=0.01, below="hold")
    velocity = np.append(velocity, [0.0995, 0.1])  # where the range begins impacts are held or not
    code = compiled((folder / "softjax_law.h").read_text(encoding="utf-8"))
    hit = sj.restitution(law, np.append(WIDE[4:], [0.1, 0.2, 3.0, 1.0]))  # by the program of `WIDE`
    slow, *fast = np.asarray(hit.coefficient)[-4:-1]
    off = code.largest_error(velocity, slow, made.time_step, np.arange(8) / 8)
    assert 0.6 * made.choice.hold_error < off < made.choice.hold_error < 0.03
    end = code.largest_error(np.array([0.1]), slow, made.time_step, np.arange(48) / 48)
    assert end <= made.choice.error + made.choice.steps.error  # the range has its end
    assert code.largest_error(velocity, slow, made.time_step / 100) < 6e-3
    assert code.largest_error(np.array([0.2, 3.0]), fast, made.time_step / 10) < 2e-4
    within = f"within {made.choice.hold_error:.2g} at this time step"
    assert f"Below 0.1 m/s ε is held at {float(slow):.4g} by a dashpot, {within}." in made.warnings
    assert made.to_dict()["below"]["restitution"] == pytest.approx(float(slow), rel=1e-9)
    peak = float(hit.peak_overlap[-1])
    again = [code.forces([peak, 0.9 * peak], rate)[0][1] for rate in (-0.1, 0.0, 0.1)]
    assert again[0] == again[1] < again[2]
