"""Collisions in closed form: against 60 digits, formulas, the equation of motion; and at the ends."""

import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest

import softjax as sj
from softjax.laws import _dashpots, _viscous
from tests import law_cases as lc
from tests.cases import compiled_soon
from tests.oracles import closed_forms as oracle

ENDS = ("zero-overlap", "zero-force")
# both sides of each border between two series, and beyond the last one
W_SQUARED = [1e-9, 0.02, 0.7, 1.0, 1.0001, 40.0, np.exp(5.0), 150.0, 1e6, np.exp(24.0), 1e13]
INPUT = np.array([1e-40, 0.01, 0.04, 0.045, 0.5, 0.9, 1 - 1e-6])
PARTS = ("restitution", "peak", "duration")
UNIT = 1.25**0.4


def along_logarithm(f, x):
    """Values and x df/dx, elementwise, all parts of a named tuple."""
    return compiled_soon(jax.vmap(lambda x: jax.jvp(f, (x,), (x,))))(jnp.asarray(x))


def in_digits(f, x):
    """The same by central differences in 60 digits."""
    with mp.workdps(oracle.DIGITS):
        x, step = mp.mpf(float(x)), mp.mpf("1e-18")
        up, down, here = f(x * (1 + step)), f(x * (1 - step)), f(x)
        return np.array(
            [
                [float(v) for v in here],
                [float((a - b) / 2 / step) for a, b in zip(up, down, strict=True)],
            ]
        )


@pytest.mark.parametrize(
    "points",
    [slice(2, 8, 4), pytest.param(slice(None), marks=pytest.mark.long)],
    ids=["few", "all"],
)
def test_viscoelastic_spheres_against_sixty_digits(points):
    w_squared = W_SQUARED[points]
    value, slope = along_logarithm(lambda b: _viscous.collision(_viscous.damping(b)), w_squared)
    for i, b in enumerate(w_squared):
        exact, change = in_digits(oracle.of_squared, b)
        for k, part in enumerate(PARTS):
            assert np.isclose(getattr(value, part)[i], exact[k], rtol=2e-14, atol=0)
            assert np.isclose(getattr(slope, part)[i], change[k], rtol=1e-13, atol=1e-16)
        assert np.isclose(value.residual[i], b * exact[0], rtol=2e-14, atol=0)


def hertz_duration(loss, end):
    """By quadrature over the phase, of -ln ε."""
    a, w = loss / (5 * mp.pi), mp.pi / mp.sqrt(mp.pi**2 + loss**2)
    last = mp.pi if end == "zero-overlap" else 2 * mp.atan2(mp.pi, loss)
    middle = last / 2
    rising = mp.quad(lambda x: mp.exp(a * x) * mp.sin(x) ** mp.mpf("-0.2"), [0, middle])
    # from its end, where the sine of the zero-overlap end vanishes
    angle = lambda s: mp.sin(s) if end == "zero-overlap" else mp.sin(last - s)  # noqa: E731
    falling = mp.quad(lambda s: mp.exp(a * (last - s)) * angle(s) ** mp.mpf("-0.2"), [0, middle])
    return [mp.mpf("0.8") * w ** mp.mpf("-0.8") * (rising + falling)]


@pytest.mark.parametrize("end", ENDS)
def test_duration_of_hertz_dashpot_against_quadratures(end):
    loss = -np.log(INPUT)
    value, slope = along_logarithm(
        lambda x: (_dashpots.hertz_duration(_dashpots.damped(jnp.exp(-x), end), end),), loss
    )
    for i, x in enumerate(loss):
        with mp.workdps(30):
            exact = float(hertz_duration(mp.mpf(float(x)), end)[0])
            up, down = (
                hertz_duration(mp.mpf(float(x)) * (1 + h), end)[0]
                for h in (mp.mpf("1e-10"), -mp.mpf("1e-10"))
            )
            change = float((up - down) / mp.mpf("2e-10"))
        # what goes through ε itself rounds as it does
        rounding = 1e-13 + 4e-16 / x
        assert np.isclose(value[0][i], exact, rtol=rounding, atol=0)
        assert np.isclose(slope[0][i], change, rtol=1e-12 + 4e-16 / x, atol=1e-12)


