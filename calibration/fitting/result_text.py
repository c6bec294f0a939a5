"""A result as text, for `print(result)`; the terminal's tables are in `calibration.report`."""

from typing import Any

from calibration.fitting.assembly import label_of_law
from calibration.fitting.estimate import Estimate
from calibration.fitting.material import MaterialFit


def fit_text(result: Any) -> str:
    """Each data set's parameters, Eq. (18)'s line, whether the fit converged, the doubts."""
    lines: list[str] = []
    for material in result.materials:
        lines += _material_lines(material, result.confidence)
    for name, e in result.pooled.items():
        told = f"all together: {name} {e} {interval_text(e, result.confidence)}"
        lines.append(told.rstrip())
    line = result.unloading_line
    if line is not None:
        lines.append(f"Eq. (18): c1 = {line.c1}, c2 = {line.c2}")
        lines += [f"  rms {name}: {rms:.4g}" for name, rms in line.rms.items()]
    lines += [f"outlier: {one}" for material in result.materials for one in material.outliers]
    lines.append("converged" if result.converged else "NOT CONVERGED")
    return "\n".join([*lines, *(f"warning: {doubt}" for doubt in result.warnings)])


def _material_lines(material: MaterialFit, confidence: float) -> list[str]:
    estimates = {**material.parameters, **material.derived}
    width = max(map(len, estimates), default=0)
    told = f"{material.name}: {material.n} points, {label_of_law(material.model)}"
    numbers = sum(tree.size for tree in material.trees)
    return [
        f"{told}, {material.objective}",
        *(
            f"  {name:{width}}  {e}  {interval_text(e, confidence)}".rstrip()
            for name, e in estimates.items()
        ),
        *([f"  and {numbers} numbers of {_names(material)}"] if numbers else []),
        f"  rms {material.rms:.4g}" + _empirical_text(material),
    ]


def _names(material: MaterialFit) -> str:
    return ", ".join(tree.name for tree in material.trees)


def _empirical_text(material: MaterialFit) -> str:
    if material.rms_empirical is None or material.model.key == "eq-17":
        return ""
    return f" (Eq. 17: {material.rms_empirical:.4g})"


def interval_text(e: Estimate, confidence: float) -> str:
    """The interval in brackets; an open end is told as such."""
    if not e.free and e.standard_error is None:
        return "(fixed)" if e.method == "fixed" and e.value is not None else ""
    if e.standard_error is None and e.low is None and e.high is None:
        return "(undetermined)"
    low = "open" if e.low is None else f"{e.low:.4g}"
    high = "open" if e.high is None else f"{e.high:.4g}"
    return f"[{low}, {high}] {100 * confidence:g} % {e.method}"
