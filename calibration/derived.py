"""Standard errors of numbers that follow from the parameters."""

import numpy as np

from calibration.empirical import eq_17

STEP = 1e-3  # in z, of fourth-order differences: their error is near 1e-12


def derived_error(fitted, g: int, what: str) -> float | None:
    """Standard error of "eps_up" or "chi" (on a line) of data set g; None where undetermined."""
    known = fitted.uncertainty
    gradient = np.array([_slope(fitted, g, what, position) for position in known.positions])
    acting = gradient != 0
    if not np.any(acting):
        return None
    covariance = known.covariance[np.ix_(acting, acting)]
    variance = float(gradient[acting] @ covariance @ gradient[acting])
    return float(np.sqrt(variance)) if np.isfinite(variance) and variance >= 0 else None


def derived_value(fitted, g: int, what: str, z) -> float:
    """ε_17(v_cr), or c1 + c2 E/Y, at z."""
    layout, contact = fitted.setup.layout, fitted.setup.datasets[g].contact
    table = layout.numpy_table(z)
    row = {name: values[g] for name, values in table.items()}
    if what == "chi":
        return row["c1"] + row["c2"] * row["youngs_modulus"] / row["yield_strength"]  # Eq. (18)
    critical = float(np.mean(np.asarray(contact.critical_velocity)))
    # v_cr goes as Y^{5/2}/E²
    own = float(np.mean(np.asarray(contact.yield_strength)))
    critical *= (row["yield_strength"] / own) ** 2.5
    own = float(np.mean(np.asarray(contact.youngs_modulus)))
    critical *= (own / row["youngs_modulus"]) ** 2
    return float(eq_17(critical, row["limit_velocity"], row["sigma"], row["psi"]))


def _slope(fitted, g, what, position) -> float:
    def at(step):
        z = np.array(fitted.z)
        z[position] += step
        return derived_value(fitted, g, what, z)

    unit = 1.0 if fitted.setup.layout.kind[position] != 2 else max(abs(fitted.z[position]), 1e-6)
    h = STEP * unit
    return (8 * (at(h) - at(-h)) - (at(2 * h) - at(-2 * h))) / (12 * h)
