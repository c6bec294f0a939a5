"""Sensitivities of the restitution, the information in data, and where to measure next.

    softjax sensitivity nylon                        # θ ∂ε/∂θ over velocity: table, CSV, pictures
    softjax sensitivity nylon --study information    # how well 30 shots would determine χ̃, σ, ψ
    softjax sensitivity nylon --study design --shots 10 --criterion D --free contact.yield_strength=2e6
    softjax sensitivity --fit results/fit.json --material nylon --study design
    softjax sensitivity --fit results/fit.json --study design --precision 5% --target eps@2

With --fit, information and design add to what the fit determines already, plan points of the kind that
its data are, and repeat its warnings. A design's shots are in design.csv."""

import argparse
import math
from pathlib import Path
from typing import Any

from calibration.commands.source_options import add_route_arguments, add_source_arguments
from calibration.console import Progress
from calibration.errors import DataError
from calibration.output import files_into, or_printed, write_text

FILES = (
    *("sensitivity.json", "sensitivity.csv", "sensitivity.png", "tornado.png"),
    *("design.png", "design.csv"),
)
PLANS = ("information", "design")
# option: its studies, type, placeholder of the value, and help text
OPTIONS: dict[str, tuple[tuple[str, ...], Any, str, str]] = {
    "points": (("local",), int, "N", "velocities of a curve (200)"),
    "at": (("local",), float, "V", "velocities of the bars [m/s]"),
    "seed": (("design",), int, "N", "of the search (0)"),
    "uncertainty": (PLANS, float, "U", "standard uncertainty of each ε (the fit's, or 0.01)"),
    "shots": (PLANS, int, "N", "number of planned shots (30)"),
    "free": (PLANS, str, "NAME[=SD]", "a further parameter to fit, known to SD beforehand"),
    "fix": (PLANS, str, "NAME", "a parameter that is not fitted"),
    "precision": (("design",), str, "U%", "as few shots as determine the target to this, 5%"),
    "criterion": (
        ("design",),
        str,
        "c|D",
        "of the design: the standard error of --target (c, default), the determinant of the covariance (D)",
    ),
    "target": (
        ("design",),
        str,
        "NAME",
        "of criterion c: chi, eps_up, eps@2 [m/s] (chi, or the first)",
    ),
}
REPEATED = ("free", "fix")
BARS = (0.02, 0.2)  # where bars are drawn by default, next to the highest velocity, in parts of it
SHOTS = 30
LOWEST = "Nothing is planned below {:.4g} m/s, where the stated error is 10 % of the reading; --from allows it."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_source_arguments(parser)
    add_route_arguments(parser)
    add = parser.add_argument_group("study").add_argument
    text = "θ ∂ε/∂θ of each input (local, default); errors after planned shots (information); best shots (design)"
    add("--study", choices=(*STUDIES, "all"), default="local", help=text)
    add("--from", dest="first", type=float, metavar="V", help="lowest v [m/s]")
    add("--to", dest="last", type=float, metavar="V", help="highest v [m/s]")
    for name, (studies, kind, metavar, text) in OPTIONS.items():
        keywords: dict[str, Any] = {"type": kind, "metavar": metavar}
        keywords |= {"action": "append"} if name in REPEATED else {}
        keywords |= {"nargs": "+"} if name == "at" else {}
        keywords |= {"choices": metavar.split("|")} if "|" in metavar else {}
        text = f"{text}{'; may be repeated' * (name in REPEATED)} [{', '.join(studies)}]"
        add(f"--{name}", help=text.replace("%", "%%"), **keywords)


