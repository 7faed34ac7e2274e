"""Benchmarks run on demand: `pytest tests/benchmarks -n 0 --benchmark-enable`. Else they are skipped."""

from pathlib import Path

import pytest

_HERE = Path(__file__).parent
_REASON = "benchmarks are off: pytest tests/benchmarks -n 0 --benchmark-enable"


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    # Disabled, pytest-benchmark would still run every benchmark once. The command line's `enable` outvotes
    # the `disable` of pyproject.toml, and with several workers nothing can be timed.
    enabled = config.getoption("benchmark_enable") and not hasattr(config, "workerinput")
    for item in items:
        if item.path.is_relative_to(_HERE) and not enabled:
            # First of all markers: no fixture is set up for a test that is skipped.
            item.add_marker(pytest.mark.skip(reason=_REASON), append=False)