def laws(end):
    """One of each kind, every impact with its own numbers."""
    v = np.array([1e-3, 0.1, 1.0, 30.0])
    r = np.array([0.05, 0.4, 0.8, 0.97])
    time = np.array([1e-7, 1e-6, 4e-6, 6e-5])
    yield sj.LinearSpringDashpot(lc.PAIR, 1e6, r, end), v
    yield sj.HertzDashpot(lc.PAIR, r, end), v
    if end == "zero-force":
        yield sj.ViscoelasticHertz(lc.PAIR, time), v


@pytest.mark.parametrize(
    "end", ["zero-force", pytest.param("zero-overlap", marks=pytest.mark.long)]
)
def test_the_equation_of_motion_agrees(end):
    """All that a result offers, by the default route and by time."""
    for law, velocity in laws(end):
        known = sj.restitution(law, velocity)
        by_time = sj.restitution(law, velocity, sj.ODE(rtol=1e-12))
        assert known.route == sj.ClosedForm()
        for name in (
            "coefficient",
            "plastic_coefficient",
            "peak_overlap",
            "residual_overlap",
            "duration",
        ):
            assert np.allclose(getattr(known, name), getattr(by_time, name), rtol=1e-10, atol=0), (
                name
            )
        assert np.array_equal(known.status, by_time.status)
        assert np.all(known.ok)
        bare = sj.restitution(law, velocity, overlaps=False)
        assert bare.peak_overlap is None
        assert np.array_equal(bare.coefficient, known.coefficient)
        assert np.allclose(
            sj.signed_restitution(law, velocity).squared, known.coefficient**2, rtol=1e-15
        )
        each = jax.vmap(lambda law, v: sj.restitution(law, v).coefficient)(
            lc.each_its_own(law, 4)
            if law is None
            else jax.tree.map(lambda a: jnp.broadcast_to(a, 4), law),
            jnp.asarray(velocity),
        )
        assert np.allclose(each, known.coefficient, rtol=1e-15)


HARD = {
    "velocity": np.array([0.0, 5e-324, 1e-310, 1e-300, 1e-150, 1.0, 1e5, 1e300]),
    "dissipation_time": np.array([0.0, 5e-324, 1e-300, 1e-6, 1.0, 1e30, 1e300]),
}


MADE = {
    "viscoelastic": lambda time, r: sj.ViscoelasticHertz(lc.PAIR, time),
    "hertz-dashpot": lambda time, r: sj.HertzDashpot(lc.PAIR, r, "zero-force"),
    "linear": lambda time, r: sj.LinearSpringDashpot(lc.PAIR, 1e6, r, "zero-force"),
}


ONCE = [("viscoelastic", np.float32), ("hertz-dashpot", np.float64), ("linear", np.float32)]
EVERY = [
    pytest.param(law, dtype, marks=() if (law, dtype) in ONCE else pytest.mark.long)
    for law in MADE
    for dtype in (np.float64, np.float32)
]


@pytest.mark.parametrize(("law", "dtype"), EVERY)
def test_nothing_is_no_number(law, dtype):
    """Values and derivatives of first and second order, forward and reverse, wherever it may be hard."""
    most = float(np.finfo(dtype).max) ** 0.8
    fit = lambda a: np.minimum(a, most).astype(dtype)  # noqa: E731
    v, time = (x.ravel() for x in np.meshgrid(*map(fit, HARD.values())))

    def of_one(x):
        v, time, r = x
        hit = sj.restitution(MADE[law](time, r), v)
        parts = (hit.coefficient, hit.duration, hit.peak_overlap, hit.residual_overlap)
        return jnp.stack([jnp.float32(1) * part for part in parts])

    r = np.resize(np.array([1.0, 1e-30, 0.5, 1 - 1e-7], dtype), v.size)
    points = jnp.stack([jnp.asarray(a, dtype) for a in (v, time, r)], -1)

    def backwards(x):
        value, pull = jax.vjp(of_one, x)
        (slopes,) = jax.vmap(pull)(jnp.eye(len(value), dtype=value.dtype))
        return (value, slopes), (value, slopes)

    derivatives = compiled_soon(jax.vmap(jax.jacfwd(backwards, has_aux=True)))
    for k, found in enumerate(jax.tree.leaves(derivatives(points))):
        assert found.dtype == dtype
        assert not np.any(np.isnan(found)), k


