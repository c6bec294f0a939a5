"""The covariance that a data set states, written out as a full matrix."""

import numpy as np


def covariance_of(data, slope=0.0, size=None, added=0.0):
    """Covariance of δε - slope δv of the points, (n, n)."""
    e, n = data.errors, len(data)
    slope = np.broadcast_to(slope, (n,)).astype(float)
    sizes = np.full(1 + int(e.index.max(initial=-1)), size, float) if e.size is None else e.size
    factors = np.zeros((n, len(sizes) + 1))  # a column of each input error, the last for none
    for k in range(3):
        of_k = e.to_restitution[:, k] - slope * e.to_velocity[:, k]
        np.add.at(factors, (np.arange(n), e.index[:, k]), of_k)
    factors = factors[:, :-1] * sizes
    alone = [0.0 if u is None else u for u in (e.u_restitution, e.u_velocity)]
    return factors @ factors.T + np.diag(
        alone[0] ** 2 + (slope * alone[1]) ** 2 + added + np.zeros(n)
    )
