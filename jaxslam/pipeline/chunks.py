"""The loop over time that every driver uses: one compiled `lax.scan` over a chunk of steps."""

import functools
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int, PRNGKeyArray

from jaxslam.core.names import optional_import
from jaxslam.core.types import StepInputs
from jaxslam.xla.compiler import compiler_options

CHUNK = 64
"""Scans between two returns to the host: often enough for a progress bar, with negligible cost."""


def run_steps(
    filter_: Any,
    inputs: StepInputs,
    key: PRNGKeyArray,
    state: Any,
    *,
    first: Int[Array, ""] | int = 0,
    count: Int[Array, ""] | int | None = None,
    length: int | None = None,
) -> tuple[Any, Any]:
    """Run a filter over its inputs as one `lax.scan`.

    Wrap it in `jax.jit`, or vmap it over keys or over floats of the filter. The options from
    `jaxslam.xla.compiler.compiler_options` make an RBPF a quarter faster on the CPU.

    Args:
        filter_: a pytree with `step(key, state, inputs) -> (state, info)`, such as `RBPF` or `AMCL`.
        inputs: leaves stacked over time, `[T, ...]`.
        key: PRNG key; step `t` uses `fold_in(key, t)`.
        state: initial state, from the filter's `init`.
        first: index of the first step.
        count: number of steps; None for `length`. It is traced, so another number does not recompile.
        length: number of compiled steps, at least `count` (static); None for all T.

    Returns:
        The final state, and the infos of all steps with leaves `[length, ...]`, which are 0 from `count` on.
    """
    length = inputs.scan.ranges.shape[0] if length is None else length
    count = length if count is None else count

    # Traced once, though `eval_shape` and the loop both need it.
    @jax.jit
    def step(state: Any, now: StepInputs) -> tuple[Any, Any]:
        return filter_.step(jax.random.fold_in(key, state.num_steps), state, now)

    def body(state: Any, index: Int[Array, ""]) -> tuple[Any, Any]:
        def one(_: Int[Array, ""], carry: tuple[Any, Any]) -> tuple[Any, Any]:
            return step(carry[0], jax.tree.map(lambda leaf: leaf[first + index], inputs))

        shapes = jax.eval_shape(step, state, jax.tree.map(lambda leaf: leaf[0], inputs))[1]
        blank = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), shapes)
        # A loop of one trip, or of none past the end: unlike `lax.cond` it never copies the maps.
        return jax.lax.fori_loop(0, (index < count).astype(jnp.int32), one, (state, blank))

    return jax.lax.scan(body, state, jnp.arange(length, dtype=jnp.int32))


@dataclass(frozen=True)
class ChunkedRun:
    """The final state of a filter and the infos of all its steps.

    Attributes:
        state: the final state.
        infos: the infos of all steps, NumPy arrays `[T, ...]`.
        compile_s: seconds spent compiling; close to 0 after an earlier run of the same sizes.
        run_s: seconds spent running, without compilation.
    """

    state: Any
    infos: Any
    compile_s: float
    run_s: float


def run_in_chunks(
    filter_: Any,
    inputs: StepInputs,
    key: PRNGKeyArray,
    state: Any,
    *,
    tuned: bool,
    progress: str | None = None,
    on_chunk: Callable[[Any, list[Any]], None] | None = None,
    every: int = CHUNK,
) -> ChunkedRun:
    """Run a filter over all inputs from the host, with the same result as `run_steps`.

    Args:
        filter_: filter, as for `run_steps`.
        inputs: leaves stacked over time, `[T, ...]`.
        key: PRNG key; same key, same bytes.
        state: initial state; it is donated.
        tuned: compile with `compiler_options`, which speed up mapping but not the map look-ups of many
            particles.
        progress: label of a progress bar on stderr (needs tqdm); None for no bar.
        on_chunk: called after each chunk with the state and the infos so far; it may raise.
        every: scans per chunk, at most `CHUNK`.
    """
    total = inputs.scan.ranges.shape[0]
    inputs, infos, run_s = pad_inputs(inputs, total), [], 0.0
    program = _program(tuned)
    bar = None
    if progress is not None:
        with optional_import():
            from tqdm import tqdm
        bar = tqdm(total=total, unit="scan", desc=progress, dynamic_ncols=True, postfix="compiling")
    started = time.perf_counter()
    # A call with 0 steps only compiles, unless the program was compiled before.
    state, _ = jax.block_until_ready(program(filter_, inputs, key, state, first=0, count=0))
    compile_s = time.perf_counter() - started
    if bar is not None:
        bar.unpause()  # The rate counts from here on.
    for first in range(0, total, every):
        count = min(every, total - first)
        started = time.perf_counter()
        state, chunk = jax.block_until_ready(program(filter_, inputs, key, state, first=first, count=count))
        run_s += time.perf_counter() - started
        infos.append(jax.tree.map(lambda leaf, count=count: np.asarray(leaf)[:count], chunk))
        if bar is not None:
            bar.set_postfix(ess=f"{infos[-1].ess.mean():.1f}", ms=f"{1e3 * run_s / (first + count):.2f}")
            bar.update(count)
        if on_chunk is not None:
            on_chunk(state, infos)
    if bar is not None:
        bar.close()
    together = jax.tree.map(lambda *leaves: np.concatenate(leaves), *infos)
    return ChunkedRun(state, together, compile_s, run_s)


def pad_inputs(inputs: StepInputs, longest: int) -> StepInputs:
    """Pad the inputs to a power of two ≥ `longest`, so that logs of similar length share one compilation."""
    size = 1 << max(longest - 1, 1).bit_length()

    def pad(leaf: Array) -> Array:
        # NumPy, because JAX would compile a program for each length.
        return jnp.asarray(np.pad(leaf, [(0, size - len(leaf))] + [(0, 0)] * (leaf.ndim - 1)))

    return jax.tree.map(pad, inputs)


@functools.cache
def _program(tuned: bool) -> Callable[..., tuple[Any, Any]]:
    """Return the jitted `run_steps` over one chunk, one per process, so that equal sizes share a program."""
    return jax.jit(
        functools.partial(run_steps, length=CHUNK),
        donate_argnums=(3,),
        compiler_options=compiler_options() if tuned else None,
    )
