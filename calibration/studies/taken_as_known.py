"""Parameters that a plan from a fit takes as known, since the fit has no standard error of them."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from calibration.fitting.result import FitResult
from calibration.rounding import number


def taken_as_known(law: Any, material: str | None, targets: Iterable[str]) -> tuple[str, ...]:
    """A sentence for each such parameter.

    Args:
        law: what is planned for: a fit, or a law, of which nothing is taken so.
        material: the data set of it.
        targets: labels of what errors are promised of.
    """
    if not isinstance(law, FitResult):
        return ()
    result, one = law, law.material(material)
    variance = dict(zip(result.covariance_names, np.diag(result.covariance), strict=True))
    open_ = [name for name, label in one.labels.items() if not np.isfinite(variance[label])]
    targets = list(targets)
    return tuple(_sentence(name, one.parameters.get(name), targets, result) for name in open_)


def _sentence(name: str, estimate: Any, targets: list[str], result: FitResult) -> str:
    at_bound = estimate is not None and estimate.at_bound and estimate.value is not None
    why = f"stands at its bound {number(estimate.value, 4)}" if at_bound else "is not determined"
    whose = "error" if len(targets) == 1 else "errors"
    text = f"{name} {why} and is taken as known: the {whose} of {', '.join(targets)} may be larger"
    intervals = [told for target in targets if (told := _interval(target, result))]
    return "; ".join([text, *intervals])


def _interval(target: str, result: FitResult) -> str:
    """The fit's own, and in parts of the value as the promised errors are."""
    estimate = result.estimates.get(target)
    if estimate is None or estimate.low is None or estimate.high is None:
        return ""
    ends, value = (estimate.low, estimate.high), estimate.value
    told = " to ".join(number(x, 4) for x in ends)
    text = f"the fit's {100 * result.confidence:g} % interval of {target} is {told}"
    if not value:
        return text
    parts = " to ".join(f"{100 * (x / value - 1):+.2g} %" for x in ends)
    return f"{text} ({parts})"
