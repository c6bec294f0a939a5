"""When two ends of searches are two minima, and not two places in one.

An end is a minimum of its own only if

- the gradient vanishes there: the search says so, see `ending` and `compare.refits`;
- the cost rises on the way from it to the other minimum. Where it does not, one could walk down
  from the one to the other, and the first was a place in the other's valley: where a search went to
  sleep, a saddle, or another of the places that a level valley offers.

A straight way that rises does not prove that every bent one does. A valley so bent and so level
that the gradient vanishes at two places along it is one whose parameters the data do not determine;
of those no other minima are told.
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

MOVED = 1e-2  # in z, from which on values are others to a reader
STATIONS = 32
# Share of the cost that the next step may still promise where the gradient counts as vanished. A
# rise no larger than that may be made of what the two searches left undone.
LEFT_UNDONE = 1e-8


def rises_between(
    cost: Callable[[np.ndarray], float],
    first: Float[np.ndarray, "p"],
    second: Float[np.ndarray, "p"],
) -> bool:
    """Whether the cost rises above both ends on the straight way from one to the other.

    Looked at the more closely the nearer to an end: the rise around a shallow minimum is there.
    """
    shares = np.sin(np.linspace(0, np.pi / 2, STATIONS + 2)[1:-1]) ** 2
    highest = max(cost(first), cost(second))
    allowed = highest * (1 + LEFT_UNDONE)
    return any(cost(first + share * (second - first)) > allowed for share in shares)
