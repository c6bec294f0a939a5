"""What moves the restitution, what data can tell, and where to measure next.

    softjax sensitivity nylon                        # θ ∂ε/∂θ over velocity: table, CSV, pictures
    softjax sensitivity nylon --study information    # what 30 shots would tell of χ̃, σ, ψ
    softjax sensitivity nylon --study design --shots 10 --criterion D --free yield_strength=2e6
    softjax sensitivity nylon --study global --range chi=0.1:0.4 --range density=1100:1200
    softjax sensitivity --fit results/fit.json --material nylon --study design

    softjax sensitivity --fit results/fit.json --posterior results/posterior.nc --study design


With --fit, information and design count what was measured already, plan for the fit's own
objective, parameters and priors, and repeat what is doubted of it. A design's shots are in
design.csv. With draws of its posterior a design is the best on average over some of them, and
sensitivities have limits.
"""

import argparse
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

from calibration.commands.source_options import add_route_arguments, add_source_arguments
from calibration.errors import DataError
from calibration.output import write_text

STUDIES = ("local", "information", "design", "global")
FILES = (
    *("sensitivity.json", "sensitivity.csv", "sensitivity.png", "tornado.png"),
    *("design.png", "design.csv", "sobol.png"),
)
PLANS = ("information", "design")
# which studies an option acts on
ACTS_ON = {
    "points": ("local",),
    "at": ("local", "global"),
    **dict.fromkeys(("objective", "uncertainty", "shots", "free", "fix"), PLANS),
    **dict.fromkeys(("criterion", "target", "over"), ("design",)),
    **dict.fromkeys(("range", "samples", "scale"), ("global",)),
    "seed": ("design", "global"),
}
BARS = (0.02, 0.2, 1.0)  # where bars are drawn unless told, in parts of the highest velocity
SHOTS = 30
LAWS_OF_LIMITS = 200  # draws that sensitivities are computed at


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_source_arguments(parser)
    add_route_arguments(parser)
    group = parser.add_argument_group("study")
    group.add_argument("--study", choices=(*STUDIES, "all"), default="local", help="default: local")
    group.add_argument("--from", dest="first", type=float, metavar="V", help="lowest v [m/s]")
    group.add_argument("--to", dest="last", type=float, metavar="V", help="highest v [m/s]")
    group.add_argument("--points", type=int, metavar="N", help="of a curve (200)")
    group.add_argument("--at", type=float, nargs="+", metavar="V", help="velocities of bars [m/s]")
    group.add_argument("--seed", type=int, metavar="N", help="default: 0")
    group.add_argument("--posterior", metavar="FILE.nc", type=Path, help="draws of --fit")
    group = parser.add_argument_group("information and design")
    group.add_argument("--objective", choices=("model", "two-step"), help="the fit's, else model")
    group.add_argument("--uncertainty", type=float, metavar="U", help="of ε (the fit's, or 0.01)")
    group.add_argument("--shots", type=int, metavar="N", help="planned ones (30)")
    group.add_argument(
        "--free",
        action="append",
        metavar="NAME[=SD]",
        help="a parameter to be fitted as well, such as yield_strength, known to SD beforehand",
    )
    group.add_argument("--fix", action="append", metavar="NAME", help="one that is not fitted")
    group.add_argument("--criterion", choices=tuple("cDAEI"), help="of the design (c)")
    group.add_argument(
        "--target", metavar="NAME", help="of criterion c (chi, or the first; eps_up)"
    )
    group.add_argument("--over", metavar="LOW:HIGH", help="where criterion I predicts [m/s]")
    group = parser.add_argument_group("global")
    group.add_argument(
        "--range",
        action="append",
        metavar="NAME=LOW:HIGH",
        help="of an input; may be repeated (default: 10 %% about each that moves by itself)",
    )
    group.add_argument("--samples", type=int, metavar="N", help="a power of two (4096)")
    group.add_argument("--scale", choices=("uniform", "log"), help="default: uniform")


def run(arguments: argparse.Namespace) -> int:
    import softjax as sj
    from calibration.commands.source import read_source, route_of

    sj.enable_x64()
    studies = STUDIES if arguments.study == "all" else (arguments.study,)
    _check_options(arguments, studies)
    text = _Job(arguments, read_source(arguments), route_of(arguments)).run(studies)
    if not arguments.quiet:
        print(text)
    return 0


