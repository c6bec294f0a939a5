"""The studies of the command line: run, written, and told on the terminal."""

import json
from pathlib import Path
from typing import Any

import numpy as np

import softjax as sj
from calibration.atomic import files_into
from calibration.curve.source import Source
from calibration.errors import DataError
from calibration.progress import Progress
from calibration.sensitivities import inputs as names_of
from calibration.sensitivities.design import optimal_velocities
from calibration.sensitivities.information import fisher_information
from calibration.sensitivities.inputs import Inputs
from calibration.sensitivities.local import Sensitivities, sensitivity
from calibration.sensitivities.sobol import sobol_indices

BUILDERS = {
    "spheres": names_of.Spheres,
    "unlike spheres": names_of.UnlikeSpheres,
    "wall": names_of.SphereAndWall,
}
OF_ZHOU = ("information", "design")
BARS = (0.02, 0.2, 1.0)  # where bars are drawn unless told, in parts of the highest velocity


def check(arguments, source: Source, studies) -> None:
    """Refuse what a study cannot use, before any of them runs.

    Raises:
        DataError: what is wrong and what is accepted.
    """
    if source.law is None:
        raise DataError("--fit", source.name, "a fit with a contact law (two-step or model)")
    if any(study in OF_ZHOU for study in studies) and not isinstance(source.law, sj.Zhou):
        raise DataError("--study", arguments.study, "local or global for another law than zhou")
    low, high = span(arguments, source)
    if not 0 < low < high:
        raise DataError("--from", low, f"a velocity between 0 and {high:g} m/s (--to)")
    if arguments.points < 2:
        raise DataError("--points", arguments.points, "a whole number of 2 or more")
    for v in arguments.at or ():
        if not 0 < v < np.inf:
            raise DataError("--at", v, "velocities above 0 m/s")
    parse_ranges(arguments.range, inputs_of(source))


def run_studies(arguments, source: Source, route, studies) -> str:
    """Run them, write all files at once, and return what to print."""
    told, results = [source.remark], {"material": source.name, "source": source.remark}
    with files_into(arguments.out) as folder, Progress(arguments.quiet) as progress:
        for study in studies:
            text, result = RUN[study](arguments, source, route, Path(folder), progress)
            told.append(text)
            results[study] = result
        text = json.dumps(results, indent=1, ensure_ascii=False, allow_nan=False)
        (folder / "sensitivity.json").write_text(text + "\n", encoding="utf-8")
    return "\n\n".join([*told, f"written to {arguments.out}"])


def inputs_of(source: Source) -> Inputs:
    """The bodies' properties where they are known, else the law's own fields."""
    law = source.law
    if source.properties is None or not isinstance(law, sj.Zhou):
        return names_of.of_law(law)
    build = BUILDERS[source.bodies](law.contact.area, law.form, law.kappa)
    own = {name: float(getattr(law, name)) for name in names_of.COEFFICIENTS}
    return Inputs(source.properties | own, build)


def span(arguments, source: Source) -> tuple[float, float]:
    """The velocities asked for, or the source's."""
    given = (arguments.first, arguments.last)
    low, high = (s if g is None else g for g, s in zip(given, source.span, strict=True))
    return float(low), float(high)


def parse_ranges(texts: list[str], inputs: Inputs) -> dict[str, tuple[float, float]]:
    """`name=low:high`, or a tenth to either side of every input.

    Raises:
        DataError: for what is no range of an input.
    """
    if not texts:
        return {n: (x - 0.1 * abs(x), x + 0.1 * abs(x)) for n, x in inputs.values.items() if x}
    ranges = {}
    for text in texts:
        name, _, ends = text.partition("=")
        name = name.strip().replace("-", "_")
        if name not in inputs.values:
            raise DataError(
                "--range", text, f"NAME=LOW:HIGH, NAME one of {', '.join(inputs.values)}"
            )
        try:
            low, high = map(float, ends.split(":"))
        except ValueError:
            raise DataError("--range", text, "NAME=LOW:HIGH") from None
        ranges[name] = (low, high)
    return ranges


def _bars(arguments, source: Source) -> list[float]:
    low, high = span(arguments, source)
    return arguments.at or [max(low, part * high) for part in BARS]


def _local(arguments, source: Source, route, folder: Path, progress) -> tuple[str, Any]:
    low, high = span(arguments, source)
    bars = _bars(arguments, source)
    inputs = inputs_of(source)
    velocity = np.geomspace(low, high, arguments.points)
    both = sensitivity(inputs, np.concatenate([velocity, bars]), route)
    curve, at_bars = both.rows(slice(None, -len(bars))), both.rows(slice(-len(bars), None))
    _write_csv(folder / "sensitivity.csv", curve)
    _draw_local(folder, curve, at_bars, source)
    table = {n: at_bars.of(n).tolist() for n in at_bars.names}
    return _local_table(at_bars), {"velocity": bars, "theta_d_epsilon_d_theta": table}


