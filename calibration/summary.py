"""From the stages of a fit to the result a user sees."""

import importlib.metadata
from dataclasses import replace

import numpy as np

import softjax as sj
from calibration import doubt as doubts
from calibration.doubt import Doubt
from calibration.empirical import eq_17, reference_losses
from calibration.parameters import COLUMNS, CONTACT_COLUMNS, NONE
from calibration.profiles import Profile, profile
from calibration.result import Estimate, FitResult, MaterialFit
from calibration.search import OPTIMISERS
from calibration.uncertainty import quantile

PACKAGES = ("softjax-contact", "jax", "diffrax", "optax", "optimistix", "numpy", "scipy")
BOUND_MARGIN = 1e-6  # of the bounds' distance, or of the value


def summarise(fitted, model, options, line, beside, confidence, with_profiles) -> FitResult:
    """Everything that is told about a fit; `fitted` is a `fit.Fitted`."""
    setup = fitted.setup
    curves = _profiles(fitted, options, confidence) if with_profiles else {}
    estimates = {
        e.position: _estimate(fitted, e, curves.get(e.label), confidence) for e in setup.elements
    }
    shared = shared_doubts(fitted, estimates, curves)
    materials = tuple(
        _material(fitted, model, g, estimates, confidence, shared) for g in range(len(setup.counts))
    )
    names, covariance = _covariance(fitted)
    reports = [s.report for s in fitted.stages] + (
        [line.stage.report] if line and line.stage else []
    )
    known = fitted.uncertainty
    return FitResult(
        materials=materials,
        unloading_line=line.line if line else None,
        covariance_names=names,
        covariance=covariance,
        rank=known.rank,
        condition_number=known.condition_number if np.isfinite(known.condition_number) else None,
        confidence=confidence,
        warnings=_all_warnings(materials, shared, line),
        optimiser_report=tuple(reports),
        beside={k: v for k, v in beside.items() if k != "seconds"} if beside else None,
        profiles=curves,
        degrees=known.degrees,
        settings=_settings(setup, model, options),
        versions={name: importlib.metadata.version(name) for name in PACKAGES},
        times=_times(fitted, line, beside),
    )


def _times(fitted, line, beside) -> dict[str, float]:
    times = {stage.report.stage: stage.seconds for stage in fitted.stages}
    if line and line.stage:
        times[line.stage.report.stage] = line.stage.seconds
    if beside:
        times["beside"] = beside["seconds"]
    return times


def _settings(setup, model, options) -> dict:
    plans = sorted(set(setup.plans))
    route = model.route
    table = {
        "objective": plans[0] if len(plans) == 1 else ", ".join(plans),
        "route": route.name,
        "optimiser": OPTIMISERS[options.optimiser],
        "area": setup.area,
        "form": model.form,
        "kappa": model.kappa,
        "x64": True,
        "loss": options.loss,
        "starts": options.starts,
        "seed": options.seed,
    }
    if options.loss != "squared":
        table["loss_scale"] = options.loss_scale
    if isinstance(route, sj.ODE):
        steps = {"rtol": route.tolerance} if route.steps is None else {"steps": route.steps}
        table |= {"solver": route.solver, **steps}
    groups = {
        e.label: [setup.datasets[g].name for g in e.sets] for e in setup.elements if len(e.sets) > 1
    }
    return table | ({"shared": groups} if groups else {})


def _covariance(fitted):
    """Of the free parameters in physical units: D C D with D = ∂θ/∂z."""
    setup, known = fitted.setup, fitted.uncertainty
    by_position = {e.position: e.label for e in setup.elements}
    rows = [i for i, p in enumerate(known.positions) if int(p) in by_position]
    names = tuple(by_position[int(known.positions[i])] for i in rows)
    slope = _slopes(fitted)[known.positions[rows]]
    covariance = known.covariance[np.ix_(rows, rows)] * np.outer(slope, slope)
    return names, covariance


