"""What to doubt about draws: whether the chains agree, and whether the data told anything.

Source: Vehtari, Gelman, Simpson, Carpenter and Bürkner, Bayesian Anal. 16, 667 (2021), of R-hat and
the effective sizes; Betancourt, arXiv:1604.00695 (2016), of the energy.
"""

from typing import Any, NamedTuple

import numpy as np

from calibration.fitting.doubt import Doubt
from calibration.fitting.posterior.extra import needed
from calibration.fitting.posterior.inference_data import dataset_of

R_HAT = 1.01
TAILS = (0.05, 0.95)  # the quantiles by which tails are judged, whatever ArviZ takes for granted
EFFECTIVE = 400.0
ENERGY = 0.3  # Bayesian fraction of missing information below which energies are badly explored
NEAR = 0.01  # of the range, or of the median's distance: that near to a bound
MASS = 0.05  # of the draws
FOLLOWS = 0.7  # of the prior's standard deviation, from which on the posterior follows it
MORE = "Sample longer: more `draws`, and as many of `warmup`."
REMEDIES = {
    "r-hat": f"{MORE} Where it stays, there are several modes: give bounds or a prior that decide.",
    "effective-size": f"{MORE} Limits of intervals are rough until then.",
    "divergences": (
        "A corner is too sharp for the steps and draws miss part of it: give a prior to what the "
        "data do not tell, or fit fewer parameters."
    ),
    "funnel": (
        "Energies are badly explored, as where a spread may be 0: give the spread or the noise a "
        "prior, or measure more data sets."
    ),
    "mass-at-bound": "Widen the bound if it was given; else the data do not keep it off: say so.",
    "follows-prior": "The data do not tell it: measure where it acts, or state a prior you stand by.",
}


class Summary(NamedTuple):
    """Of one unknown: moments, central limits and how well they are known."""

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
    """Of every variable of the posterior."""
    posterior = dataset_of(data, "posterior")
    r_hat, bulk, tail = _diagnosed(posterior)
    found = {}
    for name, values in posterior.data_vars.items():
        about, draws = values.attrs, np.asarray(values)
        low, high = np.quantile(draws, [0.5 - confidence / 2, 0.5 + confidence / 2])
        share = about.get("prior_share")
        found[str(name)] = Summary(
            float(np.mean(draws)),
            float(np.std(draws, ddof=1)),
            float(low),
            float(high),
            float(r_hat[name]),
            min(float(bulk[name]), float(tail[name])),
            str(about.get("prior", "")),
            None if share is None else float(share),
            "" if about.get("unit", "-") == "-" else str(about["unit"]),
        )
    return found


def doubts_of(data: Any) -> list[Doubt]:
    """The reasons not to trust these draws, or to make little of them."""
    told = summaries(data)
    found = [
        *_listed("r-hat", {n: s.r_hat for n, s in told.items() if not s.r_hat <= R_HAT}, "R-hat"),
        *_listed(
            "effective-size",
            {n: s.effective for n, s in told.items() if not s.effective >= EFFECTIVE},
            "effective sizes",
        ),
        *_of_statistics(dataset_of(data, "sample_stats")),
        *_at_bounds(dataset_of(data, "posterior")),
    ]
    shares = {
        n: s.prior_share for n, s in told.items() if s.prior_share and s.prior_share > FOLLOWS
    }
    if shares:
        names = ", ".join(f"{n} ({told[n].prior})" for n in shares)
        found.append(_doubt("follows-prior", f"as wide as the prior, or nearly: {names}"))
    return found


def _doubt(code: str, cause: str) -> Doubt:
    return Doubt(code, cause, advice=REMEDIES[code])


def _listed(code: str, values: dict[str, float], what: str) -> list[Doubt]:
    if not values:
        return []
    return [_doubt(code, f"{what}: " + ", ".join(f"{n} {v:.4g}" for n, v in values.items()))]


def _of_statistics(statistics: Any) -> list[Doubt]:
    found = []
    diverging = np.asarray(statistics["diverging"])
    if np.any(diverging):
        cause = f"{int(np.sum(diverging))} of {diverging.size} draws diverged"
        found.append(_doubt("divergences", cause))
    energy = np.asarray(statistics["energy"])
    steps = np.mean(np.diff(energy, axis=1) ** 2, axis=1) / np.var(energy, axis=1)
    if np.min(steps) < ENERGY:
        cause = f"the energy's fraction of missing information is {np.min(steps):.2g}"
        found.append(_doubt("funnel", cause))
    return found


def _at_bounds(posterior: Any) -> list[Doubt]:
    near = []
    for name, values in posterior.data_vars.items():
        if "lower" not in values.attrs:
            continue
        draws = np.asarray(values)
        ends = float(values.attrs["lower"]), float(values.attrs["upper"])
        for end in filter(np.isfinite, ends):
            away = np.abs(draws - end)
            scale = ends[1] - ends[0] if np.all(np.isfinite(ends)) else np.median(away)
            share = float(np.mean(away < NEAR * scale))
            if share > MASS:
                near.append(f"{name} at {end:.4g} ({100 * share:.0f} % of the draws)")
    return [_doubt("mass-at-bound", ", ".join(near))] if near else []


def _diagnosed(posterior: Any):
    """R-hat and effective sizes of the bulk and the tails, each by variable."""
    arviz = needed("arviz")
    bulk = arviz.ess(posterior, method="bulk")
    return arviz.rhat(posterior), bulk, arviz.ess(posterior, method="tail", prob=TAILS)
