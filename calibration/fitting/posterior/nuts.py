"""NUTS by blackjax, with its window adaptation: a thread for each chain.

Source: Hoffman and Gelman, J. Mach. Learn. Res. 15, 1593 (2014); Stan Reference Manual, 15.2.
"""

import importlib
import os
import warnings
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from threading import Lock
from typing import Any

import jax
import numpy as np
from jaxtyping import Array, Float

from calibration.errors import InputError

BLOCK = 100  # draws between two steps of the progress bar
ACCEPTANCE = 0.9  # that step sizes are adapted to
STEP_SIZE = 0.5  # where the adaptation starts: what is sampled is nearly standard normal
INSTALL = 'pip install -e ".[bayes]" in its folder'
Progress = Callable[[str, int, int], None] | None


class MissingExtra(InputError, ImportError):
    """A package of the extra `bayes` is not installed; one line says what to do."""


def needed(name: str) -> Any:
    """A module of the extra.

    Raises:
        MissingExtra: where it is not installed.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", FutureWarning)  # ArviZ 0.23 announces 1.0
            return importlib.import_module(name)
    except ModuleNotFoundError as error:
        package = name.partition(".")[0]
        if error.name is None or error.name.partition(".")[0] != package:
            raise
        problem = f"a posterior needs {package}, which is not installed"
        raise MissingExtra(None, None, problem, f"install it with {INSTALL}") from None


def run_chains(
    log_density: Callable[[Array], Array],
    starts: Float[np.ndarray, "chains p"],
    draws: int,
    warmup: int,
    seed: int,
    progress: Progress = None,
) -> tuple[Float[np.ndarray, "chains draws p"], Mapping[str, np.ndarray]]:
    """Draws of a chain from each start, and NUTS' statistics of each, (chains, draws).

    Equal for equal seeds, however many chains run at once.
    """
    blackjax = needed("blackjax")
    nothing = needed("blackjax.adaptation.base").get_filter_adapt_info_fn()
    adaptation = blackjax.window_adaptation(
        blackjax.nuts,
        log_density,
        is_mass_matrix_diagonal=False,
        initial_step_size=STEP_SIZE,
        target_acceptance_rate=ACCEPTANCE,
        adaptation_info_fn=nothing,
    )

    def warmed(key, start):
        return adaptation.run(key, start, warmup)[0]

    def block(keys, state, tuned):
        step = blackjax.nuts(log_density, **tuned).step

        def one(state, key):
            state, info = step(key, state)
            statistics = {
                "lp": state.logdensity,
                "diverging": info.is_divergent,
                "energy": info.energy,
                "acceptance_rate": info.acceptance_rate,
                "n_steps": info.num_integration_steps,
                "tree_depth": info.num_trajectory_expansions,
                "step_size": tuned["step_size"],
            }
            return state, (state.position, statistics)

        return jax.lax.scan(one, state, keys)

    keys = jax.random.split(jax.random.key(seed), (len(starts), 2))
    count = min(BLOCK, draws)
    blocks = -(-draws // count)
    # compiled before the threads begin
    warm_up = jax.jit(warmed).lower(keys[0, 0], starts[0]).compile()
    first = jax.eval_shape(warmed, keys[0, 0], starts[0])
    sample = jax.jit(block).lower(jax.random.split(keys[0, 1], count), *first).compile()
    total, done, lock = len(starts) * (blocks + 1), [], Lock()

    def tell() -> None:
        with lock:
            done.append(1)
            if progress is not None:
                progress("draws", len(done), total)

    def chain(k: int):
        with jax.enable_x64(True):  # a thread has settings of its own
            state, tuned = warm_up(keys[k, 0], starts[k])
            tell()
            parts = []
            for key in jax.random.split(keys[k, 1], blocks):
                state, found = sample(jax.random.split(key, count), state, tuned)
                parts.append(jax.device_get(found))
                tell()
            return jax.tree.map(lambda *every: np.concatenate(every)[:draws], *parts)

    with ThreadPoolExecutor(min(len(starts), _cores())) as threads:
        chains = list(threads.map(chain, range(len(starts))))
    return jax.tree.map(lambda *every: np.stack(every), *chains)


def _cores() -> int:
    """Processor cores that this process may use."""
    has = getattr(os, "sched_getaffinity", None)
    return len(has(0)) if has else os.cpu_count() or 1
