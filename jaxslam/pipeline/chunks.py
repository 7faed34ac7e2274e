"""A filter over a log on the host, in chunks: for progress, snapshots, and errors before the end."""

import functools
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int, PRNGKeyArray

from jaxslam.core.types import StepInputs
from jaxslam.xla.compiler import compiler_options

CHUNK = 64
"""Scans between two looks of the host: often enough for a progress bar, rarely enough to cost nothing."""


@dataclass(frozen=True)
class Advanced:
    """A filter at the end of a log.

    Attributes:
        state: its last.
        infos: what every step left behind, NumPy arrays `[T, ...]`.
        compile_s: seconds spent compiling; next to none if a run of the same sizes has been before.
        run_s: seconds spent running, compilation apart.
    """

    state: Any
    infos: Any
    compile_s: float
    run_s: float


def advance(
    filter_: Any,
    key: PRNGKeyArray,
    state: Any,
    inputs: StepInputs,
    *,
    tuned: bool,
    progress: str | None = None,
    look: Callable[[Any, list[Any]], None] | None = None,
    every: int = CHUNK,
) -> Advanced:
    """Runs a filter over all inputs; step `t` uses `fold_in(key, t)`.

    Args:
        filter_: a pytree with `step(key, state, inputs)` and `blank_infos(num_steps)`.
        key: PRNG key; same key, same bytes.
        state: to start from, with `num_steps`; it is consumed.
        inputs: leaves stacked over time, `[T, ...]`.
        tuned: compile with `compiler_options`, which suit maps and not look-ups of many particles.
        progress: what is being done, for a bar on stderr (needs tqdm); None for no bar.
        look: called with the state and the infos so far; it may raise.
        every: so many scans, at most CHUNK.
    """
    total = inputs.scan.ranges.shape[0]
    inputs, infos, run_s = padded(inputs), [], 0.0
    program = _program(tuned)
    started = time.perf_counter()
    # No step at all: what takes time is compiling, unless a run of the same sizes has been before.
    state, _ = jax.block_until_ready(program(filter_, key, state, inputs, 0, 0))
    compile_s = time.perf_counter() - started
    bar = None if progress is None else _progress_bar(total, progress)
    for first in range(0, total, every):
        count = min(every, total - first)
        started = time.perf_counter()
        state, chunk = jax.block_until_ready(program(filter_, key, state, inputs, first, count))
        run_s += time.perf_counter() - started
        infos.append(jax.tree.map(lambda leaf, count=count: np.asarray(leaf)[:count], chunk))
        if bar is not None:
            bar.set_postfix(ess=f"{infos[-1].ess.mean():.1f}", ms=f"{1e3 * run_s / (first + count):.2f}")
            bar.update(count)
        if look is not None:
            look(state, infos)
    if bar is not None:
        bar.close()
    together = jax.tree.map(lambda *leaves: np.concatenate(leaves), *infos)
    return Advanced(state, together, compile_s, run_s)


@functools.cache
def _program(tuned: bool) -> Callable[..., tuple[Any, Any]]:
    """`steps`, compiled: one per process, so that equal sizes share it."""
    options = compiler_options() if tuned else None
    return jax.jit(steps, static_argnames="room", donate_argnums=(2,), compiler_options=options)


def padded(inputs: StepInputs) -> StepInputs:
    """Inputs lengthened to a power of two, so that logs of similar length share one compilation."""
    total = inputs.scan.ranges.shape[0]
    size = 1 << max(total - 1, 1).bit_length()
    return jax.tree.map(lambda leaf: jnp.pad(leaf, [(0, size - total)] + [(0, 0)] * (leaf.ndim - 1)), inputs)


def steps(
    filter_: Any,
    key: PRNGKeyArray,
    state: Any,
    inputs: StepInputs,
    first: Int[Array, ""] | int,
    count: Int[Array, ""] | int,
    room: int = CHUNK,
) -> tuple[Any, Any]:
    """`count` ≤ `room` steps from `first`, and `room` infos of which so many are filled.

    The length is traced, so the last chunk needs no second compilation.
    """

    def step(index: Int[Array, ""], carry: tuple[Any, Any]) -> tuple[Any, Any]:
        state, infos = carry
        now = jax.tree.map(lambda leaf: leaf[first + index], inputs)
        state, info = filter_.step(jax.random.fold_in(key, state.num_steps), state, now)
        return state, jax.tree.map(lambda rows, row: rows.at[index].set(row), infos, info)

    return jax.lax.fori_loop(0, count, step, (state, filter_.blank_infos(room)))


def _progress_bar(total: int, label: str):
    from tqdm import tqdm

    return tqdm(total=total, unit="scan", desc=label, dynamic_ncols=True)
