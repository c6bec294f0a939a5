"""Numerical tools independent of collisions: powers, roots, searches, quadratures."""
