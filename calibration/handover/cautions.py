"""What to know of a hand-over before it is used: doubts of its fit, and where nobody measured."""

from calibration.handover.wanted import Wanted
from calibration.rounding import number

DEEP = 0.1  # of the radius: laws of contact are for small overlaps
SLACK = 1e-3  # of a velocity: text rounds


def cautions_of(wanted: Wanted, overlap: float) -> tuple[str, ...]:
    """One line each, in ASCII, as it also stands in the files.

    Args:
        overlap: the largest one over the radius.
    """
    told = []
    low, high = wanted.range
    if wanted.measured is not None:
        least, most = wanted.measured
        if low < (1 - SLACK) * least or high > (1 + SLACK) * most:
            span = f"{number(least)} to {number(most)} m/s"
            told.append(f"Measured were {span}: beyond them the curve is the law's alone.")
    if overlap > DEEP:
        told.append(f"Overlaps reach {100 * overlap:.0f} % of the radius: laws are for small ones.")
    if wanted.doubts:
        told.append(f"Doubts about the fit: {', '.join(wanted.doubts)}; its report has them.")
    return tuple(told)
