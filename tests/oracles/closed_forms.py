"""Series of the closed forms: `python -m tests.oracles.closed_forms` writes them.

Chebyshev coefficients of what is a function of one number: the collision of viscoelastic spheres of
w², and the duration of Hertz's dashpot of the restitution it is set to. Viscoelastic spheres are
integrated by Taylor series of 50 terms in 60 digits; the duration is a Beta function, or quadratures.
Coefficients are kept until they no longer change a float64.

The functions beside each series say what is scaled by what, and are what `softjax.laws.viscoelastic`
and `softjax.laws.dashpots` put together again.
"""

import json
import re
import textwrap
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import NamedTuple

import mpmath as mp

TARGET = Path(__file__).parents[2] / "softjax" / "laws" / "series.json"
DIGITS = 60
TERMS = 50  # of the Taylor series
NODES = 48  # of the Chebyshev series, before those that change nothing are cut off
KEPT = 1e-18
MEDIUM, LARGE = 5.0, 24.0  # ln w² up to which a series goes
SHARE = 0.86  # a/(a + 8) where ε is the least float64
RELEASED = 0.8  # acos ξ up to which the zero-force end has a series of its own
UNRELEASED = 1.55  # 2 asin ξ up to which it is distinguished from the other end


class Collision(NamedTuple):
    """In units of v, (M v²/k)^{2/5} and their quotient."""

    restitution: mp.mpf
    peak: mp.mpf
    duration: mp.mpf


def viscoelastic(spring, dashpot) -> Collision:
    """x'' = -spring x^{3/2} - dashpot √x x', x' = 1 at touch, until the force vanishes.

    All is analytic over τ, dt = √x dτ: of s = √x and U = x', s' = U/2 and U' = -s² (dashpot U + spring s²).
    """
    state, peak = (mp.mpf(0), mp.mpf(1), mp.mpf(0)), None
    while True:
        s, U, t, pull = _series(*state, mp.mpf(spring), mp.mpf(dashpot))
        h = _reach(s, U)
        if peak is None and _at(U, h) <= 0:
            peak = _at(s, _zero(U, h)) ** 2
        if _at(s, h) < 0:  # the force has one zero up to there, and another beyond
            h = _zero(s, h)
        if peak is not None and _at(pull, h) <= 0:
            h = _zero(pull, h)
            return Collision(-_at(U, h), peak, _at(t, h))
        state = [_at(series, h) for series in (s, U, t)]


def _series(s, U, t, spring, dashpot):
    """Taylor series over τ of s, U, t, and of the force over s."""
    s, U, t, square, pull = [s], [U], [t], [], []
    for n in range(TERMS):
        square.append(_product(s, s, n))
        pull.append(dashpot * U[n] + spring * square[n])
        s.append(U[n] / (2 * (n + 1)))
        U.append(-_product(square, pull, n) / (n + 1))
        t.append(s[n] / (n + 1))
    return s, U, t, pull


def _product(a, b, n):
    return mp.fsum(a[k] * b[n - k] for k in range(n + 1))


def _at(series, h):
    total = mp.mpf(0)
    for c in reversed(series):
        total = total * h + c
    return total


def _reach(*series):
    """How far the series are good to all digits but a few."""
    small = mp.mpf(10) ** (4 - mp.mp.dps)
    last = [(len(a) - i, abs(a[-i])) for a in series for i in (1, 2)]
    return mp.mpf("0.9") * min(
        (small / max(c, mp.mpf("1e-200"))) ** (mp.mpf(1) / n) for n, c in last
    )


def _zero(series, h):
    """Where a series changes its sign between 0 and h: Newton's method, halving where it leaves."""
    slope = [n * c for n, c in enumerate(series)][1:]
    low, high, x, begin = mp.mpf(0), h, h / 2, series[0]
    while True:
        f = _at(series, x)
        low, high = (x, high) if f * begin > 0 else (low, x)
        new = x - f / _at(slope, x)
        if not min(low, high) <= new <= max(low, high):
            new = (low + high) / 2
        if abs(new - x) <= abs(h) * mp.mpf(10) ** (3 - mp.mp.dps):
            return new
        x = new


def of_squared(w_squared) -> Collision:
    """The collision of any w² >= 0: where damping is strong in units in which it is one."""
    b = mp.mpf(w_squared)
    if b <= 1:
        return viscoelastic(1, b)
    found = viscoelastic(b ** (-mp.mpf(5) / 3), 1)
    unit = b ** (-mp.mpf(2) / 3)
    return Collision(found.restitution, unit * found.peak, unit * found.duration)


@cache
def strongly_damped(log) -> tuple:
    """ln ε, ln of the peak and the duration times w^{4/3}, of ln w²."""
    found = of_squared(mp.exp(log))
    return mp.log(found.restitution), mp.log(found.peak), found.duration * mp.exp(2 * log / 3)


def integral(a):
    """∫ e^{aφ} (sin φ)^{-1/5} dφ over [0, π]."""
    z = (mp.mpf(9) / 5 + 1j * a) / 2
    beta = mp.gamma(mp.mpf(9) / 5) / mp.re(mp.gamma(z) * mp.gamma(mp.conj(z)))
    return mp.exp(a * mp.pi / 2) * mp.pi * mp.mpf(2) ** mp.mpf("0.2") * beta / mp.mpf("0.8")


def partly(growth, end):
    """∫ e^{growth φ/end} (sin φ)^{-1/5} dφ over [0, end], over end^{4/5}: by quadrature over φ^{4/5}."""

    def part(y):
        share = y ** mp.mpf("1.25")
        return mp.exp(growth * share) * _sinc(end * share) ** mp.mpf("-0.2")

    return mp.mpf("1.25") * mp.quad(part, [0, mp.mpf("0.5"), 1])


