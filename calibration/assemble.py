"""From data sets and what is said of their parameters to the arrays of a search."""

import math
from dataclasses import dataclass, replace

import numpy as np

from calibration.data.measurements import RestitutionData
from calibration.empirical import effective_uncertainty, guess_losses
from calibration.objective import PADDING, Noise, Observations
from calibration.parameters import (
    COLUMNS,
    CONTACT_COLUMNS,
    LINE_COLUMNS,
    NONE,
    Layout,
    column,
    kind_and_bounds,
)
from calibration.parameters_spec import ParameterSpec
from calibration.specs import Specs, columns_of, plan_of, specs_of

Z_PADDING = 8
LEAVES = ("radius", "mass", "youngs_modulus", "yield_strength", "limit_velocity")


@dataclass(frozen=True)
class Element:
    """One free parameter: its place in z, and the data sets that it belongs to."""

    label: str  # "chi", or "chi[name]" where there are several data sets
    spec: ParameterSpec
    sets: tuple[int, ...]
    position: int

    @property
    def column(self) -> str:
        return self.spec.name


@dataclass(frozen=True)
class Setup:
    """Everything a search needs but its start and its optimiser."""

    datasets: tuple[RestitutionData, ...]
    plans: tuple[str, ...]  # the objective of each data set
    elements: tuple[Element, ...]
    layout: Layout
    obs: Observations
    noise: Noise
    counts: tuple[int, ...]
    area: str
    uncertainties: tuple  # of ε with what the velocities' adds; None where unknown

    def rows(self, g: int) -> slice:
        """The points of data set g."""
        first = sum(self.counts[:g])
        return slice(first, first + self.counts[g])

    def positions(self, columns, plans) -> np.ndarray:
        """Positions in z of the elements of these columns, in sets with these objectives."""
        return np.array(
            [
                e.position
                for e in self.elements
                if e.column in columns and any(self.plans[g] in plans for g in e.sets)
            ],
            int,
        )

    def line_layout(self) -> tuple[Layout, np.ndarray]:
        """The layout with every χ̃ on one line of Eq. (18), and the positions of c1 and c2."""
        positions = len(self.elements) + np.arange(len(LINE_COLUMNS))
        index = np.array(self.layout.index)
        on_line = np.array([plan in ("two-step", "model") for plan in self.plans])
        for name, position in zip(LINE_COLUMNS, positions, strict=True):
            index[on_line, column(name)] = position
        return self.layout._replace(index=index, on_line=on_line), positions

    def stage_observations(self, plans) -> Observations:
        """The points of data sets with these objectives; the others weigh nothing."""
        member = np.array([plan in plans for plan in self.plans])
        return self.obs._replace(weight=self.obs.weight * member[self.obs.group])


def assemble(datasets, objective, parameters: Specs) -> Setup:
    """Check what was asked for and lay it out.

    Raises:
        ValueError: naming what does not fit together and what is accepted.
    """
    names = [data.name for data in datasets]
    if len(set(names)) < len(names):
        raise ValueError(f"data sets must have different names, but are {names}")
    plans = tuple(plan_of(data, objective) for data in datasets)
    specs = specs_of(parameters, datasets)
    has_line = any("c1" in own or "c2" in own for own in specs)
    elements, given = _elements(datasets, plans, specs, has_line)
    layout = _layout(datasets, plans, specs, elements, given, has_line)
    uncertainties = tuple(effective_uncertainty(data) for data in datasets)
    obs = observations(datasets, uncertainties)
    setup = Setup(
        tuple(datasets),
        plans,
        tuple(elements),
        layout,
        obs,
        _priors(elements, len(layout.kind), len(obs.velocity)),
        tuple(len(data) for data in datasets),
        _area(datasets),
        uncertainties,
    )
    _check_counts(setup)
    return setup


def _elements(datasets, plans, specs, has_line):
    """The free parameters, and the specs that are in force for each data set's columns."""
    elements: list[Element] = []
    groups: dict[tuple[str, str], list[int]] = {}
    given: list[dict[str, ParameterSpec]] = []
    for g, (data, plan) in enumerate(zip(datasets, plans, strict=True)):
        own = columns_of(data, plan, specs[g], has_line)
        given.append(own)
        for name, spec in own.items():
            if spec.free:
                group = spec.shared or ("all" if name in LINE_COLUMNS else f"set {g}")
                groups.setdefault((name, group), []).append(g)
    for position, ((name, group), sets) in enumerate(groups.items()):
        label = _label(name, group, sets, datasets)
        elements.append(Element(label, given[sets[0]][name], tuple(sets), position))
    return elements, given


def _label(name, group, sets, datasets) -> str:
    if len(datasets) == 1 or name in LINE_COLUMNS:
        return name
    return f"{name}[{datasets[sets[0]].name if group.startswith('set ') else group}]"


