"""What holds for all impacts, over wide boxes of all inputs.

Hypothesis draws the seed of a batch of fixed size, so that everything compiles once.
"""

import numpy as np
import pytest
from hypothesis import strategies as st
from mpmath import mp

import softjax as sj
from tests import cases
from tests.drawn import drawn
from tests.oracles import zhou_mp as z
from tests.physics import boxes
from tests.physics.boxes import Choice, count, solve

SIZE = 500
CHOICES = (Choice(), Choice("full", "hertz", "printed"))
seeds = st.integers(0, 2**32 - 1)
over_choices = pytest.mark.parametrize(
    "choice",
    [pytest.param(c, id=c.form, marks=[pytest.mark.long] * k) for k, c in enumerate(CHOICES)],
)


def conditioning(inputs, result, slopes):
    """8 eps Σ|∂ε²/∂ln θ|, what rounding of the inputs may cost ε²."""
    total = sum(np.abs(slopes[name] * inputs[name]) for name in boxes.INPUTS)
    return 8 * cases.EPS * 2 * result["coefficient"] * total


@over_choices
@drawn(12, seed=seeds)
def test_finite_flagged_right_and_falling(choice, seed):
    broken = count(boxes.sample(seed, SIZE, choice), choice)
    assert broken == dict.fromkeys(broken, 0)


@pytest.mark.long
@pytest.mark.parametrize("choice", boxes.CHOICES, ids=str)
def test_a_million_impacts(choice):
    for seed in range(17):
        broken = count(boxes.sample(seed, 20_000, choice), choice)
        assert broken == dict.fromkeys(broken, 0), seed


def test_the_rules_can_be_broken():
    """A status or a slope that is wrong is counted."""
    inputs = boxes.sample(0, SIZE, Choice())
    result, _ = solve(inputs, Choice())
    plastic_squared = result["plastic_coefficient"].astype(np.longdouble) ** 2
    other = inputs | {"chi": 0 * inputs["chi"]}
    expected, clear = boxes.expected_status(other, Choice(), plastic_squared)
    assert np.sum(clear & (expected != result["status"])) > SIZE / 10


def test_full_form_rises_towards_its_end():
    """Where the claim ends, by the oracle: no flag, X > 1 and ∂ε_p²/∂y > 0, at d x_m = 1.24."""
    d, X, y = 0.05180679060827047, 1.0012268498804473, 39.987755605433996
    with mp.workdps(40):
        step = mp.mpf("1e-12")
        above, below = (z.plastic_squared("full", d, X, y * (1 + h)) for h in (step, -step))
        slope = (above - below) / (2 * step)
        assert abs(slope - mp.mpf("0.161897")) < 1e-5
        assert d * z.peak("full", d, y) > 1
    assert z.flags("full", d, X, y) == set()


@over_choices
@drawn(6, seed=seeds)
def test_continuous_in_velocity(choice, seed):
    """A step of v changes ε² by no more than the slopes at its ends allow, but at yield."""
    inputs = boxes.sample(seed, SIZE, choice)
    step = 1e-9
    results, slopes = zip(
        *(solve(inputs | {"v": inputs["v"] * (1 + h)}, choice) for h in (0, step)), strict=True
    )
    ends = sj.Status.ELASTIC | sj.Status.NO_TURNING_POINT
    same = (results[0]["status"] & ends) == (results[1]["status"] & ends)
    change = np.abs(results[1]["coefficient"] ** 2 - results[0]["coefficient"] ** 2)
    steepest = np.max(
        [2 * r["coefficient"] * np.abs(s["v"]) for r, s in zip(results, slopes, strict=True)],
        axis=0,
    )
    allowed = 2 * step * steepest * inputs["v"] + 1e-12
    allowed += sum(conditioning(inputs, r, s) for r, s in zip(results, slopes, strict=True))
    assert np.all(change[same] <= allowed[same])
    assert same.mean() > 0.9


