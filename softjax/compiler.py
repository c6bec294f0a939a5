"""Options of XLA's compiler. They are its own and no promise: what it refuses is left out."""

from collections.abc import Callable
from functools import cache

import jax
import numpy as np

# Code is made an older way, kernel by kernel: two thirds of the time to compile, and for large
# batches of the energy balance twice the time to run. Where few impacts are computed it pays.
# LLVM's first level of optimisation takes another sixth of it off and costs a few percent at most.
QUICK = (("xla_cpu_use_fusion_emitters", False), ("xla_backend_optimization_level", 1))


@cache
def accepted(options: tuple[tuple[str, bool | int | str], ...]) -> dict[str, bool | int | str]:
    """The options, or none where the compiler refuses one of them: it works without, slower.

    Any other error of the compiler is raised, and nothing concluded from it: the next call tries again.
    """
    try:
        jax.jit(lambda x: x + 1, compiler_options=dict(options))(np.zeros(1, np.float32))
    except jax.errors.JaxRuntimeError as error:
        if not str(error).startswith("INVALID_ARGUMENT"):
            raise
        return {}
    return dict(options)


@cache
def quick_to_compile(function: Callable, static: tuple[int, ...]) -> Callable:
    """The function compiled sooner, to run slower; not to be called in a traced one.

    Args:
        static: positions of what is no array.
    """
    return jax.jit(function, static_argnums=static, compiler_options=accepted(QUICK))
