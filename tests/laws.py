"""The library's laws, one row each: an example, what it comes out as, and how it may be solved.

`LAWS` serves the tests of values, histories, derivatives, hard inputs and transformations: a new law
is a row here and a formula in `oracles.laws_mp`.
"""

from collections.abc import Callable
from dataclasses import fields
from functools import lru_cache, partial
from types import SimpleNamespace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np

import softjax as sj
from tests.cases import column, fitted, pair
from tests.oracles import laws_mp as exact

PAIR = pair("stainless steel")
PRECISE = sj.ODE(rtol=1e-11)
ELASTIC, PLAIN, GAIN = (int(sj.Status[n]) for n in ("ELASTIC", "PLAIN", "ENERGY_GAIN"))
TIME = 0.3 / (1.5 * (PAIR.stiffness / PAIR.mass) ** 0.4)  # w² = 0.3 at 1 m/s
ENERGY, KNOWN = sj.EnergyBalance(), sj.ClosedForm()


class Case(NamedTuple):
    """One law.

    Attributes:
        law: in SI.
        exact: numbers by name -> `laws_mp.Collision`.
        velocity: plain impacts [m/s], and their `status`.
        route: the default.
        invalid: a field and a number that it must not have.
    """

    law: sj.ContactLaw
    exact: Callable
    velocity: np.ndarray
    status: tuple[int, ...]
    route: object
    invalid: tuple[str, float]

    @property
    def routes(self):
        return (self.route,) if isinstance(self.law, sj.HardSphereLaw) else (self.route, PRECISE)


def _case(law, formula, velocity, status, route, invalid, scale=1.0):
    status = status if isinstance(status, tuple) else (status,) * len(velocity)
    wrong = invalid, 1.5 if invalid == "restitution" else -1.0
    return Case(law, formula, scale * np.array(velocity), status, route, wrong)


def _zhou(form):
    law, y = fitted("nylon", form), [0.5, 1.02, 6.0, 40.0]
    status, scale = (ELASTIC, GAIN, PLAIN, PLAIN), float(law.contact.critical_velocity)
    return _case(law, partial(exact.zhou, form=form), y, status, ENERGY, "chi", scale)


def _thornton():
    law, y, status = sj.Thornton(PAIR, 1.3), [0.4, 1.2, 30.0], (ELASTIC, PLAIN, PLAIN)
    scale = float(law.elastic_velocity())
    return _case(law, exact.thornton, y, status, ENERGY, "yield_factor", scale)


_WIDE, _SOME, _SPRING = [1e-3, 1.0, 1e4], [1e-4, 0.7, 30.0], (1.2e6, 3.0e6, 2e4)
_VISCOUS, _EQ_17 = sj.ViscoelasticHertz(PAIR, TIME), sj.EmpiricalRestitution(340.0, 3.0432, 0.54)
LAWS = {
    "hertz": _case(sj.Hertz(PAIR), exact.hertz, _WIDE, ELASTIC, ENERGY, "radius"),
    "thornton": _thornton(),
    "walton-braun": _case(
        sj.WaltonBraun(PAIR, *_SPRING),
        exact.walton_braun,
        [1e-4, 0.1, 20.0],
        PLAIN,
        ENERGY,
        "growth",
    ),
    "viscoelastic": _case(
        _VISCOUS, exact.viscoelastic, [1e-6, 1.0, 30.0], PLAIN, KNOWN, "dissipation_time"
    ),
    "zhou": _zhou("first-order"),
    "zhou full": _zhou("full"),
    "constant": _case(
        sj.ConstantRestitution(PAIR, 0.9), exact.hard, _WIDE, PLAIN, ENERGY, "restitution"
    ),
    "eq. 17": _case(_EQ_17, exact.hard, [1e-6, 1.0, 339.0], PLAIN, ENERGY, "psi"),
}
for _end in ("zero-overlap", "zero-force"):
    for _name, _law in (
        ("linear_dashpot", sj.LinearSpringDashpot(PAIR, 1e6, 0.6, _end)),
        ("hertz_dashpot", sj.HertzDashpot(PAIR, 0.6, _end)),
    ):
        LAWS[f"{_name.replace('_', ' ')} to {_end}"] = _case(
            _law, partial(getattr(exact, _name), end=_end), _SOME, PLAIN, KNOWN, "restitution"
        )
WITH_FORCE = [name for name, case in LAWS.items() if not isinstance(case.law, sj.HardSphereLaw)]
SIZE, SMALL = 96, 16  # impacts of a batch
SYMBOLS = {  # of Zhou's law and the velocity, as the reference collisions call them
    "chi": "chi",
    "limit_velocity": "v_lim",
    "mass": "M",
    "psi": "psi",
    "radius": "R",
    "sigma": "sigma",
    "velocity": "v",
    "yield_strength": "Y",
    "youngs_modulus": "E",
}
QUANTITIES = ("coefficient", "peak_overlap", "residual_overlap", "duration")


