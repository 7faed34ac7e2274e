"""Costs of the compiled programs stay what they are: no clock, and so part of every test run."""

import os
import subprocess
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import pytest

from tests.benchmarks.costs import (
    OTHER_COMPILER,
    PROGRAMS,
    RENEW,
    SAME_COMPILER,
    compiler,
    complaints,
    count,
    read_baseline,
)
from tests.benchmarks.programs import Program

ROOT = Path(__file__).resolve().parents[2]
HERE = {"jax": "1.2.3", "jaxlib": "1.2.3", "architecture": "x86_64"}
OTHER = {**HERE, "jaxlib": "1.2.4"}
NAMES = ("flops", "bytes_accessed", "temporary_bytes", "output_bytes")


@pytest.mark.parametrize("name", PROGRAMS)
def test_a_program_costs_what_it_did(name):
    if jax.default_backend() != "cpu":
        pytest.skip(f"the baseline is for CPUs, and not for {jax.default_backend()}")
    baseline = read_baseline()
    assert name in baseline["programs"], f"a new program: {RENEW}"
    costs = count(PROGRAMS[name]())
    found = list(complaints(name, costs, baseline["programs"][name], baseline["compiler"], compiler()))
    assert not found, "\n".join(found)


def test_the_baseline_has_no_program_that_is_gone():
    assert set(read_baseline()["programs"]) <= set(PROGRAMS), f"gone: {RENEW}"


def test_the_count_is_right_where_it_is_known_by_hand():
    side = 64
    square = jnp.ones((side, side), jnp.float32)
    costs = count(Program(lambda a, b: a @ b, (square, square)))
    # A multiplication and an addition for each of n³; two matrices read and one written, 4 bytes a number.
    assert costs["flops"] == 2 * side**3
    assert costs["bytes_accessed"] == 3 * side**2 * 4
    assert costs["output_bytes"] == side**2 * 4


@pytest.mark.parametrize(
    ("compiled_by", "factor", "complains"),
    [
        (HERE, 1.09, False),
        (HERE, 1.11, True),
        (HERE, 0.92, False),
        (HERE, 0.9, True),
        (OTHER, 1.49, False),
        (OTHER, 1.51, True),
        (OTHER, 0.1, False),
    ],
)
def test_how_much_a_cost_may_change(compiled_by, factor, complains):
    before = dict.fromkeys(NAMES, 1e6)
    found = list(complaints("step", {**before, "flops": factor * 1e6}, before, compiled_by, HERE))
    assert bool(found) == complains
    for line in found:
        assert line.startswith("step: flops 1e+06 before")
        assert RENEW in line


@pytest.mark.parametrize(("compiled_by", "bounds"), [(HERE, SAME_COMPILER), (OTHER, OTHER_COMPILER)])
def test_almost_nothing_may_become_a_little(compiled_by, bounds):
    before = dict.fromkeys(NAMES, 0.0)
    little, more = (dict.fromkeys(NAMES, bounds.slack + extra) for extra in (0.0, 1.0))
    assert not list(complaints("read", little, before, compiled_by, HERE))
    assert len(list(complaints("read", more, before, compiled_by, HERE))) == len(NAMES)


def test_the_documented_command_is_understood():
    """pyproject.toml asks for workers and no benchmarks, which pytest-benchmark refuses beside this flag."""
    command = [sys.executable, "-m", "pytest", "tests/benchmarks", "--benchmark-only", "--collect-only", "-q"]
    # This test may run on one of several workers; the command does not.
    alone = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST_XDIST")}
    done = subprocess.run(command, cwd=ROOT, env=alone, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "test_stages.py::test_stage[step-15]" in done.stdout