def _layout(datasets, plans, specs, elements, given, has_line) -> Layout:
    count = Z_PADDING * -(-(len(elements) + len(LINE_COLUMNS)) // Z_PADDING)
    fixed = np.stack([_start_row(d, own) for d, own in zip(datasets, given, strict=True)])
    index = np.full((len(datasets), len(COLUMNS)), -1)
    kind, lower, upper = np.full(count, NONE), np.full(count, -math.inf), np.full(count, math.inf)
    for e in elements:
        for g in e.sets:
            index[g, column(e.column)] = e.position
        spec = e.spec
        if e.column == "limit_velocity" and spec.bounds is None:
            fastest = max(float(np.max(datasets[g].velocity)) for g in e.sets)
            spec = replace(spec, bounds=(fastest, math.inf))  # Eq. (17) ends at v_lim
        kind[e.position], lower[e.position], upper[e.position] = kind_and_bounds(spec)
    on_line = np.array([has_line and plan in ("two-step", "model") for plan in plans])
    up_given = np.array(["eps_up" in own for own in given])
    return Layout(fixed, index, kind, lower, upper, on_line, up_given)


def _start_row(data: RestitutionData, own) -> np.ndarray:
    """Where the search starts, or what is fixed: as said, or guessed from the data."""
    row = dict.fromkeys(COLUMNS, 1.0)
    if data.limit_velocity is not None:
        row["limit_velocity"] = float(np.mean(data.limit_velocity))
    if data.contact is not None:
        for name in CONTACT_COLUMNS:
            row[name] = float(np.mean(getattr(data.contact, name)))
        ratio = row["youngs_modulus"] / row["yield_strength"]
        row["chi"] = 10 / ratio  # X = 10, in the middle of what materials have
        row["c1"], row["c2"] = 0.0, 10 / ratio**2
    if data.limit_velocity is not None:
        row["sigma"], row["psi"] = guess_losses(data)
    row["eps_up"] = float(np.clip(np.max(data.restitution), 0.1, 0.999))
    row["restitution"] = float(np.clip(np.mean(data.restitution), 1e-3, 0.999))
    row |= {name: spec.value for name, spec in own.items() if spec.value is not None}
    for name, spec in own.items():
        if spec.free and spec.value is None:
            row[name] = _inside(row[name], spec)
    return np.array([row[name] for name in COLUMNS])


def _inside(value: float, spec: ParameterSpec) -> float:
    """A guess that respects prior and bounds."""
    if spec.prior is not None:
        value = spec.prior[0]
    lower, upper = spec.bounds or spec.range
    if lower < value < upper:
        return value
    if math.isfinite(lower) and math.isfinite(upper):
        return 0.5 * (lower + upper)
    return lower + max(abs(lower), 1.0) if math.isfinite(lower) else upper - max(abs(upper), 1.0)


def observations(datasets, uncertainties) -> Observations:
    """All points in a row, padded to a multiple of `PADDING` by copies of the first of weight 0."""
    columns: dict[str, list] = {name: [] for name in Observations._fields}
    for g, data in enumerate(datasets):
        n = len(data)
        own = {name: np.ones(n) for name in LEAVES}
        if data.contact is not None:
            own = {k: np.broadcast_to(v, n) for k, v in data.contact.leaves().items()}
        if data.limit_velocity is not None:
            own["limit_velocity"] = np.broadcast_to(data.limit_velocity, n)
        weight = np.ones(n) if uncertainties[g] is None else 1 / uncertainties[g]
        elastic = np.zeros(n, bool)
        if data.contact is not None:
            elastic = data.velocity <= np.asarray(data.contact.critical_velocity)
        own |= {"velocity": data.velocity, "restitution": data.restitution, "weight": weight}
        own |= {"group": np.full(n, g), "elastic": elastic}
        for name in columns:
            columns[name].append(own[name])
    flat = {name: np.concatenate(parts) for name, parts in columns.items()}
    extra = -len(flat["velocity"]) % PADDING
    flat = {name: np.concatenate([a, np.repeat(a[:1], extra)]) for name, a in flat.items()}
    flat["weight"] = np.array(flat["weight"])
    if extra:
        flat["weight"][-extra:] = 0.0
    return Observations(**flat)


def _priors(elements, count, points) -> Noise:
    mean, precision = np.zeros(count), np.zeros(count)
    for e in elements:
        if e.spec.prior is not None:
            mean[e.position], precision[e.position] = e.spec.prior[0], 1 / e.spec.prior[1]
    return Noise(np.ones(points), mean, precision)


def _area(datasets) -> str:
    areas = {data.contact.area for data in datasets if data.contact is not None}
    if len(areas) > 1:
        raise ValueError("all contacts must have the same `area`, but have 'hertz' and 'zhou'")
    return areas.pop() if areas else "zhou"


def _check_counts(setup: Setup) -> None:
    """More points than free parameters in every data set (a prior counts as a point)."""
    for g, data in enumerate(setup.datasets):
        own = [e for e in setup.elements if e.sets == (g,) and e.spec.prior is None]
        if len(data) <= len(own):
            raise data.refusal(
                f"{len(data)} points for {len(own)} free parameters "
                f"({', '.join(e.column for e in own)})",
                "more points than free parameters",
            )