def numbers(law, velocity=None) -> dict[str, float]:
    """All numbers of a law and its contact by name, and the velocity."""
    contact = getattr(law, "contact", None)
    found = {} if contact is None else dict(contact.leaves())
    named = [f.name for f in fields(law) if not f.metadata.get("static") and f.name != "contact"]
    found |= {name: getattr(law, name) for name in named}
    found |= {} if velocity is None else {"velocity": velocity}
    return dict(sorted(found.items()))  # as JAX orders them


def with_numbers(law, values: dict):
    """The law with all its numbers replaced, unchecked, as tracing leaves them."""
    names = [str(path[-1]).lstrip(".") for path, _ in jax.tree_util.tree_flatten_with_path(law)[0]]
    return jax.tree.unflatten(jax.tree.structure(law), [values[name] for name in names])


def _values(case, values) -> np.ndarray:
    return np.array([float(x) for x in case.exact(values)])


def _as_mp(law, velocity) -> dict:
    return {name: mp.mpf(float(x)) for name, x in numbers(law, float(velocity)).items()}


@lru_cache
def expected(name: str) -> np.ndarray:
    """The quantities of each plain impact, and the largest force: (impacts, 5)."""
    case = LAWS[name]
    with mp.workdps(40):
        return np.array([_values(case, _as_mp(case.law, v)) for v in case.velocity])


@lru_cache
def expected_slopes(name: str) -> dict[str, np.ndarray]:
    """θ ∂q/∂θ for each θ by central differences in 40 digits: name -> (impacts, 4)."""
    case, step = LAWS[name], mp.mpf("1e-10")
    with mp.workdps(40):
        rows = []
        for v in case.velocity:
            at = _as_mp(case.law, v)
            row = {}
            for key, value in at.items():
                up, down = (case.exact(at | {key: value * (1 + s)})[:4] for s in (step, -step))
                row[key] = [float((a - b) / (2 * step)) for a, b in zip(up, down, strict=True)]
            rows.append(row)
    return {key: np.array([row[key] for row in rows]) for key in rows[0]}


def graded(law, values: dict, route=None, *, lasting=False):
    """The quantities, the result, and θ ∂q/∂θ of the quantities in reverse; by the ODE forward too, and by Zhou's law.

    `values` holds an array for each number of the law and the velocity, all of one length up to SIZE:
    one program serves all tests of a law, route (of any tolerance) and precision. The duration, if
    `lasting`, costs as much as the rest.

    Returns:
        The quantities (q, impacts), the result, and a list of slopes (θ, q, impacts).
    """
    count, route = len(values["velocity"]), route or law.default_route()
    padded = {name: jnp.asarray(np.resize(x, SIZE)) for name, x in sorted(values.items())}
    blank = jax.tree.map(lambda _: 0.0, law)
    route, by = (None, route) if not isinstance(route, sj.ODE) else (route, None)
    found = _graded(blank, padded, route, by, QUANTITIES[: 3 + lasting])
    return jax.tree.map(lambda x: np.asarray(x)[..., :count], found)


@partial(jax.jit, static_argnames=("by", "names"))
def _graded(law, values: dict, route, by, names):
    def quantities(values):
        result = sj.restitution(with_numbers(law, values), values["velocity"], route or by)
        return [getattr(result, name) for name in names], result

    found, push, result = jax.linearize(quantities, values, has_aux=True)
    pull = jax.linear_transpose(lambda values: jnp.stack(push(values)), values)

    def forward(i):
        one = {n: jnp.where(i == k, x, 0 * x) for k, (n, x) in enumerate(values.items())}
        return jnp.stack(push(one))

    found = jnp.stack(found)
    rows = jnp.eye(len(names), dtype=found.dtype)[:, :, None] * jnp.ones_like(found[0])
    (pulled,) = jax.lax.map(pull, rows)
    slopes = [jnp.stack([pulled[name] * x for name, x in values.items()])]
    if route or (isinstance(law, sj.Zhou) and law.form == "first-order"):
        slopes.append(jax.lax.map(forward, jnp.arange(len(values))))
    return found, result, slopes


def in_small_batches(names, of, *columns) -> SimpleNamespace:
    """Quantities of the results `of` so many impacts, which compile sooner than large batches."""
    size = -(-len(columns[0]) // SMALL) * SMALL
    rows = (np.split(np.resize(x, size), size // SMALL) for x in columns)
    hits = [of(*row) for row in zip(*rows, strict=True)]
    found = {n: np.concatenate([getattr(one, n) for one in hits]) for n in names}
    return SimpleNamespace(**{n: x[: len(columns[0])] for n, x in found.items()})


def of_records(records: list[dict], dtype=np.float64) -> dict:
    """What `graded` takes, of reference collisions by Zhou's law."""
    return {name: column(records, "inputs", s).astype(dtype) for name, s in SYMBOLS.items()}


def repeated(law, velocity, dtype=np.float64) -> dict:
    """What `graded` takes: every number repeated for each impact."""
    velocity = np.asarray(velocity, dtype)
    return {
        name: np.broadcast_to(np.asarray(x, dtype), velocity.shape).copy()
        for name, x in numbers(law, velocity).items()
    }
