"""ε(v) by the million: where velocities come from, which law answers, where the rows go.

options, source   the law of a named material, a material file or a fit
velocities        grids and columns of numbers, block by block
stream            block after block through the law
digits            numbers as text of 17 digits, a block at once
writers, table    CSV, .npy; look-up tables
"""
