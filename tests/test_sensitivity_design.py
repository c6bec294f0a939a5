"""Information and optimal velocities: second derivatives, and simulated calibrations."""

from functools import lru_cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import calibration as cal
import softjax as sj
from calibration.sensitivities import estimating
from calibration.sensitivities.search import Goal, Task, search
from tests.cases import column, fitted, law_of, reference

SETS = 2000
SHOTS = 12
NOISE = 0.003
LAW = fitted("nylon")
CRITICAL = float(LAW.contact.critical_velocity)
LIMIT = float(LAW.contact.limit_velocity)
BOUNDS = (2 * CRITICAL, 80 * CRITICAL)


@lru_cache
def design(objective: str, criterion: str = "c"):
    return cal.optimal_velocities(
        LAW,
        SHOTS,
        BOUNDS,
        objective=objective,
        criterion=criterion,
        uncertainty=NOISE,
        starts=4,
        steps=250,
    )


@jax.jit
def plastic(log_chi, v):
    """ε_p² of each calibration's χ̃ at each velocity, and its slope in ln χ̃."""

    def squared(z):
        law = sj.Zhou(LAW.contact, jnp.exp(z)[:, None], 0.0, 1.0)
        return sj.restitution(law, v[None, :]).plastic_coefficient ** 2

    return jax.jvp(squared, (log_chi,), (jnp.ones_like(log_chi),))


def empirical(v, z):
    """Eq. (17) of ln σ, ln ψ in the columns of z, and its slopes, by hand."""
    sigma, psi = np.exp(z[:, :1]), np.exp(z[:, 1:])
    ratio = v / (LIMIT - v)
    exponent = sigma * ratio**psi
    value = np.exp(-exponent)
    return value, np.stack([-exponent * value, -exponent * psi * np.log(ratio) * value], axis=-1)


def gauss_newton(curve, start, data, steps=12):
    """Least squares of `curve` for each row of `data` by itself."""
    z = np.tile(start, (len(data), 1))
    for _ in range(steps):
        value, slope = curve(z)
        normal = np.einsum("sij,sik->sjk", slope, slope)
        move = np.linalg.solve(normal, np.einsum("sij,si->sj", slope, data - value)[..., None])
        z = z + np.clip(move[..., 0], -1.0, 1.0)
    assert np.max(np.abs(move)) < 1e-6
    return z


def two_step_fits(v, data):
    """ln χ̃ of each row: Eq. (17) for σ and ψ, then the model for χ̃ with their ε_up."""
    first = gauss_newton(lambda z: empirical(v, z), np.log([LAW.sigma, LAW.psi]), data)
    eps_up, _ = empirical(np.array([CRITICAL]), first)

    def curve(z):
        squared, slope = map(np.asarray, plastic(z[:, 0], v))
        value = np.sqrt(squared + eps_up**2 - 1)  # Eq. (16)
        return value, (slope / (2 * value))[..., None]

    return gauss_newton(curve, np.log([LAW.chi]), data)[:, 0]


def model_fits(v, data):
    """ln χ̃ of each row: χ̃ and ε_up together."""

    def curve(z):
        squared, slope = map(np.asarray, plastic(z[:, 0], v))
        up_squared = np.exp(2 * z[:, 1:])
        value = np.sqrt(squared + up_squared - 1)  # Eq. (16)
        return value, np.stack([slope / (2 * value), up_squared / value], axis=-1)

    start = np.log([LAW.chi, float(estimating.eps_up(LAW))])
    return gauss_newton(curve, start, data)[:, 0]


def simulated_error(objective, v, seed):
    """Standard deviation of ln χ̃ over calibrations of simulated data."""
    if objective == "two-step":
        curve, fits = sj.empirical_restitution(v, LIMIT, LAW.sigma, LAW.psi), two_step_fits
    else:
        curve, fits = sj.restitution(LAW, v).coefficient, model_fits
    noise = NOISE * np.random.default_rng(seed).standard_normal((SETS, len(v)))
    found = np.asarray(fits(v, np.asarray(curve) + noise))
    assert np.all(np.isfinite(found))
    return np.std(found, ddof=1)


@pytest.mark.parametrize("objective", ["two-step", "model"])
def test_optimal_velocities_lower_the_error_as_predicted(objective):
    """2000 calibrations each at the optimal velocities and at equally spaced ones."""
    found = design(objective)
    even = np.linspace(*BOUNDS, SHOTS)
    optimal_error = simulated_error(objective, found.velocity, seed=1)
    even_error = simulated_error(objective, even, seed=2)
    assert found.gain > 1.15
    assert optimal_error == pytest.approx(found.relative_errors["chi"], rel=0.1)
    assert even_error == pytest.approx(found.equally_spaced["chi"], rel=0.1)
    assert even_error / optimal_error == pytest.approx(found.gain, rel=0.1)


def test_slopes_change_with_velocity_as_40_digits_say():
    """θ v ∂²ε/∂θ∂v, which the search for velocities follows."""
    form = "first-order"
    materials = [r for r in reference()["curves"] if r["inputs"]["form"] == form]
    contacts = {r["material"]: r["inputs"] for r in materials}
    for name, inputs in contacts.items():
        records = [
            r
            for r in reference()["materials"]
            if (r["material"], r["inputs"]["form"]) == (name, form)
        ]
        v = column(records, "inputs", "v")
        value, change = estimating.slopes_and_change(law_of(inputs), v)
        for i, theta in enumerate(estimating.THREE):
            first = column(records, "log_sensitivities", theta, "eps")
            pair = f"{theta},v" if f"{theta},v" in records[0]["second"] else f"v,{theta}"
            second = column(records, "second", pair, "eps")
            np.testing.assert_allclose(value.model[:, i], first, atol=1e-8)
            np.testing.assert_allclose(v * change.model[:, i], second, atol=1e-7)


