"""Numbers as text of 17 significant digits, a whole block at once.

Python formats a number in about a microsecond, which for millions of rows is the longest part of
writing them. Here x = m · 10^(e-16) with an integer m of 17 digits is found in double-double
arithmetic, in which x · 10^k is exact, and cut into digits by a table. The text is `%.16e`'s; what
the arithmetic does not cover (0, subnormal or huge, not finite) is left to Python.
"""

import numpy as np
from jaxtyping import Float, UInt8

WIDTH = 24  # -1.2345678901234567e-301
SMALLEST, LARGEST = 1e-5, 1e16  # where 10^(16 - e) is exact in float64: 10^0 … 10^22
_SPLIT = 134217729.0  # 2^27 + 1
_QUADS = np.array([f"{i:04d}" for i in range(10000)], "S4").view(np.uint8).reshape(10000, 4)


def text_of(values: Float[np.ndarray, " n"]) -> UInt8[np.ndarray, "n 24"]:
    """ASCII of each number as d.dddddddddddddddde±dd, one row each, zero bytes behind it."""
    values = np.asarray(values, float)
    covered = (values >= SMALLEST) & (values < LARGEST)
    safe = np.where(covered, values, 1.0)
    mantissa, exponent = _decimal(safe)
    text = np.zeros((len(values), WIDTH), np.uint8)
    _write_digits(text, mantissa)
    text[:, 18] = ord("e")
    text[:, 19] = np.where(exponent < 0, ord("-"), ord("+"))
    size = np.abs(exponent)
    text[:, 20] = ord("0") + size // 10
    text[:, 21] = ord("0") + size % 10
    for row in np.flatnonzero(~covered):
        text[row] = _by_python(values[row])
    return text


def _decimal(x) -> tuple[np.ndarray, np.ndarray]:
    """(m, e) with x = m · 10^(e - 16) rounded to the nearest integer of 17 digits."""
    exponent = np.floor(np.log10(x)).astype(np.int64)
    mantissa = _scaled(x, 16 - exponent)
    # log10 may be off by one next to a power of ten
    too_small, too_large = mantissa < 10**16, mantissa >= 10**17
    if np.any(too_small | too_large):
        exponent = exponent - too_small + too_large
        # no double is so near below a power of ten that 17 digits would round it up to that
        mantissa = _scaled(x, 16 - exponent)
    return mantissa, exponent


def _scaled(x, power) -> np.ndarray:
    """x · 10^power to the nearest integer: the product's error is computed exactly (Dekker)."""
    factor = _POWERS[np.clip(power, 0, 22)]
    product = x * factor
    x_high, x_low = _halves(x)
    f_high, f_low = _halves(factor)
    error = ((x_high * f_high - product) + x_high * f_low + x_low * f_high) + x_low * f_low
    whole = np.floor(product)
    return whole.astype(np.int64) + np.rint((product - whole) + error).astype(np.int64)


def _halves(x) -> tuple[np.ndarray, np.ndarray]:
    """x = high + low, each of 26 bits."""
    carried = _SPLIT * x
    high = carried - (carried - x)
    return high, x - high


def _write_digits(text, mantissa) -> None:
    """d.dddddddddddddddd from an integer of 17 digits."""
    first, rest = np.divmod(mantissa, 10**16)
    text[:, 0] = ord("0") + first
    text[:, 1] = ord(".")
    upper, lower = np.divmod(rest, 10**8)
    for start, eight in ((2, upper), (10, lower)):
        four = np.divmod(eight, 10**4)
        text[:, start : start + 4] = _QUADS[four[0]]
        text[:, start + 4 : start + 8] = _QUADS[four[1]]


def _by_python(value: float) -> np.ndarray:
    return np.frombuffer(f"{value:.16e}".encode().ljust(WIDTH, b"\0"), np.uint8)


_POWERS = np.array([float(10**k) for k in range(23)])
