"""How long each stage of a filter step takes: jitted, on the CPU, in the steady state and to compile.

    pytest tests/benchmarks -n 0 --benchmark-enable --benchmark-json=benchmarks.json

The sizes are those of the defaults with a SICK: 180 beams, windows of 336 cells a side. Every stage stands
alone here, so it also pays for being called and for writing its result: some tens of microseconds that it
does not cost inside of a step.
"""

import time

import jax
import pytest

from jaxslam.compiler import compiler_options
from tests.benchmarks.filters import running_filter
from tests.benchmarks.stages import STAGES

NUM_PARTICLES = (15, 30, 100, 400)
NUM_ROUNDS, NUM_WARM_UP = 30, 3


@pytest.mark.parametrize("num_particles", NUM_PARTICLES)
@pytest.mark.parametrize("name", STAGES)
def test_stage(benchmark, name, num_particles):
    slam, state, inputs = running_filter(num_particles)
    assert (slam.window_size, inputs.scan.num_beams) == (336, 180)
    stage = STAGES[name](slam, state, inputs)
    function = jax.jit(
        stage.function, donate_argnums=(0,) if stage.in_place else (), compiler_options=compiler_options()
    )
    lowered = function.lower(*stage.arguments)
    started = time.perf_counter()
    compiled = lowered.compile()
    compile_s = time.perf_counter() - started
    first, rest = stage.arguments[0], stage.arguments[1:]

    def call():
        nonlocal first
        result = jax.block_until_ready(function(first, *rest))
        if stage.in_place:
            first = result

    benchmark.group = name
    benchmark.extra_info.update(
        stage=name,
        num_particles=num_particles,
        num_beams=inputs.scan.num_beams,
        window_size=slam.window_size,
        # Without tracing: the shape checks of the test suite would be measured with it.
        compile_s=compile_s,
        temporary_bytes=compiled.memory_analysis().temp_size_in_bytes,
        device=jax.devices()[0].device_kind,
    )
    benchmark.pedantic(call, rounds=NUM_ROUNDS, warmup_rounds=NUM_WARM_UP)
    benchmark.extra_info["median_us_per_particle"] = 1e6 * benchmark.stats.stats.median / num_particles
