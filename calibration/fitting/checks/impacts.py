"""Whether the law holds for each impact, and its velocity is known well enough."""

from collections.abc import Iterator
from typing import Any

import jax
import numpy as np
from scipy import special

import softjax as sj
from calibration.fitting.components import ComponentFit
from calibration.fitting.errors import Errors
from calibration.fitting.material import MaterialFit
from calibration.fitting.noise import Family
from calibration.fitting.rows import Batch
from calibration.fitting.warnings import Column
from calibration.observables import OBSERVABLES

VELOCITY_ERRORS = 0.15  # of a velocity, up to which intervals were seen to be right
NEAR_JUMP = 0.02  # of the critical velocity, within which a point may be on either side
SHARE_OF_NOISE = 1 / 3  # from which on a jump of ε is one to speak of
BESIDE = 1e-9  # of the critical velocity, on both sides of which ε is compared
MOST_NAMED = 8
NEAR_YIELD = 2.0  # standard uncertainties of a velocity around the kink at first yield
BLOCK, FEW = 16, 1024  # impacts in the smallest compiled program; up to so many it computes all
LARGE_OVERLAP = 0.1  # of the effective radius: no small contact
LINE_ROUNDS = 50  # of a straight line and the weights of its points in turn


def beside_jump(fit: ComponentFit, part: MaterialFit) -> str | None:
    """Points so near to first yield that they decide where it is, as ε jumps there and yield moves in the fit."""
    problem = fit.final.problem
    g = [spec.data.name for spec in fit.component.specs].index(part.name)
    yield_elements = () if problem.affects_yield is None else np.flatnonzero(problem.affects_yield)
    if not any(g in fit.component.elements[k].sets for k in yield_elements):
        return None
    critical, velocity = problem.yields_at(fit.z), problem.points.velocity
    assert critical is not None
    sides = Batch(velocity=critical * (1 + BESIDE * np.array([[-1.0], [1.0]])))
    below, above = problem.bare.linearise(np.tile(fit.z, (2, 1)), sides, False).prediction
    is_big = np.abs(above - below) > SHARE_OF_NOISE * fit.uncertainty.deviation
    jumping = [
        k for k, observable in enumerate(OBSERVABLES.values()) if observable.is_signed_square
    ]
    may_jump = (problem.points.set == g) & np.isin(problem.points.observable, jumping)
    near = np.flatnonzero(may_jump & is_big & (np.abs(velocity / critical - 1) <= NEAR_JUMP))
    if not len(near):
        return None
    data, rows = part.data, np.flatnonzero(np.isfinite(part.data.restitution))
    first = int(np.flatnonzero(may_jump)[0])
    lines = () if data.origin is None else data.origin.lines
    named = []
    for row in rows[near - first]:
        place = f"line {lines[row]}" if row < len(lines) else f"row {row + 1}"
        named.append(f"{place} at {data.velocity[row]:.4g} m/s")
    jump = float(np.max(np.abs(above - below)[near]))
    where = f"within {100 * NEAR_JUMP:g} % of the critical velocity, where ε jumps by {jump:.2g}"
    more = f" and {len(named) - MOST_NAMED} more" if len(named) > MOST_NAMED else ""
    return f"{', '.join(named[:MOST_NAMED])}{more}: {where}"


def overlap(part: MaterialFit) -> str | None:
    """Overlaps of more than a tenth of the effective radius; not by laws whose stiffness is a guess.

    Computed only where Hertz's overlap, or that of a pressure Y, comes near: δ = (15 M v²/16 E √R)^{2/5}
    and v √(M/(2π R Y)).
    """
    contact, v = part.contact, part.data.velocity
    if contact is None or isinstance(
        part.law, sj.HardSphereLaw | sj.WaltonBraun | sj.LinearSpringDashpot
    ):
        return None
    modulus, radius, mass, strength = (
        np.asarray(getattr(contact, n))
        for n in ("youngs_modulus", "radius", "mass", "yield_strength")
    )
    elastic = (15 * mass * v**2 / (16 * modulus * radius**0.5)) ** 0.4
    plastic = v * np.sqrt(mass / (2 * np.pi * radius * strength))
    if np.max(np.maximum(elastic, plastic) / radius) < 0.5 * LARGE_OVERLAP:
        return None
    share = _peak_overlap(part.law, v) / radius
    if not np.any(share > LARGE_OVERLAP):
        return None
    first = float(np.min(v[share > LARGE_OVERLAP]))
    most = f"up to {100 * np.nanmax(share):.2g} % of the effective radius"
    return f"the overlap is {most}, beyond {100 * LARGE_OVERLAP:g} % from {first:.3g} m/s on"


