"""What moves ε, what data can tell of it, and where to measure next.

inputs        the numbers that ε depends on, and the law they make
local         θ ∂ε/∂θ over velocity, exact
estimating    Jacobians of the objectives, impact by impact, and the covariance they give
information   what data can tell: expected standard errors, directions in words
design        the velocities that tell most
sobol         global indices over ranges, with bounds from derivatives
pictures      plots of these
"""
