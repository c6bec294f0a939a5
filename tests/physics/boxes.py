"""Impacts over wide boxes of all inputs, and the status that physics gives each of them.

The conditions are written here once more, in NumPy's extended precision, from the equations of the
law alone. None needs a root of the energy balance: x_m lies beyond some overlap x_t exactly if the
impact is faster than √(5/2 W_L(x_t)).
"""

from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

import softjax as sj

Long = np.longdouble
NODES, WEIGHTS = (a.astype(Long) for a in np.polynomial.legendre.leggauss(40))
AREA = {"zhou": Long(np.pi) ** (Long(2) / 3), "hertz": Long(1)}
MARGIN = 1e-10  # relative: this near a threshold rounding of the inputs may decide


@dataclass(frozen=True)
class Choice:
    form: str = "first-order"
    area: str = "zhou"
    kappa: str = "consistent"


CHOICES = (Choice(), Choice("full"), Choice("full", "hertz", "printed"))
LEAVES = ("E", "R", "M", "Y", "v_lim")
INPUTS = (*LEAVES, "chi", "sigma", "psi", "v")


def power(rng, low, high, size):
    """Numbers whose logarithms are spread evenly."""
    return 10.0 ** rng.uniform(np.log10(low), np.log10(high), size)


def some_of(rng, size, *kinds):
    """Of each kind about as many."""
    return np.choose(rng.integers(len(kinds), size=size), kinds)


def sample(seed: int, size: int, choice: Choice) -> dict[str, np.ndarray]:
    """E/Y 2…1e6 (printed κ: 5…1e6), X 1e-6…1e8, R 1 nm…1 km, y from 0 to beyond y_max."""
    rng = np.random.default_rng(seed)
    ratio = power(rng, 5 if choice.kappa == "printed" else 2, 1e6, size)
    Y = power(rng, 1e4, 1e10, size)
    R, X = power(rng, 1e-9, 1e3, size), power(rng, 1e-6, 1e8, size)
    inputs = {
        "E": ratio * Y,
        "R": R,
        "M": 4 / 3 * np.pi * power(rng, 1, 3e4, size) * R**3,
        "Y": Y,
        "chi": some_of(rng, size, X, X, X, 0 * X) / ratio,
        "sigma": some_of(rng, size, power(rng, 1e-3, 3, size), power(rng, 1e-3, 100, size), 0 * X),
        "psi": power(rng, 0.05, 3, size),
    }
    d, v_cr = scales(inputs, choice)
    v_cr = v_cr.astype(float)
    inputs["v_lim"] = v_cr * power(rng, 0.1, 1e7, size)
    y_end = y_max(d, choice.form)
    near = 1 + rng.choice([-1, 1], size) * power(rng, 1e-8, 0.1, size)
    y = some_of(
        rng,
        size,
        0 * X,
        power(rng, 1e-290, 1, size),
        power(rng, 1e-3, 1, size),
        1 + power(rng, 1e-9, 1, size),
        (y_end ** rng.uniform(0, 1.02, size)).astype(float),
        (y_end * near).astype(float),
        power(rng, 1, 100, size),
    )
    return inputs | {"v": y * v_cr}


def law_of(inputs, choice: Choice) -> sj.Zhou:
    """The law of a sample's inputs, NumPy's or JAX's."""
    contact = sj.Contact(*(inputs[name] for name in LEAVES), area=choice.area)
    values = [inputs[name] for name in ("chi", "sigma", "psi")]
    return sj.Zhou(contact, *values, form=choice.form, kappa=choice.kappa)


def scales(inputs, choice: Choice):
    """d and v_cr [m/s] in extended precision, Eqs. (2), (5) and the κ of Eq. (10)."""
    E, R, M, Y = (inputs[name].astype(Long) for name in ("E", "R", "M", "Y"))
    k = Long(4) / 3 * E * np.sqrt(R)
    overlap = critical_overlap(inputs, choice)
    v_cr = np.sqrt(4 * k / (5 * M)) * overlap ** Long(1.25)
    if choice.kappa == "printed":
        return 24 * (Long(np.pi) / 2) ** (Long(8) / 3) * (Y / E) ** 2, v_cr
    return 3 * overlap / (2 * AREA[choice.area] * R), v_cr


