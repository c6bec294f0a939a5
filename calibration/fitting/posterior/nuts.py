"""NUTS by blackjax: window adaptation and draws in one compiled program, a thread for each chain.

Compiling is most of the time, so that warm-up and draws share the program: a scan over steps, each
with what is to be adapted after it. The schedule is Stan's.

Source: Hoffman and Gelman, J. Mach. Learn. Res. 15, 1593 (2014); Stan Reference Manual, 15.2.
"""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from threading import Lock
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from calibration.fitting.posterior.extra import needed

BLOCK = 100  # steps of one call: what the progress bar counts
SMOOTH, SHARP = 0.8, 0.95  # acceptance that step sizes are adapted to, of a density with corners
STEP = 0.5  # where it starts: what is sampled is nearly standard normal
KEEP, FAST, SLOW, WINDOW_END, LAST = range(5)  # what is adapted after a step
STATISTICS = ("lp", "diverging", "energy", "acceptance_rate", "n_steps", "tree_depth", "step_size")
Progress = Callable[[str, int, int], None] | None


class Chain(NamedTuple):
    """Draws of one chain, and what NUTS tells of each."""

    draws: Float[np.ndarray, "draws p"]
    statistics: dict[str, np.ndarray]


class _Carry(NamedTuple):
    state: Any
    step_sizes: Any
    metric: Any
    step_size: Any


@dataclass
class Sampler:
    """NUTS on a density of u with arrays beside it; compiled once, for all arrays of one shape.

    Attributes:
        log_density: (u, *arrays) -> ln p.
        acceptance: that step sizes are adapted to.
    """

    log_density: Callable[..., Any]
    acceptance: float = SHARP
    _compiled: Any = field(default=None, repr=False)

    def run(
        self,
        starts: Float[np.ndarray, "chains p"],
        arrays: Sequence[Any],
        draws: int,
        warmup: int,
        seed: int,
        progress: Progress = None,
    ) -> list[Chain]:
        """A chain from each start; equal for equal seeds, however many run at once."""
        stages = _stages(warmup, draws)
        keys = jax.random.split(jax.random.key(seed), len(starts))
        self._prepare(starts[0], arrays)
        total, done, lock = len(starts) * len(stages) // BLOCK, [], Lock()

        def told() -> None:
            with lock:
                done.append(1)
                if progress is not None:
                    progress("draws", len(done), total)

        def chain(k: int) -> Chain:
            with jax.enable_x64(True):  # a thread has settings of its own
                return self._chain(keys[k], starts[k], arrays, stages, draws, told)

        with ThreadPoolExecutor(min(len(starts), cores())) as threads:
            return list(threads.map(chain, range(len(starts))))

    def _prepare(self, start, arrays) -> None:
        """Compile, before the threads begin."""
        if self._compiled is None:
            first = jax.jit(jax.value_and_grad(self.log_density))
            carry = _begun(first, start, arrays)
            stages = np.zeros(BLOCK, int)
            step = jax.jit(lambda *some: _block(self.log_density, self.acceptance, *some))
            lowered = step.lower(carry, jax.random.key(0), stages, tuple(arrays))
            self._compiled = first, lowered.compile()

    def _chain(self, key, start, arrays, stages, draws: int, told) -> Chain:
        first, block = self._compiled
        carry = _begun(first, start, arrays)
        parts = []
        for k, one in enumerate(jax.random.split(key, len(stages) // BLOCK)):
            some = stages[k * BLOCK : (k + 1) * BLOCK]
            carry, found = block(carry, one, some, tuple(arrays))
            parts.append(jax.device_get(found))
            told()
        position, *rest = (np.concatenate(every)[-draws:] for every in zip(*parts, strict=True))
        return Chain(position, dict(zip(STATISTICS, rest, strict=True)))


def cores() -> int:
    """Processor cores that this process may use."""
    has = getattr(os, "sched_getaffinity", None)
    return len(has(0)) if has else os.cpu_count() or 1


def _stages(warmup: int, draws: int) -> Int[np.ndarray, "steps"]:
    """What is adapted after each step; steps before the warm-up fill up the first block."""
    schedule = needed("blackjax.adaptation.window_adaptation").build_schedule(warmup)
    windows = np.asarray(schedule).reshape(-1, 2).astype(int)
    adapted = FAST + windows[:, 0] + windows[:, 1]
    adapted[-1] = LAST
    filled = -(warmup + draws) % BLOCK
    return np.concatenate([np.full(filled, FAST), adapted, np.full(draws, KEEP)])


def _adaptation(acceptance: float = SHARP):
    """blackjax's dual averaging of the step size and Welford's dense covariance."""
    step_size = needed("blackjax.adaptation.step_size")
    metric = needed("blackjax.adaptation.mass_matrix")
    return step_size.dual_averaging_adaptation(acceptance), metric.mass_matrix_adaptation(False)


def _begun(first, start, arrays) -> _Carry:
    (begin_step, *_), (begin_metric, *_) = _adaptation()
    start = jnp.asarray(start)
    value, slope = first(start, *arrays)
    state = needed("blackjax.mcmc.hmc").HMCState(start, value, slope)
    return _Carry(state, begin_step(STEP), begin_metric(len(start)), jnp.asarray(STEP))


def _block(log_density, target: float, carry: _Carry, key, stages, arrays):
    """Some steps of a chain."""
    kernel = needed("blackjax.mcmc.nuts").build_kernel()
    density = lambda u: log_density(u, *arrays)  # noqa: E731

    def one(carry: _Carry, told):
        key, stage = told
        inverse_mass = carry.metric.inverse_mass_matrix
        state, info = kernel(key, carry.state, density, carry.step_size, inverse_mass)
        statistics = (
            state.logdensity,
            info.is_divergent,
            info.energy,
            info.acceptance_rate,
            info.num_integration_steps,
            info.num_trajectory_expansions,
            carry.step_size,
        )
        moved = carry._replace(state=state)
        adapted = _adapted(moved, target, info.acceptance_rate, stage)
        return adapted, (state.position, *statistics)

    return jax.lax.scan(one, carry, (jax.random.split(key, len(stages)), stages))


def _adapted(carry: _Carry, target: float, acceptance, stage) -> _Carry:
    (begin, average, averaged), (_, seen, covariance) = _adaptation(target)

    def keep() -> _Carry:
        return carry

    def fast() -> _Carry:
        sizes = average(carry.step_sizes, acceptance)
        return carry._replace(step_sizes=sizes, step_size=jnp.exp(sizes.log_step_size))

    def slow() -> _Carry:
        return fast()._replace(metric=seen(carry.metric, carry.state.position))

    def window_end() -> _Carry:
        after = slow()
        sizes = begin(averaged(after.step_sizes))
        size = jnp.exp(sizes.log_step_size)
        return after._replace(step_sizes=sizes, step_size=size, metric=covariance(after.metric))

    def last() -> _Carry:
        after = fast()
        return after._replace(step_size=averaged(after.step_sizes))

    return jax.lax.switch(stage, [keep, fast, slow, window_end, last])
