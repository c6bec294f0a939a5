"""What a fit searches: elements, each one parameter of a law, and pools of them around a common mean."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from calibration.parameters import Parameter
from softjax.fields import Declared

FARTHEST = 25.0  # from the start of a search, in log units, a factor of 7e10: beyond, nothing changes any more
DRAG = "air_drag"  # c, what the drag coefficient of flights in air is off by, in parts
FIRST_SPREAD = 3.0  # of a pool, in z: factors of 20, which hardly hold its members together


@dataclass(frozen=True)
class Element:
    """One parameter of a data set's law; one number that a fit searches, where it is free.

    Attributes:
        name: in full, an entry of an array as "weights[3]".
        parameter, declared: what was said of it, and what its law says.
        start: where it starts, or what it is fixed at, in physical units; one number, or one an impact.
        range: (lowest, highest).
        stands_in: whether it is fixed at a number that nobody stated and that acts nowhere in the
            data: ψ where ε_up is fitted in its place.
        label: what results call it: "chi", or "chi[name]" where there are several data sets.
        sets: the data sets that it belongs to, of those of its component.
        end: where a search upwards ends if no highest is stated.
        reach: how far up from its start a search may go, in log units.
    """

    name: str
    parameter: Parameter
    declared: Declared
    start: Any
    range: tuple[float, float]
    stands_in: bool = False
    label: str = ""
    sets: tuple[int, ...] = ()
    end: float = np.inf
    reach: float = FARTHEST

    @property
    def group(self) -> str | None:
        """The group of data sets that it is shared in: "" for all of them, None for none."""
        shared = self.parameter.shared
        if self.parameter.pooled:
            return None
        return ("" if shared else None) if isinstance(shared, bool) else shared


class Pool(NamedTuple):
    """Elements of several data sets that lie around a common mean, on the scale that is searched."""

    name: str  # of the parameter
    members: tuple[int, ...]  # places of the elements
    spread: float  # standard deviation of the members in z

    @property
    def spread_name(self) -> str:
        """Name of the spread in results; the mean has the name of the parameter."""
        return f"{self.name}_spread"


def pools_of(elements: Sequence[Element]) -> tuple[Pool, ...]:
    """The pools among some elements, to begin with hardly held together."""
    members: dict[str, list[int]] = {}
    for k, element in enumerate(elements):
        if element.parameter.pooled:
            members.setdefault(element.name, []).append(k)
    return tuple(Pool(name, tuple(places), FIRST_SPREAD) for name, places in members.items())