def critical_overlap(inputs, choice: Choice):
    """δ_cr [m], Eq. (5a)."""
    E, R, Y = (inputs[name].astype(Long) for name in ("E", "R", "Y"))
    k = Long(4) / 3 * E * np.sqrt(R)
    return (2 * Long(np.pi) * AREA[choice.area] * R * Y / (3 * k)) ** 2


def loading_end(d, form: str):
    """Where the loading force vanishes (first-order), or the law ends (full)."""
    if form == "full":
        e = 2 * d / 3
        return (1 + np.sqrt(1 + 4 * e**2)) / (2 * e)
    s = 2 + np.sqrt(Long(2.2) / d)
    for _ in range(60):
        value, slope = (s - s**-3) * (s - 1) - 1 / d, (1 + 3 * s**-4) * (s - 1) + s - s**-3
        s = s - value / slope
    return s**2


def velocity_to(x, d, form: str):
    """y of the impact that ends at overlap x >= 1: √(5/2 W_L)."""
    return np.sqrt(1 + Long(2.5) * _work_from_yield(x, d, form))


def _work_from_yield(x, d, form: str):
    """∫_1^x p_L dx by quadrature."""
    if form == "full":
        # x = x_e sin²φ takes the rim's square root at the end out
        end = loading_end(d, form)
        low, high = (np.arcsin(np.minimum(np.sqrt(at / end), 1)) for at in (1 + 0 * x, x))
        force = lambda phi: end * np.sin(2 * phi) * _full(end * np.sin(phi) ** 2, d, end)  # noqa: E731
        return _integral(force, low, high)
    return _integral(lambda s: 2 * s * _first_order(s, d), 1 + 0 * x, np.sqrt(x))


def _integral(f, low, high):
    half = (high - low) / 2
    return half * sum(w * f(low + half * (1 + t)) for t, w in zip(NODES, WEIGHTS, strict=True))


def _first_order(s, d):
    return s**3 + d * (s**4 - 1) * (1 - s)  # Eq. (8)


def _full(x, d, end):
    rim = 2 * d / 3 * np.maximum(end - x, 0) * (x + 1 / end)  # x - (2d/3)(x² - 1)
    return rim * np.sqrt(rim) + d * (x**2 - 1)  # Eq. (6)


def y_max(d, form: str):
    """The fastest impact that turns."""
    return velocity_to(loading_end(d, form), d, form)


def expected_status(inputs, choice: Choice, plastic_squared, margin=MARGIN, rounding=1e-13):
    """The flags of each impact, and whether it is clear of all thresholds.

    Clear is y by `margin`, relative, and ε_p² and ε² by `rounding`.
    ENERGY_GAIN and NO_REBOUND follow from the ε_p² that is given; all others from the inputs.
    """
    d, v_cr = scales(inputs, choice)
    v, v_lim = inputs["v"].astype(Long), inputs["v_lim"].astype(Long)
    X = inputs["chi"].astype(Long) * inputs["E"] / inputs["Y"]
    y = v / v_cr
    yields, lost = y > 1, y > y_max(d, choice.form)
    answered = yields & ~lost
    open_at, beyond_at = _thresholds(d, X, choice.form)
    left = plastic_squared + np.expm1(-2 * _exponent(inputs, v_cr))
    flags = {
        sj.Status.ELASTIC: ~yields,
        sj.Status.ZERO_VELOCITY: v == 0,
        sj.Status.ABOVE_LIMIT_VELOCITY: v >= v_lim,
        sj.Status.NO_TURNING_POINT: yields & lost,
        sj.Status.BEYOND_EXPANSION: yields & (lost | (y > beyond_at)),
        sj.Status.NO_RESIDUAL_OVERLAP: answered & (y <= open_at),
        sj.Status.ENERGY_GAIN: answered & (plastic_squared > 1),
        sj.Status.NO_REBOUND: answered & (left < 0),
    }
    total = sum(np.where(holds, int(flag), 0) for flag, holds in flags.items())
    thresholds = (1 + 0 * y, y_max(d, choice.form), open_at, beyond_at)
    clear = np.all([~(np.abs(y - at) < margin * y) for at in thresholds], axis=0)
    clear &= (np.abs(plastic_squared - 1) > rounding) | ~answered
    return total, clear & ((np.abs(left) > rounding) | ~answered)


