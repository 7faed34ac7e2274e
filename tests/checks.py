"""Checks that many tests share, on top of those of chex."""

import json

import chex
import jax


def error_line(capsys) -> str:
    """Return the error of a command, which is its last line on stderr; before it are only warnings."""
    *warnings, error = capsys.readouterr().err.splitlines()
    assert all(line.startswith("jaxslam: warning: ") for line in warnings)
    assert error.startswith("jaxslam: error: ")
    return error


def strict_json(path):
    """Return the content of a file that must be JSON by the standard: without NaN and infinities."""

    def refuse(name):
        raise AssertionError(f"{name} is not JSON")

    return json.loads(path.read_text(), parse_constant=refuse)


def jit_once(function):
    """Compile a function such that a second trace of it raises an `AssertionError`.

    chex counts the traces of all cases of a parametrized test together: the count starts anew here.
    """
    chex.clear_trace_counter()
    return jax.jit(chex.assert_max_traces(function, n=1))


def assert_strongly_typed(tree) -> None:
    """Assert that no leaf has a weak type, which chex does not look at and a carry must not have."""
    assert not any(leaf.weak_type for leaf in jax.tree.leaves(tree)), tree
