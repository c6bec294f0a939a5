"""ε(v) by the million: where velocities come from, which law answers, where the rows go.

source       the law of a named material, a material file or a fit
laws         contact laws by name
velocities   grids and columns of numbers, block by block
stream       block after block through the law
digits       numbers as text of 17 digits, a block at once
writers      CSV, .npy, look-up tables
picture      the curve drawn
"""
