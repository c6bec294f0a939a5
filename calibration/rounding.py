"""Round numbers to their errors, never to more digits than are known."""

import math
from typing import TypeGuard

ABSENT = "–"
MOST_DIGITS = 7  # published constants have four
NO_ERROR = 1e-9  # relative: a smaller standard error is rounding, and is not shown
ERROR_DIGITS = 2
LARGEST_WHOLE = 1e6  # larger numbers have a power of ten


def number(value: float | None, digits: int = 4) -> str:
    """`digits` significant digits, or a dash; whole numbers below a million without a power of ten.

    >>> number(0.12345, 3), number(999.9, 3)
    ('0.123', '1000')
    """
    if not _finite(value):
        return ABSENT
    text = f"{value + 0.0:.{digits}g}"  # no -0
    is_whole = 10.0**digits <= abs(float(text)) < LARGEST_WHOLE
    return f"{float(text):.0f}" if is_whole else text


def to_digits(value: float, digits: int) -> float:
    """The value rounded to significant digits: a key by which numbers that agree to these are equal."""
    return float(f"{value:.{digits}g}")


def with_error(value: float | None, error: float | None) -> str:
    """`1.794 ± 0.052`: the error to two digits, the value to the same place; no error below `NO_ERROR`."""
    if not _finite(value):
        return ABSENT
    if not _finite(error):
        return number(value, 5)
    if error <= NO_ERROR * abs(value):
        return number(value, MOST_DIGITS)
    exponent, places = _scale(value, error)
    if places is None:
        return f"{number(value, MOST_DIGITS)} ± {error:.0e}"
    factor = 10.0**exponent
    shown = f"{_fixed(value / factor, places)} ± {_fixed(error / factor, places)}"
    return f"({shown})e{exponent}" if exponent else shown


def to_place(value: float | None, error: float) -> str:
    """The value alone, rounded where an error of this size would be: `7.1` for an error of 1.2."""
    if not _finite(value):
        return ABSENT
    return _end(value, error)


def interval(low: float | None, high: float | None, error: float | None = None) -> str:
    """`1.69 … 1.90`, an open end as a dash; rounded to the standard error `error`, if any."""
    if not _finite(low) and not _finite(high):
        return ABSENT
    if _finite(low) and _finite(high) and high - low <= 4 * NO_ERROR * abs(high):
        return ABSENT
    return f"{_end(low, error)} … {_end(high, error)}"


def _end(value: float | None, error: float | None) -> str:
    if not _finite(value):
        return "open"
    if not _finite(error) or error <= 0:
        return number(value)
    exponent, places = _scale(value, error)
    if places is None:
        return number(value, MOST_DIGITS)
    scaled = value / 10.0**exponent
    # an end far below the error is not shown as zero: it keeps two digits
    fewest = ERROR_DIGITS - 1 - _leading_place(abs(scaled)) if scaled else places
    return _fixed(scaled, max(places, fewest)) + (f"e{exponent}" if exponent else "")


def _scale(value: float, error: float) -> tuple[int, int | None]:
    """Power of ten to factor out, and the last decimal; None for more than `MOST_DIGITS` digits."""
    size = math.floor(math.log10(max(abs(value), error)))
    last = _leading_place(error) - ERROR_DIGITS + 1
    if size - last + 1 > MOST_DIGITS:
        return 0, None
    exponent = 0 if -4 <= size < 6 else size
    return exponent, exponent - last


def _fixed(value: float, places: int) -> str:
    """Rounded to `places` decimals; to tens for -1."""
    return f"{round(value, places) + 0.0:.{max(places, 0)}f}"


def _leading_place(error: float) -> int:
    """Decimal place of the first digit once rounded: 0.0996 is 0.10."""
    return int(f"{error:.{ERROR_DIGITS - 1}e}".partition("e")[2])


def _finite(value: float | None) -> TypeGuard[float]:
    return value is not None and math.isfinite(value)
