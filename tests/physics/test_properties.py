"""What holds for all impacts, over wide boxes of all inputs; batches of one size, which compile once."""

import numpy as np
import pytest

from tests import cases
from tests.physics import boxes
from tests.physics.boxes import Choice, count, solve

SIZE = 500
over_choices = pytest.mark.parametrize(
    "choice",
    [
        pytest.param(Choice(), id="first-order"),
        pytest.param(Choice("full", "hertz", "printed"), id="full", marks=pytest.mark.long),
    ],
)


def conditioning(inputs, result, slopes):
    """8 eps Σ|∂ε²/∂ln θ|, what rounding of the inputs may cost ε²."""
    total = sum(np.abs(slopes[name] * inputs[name]) for name in boxes.INPUTS)
    return 8 * cases.EPS * 2 * result["coefficient"] * total


@over_choices
def test_finite_falling_and_within_bounds(choice):
    for seed in range(12):
        broken = count(boxes.sample(seed, SIZE, choice), choice)
        assert broken == dict.fromkeys(broken, 0), seed


@pytest.mark.long
@pytest.mark.parametrize("choice", boxes.CHOICES, ids=str)
def test_a_million_impacts(choice):
    for seed in range(17):
        broken = count(boxes.sample(seed, 20_000, choice), choice)
        assert broken == dict.fromkeys(broken, 0), seed


@over_choices
def test_scales_do_not_matter(choice):
    """The same d, X and y give the same ε_p; with the same v_cr/v_lim the same ε."""
    inputs = boxes.sample(100, SIZE, choice)
    rng = np.random.default_rng(100)
    stress, length, mass = (boxes.power(rng, 1e-3, 1e3, SIZE) for _ in range(3))
    other = inputs | {
        "E": inputs["E"] * stress,
        "Y": inputs["Y"] * stress,
        "R": inputs["R"] * length,
        "M": inputs["M"] * mass,
    }
    pace = [np.asarray(boxes.law_of(x, choice).elastic_velocity()) for x in (other, inputs)]
    other |= {name: inputs[name] * (pace[0] / pace[1]) for name in ("v", "v_lim")}
    (one, slopes), (two, _) = solve(inputs, choice), solve(other, choice)
    same = one["status"] == two["status"]  # not beside a threshold, where rounding decides
    assert np.mean(same) > 0.98
    allowed = 1e-12 + 4 * conditioning(inputs, one, slopes)
    for name in ("coefficient", "plastic_coefficient"):
        difference = np.abs(one[name] ** 2 - two[name] ** 2)
        alive = same & ((one["coefficient"] > 0) | (name == "coefficient"))
        assert np.all(difference[alive] <= allowed[alive]), name
