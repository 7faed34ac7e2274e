"""What correcting scans takes, as the benchmarks need it."""

import jax
import jax.numpy as jnp

from jaxslam.range_network import RangeNetwork
from tests.benchmarks.programs import Program


def corrections(num_beams: int, count: int) -> Program:
    """A scan corrected so many times, one after the other."""

    def correct(network, ranges):
        return jax.lax.fori_loop(0, count, lambda _, ranges: network(ranges), ranges)

    network = RangeNetwork.draw(jax.random.key(0), 50, 0.1, 3.5)
    return Program(correct, (network, jnp.linspace(0.1, 3.5, num_beams, dtype=jnp.float32)), tuned=False)
