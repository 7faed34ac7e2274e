"""Compiler options for running a filter on the CPU."""

import functools

import jax

_CPU_OPTIONS: dict[str, str | bool] = {"xla_cpu_use_fusion_emitters": False}


@functools.cache
def compiler_options() -> dict[str, str | bool]:
    """Return options for `jax.jit(run, compiler_options=…)` that reduce the time of a step to three quarters.

    The matcher consists of table look-ups and sums of several arrays. XLA's newer CPU code generator compiles
    them to scalar code, the older one to vector instructions. The result is empty on other devices, and with
    XLA versions that lack the older generator.
    """
    if jax.default_backend() != "cpu":
        return {}
    try:
        jax.jit(lambda: 0, compiler_options=_CPU_OPTIONS)()
    except jax.errors.JaxRuntimeError:
        # "No such compile option": this XLA has only one code generator.
        return {}
    return dict(_CPU_OPTIONS)