def test_limits():
    """Without damping Hertz's collision; at rest nothing; far beyond the series what is left is 0."""
    law = sj.ViscoelasticHertz(lc.PAIR, np.array([0.0, 1e-6, 1e290]))
    result = sj.restitution(law, np.array([1.0, 0.0, 1e3]))
    hertz = sj.restitution(sj.Hertz(lc.PAIR), 1.0)
    assert result.coefficient[0] == 1
    assert np.isclose(result.peak_overlap[0], hertz.peak_overlap, rtol=1e-15)
    assert np.isclose(result.duration[0], hertz.duration, rtol=1e-14)
    rest = sj.Status.ELASTIC | sj.Status.ZERO_VELOCITY
    assert np.array_equal(result.status, [sj.Status.PLAIN, rest, sj.Status.PLAIN])
    assert (result.coefficient[1], result.peak_overlap[1], result.duration[1]) == (1, 0, 0)
    assert result.coefficient[2] == 0
    assert np.all(np.isfinite(result.duration))


def test_second_derivative_at_rest_of_the_damping():
    """ε = 1 - 1.15345 w² + 0.79826 w⁴ + …, whose root of w² has no second derivative."""
    restitution = lambda b: _viscous.collision(_viscous.damping(b)).restitution  # noqa: E731
    assert np.isclose(jax.grad(restitution)(0.0), -1.153449, atol=1e-6)
    assert np.isclose(jax.grad(jax.grad(restitution))(0.0), 2 * 0.798267, atol=2e-6)


@pytest.mark.parametrize(
    "name", ["falling", *(pytest.param(n, marks=pytest.mark.long) for n in oracle.WANTED)]
)
def test_the_script_gives_what_is_stored(name):
    stored = oracle.stored()["series"][name]
    found = oracle.coefficients(name)
    assert (stored["low"], stored["high"]) == oracle.WANTED[name][1:]
    assert np.allclose(found, stored["coefficients"], rtol=0, atol=1e-15 * max(map(abs, found)))


class Stiffer(sj.ViscoelasticHertz):
    """Another force in newtons."""

    def force(self, overlap, velocity):
        return (
            2
            * self.contact.stiffness
            * overlap**1.5
            * (1 + 1.5 * self.dissipation_time * velocity / overlap)
        )


class Reshaped(sj.HertzDashpot):
    """Another reduced law."""

    def reduced(self):
        return super().reduced()


class Renamed(sj.ViscoelasticHertz):
    """The same force by another name."""

    @classmethod
    def of(cls, contact):
        return cls(contact, 1e-6)


class Told(Stiffer):
    """Another force, and its collisions told: a spring of 2 k is one of twice the modulus."""

    def closed_form(self, velocity):
        stiffer = sj.Contact(
            *[2 * v if k == 0 else v for k, v in enumerate(self.contact.leaves().values())]
        )
        return sj.ViscoelasticHertz(stiffer, self.dissipation_time).closed_form(velocity)


def test_a_subclass_with_another_force_is_integrated():
    assert Renamed.of(lc.PAIR).default_route() == sj.ClosedForm()
    for kind in (Stiffer, Reshaped):
        law = kind(lc.PAIR, 0.5)
        assert law.default_route() == sj.ODE()
        with pytest.raises(
            ValueError, match=r"`route` must be another than ClosedForm.*LinearSpring"
        ) as e:
            sj.restitution(law, 1.0, sj.ClosedForm())
        assert "\n" not in str(e.value)


def test_a_law_of_ones_own_tells_its_collisions():
    velocity = np.array([0.5, 2.0])
    known = sj.restitution(Told(lc.PAIR, 1e-6), velocity)
    by_time = sj.restitution(Stiffer(lc.PAIR, 1e-6), velocity)
    assert (known.route, by_time.route) == (sj.ClosedForm(), sj.ODE())
    assert np.allclose(known.coefficient, by_time.coefficient, rtol=0, atol=1e-7)
    assert np.allclose(known.duration, by_time.duration, rtol=1e-7)
    plain = sj.restitution(sj.ViscoelasticHertz(lc.PAIR, 1e-6), velocity)
    assert np.all(np.abs(known.coefficient - plain.coefficient) > 1e-4)


def test_laws_without_are_told():
    for law in (sj.Hertz(lc.PAIR), sj.Thornton(lc.PAIR)):
        with pytest.raises(ValueError, match="`closed_form`, such as LinearSpringDashpot"):
            sj.restitution(law, 1.0, sj.ClosedForm())
    hard = sj.ConstantRestitution(None, 0.7)
    assert sj.restitution(hard, 1.0, sj.ClosedForm()).coefficient == 0.7
