"""Small changes to the code, each with the tests that should notice it: see `tests.mutants`.

By file: what stands there once, what is put in its place, and the tests' files without "test_".
"""

CHANGES: dict[str, list[tuple[str, str, str]]] = {
    "calibration/fitting/posterior/diagnostics.py": [
        ("ENERGY = 0.3", "ENERGY = 0.0", "posterior_told posterior"),
        ("share > MASS", "share > 1", "posterior_told posterior"),
        ("R_HAT = 1.01", "R_HAT = 2.0", "posterior_told posterior"),
    ],
}
