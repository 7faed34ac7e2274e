"""Benchmarks run on demand, `pytest tests/benchmarks --benchmark-only`, and else are skipped."""

from pathlib import Path

import pytest

_HERE = Path(__file__).parent
_REASON = "benchmarks are off: pytest tests/benchmarks --benchmark-only"


@pytest.hookimpl(tryfirst=True)
def pytest_cmdline_main(config: pytest.Config) -> None:
    # pyproject.toml asks for several workers, among which nothing can be timed, and for no benchmarks.
    # Before xdist starts them, and before pytest-benchmark finds that the two do not go together.
    if config.getoption("benchmark_only"):
        config.option.numprocesses = 0
        config.option.benchmark_enable = True


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    # Disabled, pytest-benchmark would still run every benchmark once.
    enabled = config.getoption("benchmark_enable") and not hasattr(config, "workerinput")
    for item in items:
        is_benchmark = "benchmark" in getattr(item, "fixturenames", ())
        if item.path.is_relative_to(_HERE) and is_benchmark and not enabled:
            # First of all markers: no fixture is set up for a test that is skipped.
            item.add_marker(pytest.mark.skip(reason=_REASON), append=False)