def _check_options(arguments: argparse.Namespace, studies: tuple[str, ...]) -> None:
    """Refuse options that would not act."""
    for name, where in ACTS_ON.items():
        if getattr(arguments, name) is not None and not set(where) & set(studies):
            raise DataError(f"--{name}", "given", f"left out, or --study {' or '.join(where)}")
    if arguments.seed is not None and arguments.seed < 0:
        raise DataError("--seed", arguments.seed, "a whole number of 0 or more")
    if arguments.over is not None and arguments.criterion != "I":
        raise DataError("--over", arguments.over, "given with --criterion I only")
    if arguments.target is not None and arguments.criterion not in (None, "c"):
        raise DataError("--target", arguments.target, "given with --criterion c only")


class _Job:
    """The studies of one law, into one folder."""

    def __init__(self, arguments: argparse.Namespace, source: Any, route: Any):
        from calibration.studies.asked import inputs_of, ranges_of

        self.arguments, self.source, self.route = arguments, source, route
        told = (arguments.first, arguments.last)
        self.low, self.high = (
            float(s if t is None else t) for t, s in zip(told, source.span, strict=True)
        )
        if not 0 < self.high < math.inf:
            raise DataError("--to", self.high, "a finite velocity above 0 m/s")
        if not 0 < self.low < self.high:
            raise DataError(
                "--from", self.low, f"a velocity between 0 and {self.high:g} m/s (--to)"
            )
        self.points = 200 if arguments.points is None else arguments.points
        if self.points < 2:
            raise DataError("--points", self.points, "a whole number of 2 or more")
        for v in arguments.at or ():
            if not 0 < v < math.inf:
                raise DataError("--at", v, "velocities above 0 m/s")
        self.bars = arguments.at or [max(self.low, part * self.high) for part in BARS]
        self.inputs = inputs_of(source)
        scale = arguments.scale or "uniform"
        self.ranges = ranges_of(arguments.range, scale, self.inputs, source)
        self.subject = source.law if source.result is None else source.result
        self.draws = [] if source.draws is None else source.result.at_draws(source.draws)
        self.options = self._options()
        self.told = [source.remark]  # and what each study found, as soon as it has

    def run(self, studies: tuple[str, ...]) -> str:
        """Run them, write all files at once, and return what to print."""
        from calibration.console import Progress
        from calibration.data.json_file import dumps
        from calibration.output import files_into, or_printed
        from calibration.studies.text import doubts_text

        arguments, source = self.arguments, self.source
        results: dict[str, Any] = {"material": source.name, "source": source.remark}
        with (
            or_printed([] if arguments.quiet else self.told),
            files_into(arguments.out, FILES) as folder,
            Progress(arguments.quiet) as progress,
        ):
            for study in studies:
                results[study] = getattr(self, f"_{study}")(Path(folder), progress)
            doubts = self._doubts() if {*PLANS} & {*studies} else []
            if doubts:
                self.told.append(doubts_text(doubts))
                results["doubts"] = [str(doubt) for doubt in doubts]
            write_text(folder / "sensitivity.json", dumps(results))
        return "\n\n".join([*self.told, f"written to {arguments.out}"])

    def _doubts(self) -> list[Any]:
        """What is doubted of the fit, of this material or of all together."""
        fit, name = self.source.result, self.source.name
        doubts = [] if fit is None else fit.warnings
        return [doubt for doubt in doubts if doubt.material in (None, name)]

    def _options(self) -> dict[str, Any]:
        """What information and design are told of the fit."""
        import calibration as cal
        from calibration.studies.asked import number

        names = {"free": self.arguments.free or [], "fix": self.arguments.fix or []}
        if self.source.result is not None:
            for name, told in {**names, "objective": self.arguments.objective}.items():
                if told:
                    raise DataError(f"--{name}", "given", "left out with --fit, which has its own")
            return {"material": self.source.name, "route": self.route}
        parameters = {name: cal.Parameter(free=False) for name in names["fix"]}
        for text in names["free"]:
            name, sign, deviation = text.partition("=")
            prior = (0.0, number("--free", text, deviation, "NAME=SD")) if sign else None
            parameters[name] = cal.Parameter(prior=prior)
        told = {"objective": self.arguments.objective, "parameters": parameters}
        return {**told, "route": self.route}

    def _local(self, folder: Path, progress: Any) -> Any:
        import numpy as np

        from calibration.plots import studies as pictures
        from calibration.plots import style
        from calibration.studies.local import sensitivity
        from calibration.studies.text import limits_table, local_table, sensitivities_csv

        velocity = np.geomspace(self.low, self.high, self.points)
        both = sensitivity(self.inputs, np.concatenate([velocity, self.bars]), self.route)
        if not np.any(both.coefficient > 0):
            raise DataError("--from, --to", "such that ε = 0 everywhere", "where the law rebounds")
        count = len(self.bars)
        curve, bars = both.rows(slice(None, -count)), both.rows(slice(-count, None))
        self.told.append(local_table(bars))
        write_text(folder / "sensitivity.csv", sensitivities_csv(curve))
        figure = style.new_figure(7.2, 4.2)
        critical = getattr(getattr(self.source.law, "contact", None), "critical_velocity", None)
        at_yield = None if critical is None else float(critical)
        pictures.plot_sensitivities(curve, figure.add_subplot(), at_yield)
        style.save(figure, folder / "sensitivity.png")
        style.save(pictures.tornado_figure(bars), folder / "tornado.png")
        table = {name: bars.of(name) for name in bars.names}
        told = {"velocity": self.bars, "theta_d_epsilon_d_theta": table}
        if not self.draws:
            return told
        limits = self._limits()
        self.told.append(limits_table(bars, limits, self.source.result.confidence))
        return told | {"limits": limits}

    def _limits(self) -> dict[str, Any]:
        """Central limits of θ ∂ε/∂θ over draws, {name: (low, high)}, each at the bars' velocities."""
        import numpy as np

        from calibration.studies.asked import inputs_of
        from calibration.studies.local import sensitivity

        source, half = self.source, 0.5 * self.source.result.confidence
        fits = source.result.at_draws(source.draws, LAWS_OF_LIMITS)
        laws = [one.material(source.name).law for one in fits]
        inputs = [inputs_of(replace(source, law=law)) for law in laws]
        every = [sensitivity(one, self.bars, self.route) for one in inputs]
        stacked = np.stack([one.absolute for one in every])
        low, high = np.quantile(stacked, [0.5 - half, 0.5 + half], axis=0)
        return {n: (low[:, k], high[:, k]) for k, n in enumerate(every[0].names)}

    def _information(self, folder: Path, progress: Any) -> Any:
        import numpy as np

        from calibration.studies.information import fisher_information
        from calibration.studies.text import information_text

        of_fit, planned = self.source.result is not None, self.arguments.shots
        if planned is None:
            planned = 0 if of_fit else SHOTS
        if planned < (not of_fit):
            raise DataError("--shots", planned, "a whole number of 1 or more, of a fit 0 or more")
        velocity = np.linspace(self.low, self.high, planned)
        u = self.arguments.uncertainty
        found = fisher_information(self.subject, velocity, u, **self.options)
        self.told.append(information_text(found))
        return found.to_dict()

    def _design(self, folder: Path, progress: Any) -> Any:
        from calibration.plots import studies as pictures
        from calibration.plots import style
        from calibration.studies.asked import pair
        from calibration.studies.design import optimal_velocities
        from calibration.studies.text import design_csv, wrapped

        arguments = self.arguments
        limit = getattr(getattr(self.source.law, "contact", None), "limit_velocity", math.inf)
        found = optimal_velocities(
            self.draws or self.subject,
            SHOTS if arguments.shots is None else arguments.shots,
            (self.low, min(self.high, 0.999 * float(limit))),
            criterion=arguments.criterion or "c",
            target=arguments.target,
            over=None if arguments.over is None else pair("--over", arguments.over, arguments.over),
            uncertainty=arguments.uncertainty,
            seed=arguments.seed or 0,
            progress=progress,
            **self.options,
        )
        figure = style.new_figure(6.8, 4.8)
        pictures.plot_design(found, figure.add_subplot())
        style.save(figure, folder / "design.png")
        write_text(folder / "design.csv", design_csv(found))
        average = f"on average over {len(self.draws)} draws of the posterior: "
        self.told.append(wrapped(f"{average if self.draws else ''}{found}"))
        return found.to_dict() | ({"draws": len(self.draws)} if self.draws else {})

    def _global(self, folder: Path, progress: Any) -> Any:
        from calibration.plots import studies as pictures
        from calibration.plots import style
        from calibration.studies.text import sobol_table

        found = self.indices(progress)
        self.told += [sobol_table(found), self.ranges.text(self.inputs)]
        figure = pictures.sobol_figure(found, self.ranges.title(self.inputs))
        style.save(figure, folder / "sobol.png")
        return found.to_dict() | self.ranges.to_dict()

    def indices(self, progress: Any) -> Any:
        """Those of the global study, by all processes."""
        from calibration.studies.sobol import sobol_indices

        arguments = self.arguments
        return sobol_indices(
            self.inputs,
            self.ranges.of,
            self.bars,
            route=self.route,
            samples=4096 if arguments.samples is None else arguments.samples,
            scale=arguments.scale or "uniform",
            seed=arguments.seed or 0,
            progress=progress,
        )
