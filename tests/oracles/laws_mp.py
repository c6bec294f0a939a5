"""The library's laws other than Zhou's in high-precision arithmetic: formulas and quadratures.

Each function takes the numbers of a law, its contact and the velocity by their names, as `mpf`.
Sources: K. L. Johnson, Contact Mechanics (1985), ch. 11 (Hertz); C. Thornton, J. Appl. Mech. 64, 383
(1997); O. R. Walton and R. L. Braun, J. Rheol. 30, 949 (1986); T. Schwager and T. Pöschel, Granul.
Matter 9, 465 (2007) (both ends of a dashpot); Y. Tsuji et al., Powder Technol. 71, 239 (1992).
"""

from functools import cache
from typing import NamedTuple

from mpmath import mp, mpf

from tests.oracles import closed_forms, zhou_mp


class Collision(NamedTuple):
    """ε [-], δ_max and δ* [m], duration [s], the largest force [N]; NaN where no formula tells it."""

    coefficient: mpf
    peak: mpf
    residual: mpf
    duration: mpf
    force: mpf = mp.nan


def _stiffness(n) -> mpf:
    return 4 * n["youngs_modulus"] * mp.sqrt(n["radius"]) / 3


def _beta():
    """0.8 B(2/5, 1/2) = 2.943…: the duration of Hertz's collision over peak/v."""
    return mpf("0.8") * mp.beta(mpf("0.4"), mpf("0.5"))


def hertz(n) -> Collision:
    v = n["velocity"]
    peak = (5 * n["mass"] * v**2 / (4 * _stiffness(n))) ** mpf("0.4")
    force = _stiffness(n) * peak ** mpf("1.5")
    return Collision(mpf(1), peak, mpf(0), _beta() * peak / v, force)


def thornton(n) -> Collision:
    """p = x^{3/2} to x = 1, then 1 + (3/2)(x - 1); back by p_m [(x - x*)/(x_m - x*)]^{3/2}."""
    strain = mp.pi * n["yield_factor"] * n["yield_strength"] / (2 * n["youngs_modulus"])
    length = n["radius"] * strain**2
    pace = mp.sqrt(4 * _stiffness(n) / (5 * n["mass"])) * length ** mpf("1.25")
    y = n["velocity"] / pace
    if y <= 1:
        return hertz(n)
    r = 1 / y
    bracket = r / (r + 2 * mp.sqrt(mpf(6) / 5 - r**2 / 5))  # the formula as printed
    epsilon = mp.sqrt(6 * mp.sqrt(3) / 5) * mp.sqrt(1 - r**2 / 6) * bracket ** mpf("0.25")
    peak = 1 + mpf(2) / 3 * (mp.sqrt(1 + mpf("1.2") * (y**2 - 1)) - 1)
    way = (1 + mpf("1.5") * (peak - 1)) / mp.sqrt(peak)
    elastic = mp.betainc(mpf("0.4"), mpf("0.5"), 0, y**-2) * mpf("0.4") * y ** mpf("-0.2")
    third = mpf(2) / 3
    linear = mp.acos(third / (peak - 1 + third)) / mp.sqrt(mpf(15) / 8)
    back = _beta() / 2 * way / (epsilon * y)
    time = (elastic + linear + back) * length / pace
    force = _stiffness(n) * length ** mpf("1.5") * (1 + mpf("1.5") * (peak - 1))
    return Collision(epsilon, peak * length, (peak - way) * length, time, force)


def walton_braun(n) -> Collision:
    k1, mass, v = n["loading_stiffness"], n["mass"], n["velocity"]
    k2 = n["unloading_stiffness"] + n["growth"] * v * mp.sqrt(k1 * mass)
    peak = v * mp.sqrt(mass / k1)
    time = mp.pi / 2 * mp.sqrt(mass) * (1 / mp.sqrt(k1) + 1 / mp.sqrt(k2))
    return Collision(mp.sqrt(k1 / k2), peak, peak * (1 - k1 / k2), time, k1 * peak)


class _Damped(NamedTuple):
    """ξ, w = √(1 - ξ²), the phase at which the contact ends, and ε there."""

    xi: mpf
    w: mpf
    angle: mpf
    coefficient: mpf

    @property
    def peak(self):
        return mp.exp(-self.xi / self.w * mp.acos(self.xi))

    def at(self, phase):
        """The overlap, which would be one at the peak without damping, and its rate."""
        decay = mp.exp(-self.xi / self.w * phase)
        overlap = decay * mp.sin(phase) / self.w
        return overlap, decay * mp.cos(phase) - self.xi * overlap

    def force(self, phase):
        overlap, rate = self.at(phase)
        return overlap + 2 * self.xi * rate


def _damped(restitution, end: str) -> _Damped:
    loss = -mp.log(restitution)
    xi, w = (x / mp.hypot(mp.pi, loss) for x in (loss, mp.pi))
    angle = mp.pi if end == "zero-overlap" or not xi else mp.atan2(2 * xi * w, 2 * xi**2 - 1)
    return _Damped(xi, w, angle, mp.exp(-xi / w * angle))


