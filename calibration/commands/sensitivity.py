"""What moves the restitution, what data can tell, and where to measure next.

    softjax sensitivity nylon                        # θ ∂ε/∂θ over velocity: table, CSV, pictures
    softjax sensitivity nylon --study information    # what 30 shots would tell of χ̃, σ, ψ
    softjax sensitivity nylon --study design --shots 10 --criterion D --free yield_strength=2e6
    softjax sensitivity nylon --study global --range chi=0.1:0.4 --range density=1100:1200
    softjax sensitivity --fit results/fit.json --material nylon --study design
    softjax sensitivity --fit results/fit.json --posterior results/posterior.nc --study design

With --fit, information and design count what the fit knows already, plan points of the kind that its
data are, and repeat its warnings. A design's shots are in design.csv. With draws of its posterior a design is the best on average over some of them, and sensitivities have
limits.
"""

import argparse
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

from calibration.commands.source_options import add_route_arguments, add_source_arguments
from calibration.console import Progress
from calibration.errors import DataError
from calibration.output import files_into, or_printed, write_text

STUDIES = ("local", "information", "design", "global")
FILES = (
    *("sensitivity.json", "sensitivity.csv", "sensitivity.png", "tornado.png"),
    *("design.png", "design.csv", "sobol.png"),
)
METHODS = {"global": "sobol"}  # which is a word of Python
PLANS = ("information", "design")
# which studies an option acts on
ACTS_ON = {
    "points": ("local",),
    "at": ("local", "global"),
    **dict.fromkeys(("uncertainty", "shots", "free", "fix"), PLANS),
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
    add = parser.add_argument_group("study").add_argument
    add("--study", choices=(*STUDIES, "all"), default="local", help="default: local")
    add("--from", dest="first", type=float, metavar="V", help="lowest v [m/s]")
    add("--to", dest="last", type=float, metavar="V", help="highest v [m/s]")
    add("--points", type=int, metavar="N", help="of a curve (200)")
    add("--at", type=float, nargs="+", metavar="V", help="velocities of bars [m/s]")
    add("--seed", type=int, metavar="N", help="default: 0")
    add("--posterior", metavar="FILE.nc", type=Path, help="draws of --fit")
    add = parser.add_argument_group("information and design").add_argument
    add("--uncertainty", type=float, metavar="U", help="of ε (the fit's, or 0.01)")
    add("--shots", type=int, metavar="N", help="planned ones (30)")
    text = "a parameter to be fitted as well, such as yield_strength, known to SD beforehand"
    add("--free", action="append", metavar="NAME[=SD]", help=text)
    add("--fix", action="append", metavar="NAME", help="one that is not fitted")
    add("--criterion", choices=tuple("cDAEI"), help="of the design (c)")
    add("--target", metavar="NAME", help="of criterion c (chi, or the first; eps_up)")
    add("--over", metavar="LOW:HIGH", help="where criterion I predicts [m/s]")
    add = parser.add_argument_group("global").add_argument
    text = "of an input; may be repeated (default: 10 %% about each that moves by itself)"
    add("--range", action="append", metavar="NAME=LOW:HIGH", help=text)
    add("--samples", type=int, metavar="N", help="a power of two (4096)")
    add("--scale", choices=("uniform", "log"), help="default: uniform")


def run(arguments: argparse.Namespace) -> int:
    """Run the studies, write all files at once, print."""
    import softjax as sj
    from calibration.commands.source import read_source, route_of
    from calibration.data.json_file import dumps

    sj.enable_x64()
    studies = STUDIES if arguments.study == "all" else (arguments.study,)
    _check_options(arguments, studies)
    job = _Job(arguments, read_source(arguments), route_of(arguments))
    results: dict[str, Any] = {"material": job.source.name, "source": job.source.remark}
    with (
        or_printed([] if arguments.quiet else job.text),
        files_into(arguments.out, FILES) as folder,
        Progress(arguments.quiet) as progress,
    ):
        for study in studies:
            results[study] = getattr(job, METHODS.get(study, study))(folder, progress)
        if {*PLANS} & {*studies}:
            results |= job.warnings()
        write_text(folder / "sensitivity.json", dumps(results))
    if not arguments.quiet:
        print("\n\n".join([*job.text, f"written to {arguments.out}"]))
    return 0


def _check_options(arguments: argparse.Namespace, studies: tuple[str, ...]) -> None:
    """Refuse options that would not act, and values that no study accepts."""
    for name, where in ACTS_ON.items():
        if getattr(arguments, name) is not None and not set(where) & set(studies):
            raise DataError(f"--{name}", "given", f"left out, or --study {' or '.join(where)}")
    if arguments.over is not None and arguments.criterion != "I":
        raise DataError("--over", arguments.over, "given with --criterion I only")
    if arguments.target is not None and arguments.criterion not in (None, "c"):
        raise DataError("--target", arguments.target, "given with --criterion c only")
    for name, least in (("seed", 0), ("points", 2)):
        value = getattr(arguments, name)
        if value is not None and value < least:
            raise DataError(f"--{name}", value, f"a whole number of {least} or more")
    for v in arguments.at or ():
        if not 0 < v < math.inf:
            raise DataError("--at", v, "velocities above 0 m/s")


class _Job:
    """The studies of one law: each writes its files, adds to `text`, and returns what JSON keeps."""

    def __init__(self, arguments: argparse.Namespace, source: Any, route: Any):
        from calibration.studies.asked import inputs_of, ranges_of

        self.arguments, self.source, self.route = arguments, source, route
        stated = zip((arguments.first, arguments.last), source.span, strict=True)
        self.low, self.high = (float(of if given is None else given) for given, of in stated)
        if not 0 < self.high < math.inf:
            raise DataError("--to", self.high, "a finite velocity above 0 m/s")
        if not 0 < self.low < self.high:
            accepted = f"a velocity between 0 and {self.high:g} m/s (--to)"
            raise DataError("--from", self.low, accepted)
        self.bars = arguments.at or [max(self.low, part * self.high) for part in BARS]
        self.inputs = inputs_of(source)
        self.scale = arguments.scale or "uniform"
        self.ranges = ranges_of(arguments.range, self.scale, self.inputs, source)
        self.subject = source.law if source.result is None else source.result
        self.draws = [] if source.draws is None else source.result.at_draws(source.draws)
        self.options = self._options()
        self.text = [source.remark]

    def local(self, folder: Path, progress: Progress) -> dict[str, Any]:
        """Sensitivities over velocity, and bars at some."""
        import numpy as np

        from calibration.plots import studies as pictures
        from calibration.plots import style
        from calibration.studies.local import sensitivity
        from calibration.studies.text import limits_table, local_table, sensitivities_csv

        velocity = np.geomspace(self.low, self.high, self.arguments.points or 200)
        both = sensitivity(self.inputs, np.concatenate([velocity, self.bars]), self.route)
        if not np.any(both.coefficient > 0):
            raise DataError("--from, --to", "such that ε = 0 everywhere", "where the law rebounds")
        count = len(self.bars)
        curve, bars = both.rows(slice(None, -count)), both.rows(slice(-count, None))
        self.text.append(local_table(bars))
        write_text(folder / "sensitivity.csv", sensitivities_csv(curve))
        critical = getattr(getattr(self.source.law, "contact", None), "critical_velocity", None)
        figure = style.new_figure(7.2, 4.2)
        at_yield = None if critical is None else float(critical)
        pictures.plot_sensitivities(curve, figure.add_subplot(), at_yield)
        style.save(figure, folder / "sensitivity.png")
        style.save(pictures.tornado_figure(bars), folder / "tornado.png")
        table = {name: bars.of(name) for name in bars.names}
        found: dict[str, Any] = {"velocity": self.bars, "theta_d_epsilon_d_theta": table}
        if self.draws:
            found["limits"] = self._limits()
            confidence = self.source.result.confidence
            self.text.append(limits_table(bars, found["limits"], confidence))
        return found

    def information(self, folder: Path, progress: Progress) -> dict[str, Any]:
        """What equally spaced shots would tell."""
        import numpy as np

        from calibration.studies.information import fisher_information
        from calibration.studies.text import information_text

        of_fit, shots = self.source.result is not None, self.arguments.shots
        shots = (0 if of_fit else SHOTS) if shots is None else shots
        if shots < (not of_fit):
            raise DataError("--shots", shots, "a whole number of 1 or more, of a fit 0 or more")
        velocity = np.linspace(self.low, self.high, shots)
        uncertainty = self.arguments.uncertainty
        found = fisher_information(self.subject, velocity, uncertainty, **self.options)
        self.text.append(information_text(found))
        return found.to_dict()

    def design(self, folder: Path, progress: Progress) -> dict[str, Any]:
        """Where to measure next."""
        from calibration.plots import studies as pictures
        from calibration.plots import style
        from calibration.studies.asked import pair
        from calibration.studies.design import optimal_velocities
        from calibration.studies.text import design_csv, wrapped

        arguments = self.arguments
        limit = getattr(getattr(self.source.law, "contact", None), "limit_velocity", math.inf)
        over = arguments.over
        found = optimal_velocities(
            self.draws or self.subject,
            SHOTS if arguments.shots is None else arguments.shots,
            (self.low, min(self.high, 0.999 * float(limit))),
            criterion=arguments.criterion or "c",
            target=arguments.target,
            over=None if over is None else pair("--over", over, over),
            uncertainty=arguments.uncertainty,
            seed=arguments.seed or 0,
            progress=progress,
            **self.options,
        )
        figure = style.new_figure(6.8, 4.8)
        pictures.plot_design(found, figure.add_subplot())
        style.save(figure, folder / "design.png")
        write_text(folder / "design.csv", design_csv(found))
        count = len(self.draws)
        average = f"on average over {count} draws of the posterior: " if count else ""
        self.text.append(wrapped(f"{average}{found}"))
        return found.to_dict() | ({"draws": count} if count else {})

    def warnings(self) -> dict[str, list[str]]:
        """The warnings of the fit, of this material or of all together."""
        from calibration.studies.text import doubts_text

        every = [] if self.source.result is None else self.source.result.warnings
        own = [one for one in every if one.material in (None, self.source.name)]
        if own:
            self.text.append(doubts_text(own))
        return {"doubts": [str(one) for one in own]} if own else {}

    def sobol(self, folder: Path, progress: Progress) -> dict[str, Any]:
        """Sobol indices over ranges of the inputs."""
        from calibration.plots import studies as pictures
        from calibration.plots import style
        from calibration.studies.sobol import sobol_indices
        from calibration.studies.text import sobol_table

        samples, seed = self.arguments.samples, self.arguments.seed or 0
        more: dict[str, Any] = {
            "samples": 4096 if samples is None else samples,
            "scale": self.scale,
            "seed": seed,
        }
        found = sobol_indices(
            self.inputs, self.ranges.of, self.bars, route=self.route, progress=progress, **more
        )
        self.text += [sobol_table(found), self.ranges.text(self.inputs)]
        figure = pictures.sobol_figure(found, self.ranges.title(self.inputs))
        style.save(figure, folder / "sobol.png")
        return found.to_dict() | self.ranges.to_dict()

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

    def _options(self) -> dict[str, Any]:
        """What information and design need to know of the fit."""
        import calibration as cal
        from calibration.studies.asked import number

        names = {name: getattr(self.arguments, name) for name in ("free", "fix")}
        if self.source.result is not None:
            for name in (name for name, given in names.items() if given):
                raise DataError(f"--{name}", "given", "left out with --fit, which has its own")
            return {"material": self.source.name, "route": self.route}
        parameters = {name: cal.Parameter(free=False) for name in names["fix"] or ()}
        for text in names["free"] or ():
            name, sign, deviation = text.partition("=")
            prior = (0.0, number("--free", text, deviation, "NAME=SD")) if sign else None
            parameters[name] = cal.Parameter(prior=prior)
        return {"parameters": parameters, "route": self.route}