@over_choices
@drawn(6, seed=seeds)
def test_jump_at_yield(choice, seed):
    """ε_p² = 1 up to v_cr, 1 + 2d/3 after (full: (1 - (2d/3)^{5/2})/(1 - 2d/3))."""
    inputs = boxes.sample(seed, SIZE, choice)
    d, v_cr = boxes.scales(inputs, choice)
    near = 1e-10
    below, _ = solve(inputs | {"v": (v_cr * (1 - near)).astype(float)}, choice)
    assert np.all(below["plastic_coefficient"] == 1)
    at = inputs | {"v": (v_cr * (1 + near)).astype(float)}
    above, _ = solve(at, choice)
    e = 2 * d / 3
    full = np.where(np.abs(e - 1) < 1e-6, 2.5, (1 - e**2.5) / np.where(e == 1, 1, 1 - e))
    jump = (1 + e if choice.form == "first-order" else full).astype(float)
    # X = 1e8 unloads the more steeply the less has yielded: what is left to the limit is its slope
    steep = 10 * near * (1 + inputs["chi"] * inputs["E"] / inputs["Y"]) * (1 + np.sqrt(d))
    assert np.all(np.abs(above["plastic_coefficient"] ** 2 - jump) <= steep.astype(float))


@over_choices
@drawn(6, seed=seeds)
def test_scales_do_not_matter(choice, seed):
    """The same d, X and y give the same ε_p; with the same v_cr/v_lim the same ε."""
    inputs = boxes.sample(seed, SIZE, choice)
    rng = np.random.default_rng(seed)
    _, v_cr = boxes.scales(inputs, choice)
    stress, length, mass = (boxes.power(rng, 1e-3, 1e3, SIZE) for _ in range(3))
    other = inputs | {
        "E": inputs["E"] * stress,
        "Y": inputs["Y"] * stress,
        "R": inputs["R"] * length,
        "M": inputs["M"] * mass,
    }
    faster = (boxes.scales(other, choice)[1] / v_cr).astype(float)
    other |= {"v": inputs["v"] * faster, "v_lim": inputs["v_lim"] * faster}
    (one, slopes), (two, _) = solve(inputs, choice), solve(other, choice)
    _, clear = boxes.expected_status(
        inputs, choice, one["plastic_coefficient"].astype(np.longdouble) ** 2
    )
    allowed = 1e-12 + 4 * conditioning(inputs, one, slopes)
    for name in ("coefficient", "plastic_coefficient"):
        difference = np.abs(one[name] ** 2 - two[name] ** 2)
        alive = clear & ((one["coefficient"] > 0) | (name == "coefficient"))
        assert np.all(difference[alive] <= allowed[alive]), name
    assert np.array_equal(one["status"][clear], two["status"][clear])


def between(materials, radii):
    """All that a law knows of two bodies."""
    contact = sj.Contact.between_spheres(*(sj.Material(*m) for m in materials), *radii)
    return contact.leaves() | {"v_cr": contact.critical_velocity}


def some_bodies(seed):
    """Two bodies of any materials, E/Y from 20 to 1e4."""
    rng = np.random.default_rng(seed)

    def material():
        Y, ratio = boxes.power(rng, 1e5, 1e10, SIZE), boxes.power(rng, 20, 1e4, SIZE)
        return ratio * Y, rng.uniform(-0.5, 0.5, SIZE), boxes.power(rng, 10, 2e4, SIZE), Y

    radii = boxes.power(rng, 1e-6, 10, SIZE), boxes.power(rng, 1e-6, 10, SIZE)
    return (material(), material()), radii


def assert_alike(one, two):
    assert set(one) == set(two)
    for name, value in one.items():
        assert np.allclose(value, two[name], rtol=1e-12, atol=0), name


@drawn(6, seed=seeds)
def test_swapping_the_bodies(seed):
    """Equal yield strengths among them, where v_lim takes the denser body's."""
    (one, two), radii = some_bodies(seed)
    two = (*two[:3], np.where(np.arange(SIZE) % 3 == 0, one[3], two[3]))
    assert_alike(between((one, two), radii), between((two, one), radii[::-1]))


@drawn(6, seed=seeds)
def test_a_wall_is_a_large_sphere(seed):
    """The difference goes as R1/R2, and is gone at 1e-14."""
    materials, (radius, _) = some_bodies(seed)
    contact = sj.Contact.with_wall(*(sj.Material(*m) for m in materials), radius)
    wall = contact.leaves() | {"v_cr": contact.critical_velocity}
    assert_alike(between(materials, (radius, 1e14 * radius)), wall)
    near, nearer = (between(materials, (radius, n * radius))["radius"] for n in (1e3, 1e5))
    off, less = (np.max(np.abs(one / radius - 1)) for one in (near, nearer))
    assert off / less == pytest.approx(100, rel=0.01)
