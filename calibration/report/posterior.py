"""Section on posterior draws: a table, and which parameters the data determine."""

from collections.abc import Mapping
from typing import Any

import pandas as pd

from calibration import symbols
from calibration.fitting.posterior.diagnostics import (
    FOLLOWS,
    Summary,
    doubts_of,
    not_converged,
    summaries,
)
from calibration.fitting.posterior.draws import dataset_of
from calibration.report.fit import warning_items
from calibration.report.layout import Block
from calibration.rounding import interval, number, with_error

DETERMINED = 0.3  # of the prior's width, up to which the data determine a parameter


def section(data: Any, result: Any) -> list[Block]:
    """Settings of the sampler, a table of the draws, conclusions, and warnings."""
    found, failed = summaries(data, result.confidence), not_converged(data)
    written = {name: symbols.of_label(name, result) for name in found}
    return [
        Block("heading", "Posterior"),
        Block("text", _how(data)),
        Block("table", posterior_table(found, written, result.confidence)),
        Block("list", [failed] if failed else known(found, written)),
        Block("warnings", warning_items(doubts_of(data), result)),
    ]


def posterior_table(
    found: Mapping[str, Summary], written: Mapping[str, str], confidence: float
) -> pd.DataFrame:
    """Mean, standard deviation, central interval and convergence of the draws of each unknown."""
    return pd.DataFrame(
        {
            "parameter": written[name] + (f" [{one.unit}]" if one.unit else ""),
            "mean ± std. deviation": with_error(one.mean, one.deviation),
            f"{100 * confidence:g} % interval": interval(one.low, one.high, one.deviation),
            "R-hat": f"{one.r_hat:.3f}",
            "ESS": f"{one.effective:.0f}",
            "posterior/prior width": number(one.prior_share, 2),
            "prior": one.prior or "derived",
        }
        for name, one in found.items()
    )


def known(found: Mapping[str, Summary], written: Mapping[str, str]) -> list[str]:
    """Sentences on which parameters the data determine, and which follow the prior."""
    kinds: dict[str, list[str]] = {"determine": [], "narrow": [], "do not determine": []}
    wide = {name for name, one in found.items() if (one.prior_share or 0.0) > DETERMINED}
    for name, one in found.items():
        if name not in wide:
            kinds["determine"].append(f"{written[name]} = {with_error(one.mean, one.deviation)}")
        else:
            kind = "narrow" if one.prior_share <= FOLLOWS else "do not determine"  # type: ignore[operator]
            share = f"{100 * one.prior_share:.0f} % of its prior's width left"  # type: ignore[operator]
            kinds[kind].append(f"{written[name]} ({share})")
    lines = [f"The data {kind} {', '.join(names)}." for kind, names in kinds.items() if names]
    if {"sigma", "psi"} & {name.partition("[")[0] for name in wide}:
        lines.append(
            "σ and ψ act through the loss that they make together: at the critical velocity it is "
            "ε_up, which is determined; each alone only as far as the velocities below reach."
        )
    return lines


def _how(data: Any) -> str:
    posterior = dataset_of(data, "posterior")
    sizes, about = posterior.sizes, posterior.attrs
    return (
        f"{sizes['chain']} chains of {sizes['draw']} draws by NUTS "
        f"({about['inference_library']} {about['inference_library_version']}) after {about['warmup']} "
        f"of warm-up each, seed {about['seed']}; intervals are central. Widths are compared on the "
        "scale that is sampled, ln θ where θ is positive."
    )
