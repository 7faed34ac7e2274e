"""The examples that extend the library run as they are printed, and what they build works."""

import numpy as np

from tests.docs.pages import DOCS, run_blocks


def test_a_proposal():
    names = run_blocks(DOCS / "extend" / "proposal.md")
    assert type(names["slam"].proposal) is names["ChosenProposal"]
    # Ten particles of the wide motion model: 0.15 m; particles that ignore the scan are off by more.
    assert names["error"].rmse_m < 0.3
    assert not names["result"].warnings


def test_a_sensor_model():
    names = run_blocks(DOCS / "extend" / "sensor-model.md")
    assert type(names["slam"].sensor) is names["CauchyField"]
    assert names["error"].rmse_m < 0.05


def test_a_resampler():
    names = run_blocks(DOCS / "extend" / "resampler.md")
    # Counts of one draw deviate by at most 0.5, so the mean of 4000 by 0.008; five times that.
    np.testing.assert_allclose(names["copies"], [2.0, 1.2, 0.8, 0.0], atol=0.04)
    assert names["error"].rmse_m < 0.05
    assert names["result"].resampled.all()
