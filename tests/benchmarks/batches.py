"""The program that `run_many` compiles, as the costs need it."""

import jax
import jax.numpy as jnp

from jaxslam.pipeline.many import _Inputs, _program, _Runs
from tests.benchmarks.filters import repeated, still_filter
from tests.benchmarks.programs import Program


def still_runs(method: str, num_particles: int, num_scans: int, count: int) -> Program:
    """So many runs over a few equal scans, one after the other on one device."""
    slam, _, inputs = still_filter(num_particles, method)
    runs = _Runs(
        repeated(slam, count),
        jax.random.split(jax.random.key(0), count),
        jnp.zeros(count, jnp.int32),
    )
    over = _Inputs(
        repeated(repeated(inputs, num_scans), 1), jnp.zeros((1, 3)), jnp.full(1, num_scans, jnp.int32)
    )
    program = _program((jax.devices()[0],), together=1, room=num_scans, maps=False)
    # What was jitted: the costs are those of another degree of optimization.
    return Program(program.__wrapped__, (runs, over))
