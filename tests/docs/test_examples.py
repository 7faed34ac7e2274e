"""The examples in the docs run as they are printed, and what they build works."""

import re
from pathlib import Path

import numpy as np
import pytest

from jaxslam.config.registry import VARIANTS

DOCS = Path(__file__).resolve().parents[2] / "docs"
if not DOCS.is_dir():
    pytest.skip("a source distribution has no docs", allow_module_level=True)


@pytest.fixture(autouse=True)
def registry_as_before():
    before = {base: dict(named) for base, named in VARIANTS.items()}
    yield
    VARIANTS.clear()
    VARIANTS.update(before)


def run_blocks(page: str) -> dict[str, object]:
    """Run the Python blocks of a page one after the other; their names."""
    blocks = re.findall(r"^```python\n(.*?)^```$", (DOCS / page).read_text(encoding="utf-8"), re.M | re.S)
    assert blocks
    names: dict[str, object] = {"__name__": "__main__"}
    for block in blocks:
        exec(compile(block, page, "exec"), names)
    return names


def test_a_proposal():
    names = run_blocks("extend/proposal.md")
    assert type(names["slam"].proposal) is names["ChosenProposal"]
    # Ten particles of the wide motion model: 0.1 m or so; a filter that drifts is off by more than a meter.
    assert names["error"].rmse_m < 0.3
    assert not names["result"].warnings


def test_a_sensor_model():
    names = run_blocks("extend/sensor-model.md")
    assert type(names["slam"].sensor) is names["CauchyField"]
    assert names["error"].rmse_m < 0.05


def test_a_resampler():
    names = run_blocks("extend/resampler.md")
    # The counts of 4000 draws: a standard deviation of at most 0.5 each, so 0.008 of the mean; 5 of them.
    np.testing.assert_allclose(names["copies"], [2.0, 1.2, 0.8, 0.0], atol=0.04)
    assert names["error"].rmse_m < 0.05
    assert names["result"].resampled.all()