def _slopes(fitted) -> np.ndarray:
    from calibration.objective import physical_map

    return np.asarray(physical_map(fitted.z, fitted.setup.layout)[1])


def _degrees_of(fitted, element) -> int | None:
    own = [fitted.uncertainty.degrees[g] for g in element.sets]
    return None if any(d is None for d in own) else sum(own)


def _estimate(fitted, element, curve: Profile | None, confidence) -> Estimate:
    """Value, standard error and interval: the profile's where there is one."""
    setup, known = fitted.setup, fitted.uncertainty
    layout, i = setup.layout, element.position
    value = float(layout.physical(fitted.z, np)[i])
    at_bound = _bound_reached(layout, i, value) is not None
    row = known.of(i)
    if row is None or known.undetermined[row]:
        # nothing in the data says anything about it
        return Estimate(value, method="undetermined", free=True, at_bound=at_bound)
    z_error = float(np.sqrt(known.covariance[row, row]))
    error = abs(float(_slopes(fitted)[i])) * z_error
    if curve is not None:
        return Estimate(value, error, curve.low, curve.high, "profile", True, at_bound)
    reach = quantile(confidence, _degrees_of(fitted, element)) * z_error
    ends = []
    for sign in (-1, 1):
        z = np.array(fitted.z)
        z[i] += sign * reach
        ends.append(float(layout.physical(z, np)[i]))
    sandwich = any(setup.plans[g] == "two-step" for g in element.sets)
    robust = any(stage.problem.loss != "squared" for stage in fitted.stages)
    method = "sandwich" if sandwich or robust else "wald"
    return Estimate(value, error, ends[0], ends[1], method, True, at_bound)


def _bound_reached(layout, i: int, value: float) -> float | None:
    """The bound that a value lies at, if it does."""
    lower, upper = float(layout.lower[i]), float(layout.upper[i])
    span = upper - lower
    near = BOUND_MARGIN * (span if np.isfinite(span) else max(abs(value), 1.0))
    if layout.kind[i] != NONE and np.isfinite(lower) and not np.isfinite(upper) and lower == 0:
        near = 1e-6  # of a quantity that nears zero on a logarithmic scale
    if np.isfinite(lower) and value - lower <= near:
        return lower
    return upper if np.isfinite(upper) and upper - value <= near else None


def _profiles(fitted, options, confidence) -> dict[str, Profile]:
    """Of Eq. (17)'s step and of `model`: where there is a likelihood. χ̃ of `two-step` has none."""
    setup, known = fitted.setup, fitted.uncertainty
    jobs = []
    for stage in fitted.stages:
        problem = stage.problem
        if problem.loss != "squared" or not stage.search.converged:
            continue
        if problem.kind == "model" and "two-step" in setup.plans:
            continue
        jobs += [(stage, e) for e in setup.elements if e.position in problem.active]
    curves = {}
    for k, (stage, e) in enumerate(jobs):
        options.tell("profiles", k, len(jobs))
        row = known.of(e.position)
        if known.undetermined[row]:
            continue
        variance = _variance(fitted, stage.problem, e)
        step = float(np.sqrt(known.covariance[row, row]))
        if variance is None or not step > 1e-12:
            continue  # data without noise: the interval is a point
        reach = quantile(confidence, _degrees_of(fitted, e))
        curves[e.label] = profile(stage.problem, e.position, e.label, variance, step, reach)
    if jobs:
        options.tell("profiles", len(jobs), len(jobs))
    return curves


def _variance(fitted, problem, element) -> float | None:
    """The weighted residuals' variance: 1 where u is stated, else the noise's; None where sets
    of one shared parameter differ in it."""
    weighted = {
        round(
            float((fitted.uncertainty.noise * problem.obs.weight)[fitted.setup.rows(g).start]), 14
        )
        for g in element.sets
    }
    variance = weighted.pop() ** 2
    return variance if not weighted and variance > 0 else None


