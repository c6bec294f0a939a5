"""What a function depends on, as it is written."""

from collections.abc import Callable

import jax
from jax.extend.core import Literal


def moving(f: Callable, *leaves) -> list[bool]:
    """For each input whether anything that f gives follows from it, as f is written."""
    program = jax.make_jaxpr(f)(*leaves).jaxpr

    def reaches(start) -> bool:
        reached = {start}
        for equation in program.eqns:
            if not reached.isdisjoint(_variables(equation.invars)):
                reached.update(equation.outvars)
        return not reached.isdisjoint(_variables(program.outvars))

    return [reaches(variable) for variable in program.invars]


def _variables(atoms) -> list:
    return [atom for atom in atoms if not isinstance(atom, Literal)]