def run(arguments: argparse.Namespace) -> int:
    """Run the studies, write all files at once, print."""
    import softjax as sj
    from calibration.data.json_file import dumps

    sj.enable_x64()
    studies = tuple(STUDIES) if arguments.study == "all" else (arguments.study,)
    _check_options(arguments, studies)
    job = _Job(arguments)
    results: dict[str, Any] = {"material": job.source.name, "source": job.source.remark}
    with (
        or_printed([] if arguments.quiet else job.text),
        files_into(arguments.out, FILES) as job.folder,
        Progress(arguments.quiet) as job.progress,
    ):
        for study in studies:
            results[study] = STUDIES[study](job)
        if {*PLANS} & {*studies} and (warnings := _warnings(job)):
            results["warnings"] = warnings
        write_text(job.folder / "sensitivity.json", dumps(results))
    if not arguments.quiet:
        print("\n\n".join(job.text) + "\n")
    return 0


def _check_options(arguments: argparse.Namespace, studies: tuple[str, ...]) -> None:
    """Refuse options that would not act, and values that no study accepts."""
    stated = {name: x for name in OPTIONS if (x := getattr(arguments, name)) is not None}
    for name in stated:
        acts_on = OPTIONS[name][0]
        if not {*acts_on} & {*studies}:
            raise DataError(f"--{name}", "given", f"left out, or --study {' or '.join(acts_on)}")
    if stated.get("points", 2) < 2:
        raise DataError("--points", arguments.points, "a whole number of 2 or more")
    for v in arguments.at or ():
        if not 0 < v < math.inf:
            raise DataError("--at", v, "velocities above 0 m/s")


class _Job:
    """One law and what its studies share; each study appends to `text` what is printed."""

    folder: Path
    progress: Progress

    def __init__(self, arguments: argparse.Namespace):
        from calibration.commands.source import read_source, route_of
        from calibration.studies.inputs import inputs_of

        self.arguments = arguments
        self.source, self.route = read_source(arguments), route_of(arguments)
        stated = zip((arguments.first, arguments.last), self.source.span, strict=True)
        self.low, self.high = (float(end if value is None else value) for value, end in stated)
        if not 0 < self.high < math.inf:
            raise DataError("--to", self.high, "a finite velocity above 0 m/s")
        if not 0 < self.low < self.high:
            accepted = f"a velocity between 0 and {self.high:g} m/s (--to)"
            raise DataError("--from", self.low, accepted)
        first, middle = (part * self.high for part in BARS)
        first = max(self.low, first)
        middle = max(middle, math.sqrt(first * self.high))
        self.bars = arguments.at or [first, middle, self.high]
        self.inputs = inputs_of(self.source)
        self.fit = self.source.result
        self.subject = self.source.law if self.fit is None else self.fit
        self.options = _options(arguments, self.source) | {"route": self.route}
        self.contact = getattr(self.source.law, "contact", None)
        self.text = [self.source.remark]

    @property
    def lowest(self) -> float:
        """The lowest velocity of a plan [m/s]: where readings of the fit's kind make sense, unless --from is given."""
        from calibration.studies.plans import lowest_shot

        if self.fit is None or self.arguments.first is not None:
            return self.low
        return lowest_shot(self.fit.material(self.source.name), self.low, self.high)


def _options(arguments: argparse.Namespace, source: Any) -> dict[str, Any]:
    """The options of information and design: of a fit its own parameters, else the free ones."""
    import calibration as cal

    if source.result is not None:
        for name in ("free", "fix"):
            if getattr(arguments, name):
                raise DataError(f"--{name}", "given", "left out with --fit, which has its own")
        return {"material": source.name}
    parameters = {name: cal.Parameter(free=False) for name in arguments.fix or []}
    for text in arguments.free or []:
        name, sign, deviation = text.partition("=")
        prior = (0.0, _number("--free", text, deviation, "NAME=SD")) if sign else None
        parameters[name] = cal.Parameter(prior=prior)
    return {"parameters": parameters}


def _number(option: str, text: str, digits: str, accepted: str) -> float:
    """A number in the text of an option."""
    try:
        return float(digits)
    except ValueError:
        raise DataError(option, text, accepted) from None


