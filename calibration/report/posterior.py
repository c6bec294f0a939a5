"""What draws from the posterior say: in a table, and in words of what is known and what is not."""

from collections.abc import Mapping
from typing import Any

from calibration.console import wrapped
from calibration.fitting.posterior.diagnostics import FOLLOWS, Summary, doubts_of, summaries
from calibration.fitting.posterior.inference_data import dataset_of
from calibration.report import symbols
from calibration.report.markdown import doubt_item
from calibration.report.rows import Table
from calibration.report.tables import aligned, escaped, markdown
from calibration.rounding import interval, number, with_error

TOLD = 0.3  # of the prior's width, up to which the data tell a parameter


def posterior_table(told: Mapping[str, Summary], confidence: float) -> Table:
    """Each unknown's mean, standard deviation and central interval, and how well the draws tell them."""
    header = ["parameter", "mean ± std. deviation", f"{100 * confidence:g} % interval"]
    header += ["R-hat", "effective draws", "width / prior's", "prior"]
    rows = []
    for name, one in told.items():
        unit = f" [{one.unit}]" if one.unit else ""
        rows.append(
            [
                _written(name) + unit,
                with_error(one.mean, one.deviation),
                interval(one.low, one.high, one.deviation),
                f"{one.r_hat:.3f}",
                f"{one.effective:.0f}",
                number(one.prior_share, 2),
                one.prior or "follows from the others",
            ]
        )
    return Table(header, rows, right=(3, 4, 5))


def posterior_section(data: Any, confidence: float) -> list[list[str]]:
    """Blocks of a report in Markdown."""
    told = summaries(data, confidence)
    return [
        ["## Posterior"],
        [_how(data)],
        markdown(*posterior_table(told, confidence)[:2]),
        [f"- {escaped(line)}" for line in known(told)],
        [doubt_item(doubt) for doubt in doubts_of(data)]
        or ["No doubts were raised about the draws."],
    ]


def known(told: Mapping[str, Summary]) -> list[str]:
    """In words, what the data tell, and what they leave to the prior."""
    kinds: dict[str, list[str]] = {"tell": [], "narrow": [], "do not tell": []}
    for name, one in told.items():
        if one.prior_share is None or one.prior_share <= TOLD:
            kinds["tell"].append(f"{_written(name)} = {with_error(one.mean, one.deviation)}")
        else:
            way = "narrow" if one.prior_share <= FOLLOWS else "do not tell"
            share = f"{100 * one.prior_share:.0f} % of its prior's width left"
            kinds[way].append(f"{_written(name)} ({share})")
    lines = [f"The data {way} {', '.join(names)}." for way, names in kinds.items() if names]
    untold = {name for name, one in told.items() if (one.prior_share or 0.0) > TOLD}
    if {"sigma", "psi"} & {name.partition("[")[0] for name in untold}:
        lines.append(
            "σ and ψ act through the loss that they make together: at the critical velocity it is "
            "ε_up, which is told; each alone is known only as far as the velocities below reach."
        )
    return lines


def posterior_text(data: Any, confidence: float) -> str:
    """The same on a terminal, without the priors."""
    told = summaries(data, confidence)
    table = posterior_table(told, confidence)
    rows = [row[:-1] for row in table.rows]
    lines = aligned(table.header[:-1], rows, table.right)
    words = [*known(told), *(f"! {doubt}" for doubt in doubts_of(data))]
    return "\n".join(["", "Posterior:", *lines, *wrapped(words, "  ", "    ")])


def _how(data: Any) -> str:
    posterior = dataset_of(data, "posterior")
    sizes, about = posterior.sizes, posterior.attrs
    return (
        f"{sizes['chain']} chains of {sizes['draw']} draws by NUTS "
        f"({about['inference_library']} {about['inference_library_version']}) after {about['warmup']} "
        f"of warm-up each, seed {about['seed']}; intervals are central. Widths are compared on the "
        "scale that is sampled, ln θ where θ is positive."
    )


def _written(name: str) -> str:
    base, bracket, owner = name.partition("[")
    return symbols.symbol(base).text + bracket + owner