def _thresholds(d, X, form: str):
    """y up to which the unloading force has no root, and y beyond which the expansion is lost."""
    end = loading_end(d, form)
    if form == "first-order":
        at = velocity_to(np.clip(1 / d, 1, end), d, form)
        return np.where(X <= 1, Long(np.inf), 0), np.where(
            1 / d < 1, 1, np.where(1 / d < end, at, np.inf)
        )
    least = (Long(2) / 3) ** Long(1.5) * np.sqrt(d) / np.where(X > 1, X - 1, 1)  # x_m² - 1
    x_open = np.sqrt(1 + least)
    at = velocity_to(np.minimum(x_open, end), d, form)
    return np.where((X <= 1) | (x_open >= end), Long(np.inf), at), Long(np.inf) + 0 * d


def _exponent(inputs, v_cr):
    """-ln ε_up, Eq. (17) at v_cr; infinite from the limit velocity on."""
    below = v_cr < inputs["v_lim"]
    ratio = v_cr / np.where(below, inputs["v_lim"] - v_cr, 1)
    return np.where(below, inputs["sigma"] * ratio ** inputs["psi"], Long(np.inf))


# What must hold for every impact, as counts of the impacts for which it does not.

NAMES = ("coefficient", "plastic_coefficient", "peak_overlap", "residual_overlap", "status")


@partial(jax.jit, static_argnums=1)
def _solve(inputs, choice):
    def total(inputs):
        result = sj.restitution(law_of(inputs, choice), inputs["v"])
        return result.coefficient.sum(), {name: getattr(result, name) for name in NAMES}

    (_, result), slopes = jax.value_and_grad(total, has_aux=True)(inputs)
    return result, slopes


def solve(inputs, choice, dtype=np.float64):
    """The results by name and ∂ε/∂θ by name, NumPy's, of a sample."""
    arrays = {name: jnp.asarray(value, dtype) for name, value in inputs.items()}
    return jax.tree.map(np.asarray, _solve(arrays, choice))


def count(inputs, choice) -> dict[str, int]:
    """How many impacts break each rule."""
    result, slopes = solve(inputs, choice)
    status = result["status"]
    plastic_squared = result["plastic_coefficient"].astype(np.longdouble) ** 2
    expected, clear = expected_status(inputs, choice, plastic_squared)
    broken = {
        "not finite": ~_finite(result),
        "gradient not finite": ~_finite(slopes),
        "status": clear & (status != expected),
        "ε outside 0 and ε_p": (result["coefficient"] < 0)
        | (result["coefficient"] > result["plastic_coefficient"] * (1 + 1e-15)),
        "residual beyond peak": result["residual_overlap"] > result["peak_overlap"],
        "rises with v": (status == sj.Status.PLAIN)
        & within_claim(inputs, choice, result)
        & (slopes["v"] * inputs["v"] > 1e-13),
        "gradient where ε is 0": (result["coefficient"] == 0)
        & (sum(np.abs(slope) for slope in slopes.values()) > 0),
    }
    return {rule: int(np.sum(holds)) for rule, holds in broken.items()}


def _finite(values) -> np.ndarray:
    return np.all([np.isfinite(value) for value in values.values()], axis=0)


def within_claim(inputs, choice, result) -> np.ndarray:
    """Where ε falls with v: X >= 1, and for the full form d x_m <= 1 besides.

    Beyond that the full form's ε_p rises again towards its end, seen from d x_m = 1.107 on; the
    first-order form's never did in 220 000 impacts without a flag.
    """
    d, _ = scales(inputs, choice)
    peak = result["peak_overlap"] / critical_overlap(inputs, choice)
    steep = inputs["chi"] * inputs["E"] / inputs["Y"] >= 1
    return steep & ((choice.form == "first-order") | (d * peak <= 1))
