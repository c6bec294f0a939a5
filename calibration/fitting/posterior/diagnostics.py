"""Convergence of draws, and whether the data were informative: by ArviZ, in words.

Source: Vehtari, Gelman, Simpson, Carpenter and Bürkner, Bayesian Anal. 16, 667 (2021), of R-hat and
the effective sizes; Betancourt, arXiv:1604.00695 (2016), of the energy.
"""

from typing import Any, NamedTuple

import numpy as np

from calibration.fitting.posterior.draws import dataset_of, needed
from calibration.fitting.warnings import FitWarning

R_HAT = 1.01
TAILS = (0.05, 0.95)  # the quantiles by which tails are judged, whatever ArviZ takes for granted
EFFECTIVE = 400.0
DIVERGING = 0.005  # of the draws, up to which their moments hardly change
ENERGY = 0.3  # Bayesian fraction of missing information below which energies are badly explored
NEAR = 0.01  # of the range, or of the median's distance: that near to a bound
MASS = 0.05  # of the draws
FOLLOWS = 0.7  # of the prior's standard deviation, from which on the posterior follows it


class Summary(NamedTuple):
    """Summary of one unknown: moments, central limits and their accuracy."""

    mean: float
    deviation: float
    low: float
    high: float
    r_hat: float
    effective: float  # the smaller one, of the bulk and of the tails
    prior: str
    prior_share: float | None  # standard deviation over the prior's, both in z; None: derived
    unit: str


def summaries(data: Any, confidence: float = 0.95) -> dict[str, Summary]:
    """Summaries of every variable of the posterior."""
    posterior, arviz = dataset_of(data, "posterior"), needed("arviz")
    r_hat, bulk = arviz.rhat(posterior), arviz.ess(posterior)  # of the bulk
    tail = arviz.ess(posterior, method="tail", prob=TAILS)
    by_name = {}
    for name, values in posterior.data_vars.items():
        about, draws = values.attrs, np.asarray(values)
        low, high = np.quantile(draws, [0.5 - confidence / 2, 0.5 + confidence / 2])
        effective = min(float(bulk[name]), float(tail[name]))
        moments = float(np.mean(draws)), float(np.std(draws, ddof=1)), float(low), float(high)
        share, unit = about.get("prior_share"), str(about.get("unit", "-"))
        prior_and_share = str(about.get("prior", "")), share if share is None else float(share)
        of_chains = float(r_hat[name]), effective
        by_name[str(name)] = Summary(
            *moments, *of_chains, *prior_and_share, "" if unit == "-" else unit
        )
    return by_name


def not_converged(data: Any) -> str:
    """One line where the draws are not those of the posterior: nothing is to be concluded from them."""
    slow = {n: s.r_hat for n, s in summaries(data).items() if not s.r_hat <= R_HAT}
    diverging, reasons = np.asarray(dataset_of(data, "sample_stats")["diverging"]), []
    if slow:
        worst = max(slow, key=slow.__getitem__)
        reasons.append(f"R-hat {slow[worst]:.2f} of {worst}")
    if np.mean(diverging) > DIVERGING:
        reasons.append(_diverged(diverging))
    if not reasons:
        return ""
    return f"The chains did not converge ({', '.join(reasons)}): conclude nothing from these draws."


def _diverged(diverging: np.ndarray) -> str:
    return f"{np.sum(diverging)} of {diverging.size} draws diverged"


def warnings_of(data: Any) -> list[FitWarning]:
    """Warnings: reasons not to rely on these draws."""
    by_name, statistics = summaries(data), dataset_of(data, "sample_stats")
    slow = [f"{n} {s.r_hat:.4g}" for n, s in by_name.items() if not s.r_hat <= R_HAT]
    few = [f"{n} {s.effective:.4g}" for n, s in by_name.items() if not s.effective >= EFFECTIVE]
    follow = [f"{n} ({s.prior})" for n, s in by_name.items() if (s.prior_share or 0) > FOLLOWS]
    diverging, energy = (np.asarray(statistics[name]) for name in ("diverging", "energy"))
    missing = float(np.min(needed("arviz").bfmi(energy)))
    near = _at_bounds(dataset_of(data, "posterior"))
    causes = {
        "r-hat": (slow, "R-hat: " + ", ".join(slow)),
        "effective-size": (few, "effective sizes: " + ", ".join(few)),
        "divergences": (np.any(diverging), _diverged(diverging)),
        "funnel": (
            missing < ENERGY,
            f"the energy's fraction of missing information is {missing:.2g}",
        ),
        "mass-at-bound": (near, ", ".join(near)),
        "follows-prior": (follow, f"as wide as the prior, or nearly: {', '.join(follow)}"),
    }
    every = causes.items()
    return [FitWarning(code, cause) for code, (is_so, cause) in every if is_so]  # type: ignore[arg-type]


def _at_bounds(posterior: Any) -> list[str]:
    near = []
    for name, values in posterior.data_vars.items():
        ends = [float(values.attrs.get(end, np.inf)) for end in ("lower", "upper")]
        for end in filter(np.isfinite, ends):
            away = np.abs(np.asarray(values) - end)
            scale = ends[1] - ends[0] if np.all(np.isfinite(ends)) else np.median(away)
            share = float(np.mean(away < NEAR * scale))
            if share > MASS:
                near.append(f"{name} at {end:.4g} ({100 * share:.0f} % of the draws)")
    return near
