"""Golden numbers: what the library finds in two dozen cases, through its public names alone.

`numbers` records and compares, `simulated` makes the data by NumPy, the other modules are the cases.
`python -m tests.golden` writes `recorded/`, `python -m tests.golden --check` compares with it.
"""