def _sinc(angle):
    return mp.sin(angle) / angle if angle else mp.mpf(1)


def falling(share):
    """0.8 ∫ e^{a(φ-π)} (sin φ)^{-1/5} dφ (2 + a)^{4/5}, a = -ln ε/(5π), of a/(a + 8)."""
    a = 8 * share / (1 - share)
    return mp.mpf("0.8") * integral(a) * mp.exp(-mp.pi * a) * (2 + a) ** mp.mpf("0.8")


def unreleased(angle):
    """By how much the zero-force end is before the other, over angle^{4/5}; angle = 2 asin ξ."""
    a = mp.tan(angle / 2) / 5
    whole = mp.exp(a * mp.pi) * partly(-a * angle, angle)
    return mp.mpf("0.8") * mp.cos(angle / 2) ** mp.mpf("-0.8") * whole


def released(angle):
    """The duration of the zero-force end, of angle = acos ξ."""
    growth = mp.mpf("0.4") * mp.cos(angle) / _sinc(angle)
    return mp.mpf("0.8") * (2 / _sinc(angle)) ** mp.mpf("0.8") * partly(growth, 2 * angle)


@cache
def weakly_damped(part: str) -> list:
    """Taylor coefficients in w of a part of the collision: of the polynomial through it."""
    nodes = [(1 + x) / 2 for x in _nodes(NODES)]
    return _through(nodes, [getattr(_weak(w), part) for w in nodes])


@cache
def _weak(w) -> Collision:
    return viscoelastic(1, w * w)


def _through(nodes, values) -> list:
    """Coefficients of the polynomial through points, by Newton's divided differences."""
    table = list(values)
    for k in range(1, len(nodes)):
        for i in range(len(nodes) - 1, k - 1, -1):
            table[i] = (table[i] - table[i - 1]) / (nodes[i] - nodes[i - k])
    found = [mp.mpf(0)]
    for node, value in zip(reversed(nodes), reversed(table), strict=True):
        found = [
            a - node * b for a, b in zip([mp.mpf(0), *found], [*found, mp.mpf(0)], strict=True)
        ]
        found[0] += value
    return found[: len(nodes)]


def beyond_fourth(part: str, w):
    """What of a part of the collision is beyond w⁴, over w⁵."""
    return _at(weakly_damped(part)[5:], w)


def strong(part: int, log):
    return strongly_damped(log)[part]


# the function, and from where to where
WANTED: dict[str, tuple[Callable, float, float]] = {
    "weak restitution": (partial(beyond_fourth, "restitution"), 0.0, 1.0),
    "weak duration": (partial(beyond_fourth, "duration"), 0.0, 1.0),
    "weak peak": (lambda b: _weak(mp.sqrt(b)).peak, 0.0, 1.0),
    "medium restitution": (partial(strong, 0), 0.0, MEDIUM),
    "medium peak": (partial(strong, 1), 0.0, MEDIUM),
    "medium duration": (partial(strong, 2), 0.0, MEDIUM),
    "strong restitution": (partial(strong, 0), MEDIUM, LARGE),
    "strong peak": (partial(strong, 1), MEDIUM, LARGE),
    "strong duration": (partial(strong, 2), MEDIUM, LARGE),
    "falling": (falling, 0.0, SHARE),
    "unreleased": (unreleased, 0.0, UNRELEASED),
    "released": (released, 0.0, RELEASED),
}
TAYLOR = ("restitution", "duration")  # what is stated up to w⁴ next to its series


def coefficients(name: str, count: int = NODES) -> list[float]:
    """Chebyshev coefficients of a series, without those that change nothing."""
    function, low, high = WANTED[name]
    with mp.workdps(DIGITS):
        low, width = mp.mpf(low), mp.mpf(high) - mp.mpf(low)
        values = [function(low + width * (1 + x) / 2) for x in _nodes(count)]
        found = [_coefficient(values, j) for j in range(count)]
        least = KEPT * max(abs(c) for c in found)
        last = max(j for j, c in enumerate(found) if abs(c) > least)
    return [float(c) for c in found[: last + 1]]


def _nodes(count: int) -> list:
    return [mp.cospi(mp.mpf(2 * k + 1) / (2 * count)) for k in range(count)]


def _coefficient(values, j: int):
    count = len(values)
    terms = (v * mp.cospi(mp.mpf(j * (2 * k + 1)) / (2 * count)) for k, v in enumerate(values))
    return (2 if j else 1) * mp.fsum(terms) / count


def taylor(part: str) -> list[float]:
    """What of a part of the collision is 1, w² and w⁴; w and w³ have none."""
    with mp.workdps(DIGITS):
        found = weakly_damped(part)
        assert max(abs(found[1]), abs(found[3])) < 1e-20
        return [float(found[k]) for k in (0, 2, 4)]


def stored() -> dict:
    return json.loads(TARGET.read_text(encoding="utf-8"))


def main() -> None:
    series = {
        name: {"low": low, "high": high, "coefficients": coefficients(name)}
        for name, (_, low, high) in WANTED.items()
    }
    stored = {"taylor": {part: taylor(part) for part in TAYLOR}, "series": series}
    # many numbers a line
    lines = re.sub(r",\s+(?=[-\d])", ", ", json.dumps(stored, indent=1)).splitlines()
    text = "\n".join(textwrap.fill(line, 100, break_on_hyphens=False) for line in lines)
    TARGET.write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
