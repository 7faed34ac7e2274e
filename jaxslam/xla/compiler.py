"""How to compile a filter for the CPU."""

import functools

import jax

_CPU_OPTIONS: dict[str, str | bool] = {"xla_cpu_use_fusion_emitters": False}


@functools.cache
def compiler_options() -> dict[str, str | bool]:
    """Options for `jax.jit(run, compiler_options=…)` with which a step takes three quarters of the time.

    XLA's newer code generator for the CPU leaves look-ups and sums of several arrays in scalar code, which
    the matcher consists of; the older one makes vector instructions of them. Empty on other devices, and
    with a version of XLA that no longer has the choice.
    """
    if jax.default_backend() != "cpu":
        return {}
    try:
        jax.jit(lambda: 0, compiler_options=_CPU_OPTIONS)()
    except jax.errors.JaxRuntimeError:
        # "No such compile option": there is nothing to choose between.
        return {}
    return dict(_CPU_OPTIONS)
