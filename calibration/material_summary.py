"""One data set's part of a result: its parameters, what follows from them, how closely it fits."""

from dataclasses import replace

import numpy as np

from calibration.derived import derived_error
from calibration.empirical import eq_17, reference_losses
from calibration.estimate import Estimate
from calibration.material_fit import MaterialFit
from calibration.parameters import COLUMNS, CONTACT_COLUMNS
from calibration.suspicions import material_doubts
from calibration.uncertainty import quantile


def summarise_material(fitted, model, g, estimates, confidence, shared) -> MaterialFit:
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
    own += material_doubts(fitted, part, g, residual, left)
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
    error = derived_error(fitted, g, what)
    if error is None:
        return Estimate(value, method="derived")
    degrees = fitted.uncertainty.degrees[g]
    reach = quantile(confidence, degrees) * error
    low, high = value - reach, value + reach
    if what == "eps_up":
        low, high = max(low, 0.0), min(high, 1.0)
    return Estimate(value, error, low, high, "derived")


def _status(problem, z, part: MaterialFit, rows) -> tuple[int, ...]:
    if part.plan not in ("two-step", "model"):
        return ()
    return tuple(int(flag) for flag in problem.status(z)[rows])
