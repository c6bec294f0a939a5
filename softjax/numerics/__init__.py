"""Numerical tools that know nothing of collisions: powers, roots, searches, quadratures."""
