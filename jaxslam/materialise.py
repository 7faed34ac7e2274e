"""Keeping XLA from recomputing a small array for every element of a large one."""

import jax
from jaxtyping import Array, Shaped


def materialise(array: Shaped[Array, "n *rest"]) -> Shaped[Array, "n *rest"]:
    """Returns `array` unchanged, computed exactly once; `n` must be even.

    On the CPU, XLA fuses the computation of a table into the loop that looks entries up, and so repeats it
    for every look-up (`lax.optimization_barrier` is dropped before fusion). What enters a loop is a buffer,
    so a copy by a loop of two trips is the cheapest wall there is: about 2 µs for a kilobyte.
    """
    halves = array.reshape(2, array.shape[0] // 2, *array.shape[1:])
    # The barrier keeps JAX from seeing that the loop does nothing.
    return jax.lax.map(jax.lax.optimization_barrier, halves).reshape(array.shape)