@pytest.mark.parametrize("objective", ["two-step", "model"])
@pytest.mark.parametrize("criterion", ["c", "D"])
def test_gradient_of_the_criterion_agrees_with_differences(objective, criterion):
    names = estimating.parameters_of(objective, LAW, BOUNDS[0])
    goal = Goal(names, objective, criterion, 0)
    none = estimating.Rows(np.zeros((0, 3)), np.zeros((0, 2)), np.zeros(0))
    task = Task(LAW, np.array(BOUNDS), none, np.zeros(0), NOISE**-2.0)
    z = np.linspace(-2.0, 1.5, 6)

    def cost(z):
        return float(goal(*task.joined(estimating.slopes(LAW, task.velocity(z)))))

    h = 1e-4
    unit = np.eye(len(z))
    found = search(z[None], task, goal, steps=1)
    # one step of size 0.1 has been taken: its gradient is at the end, compare there
    end = np.asarray(found.velocity[0])
    assert not np.allclose(end, np.asarray(task.velocity(z)))
    part = np.log(end / BOUNDS[0]) / np.log(BOUNDS[1] / BOUNDS[0])
    z_end = np.log(part / (1 - part))
    differences = [(cost(z_end + h * e) - cost(z_end - h * e)) / (2 * h) for e in unit]
    norm = np.linalg.norm(differences)
    assert found.gradient_norm[0] == pytest.approx(norm, rel=1e-5)
    assert found.cost[0] == pytest.approx(cost(z_end), abs=1e-9)


def test_the_optimum_is_better_than_its_neighbours():
    found = design("two-step")
    best = found.relative_errors["chi"]
    for factor in (0.8, 1.2):
        moved = np.clip(found.velocity * factor, *BOUNDS)
        error = cal.fisher_information(LAW, moved, NOISE).relative_errors["chi"]
        assert error > best * (1 - 1e-4)
    assert all(BOUNDS[0] <= v <= BOUNDS[1] for v in found.velocity)
    assert sum(count for _, count in found.support) == SHOTS


def test_what_is_measured_already_counts():
    old = np.linspace(*BOUNDS, 40)
    found = cal.optimal_velocities(
        LAW, 2, BOUNDS, uncertainty=NOISE, measured=old, starts=2, steps=50
    )
    together = np.concatenate([old, found.velocity])
    expected = cal.fisher_information(LAW, together, NOISE).relative_errors
    assert found.relative_errors["chi"] == pytest.approx(expected["chi"], rel=1e-6)
    assert found.relative_errors["chi"] < found.before["chi"]


def test_information_of_the_model_is_that_of_least_squares():
    """(JᵀWJ)⁻¹ with J by differences of ε."""
    v = np.linspace(0.2 * CRITICAL, 30 * CRITICAL, 12)
    u = np.linspace(0.001, 0.004, 12)
    found = cal.fisher_information(LAW, v, u, "model")
    h = 1e-6
    rows = []
    for name in ("chi", "sigma", "psi"):
        values = [
            sj.restitution(fitted("nylon", **{name: getattr(LAW, name) * (1 + s)}), v).coefficient
            for s in (h, -h)
        ]
        rows.append(np.asarray(values[0] - values[1]) / (2 * h) / u)
    np.testing.assert_allclose(found.matrix, np.array(rows) @ np.transpose(rows), rtol=1e-6)
    expected = np.sqrt(np.diag(np.linalg.inv(found.matrix)))
    np.testing.assert_allclose(list(found.relative_errors.values()), expected, rtol=1e-3)


def test_above_yield_the_model_knows_the_losses_only_as_one_number():
    v = np.linspace(*BOUNDS, 10)
    found = cal.fisher_information(LAW, v, NOISE, "model")
    assert found.names == ("chi", "eps_up")


def test_directions_are_told_in_words():
    """Physics: with ten points below yield at noise 0.01, σ and ψ are still not separate."""
    v = np.concatenate([np.linspace(0.1, 0.9, 10), np.linspace(2, 80, 20)]) * CRITICAL
    words = cal.fisher_information(LAW, v, 0.01, "model").words
    assert "σ and ψ only together" in words[-1]
    assert "will be known to" in words[0]
    better = cal.fisher_information(LAW, v, 0.0005, "model").words
    assert all("will be known" in sentence for sentence in better)


@pytest.mark.parametrize(
    ("changed", "named"),
    [
        ({"count": 0}, "count"),
        ({"bounds": (1.0, 1e4)}, "bounds"),
        ({"bounds": (2.0, 1.0)}, "bounds"),
        ({"criterion": "A"}, "criterion"),
        ({"target": "eps"}, "target"),
        ({"objective": "both"}, "objective"),
        ({"uncertainty": 0.0}, "uncertainty"),
        ({"law": sj.Zhou(LAW.contact, 0.2, 0.0, 0.5)}, "sigma"),
    ],
)
def test_what_makes_no_sense_is_named(changed, named):
    arguments = {"law": LAW, "count": 3, "bounds": BOUNDS} | changed
    with pytest.raises(ValueError, match=f"`{named}`"):
        cal.optimal_velocities(**arguments)
