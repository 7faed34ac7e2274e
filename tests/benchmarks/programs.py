"""What is timed and whose costs are counted: a function to compile, and what to call it with."""

import time
from collections.abc import Callable
from typing import NamedTuple

import jax

from jaxslam.xla.compiler import compiler_options


class Program(NamedTuple):
    """A function to jit with its arguments.

    Attributes:
        function: pure.
        arguments: arrays and modules.
        in_place: the first argument is donated, and the result takes its place in the next call.
        tuned: compiled with `compiler_options`, as mapping is and localization is not.
    """

    function: Callable
    arguments: tuple
    in_place: bool = False
    tuned: bool = True

    def lowered(self, **options: bool | int) -> jax.stages.Lowered:
        """Traced, and not yet compiled.

        Args:
            options: for the compiler, beside those that it has anyway.
        """
        function = jax.jit(
            self.function,
            donate_argnums=(0,) if self.in_place else (),
            compiler_options={**(compiler_options() if self.tuned else {}), **options},
        )
        return function.lower(*self.arguments)


def measure(benchmark, program: Program, group: str, rounds: int, warm_up: int, **extra):
    """Times a program: compiling once, and then call after call; returns what the last one gave.

    `extra_info` has both apart, `compile_s` and `steady_ms` (the median), and the sizes that are handed in.
    Tracing is left out: the shape checks of the test suite would be measured with it.
    """
    lowered = program.lowered()
    started = time.perf_counter()
    compiled = lowered.compile()
    compile_s = time.perf_counter() - started
    first, rest = program.arguments[0], program.arguments[1:]
    result = None

    def call():
        nonlocal first, result
        result = jax.block_until_ready(compiled(first, *rest))
        if program.in_place:
            first = result

    benchmark.group = group
    benchmark.extra_info.update(
        extra,
        compile_s=compile_s,
        temporary_bytes=compiled.memory_analysis().temp_size_in_bytes,
        device=jax.devices()[0].device_kind,
    )
    benchmark.pedantic(call, rounds=rounds, warmup_rounds=warm_up)
    benchmark.extra_info["steady_ms"] = 1e3 * benchmark.stats.stats.median
    return result
