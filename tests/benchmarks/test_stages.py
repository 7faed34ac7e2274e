"""How long each stage of a filter step takes: jitted, on the CPU, in the steady state and to compile.

    pytest tests/benchmarks/test_stages.py --benchmark-only --benchmark-json=benchmarks.json

The sizes are those of the defaults with a SICK: 180 beams, windows of 336 cells a side. Every stage stands
alone here, so it also pays for being called and for writing its result: some tens of microseconds that it
does not cost inside of a step.
"""

import pytest

from tests.benchmarks.filters import running_filter
from tests.benchmarks.programs import measure
from tests.benchmarks.stages import STAGES


@pytest.mark.parametrize("num_particles", [15, 30, 100, 400])
@pytest.mark.parametrize("name", STAGES)
def test_stage(benchmark, name, num_particles):
    slam, state, inputs = running_filter(num_particles)
    assert (slam.window_size, inputs.scan.num_beams) == (336, 180)
    measure(
        benchmark,
        STAGES[name](slam, state, inputs),
        group=name,
        rounds=30,
        warm_up=3,
        stage=name,
        num_particles=num_particles,
        num_beams=inputs.scan.num_beams,
        window_size=slam.window_size,
    )
    benchmark.extra_info["us_per_particle"] = 1e3 * benchmark.extra_info["steady_ms"] / num_particles