def _material(fitted, model, g, estimates, confidence, shared) -> MaterialFit:
    """One data set's part of the result."""
    setup = fitted.setup
    data, plan = setup.datasets[g], setup.plans[g]
    stages = [s for s in fitted.stages if np.any(s.problem.obs.weight[setup.rows(g)] > 0)]
    final = stages[-1]
    rows = setup.rows(g)
    residual = (final.problem.prediction(fitted.z) - setup.obs.restitution)[rows]
    rms = float(np.sqrt(np.mean(residual**2)))
    table = {k: float(v[g]) for k, v in setup.layout.numpy_table(fitted.z).items()}
    parameters = _parameters(setup, g, estimates, table)
    columns = _columns(setup, g, table)
    reduced, left = _reduced(fitted, final.problem, g, residual)
    part = MaterialFit(
        data=data,
        plan=plan,
        parameters=parameters,
        derived={},
        columns=columns,
        rms=rms,
        rms_empirical=_rms_empirical(fitted, data, plan, g),
        reduced_chi_squared=reduced,
        converged=all(stage.search.converged for stage in stages),
        status=(),
        warnings=(),
        form=model.form,
        kappa=model.kappa,
    )
    part = replace(part, derived=_derived(fitted, part, g, confidence))
    part = replace(part, status=_status(final.problem, fitted.z, part, rows))
    own = [d for d in shared if d.material == data.name]
    own += _material_doubts(fitted, part, g, residual, left)
    return replace(part, warnings=tuple(own))


def _parameters(setup, g, estimates, table) -> dict[str, Estimate]:
    """Free ones, then the fixed ones that act."""
    found = {e.column: estimates[e.position] for e in setup.elements if g in e.sets}
    plan = setup.plans[g]
    acting = {"constant": ("restitution",), "empirical": ("sigma", "psi")}.get(
        plan, ("chi", "sigma", "psi")
    )
    if setup.layout.on_line[g]:
        acting = ("c1", "c2", "sigma", "psi")
    for name in acting:
        if name not in found:
            lost = _undefined(setup, g, name)
            found[name] = Estimate(None if lost else table[name], method="fixed")
    order = {name: i for i, name in enumerate(COLUMNS)}
    return dict(sorted(found.items(), key=lambda item: order[item[0]]))


def _undefined(setup, g, name) -> bool:
    """σ and ψ where ε_up stands in their place, χ̃ where it acts nowhere."""
    if setup.layout.up_given[g] and name in ("sigma", "psi"):
        return True
    rows = setup.rows(g)
    return name in ("chi", "c1", "c2") and bool(np.all(setup.obs.elastic[rows]))


def _columns(setup, g, table) -> dict[str, float]:
    """The physical values that make the curve."""
    plan = setup.plans[g]
    if plan == "constant":
        return {"restitution": table["restitution"]}
    if plan == "empirical":
        return {name: table[name] for name in ("sigma", "psi", "limit_velocity")}
    names = ["chi", "sigma", "psi", *CONTACT_COLUMNS]
    columns = {name: table[name] for name in names}
    if setup.layout.up_given[g]:
        columns["eps_up"] = table["eps_up"]
    if setup.layout.on_line[g]:
        columns |= {"c1": table["c1"], "c2": table["c2"]}
        ratio = table["youngs_modulus"] / table["yield_strength"]
        columns["chi"] = table["c1"] + table["c2"] * ratio
    return columns


def _rms_empirical(fitted, data, plan, g) -> float | None:
    """Of Eq. (17): this fit's own, or for `model` one fitted for comparison."""
    if data.limit_velocity is None:
        return None
    table = fitted.setup.layout.numpy_table(fitted.z)
    sigma, psi, limit = float(table["sigma"][g]), float(table["psi"][g]), data.limit_velocity
    if plan in ("model", "constant"):
        sigma, psi = reference_losses(data, fitted.setup.uncertainties[g])
    elif fitted.setup.layout.index[g, COLUMNS.index("limit_velocity")] >= 0:
        limit = float(table["limit_velocity"][g])
    residual = eq_17(data.velocity, limit, sigma, psi) - data.restitution
    return float(np.sqrt(np.mean(residual**2)))


