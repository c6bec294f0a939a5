"""Small changes to the code, each with the tests that should notice it: see `tests.mutants`.

By file: what stands there once, what is put in its place, and the tests' files without "test_".
"""

CHANGES: dict[str, list[tuple[str, str, str]]] = {
    "calibration/fitting/uncertainty.py": [
        ("covariance, seen = covariance + added, seen + added", "pass", "shared_errors")
    ],
    "calibration/fitting/noise.py": [
        ("LEAST = 1e-4", "LEAST = 0.9", "shared_errors"),
        ("np.sqrt(counts / scatter)", "np.sqrt(1 / scatter)", "shared_errors"),
    ],
    "calibration/fitting/variances.py": [
        ("if not restricted or not jacobian", "if True or not jacobian", "shared_errors")
    ],
    "calibration/handover/steps.py": [
        ("start = -phases * velocity * step", "start = 0 * phases * velocity", "export_choice")
    ],
    "calibration/handover/substitutes.py": [
        ("math.atan2(math.pi, loss)", "math.atan2(math.pi, 2 * loss)", "export_choice")
    ],
    "calibration/studies/sobol.py": [
        ("width**2 * squares", "width * squares", "studies_sobol"),
        ("mixed[i] = b[i]", "mixed[i] = a[i]", "studies_sobol"),
        ("hit.coefficient, jnp.nan)", "hit.coefficient, 0.0)", "studies_sobol"),
    ],
    "calibration/studies/asked.py": [("min(high, declared.upper)", "high", "studies_command")],
    "calibration/studies/planning.py": [
        ("kept = sets_beside(place, placed)", "kept = component.sets", "studies_information"),
        ("problem = reweighed(problem, z)", "pass", "studies_information"),
    ],
    "calibration/studies/shot_errors.py": [
        ("values, 1 / self.uncertainty", "values, self.uncertainty", "studies_shared")
    ],
    "calibration/studies/planned.py": [
        ("else np.zeros(0) for k", "else uncertainty for k", "studies_shared"),
        ("self.spreads.get(p.name, p.spread)", "p.spread", "studies_information"),
    ],
    "calibration/studies/text.py": [
        ("{v * (v / fall):.6g}", "{v * (v * fall):.6g}", "studies_command")
    ],
    "calibration/studies/local.py": [
        ("velocity * (1 + s[-1])", "velocity * (1 + 2 * s[-1])", "studies_local"),
        ('"m/s": (0, 1, -1)', '"m/s": (0, 1, 1)', "studies_local"),
    ],
    "calibration/studies/comparison.py": [("TIE = 2.0", "TIE = 3.0", "compare")],
    "calibration/report/comparison.py": [
        ("_score(result.bic)", "_score(result.aic)", "compare_command")
    ],
    "calibration/fitting/posterior/diagnostics.py": [
        ("ENERGY = 0.3", "ENERGY = 0.0", "posterior_told posterior"),
        ("share > MASS", "share > 1", "posterior_told posterior"),
        ("R_HAT = 1.01", "R_HAT = 2.0", "posterior_told posterior"),
    ],
}
