"""Solves the stored collisions anew, from their inputs: `python -m tests.oracles.write`.

`reference.json`, `hard_cases.json` and `turning_point.json` beside this file, and the answers of
`softjax speed`, hold collisions by Zhou's law: numbers as float64 or float32 hold them, and what
exactly these come out as. Answers are strings of 25 digits, null where there is none (the duration of
an impact at rest). For a further collision add a record with its inputs, and run this.
"""

import json
from itertools import combinations_with_replacement
from pathlib import Path
from typing import Any

from mpmath import mp, mpf

from tests.oracles import zhou_mp as z

HERE = Path(__file__).parent
SPEED = HERE.parents[1] / "calibration" / "speed.json"
PROPERTIES = ("E", "nu", "rho", "Y", "R", "chi", "sigma", "psi", "v")  # of two equal spheres
PAIRED = ("chi", "sigma", "psi", "E", "Y", "v")
BESIDE_YIELD = mpf("1e-20")  # which side of y = 1 an impact is on, beyond any difference's step
Record = dict[str, Any]


def text(value: mpf) -> str | None:
    """25 digits; the rounding noise of a derivative that is exactly zero becomes zero."""
    if not mp.isfinite(value):
        return None
    return mp.nstr(value if abs(value) > mpf("1e-50") else mpf(0), 25)


def texts(values: dict[str, Any]) -> Record:
    """The same for a table of numbers, whatever its depth; flags in the order of the alphabet."""
    kinds = {dict: texts, set: sorted}
    return {k: kinds.get(type(v), text)(v) for k, v in values.items()}


def plastic_slopes(form: str, *at: float) -> list[mpf]:
    """∂ε_p²/∂ln θ for θ = d, X, y, by central differences."""

    def value(k, sign):
        moved = (mpf(x) * (1 + (sign * z.STEP if i == k else 0)) for i, x in enumerate(at))
        return z.plastic_squared(form, *moved)

    with mp.workdps(140):
        return [(value(k, 1) - value(k, -1)) / (2 * z.STEP) for k in range(3)]


def box(record: Record) -> Record:
    """One collision of given d, X and y."""
    form, d, X, y = (record[k] for k in ("form", "d", "X", "y"))
    x_m = z.peak(form, d, y)
    slopes = plastic_slopes(form, d, X, y)
    return texts(
        {
            "x_m": z.loading_end(form, d) if x_m is None else x_m,
            "x_star": z.loading_end(form, d) if x_m is None else z.residual(form, d, X, x_m),
            "eps_p_squared": z.plastic_squared(form, d, X, y),
            "duration": z.duration(form, d, X, y),
            "log_sensitivities": dict(zip(("d", "X", "y"), slopes, strict=True)),
            "log_sensitivity_sum": sum(map(abs, slopes), mpf(0)),
            "flags": z.flags(form, d, X, y),
        }
    )


def of_contact(record: Record) -> Record:
    """ε, overlaps, duration and flags of an impact, and their sensitivities."""
    inputs = record["inputs"]
    return texts(z.coefficient(inputs) | {"log_sensitivities": z.log_sensitivities(inputs)})


def of_spheres(record: Record) -> Record:
    """The same of two equal spheres in the properties of their material, with second derivatives."""
    inputs = record["inputs"]
    pairs = combinations_with_replacement(PAIRED, 2)
    derivatives = {
        "log_sensitivities": z.log_sensitivities(inputs, PROPERTIES, z.equal_spheres),
        "second": {f"{a},{b}": z.second(inputs, a, b, z.equal_spheres) for a, b in pairs},
    }
    return texts(z.coefficient(z.equal_spheres(inputs)) | derivatives)