def _reduced(fitted, problem, g, residual):
    """Reduced χ² with stated uncertainties, and its degrees of freedom."""
    setup = fitted.setup
    used = sum(e.spec.free and g in e.sets for e in setup.elements)
    left = len(residual) - used
    uncertainty = setup.uncertainties[g]
    if setup.datasets[g].uncertainty is None or left < 1:
        return None, left
    return float(np.sum((residual / uncertainty) ** 2) / left), left


def _derived(fitted, part: MaterialFit, g, confidence) -> dict[str, Estimate]:
    """ε_up and, on a line, χ̃: numbers that follow from the parameters."""
    if part.plan not in ("two-step", "model"):
        return {}
    derived = {}
    critical = float(np.mean(np.asarray(part.contact.critical_velocity)))
    derived["critical_velocity"] = Estimate(critical, method="derived")
    if not fitted.setup.layout.up_given[g]:
        derived["eps_up"] = _propagate(fitted, g, _eps_up(part), confidence, "eps_up")
    if fitted.setup.layout.on_line[g]:
        derived["chi"] = _propagate(fitted, g, part.columns["chi"], confidence, "chi")
    return derived


def _eps_up(part: MaterialFit) -> float:
    c = part.columns
    critical = float(np.mean(np.asarray(part.contact.critical_velocity)))
    return float(eq_17(critical, c["limit_velocity"], c["sigma"], c["psi"]))


def _propagate(fitted, g, value, confidence, what) -> Estimate:
    """A derived number with the error that the covariance gives it."""
    from calibration.derived import derived_error

    error = derived_error(fitted, g, what)
    if error is None:
        return Estimate(value, method="derived")
    degrees = fitted.uncertainty.degrees[g]
    reach = quantile(confidence, degrees) * error
    return Estimate(value, error, value - reach, value + reach, "derived")


def _status(problem, z, part: MaterialFit, rows) -> tuple[int, ...]:
    if part.plan not in ("two-step", "model"):
        return ()
    return tuple(int(flag) for flag in problem.status(z)[rows])


def shared_doubts(fitted, estimates, curves) -> list[Doubt]:
    """Doubts about parameters and searches."""
    setup, known = fitted.setup, fitted.uncertainty
    found: list[Doubt] = []
    for e in setup.elements:
        name = setup.datasets[e.sets[0]].name if len(e.sets) == 1 else None
        estimate = estimates[e.position]
        if estimate.method == "undetermined":
            cause = f"{e.column} does not show in these data, or only together with another"
            found.append(Doubt("rank-deficient", cause, name))
        elif estimate.at_bound:
            bound = _bound_reached(setup.layout, e.position, estimate.value)
            found.append(doubts.at_bound(e.column, estimate.value, bound, name))
    for stage in fitted.stages:
        if not stage.search.converged:
            cause = f"{stage.report.stage}: {stage.search.reason}"
            found += [Doubt("not-converged", cause, name) for name in _names(setup, stage)]
        if stage.crossings:
            cause = f"{stage.crossings} points changed between elastic and plastic on the way"
            found += [Doubt("branch-change", cause, name) for name in _names(setup, stage)]
        found += _several_minima(fitted, stage)
    if known.condition_number > doubts.CONDITION_LIMIT:
        cause = f"the Jacobian's condition number is {known.condition_number:.2g}"
        found.append(Doubt("ill-conditioned", cause))
    return found + _separation(fitted, curves)


def _names(setup, stage) -> list[str]:
    weight = stage.problem.obs.weight
    return [d.name for g, d in enumerate(setup.datasets) if np.any(weight[setup.rows(g)] > 0)]