def _warnings(job: _Job) -> list[str]:
    """The warnings of the fit, of this material or of all together."""
    from calibration import symbols
    from calibration.report.studies import warnings_text

    warnings = [] if job.fit is None else job.fit.warnings
    ours = [warning for warning in warnings if warning.material in (None, job.source.name)]
    if ours:
        models = [fit.model for fit in job.fit.materials]
        job.text.append(symbols.written(warnings_text(ours), models))
    return [str(warning) for warning in ours]


def _local(job: _Job) -> dict[str, Any]:
    """Sensitivities over velocity, and bars at some velocities."""
    import numpy as np

    from calibration.plots import draw, studies
    from calibration.report.studies import local_table, sensitivities_csv
    from calibration.studies.sensitivities import sensitivity

    velocity = np.geomspace(job.low, job.high, job.arguments.points or 200)
    both = sensitivity(job.inputs, np.concatenate([velocity, job.bars]), job.route)
    if not np.any(both.coefficient > 0):
        raise DataError("--from, --to", "such that ε = 0 everywhere", "where the law rebounds")
    count = len(job.bars)
    curve, bars = both.rows(slice(None, -count)), both.rows(slice(-count, None))
    job.text.append(local_table(bars))
    write_text(job.folder / "sensitivity.csv", sensitivities_csv(curve))
    critical = getattr(job.contact, "critical_velocity", None)
    critical = None if critical is None else float(critical)
    make = lambda: studies.plot_sensitivities(curve, critical_velocity=critical)  # noqa: E731
    draw(make, job.folder / "sensitivity.png")
    draw(lambda: studies.tornado_figure(bars), job.folder / "tornado.png")
    table = {name: bars.of(name) for name in bars.names}
    return {"velocity": job.bars, "theta_d_epsilon_d_theta": table}


def _information(job: _Job) -> dict[str, Any]:
    """Expected standard errors of equally spaced shots."""
    import numpy as np

    from calibration.report.studies import wrapped
    from calibration.studies.plans import fisher_information

    shots, of_fit = job.arguments.shots, job.fit is not None
    shots = (0 if of_fit else SHOTS) if shots is None else shots
    if shots < (not of_fit):
        raise DataError("--shots", shots, "a whole number of 1 or more, or with --fit of 0 or more")
    velocity = np.linspace(job.lowest, job.high, shots)
    information = fisher_information(
        job.subject, velocity, job.arguments.uncertainty, **job.options
    )
    job.text.append(wrapped(str(information)))
    return information.to_dict()


def _design(job: _Job) -> dict[str, Any]:
    """Velocities of the next measurements."""
    from calibration.plots import draw, studies
    from calibration.report.studies import design_csv, drops_text, wrapped
    from calibration.studies.designs import optimal_velocities

    arguments, fall = job.arguments, job.source.fall
    limit = getattr(job.contact, "limit_velocity", math.inf)
    precision = None
    if arguments.precision is not None:
        if arguments.shots is not None:
            raise DataError("--precision", "given", "left out with --shots")
        text = arguments.precision
        precision = _number("--precision", text, text.removesuffix("%"), "U%, as 5%")
        precision /= 100 if text.endswith("%") else 1
    shots = SHOTS if arguments.shots is None else arguments.shots
    design = optimal_velocities(
        job.subject,
        shots if precision is None else None,
        (job.lowest, min(job.high, 0.999 * float(limit))),
        criterion=arguments.criterion or "c",
        target=arguments.target,
        precision=precision,
        uncertainty=arguments.uncertainty,
        seed=0 if arguments.seed is None else arguments.seed,
        progress=job.progress,
        **job.options,
    )
    draw(lambda: studies.plot_design(design), job.folder / "design.png")
    write_text(job.folder / "design.csv", design_csv(design, fall))
    lines = [str(design)]
    lines += [drops_text(design, fall)] if fall is not None else []
    lines += [LOWEST.format(job.lowest)] if job.lowest > job.low else []
    job.text.append(wrapped("\n".join(lines)))
    return design.to_dict()


STUDIES = {"local": _local, "information": _information, "design": _design}