def linear_dashpot(n, end="zero-overlap") -> Collision:
    damped = _damped(n["restitution"], end)
    rate, v = mp.sqrt(n["stiffness"] / n["mass"]), n["velocity"]
    left = 2 * damped.xi * damped.coefficient * v / rate if end == "zero-force" else mpf(0)
    time = damped.angle / (rate * damped.w)
    steep = 1 - 4 * damped.xi**2  # where it is not positive the force falls from touch on
    phase = mp.acot((2 * damped.xi / steep + damped.xi) / damped.w) if steep > 0 else mpf(0)
    force = damped.force(phase) * v * mp.sqrt(n["stiffness"] * n["mass"])
    return Collision(damped.coefficient, damped.peak * v / rate, left, time, force)


def hertz_dashpot(n, end="zero-overlap") -> Collision:
    """x^{5/4} is the linear law's overlap over its own time τ, dt = (4/5) x^{-1/4} dτ."""
    damped = _damped(n["restitution"], end)
    left = 2 * damped.xi * damped.coefficient if end == "zero-force" else mpf(0)
    length = hertz(n).peak

    def pace(phase):
        return (mp.exp(-damped.xi / damped.w * phase) * mp.sin(phase) / damped.w) ** mpf("-0.2")

    time = mpf("0.8") / damped.w * mp.quad(pace, [0, damped.angle / 2, damped.angle])

    def slope(phase):
        """Of q^{1/5} (q + 2ξ q'), times 5 q^{4/5}."""
        q, rate = damped.at(phase)
        along = rate - 2 * damped.xi * (q + 2 * damped.xi * rate)
        return rate * damped.force(phase) + 5 * q * along

    phase = mp.acos(damped.xi)
    if damped.xi:
        phase = mp.findroot(slope, (mpf(0), phase), "bisect", maxsteps=130, verify=False)
    force = damped.at(phase)[0] ** mpf("0.2") * damped.force(phase)
    force *= _stiffness(n) * length ** mpf("1.5")
    lengths = (length * q ** mpf("0.8") for q in (damped.peak, left))
    return Collision(damped.coefficient, *lengths, time * length / n["velocity"], force)


@cache
def _of_squared(w_squared: float):
    """The collision and its first two derivatives with ln w²."""
    w, step = mpf(w_squared), mpf("1e-15")
    up, here, down = (closed_forms.of_squared(w * mp.exp(k * step)) for k in (1, 0, -1))
    rows = zip(up, here, down, strict=True)
    return [(b, (a - c) / (2 * step), (a - 2 * b + c) / step**2) for a, b, c in rows]


def viscoelastic(n, alone=False) -> Collision:
    """By Taylor series, in units of v and (M v²/k)^{2/5}; P = 0 where δ = -(3/2) A δ'."""
    rate, v = _stiffness(n) / n["mass"], n["velocity"]
    w_squared = mpf("1.5") * n["dissipation_time"] * rate ** mpf("0.4") * v ** mpf("0.2")
    if alone:
        found = closed_forms.of_squared(w_squared)
    else:
        near = float(f"{float(w_squared):.9g}")  # so that differences share a few integrations
        by, parts = mp.log(w_squared / near), _of_squared(near)
        found = closed_forms.Collision(*(a + by * (b + by * c / 2) for a, b, c in parts))
    length = (v**2 / rate) ** mpf("0.4")
    left = mpf("1.5") * n["dissipation_time"] * found.restitution * v
    return Collision(found.restitution, length * found.peak, left, length / v * found.duration)


def zhou(n, form="first-order") -> Collision:
    names = ("youngs_modulus", "radius", "mass", "yield_strength", "limit_velocity")
    inputs = dict(zip(("E", "R", "M", "Y", "v_lim"), (n[name] for name in names), strict=True))
    inputs |= {"chi": n["chi"], "sigma": n["sigma"], "psi": n["psi"], "v": n["velocity"]}
    inputs |= {"area": "zhou", "kappa": "consistent", "form": form}
    found = zhou_mp.coefficient(inputs)
    names = ("eps", "peak_overlap", "residual_overlap", "duration")
    scale = zhou_mp.dimensionless(inputs)  # the force grows up to the peak unless d x_m is large
    top = zhou_mp.loading(form, scale["d"], found["peak_overlap"] / scale["delta_cr"])
    force = top * scale["k"] * scale["delta_cr"] ** mpf("1.5")
    return Collision(*(found[name] for name in names), force)


def hard(n) -> Collision:
    """Eq. (17) of Zhou (2013), or a constant."""
    epsilon = n.get("restitution")
    if epsilon is None:
        ratio = n["velocity"] / (n["limit_velocity"] - n["velocity"])
        epsilon = mp.exp(-n["sigma"] * ratio ** n["psi"])
    return Collision(epsilon, mpf(0), mpf(0), mpf(0), mpf(0))