def hard(record: Record) -> Record:
    """ε² unclipped, ε_p², θ ∂ε²/∂θ, and Σ|∂²ε²/∂ln θ ∂ln θ'| over θ': what rounding does to those.

    At yield the velocity is on the `side` of y = 1 that the record means.
    """
    inputs = dict(record["inputs"])
    if "side" in record:
        with mp.workdps(140):
            inputs["v"] = z.dimensionless(inputs)["v_cr"] * (1 + record["side"] * BESIDE_YIELD)
    result = z.coefficient(inputs, lasts=False)
    slopes = sums = dict.fromkeys(z.NUMBERS, mpf(0))
    if "NO_TURNING_POINT" not in result["flags"]:
        slopes = {n: s["eps_squared"] for n, s in z.log_sensitivities(inputs).items()}
        sums = curvature_sums(inputs, slopes)
    return texts(
        {
            "eps_squared": result["eps_squared"],
            "eps_p_squared": result["eps_p_squared"],
            "slopes": slopes,
            "sensitivity": sum(map(abs, slopes.values()), mpf(0)),
            "flags": result["flags"],
        }
    ) | {"curvatures": {n: f"{float(x) * (x > 1e-70):.6g}" for n, x in sums.items()}}


def curvature_sums(inputs: Record, slopes: dict[str, mpf]) -> dict[str, mpf]:
    """By central differences in θ, whose θ² ∂²/∂θ² lacks the slope."""
    with mp.workdps(140):
        return {
            a: sum(
                abs(z.second(inputs, a, b)["eps_squared"] + (slopes[a] if a == b else 0))
                for b in z.NUMBERS
            )
            for a in z.NUMBERS
        }


def turning(row: list[float]) -> list[float]:
    """Beside y_max: d, X, y, 1 - y/y_max, ε_p², x_m, and Σ|∂ε_p²/∂ln θ| over d, X and y."""
    d, X, y = row[:3]
    form = "first-order"
    with mp.workdps(120):
        answers = (
            1 - y / z.y_max(form, d),
            z.plastic_squared(form, d, X, y),
            z.peak(form, d, y),
            sum(map(abs, plastic_slopes(form, d, X, y))),
        )
    return [d, X, y, *map(float, answers)]


def timed(inputs: Record, row: list) -> list:
    """Velocity, ε_p and θ ∂ε_p/∂θ for θ = χ̃, E, Y by Zhou's law."""
    full = inputs | {"v": row[0]}
    answer = z.coefficient(full, lasts=False)
    slopes = z.log_sensitivities(full, ("chi", "E", "Y")).values()
    with mp.workdps(30):
        log = [slope["eps_p_squared"] / (2 * answer["eps_p"]) for slope in slopes]
        return [row[0], *(mp.nstr(x, 20) for x in (answer["eps_p"], *log))]


SOLVERS = {"boxes": box, "curves": of_contact, "materials": of_spheres}


def stored(path: Path) -> Any:
    return json.loads(path.read_text(encoding="utf-8"))


def lines(records: list) -> str:
    """One record a line."""
    return "[\n" + ",\n".join(json.dumps(r, ensure_ascii=False) for r in records) + "\n]"


def replace(path: Path, sections: dict[str, str] | str) -> None:
    if isinstance(sections, dict):
        sections = "{\n" + ",\n".join(f'"{k}": {v}' for k, v in sections.items()) + "\n}"
    temporary = path.with_suffix(".tmp")
    temporary.write_text(sections + "\n", encoding="utf-8")
    temporary.replace(path)


def main() -> None:
    reference = stored(HERE / "reference.json")
    found = {k: lines([r | f(r) for r in reference[k]]) for k, f in SOLVERS.items()}
    source = json.dumps(reference["source"], ensure_ascii=False)
    replace(HERE / "reference.json", {"source": source} | found)
    rows = stored(HERE / "hard_cases.json")
    replace(HERE / "hard_cases.json", lines([r | hard(r) for r in rows]))
    points = stored(HERE / "turning_point.json")
    replace(
        HERE / "turning_point.json", {k: lines(list(map(turning, v))) for k, v in points.items()}
    )
    inputs, rows = stored(SPEED)["zhou"].values()
    rows = lines([timed(inputs, row) for row in rows])
    replace(SPEED, {"zhou": f'{{"inputs": {json.dumps(inputs)}, "rows": {rows}}}'})


if __name__ == "__main__":
    main()
