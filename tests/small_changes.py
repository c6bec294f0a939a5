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
    "calibration/studies/comparison.py": [("TIE = 2.0", "TIE = 3.0", "compare")],
    "calibration/fitting/posterior/diagnostics.py": [
        ("ENERGY = 0.3", "ENERGY = 0.0", "posterior_told posterior"),
        ("share > MASS", "share > 1", "posterior_told posterior"),
        ("R_HAT = 1.01", "R_HAT = 2.0", "posterior_told posterior"),
    ],
}