def _local_table(found: Sensitivities) -> str:
    head = "θ ∂ε/∂θ at v [m/s]" + "".join(f"{v:>11.4g}" for v in found.velocity)
    lines = [
        f"{names_of.symbol(name):<18}"
        + "".join(f"{round(x, 5) + 0.0:>11.5f}" for x in found.of(name))
        for name in found.names
    ]
    return "\n".join([head, *lines])


def _write_csv(path: Path, found: Sensitivities) -> None:
    """θ ∂ε/∂θ and ∂ln ε/∂ln θ of every input; an empty cell where ε = 0."""
    kinds = [f"{n} d(eps)/d({n})" for n in found.names], [f"dln(eps)/dln({n})" for n in found.names]
    header = ["velocity [m/s]", "restitution", *kinds[0], *kinds[1], "status"]
    columns = [found.velocity, found.coefficient, *found.absolute.T, *found.logarithmic.T]
    rows = zip(*(column.tolist() for column in columns), found.status.tolist(), strict=True)
    lines = [",".join(_cell(x) for x in row) for row in rows]
    path.write_text("\n".join([",".join(header), *lines]) + "\n", encoding="utf-8")


def _cell(value: float | int) -> str:
    from calibration.curve.writers import status_names

    if isinstance(value, int):
        return status_names(value)
    return "" if np.isnan(value) else f"{value:.17g}"


def _draw_local(folder: Path, curve, at_bars, source: Source) -> None:
    from calibration.plots import style
    from calibration.sensitivities import pictures

    figure = style.new_figure(7.2, 4.2)
    critical = getattr(source.law.contact, "critical_velocity", None)
    pictures.plot_sensitivities(curve, figure.add_subplot(), float(critical))
    style.save(figure, folder / "sensitivity.png")
    count = len(at_bars.velocity)
    figure = style.new_figure(max(3.4 * count, 4.5), 3.6)
    for ax, v in zip(figure.subplots(1, count, squeeze=False)[0], at_bars.velocity, strict=True):
        pictures.plot_tornado(at_bars, v, ax)
    style.save(figure, folder / "tornado.png")


def _measured(source: Source):
    """Velocities and uncertainties of a fit's data, None without."""
    if source.result is None:
        return None, None
    data = source.result.material(source.name).data
    return data.velocity, data.uncertainty


def _information(arguments, source: Source, route, folder, progress) -> tuple[str, Any]:
    velocity, uncertainty = _measured(source)
    if velocity is None:
        low, high = span(arguments, source)
        velocity = np.linspace(low, high, arguments.shots)
    u = arguments.uncertainty if uncertainty is None else uncertainty
    found = fisher_information(source.law, velocity, u, arguments.objective, route)
    lines = [str(found)]
    for name, error in found.standard_errors.items():
        told = "not determined" if error is None else f"{error:.3g}"
        lines.append(f"expected standard error of {names_of.symbol(name)}: {told}")
    return "\n".join(lines), found.to_dict()


def _design(arguments, source: Source, route, folder: Path, progress) -> tuple[str, Any]:
    from calibration.plots import style
    from calibration.sensitivities import pictures

    low, high = span(arguments, source)
    measured, uncertainty = _measured(source)
    found = optimal_velocities(
        source.law,
        arguments.shots,
        (low, min(high, 0.999 * float(source.law.contact.limit_velocity))),
        criterion=arguments.criterion,
        target=arguments.target,
        objective=arguments.objective,
        uncertainty=arguments.uncertainty,
        measured=measured,
        measured_uncertainty=uncertainty,
        seed=arguments.seed,
        progress=progress,
    )
    figure = style.new_figure(6.8, 4.8)
    pictures.plot_design(found, source.law, figure.add_subplot())
    style.save(figure, folder / "design.png")
    return str(found), found.to_dict()


def _global(arguments, source: Source, route, folder: Path, progress) -> tuple[str, Any]:
    from calibration.plots import style
    from calibration.sensitivities import pictures

    inputs, bars = inputs_of(source), _bars(arguments, source)
    found = sobol_indices(
        inputs,
        parse_ranges(arguments.range, inputs),
        bars,
        route=route,
        samples=arguments.samples,
        scale=arguments.scale,
        seed=arguments.seed,
        progress=progress,
    )
    figure = style.new_figure(max(4.2 * len(bars), 5.0), 3.8)
    for i, ax in enumerate(figure.subplots(1, len(bars), squeeze=False)[0]):
        pictures.plot_sobol(found, i, ax)
    style.save(figure, folder / "sobol.png")
    return _sobol_table(found), found.to_dict()


def _sobol_table(found) -> str:
    head = "Sobol indices, first (total) at v [m/s]"
    lines = [head + "".join(f"{v:>18.4g}" for v in found.velocity)]
    for i, name in enumerate(found.names):
        cells = zip(found.first[:, i], found.total[:, i], strict=True)
        text = "".join(
            f"{f'{round(s, 3) + 0.0:.3f} ({round(t, 3) + 0.0:.3f})':>18}" for s, t in cells
        )
        lines.append(f"{names_of.symbol(name):<{len(head)}}" + text)
    return "\n".join(lines)


RUN = {"local": _local, "information": _information, "design": _design, "global": _global}