def _peak_overlap(law: sj.ContactLaw, velocity: Column) -> Column:
    """δ_max of each impact; in blocks, so that data sets of any length share a compiled program."""
    if len(velocity) > FEW or any(np.ndim(leaf) for leaf in jax.tree.leaves(law)):
        return np.asarray(sj.restitution(law, velocity).peak_overlap)
    blocks = np.array_split(velocity, range(BLOCK, len(velocity), BLOCK))
    return np.concatenate([np.asarray(sj.restitution(law, v).peak_overlap) for v in blocks])


def velocity_errors(velocity: Column, uncertainty: Any, yields: Any) -> str | None:
    """Errors of velocities that their treatment to second order does not carry.

    Args:
        yields: the velocity of first yield [m/s], where the curve has a kink; NaN without one.
    """
    if uncertainty is None:
        return None
    most = float(np.max(np.asarray(uncertainty) / velocity))
    near = int(np.sum(np.abs(velocity - yields) < NEAR_YIELD * np.asarray(uncertainty)))
    causes = []
    if most > VELOCITY_ERRORS:
        causes.append(f"velocities are uncertain by up to {100 * most:.2g} %")
    if near:
        causes.append(
            f"{near} of {len(velocity)} points are nearer to first yield than {NEAR_YIELD:g} "
            "standard uncertainties of their velocity"
        )
    return "; ".join(causes) or None


def statuses(status: Any, velocity: Column) -> Iterator[str]:
    """Each flag that is raised at data points, other than elastic."""
    for flag in sj.Status:
        at = velocity[(np.asarray(status, int) & int(flag)) != 0]
        if sj.Status.is_ok(int(flag)) or not len(at):
            continue
        span = f"{np.min(at):.3g} to {np.max(at):.3g} m/s" if len(at) > 1 else f"{at[0]:.3g} m/s"
        yield f"{flag.name} at {len(at)} of {len(status)} points ({span})"


def no_velocity_dependence(errors: Errors, restitution: Column, noise: Family) -> str | None:
    """A straight line's slope is zero within its 95 % interval, by the noise of the fit.

    Scatter that is not stated is estimated about the line, in turn with the weights of the points.
    """
    velocity, stated = errors.velocity, errors.points.uncertainty if errors.is_stated else None
    if np.ptp(velocity) == 0:
        return f"all points have one velocity, {velocity[0]:.4g} m/s"
    residual_dof, unit = len(velocity) - 2, np.ones(len(velocity)) if stated is None else stated
    design = np.stack([np.ones(len(velocity)), velocity - np.mean(velocity)], 1)
    white, target = design / unit[:, None], restitution / unit
    weight, scale = np.ones(len(velocity)), 1.0
    for _ in range(LINE_ROUNDS):
        line = np.linalg.pinv(white * weight[:, None] ** 0.5) @ (target * weight**0.5)
        residual = target - white @ line
        if stated is None:
            scale = (
                float(np.sum(weight * residual**2) / residual_dof) ** 0.5
                if residual_dof > 0
                else np.inf
            )
        weight, before = noise.weight(residual / max(scale, 1e-300)), weight
        if np.array_equal(weight, before):
            break
    error = scale * float(np.linalg.inv(white.T @ white * noise.information)[1, 1]) ** 0.5
    slope, quantile = float(line[1]), float(special.ndtri(0.975))
    if stated is None and residual_dof > 0:
        quantile = float(special.stdtrit(residual_dof, 0.975))
    if abs(slope) > quantile * error or (error == 0 and abs(slope) * np.ptp(velocity) > 1e-9):
        return None
    if error == np.inf:
        return (
            f"the slope of restitution is {slope:.2g} per m/s, and two points do not tell its error"
        )
    return f"the slope of restitution is {slope:.2g} ± {error:.2g} per m/s, 0 within its error"