def _several_minima(fitted, stage) -> list[Doubt]:
    """Other converged ends of nearly the same cost at other values, data set by data set."""
    setup, problem = fitted.setup, stage.problem
    found = []
    for other in stage.others:
        if not other.converged or problem.loss != "squared":
            continue
        moved = np.abs(other.z - problem.start) > 1e-2
        names = {e.position: e for e in setup.elements}
        for i in np.flatnonzero(moved):
            e = names.get(int(problem.active[i]))
            if e is None or fitted.uncertainty.undetermined[fitted.uncertainty.of(e.position)]:
                continue
            variance = _variance(fitted, problem, e) or np.inf
            rise = 2 * (other.cost - 0.5 * _cost(problem)) / variance
            if abs(rise) < doubts.SEVERAL_DELTA:
                cause = f"another minimum for {e.column} has a chi squared only {rise:.2g} higher"
                material = setup.datasets[e.sets[0]].name if len(e.sets) == 1 else None
                found.append(Doubt("several-minima", cause, material))
    return list(dict.fromkeys(found))


def _cost(problem) -> float:
    value, _ = problem.linearise(problem.start)
    return float(value @ value)


def _separation(fitted, curves) -> list[Doubt]:
    """σ and ψ that only their combination ε_up is known of; and ε_up in their place."""
    setup, known = fitted.setup, fitted.uncertainty
    found = []
    for g, data in enumerate(setup.datasets):
        if setup.layout.up_given[g] and setup.plans[g] == "model":
            cause = "no points below the critical velocity: sigma and psi act through eps_up alone"
            found.append(Doubt("eps-up-only", cause, data.name))
        pair = [e for e in setup.elements if g in e.sets and e.column in ("sigma", "psi")]
        rows = [known.of(e.position) for e in pair]
        own = [curves[e.label] for e in pair if e.label in curves]
        if len(rows) == 2 and setup.plans[g] == "model":
            errors = np.sqrt(np.diag(known.covariance)[rows])
            if not np.max(errors) <= doubts.SEPARATE or any(map(doubts.is_wide, own)):
                cause = f"the standard error of ln sigma is {errors[0]:.2g}"
                found.append(Doubt("sigma-psi-not-separate", cause, data.name))
    return found


def _material_doubts(fitted, part: MaterialFit, g, residual, left) -> list[Doubt]:
    """Doubts about one data set's curve."""
    data, name = part.data, part.name
    found = [Doubt("data", note, name) for note in data.notes if "above 1" in note]
    uncertainty = fitted.setup.uncertainties[g]
    if data.uncertainty is not None and part.reduced_chi_squared is not None:
        noise = float(np.sqrt(np.mean(uncertainty**2)))
        found.append(doubts.misfit(part.rms, noise, part.reduced_chi_squared, left, name))
    elif part.plan == "two-step":
        n = part.n
        scatter = part.rms_empirical * np.sqrt(n / max(n - 2, 1))
        found.append(
            doubts.misfit_against_scatter(
                part.rms * np.sqrt(n / max(left, 1)), scatter, max(left, 1), max(n - 2, 1), name
            )
        )
    found.append(doubts.runs(data.velocity, residual, name))
    found.append(doubts.no_velocity_dependence(data.velocity, data.restitution, uncertainty, name))
    found += doubts.statuses(part.status, data.velocity, name)
    if part.plan in ("two-step", "model") and np.all(
        fitted.setup.obs.elastic[fitted.setup.rows(g)]
    ):
        cause = "all velocities are below the critical velocity"
        found.append(Doubt("all-below-yield", cause, name))
    return [one for one in found if one is not None]


def _all_warnings(materials, shared, line) -> tuple[Doubt, ...]:
    """Each doubt once: the common ones, then those of each data set."""
    everything = [d for d in shared if d.material is None]
    for material in materials:
        everything += material.warnings
    if line is not None and not line.line.converged:
        everything.append(Doubt("not-converged", f"Eq. (18): {line.stage.search.reason}"))
    return tuple(dict.fromkeys(everything))
