"""A trial on a real log: read, cut, mapped and measured."""

import dataclasses

import numpy as np

from jaxslam.study.measure import load, measure
from jaxslam.study.plan import Source, read_plan
from tests.study.studies import FILTER, LOGS, SPACE, STUDY, write_plan


def test_the_first_minute_of_a_real_log(tmp_path, data_dir):
    folder = data_dir / "carmen"
    whole = Source("csail", log=str(folder / "csail.clf.gz"), reference=str(folder / "csail.reference.tum"))
    source = dataclasses.replace(whole, duration=60.0)
    loaded = load(source)
    stamps = loaded.log.scans.stamps
    assert 50.0 < stamps[-1] - stamps[0] <= 60.0
    assert len(load(whole).log.scans.stamps) > 2 * len(stamps)

    plan = read_plan(write_plan(tmp_path, STUDY, LOGS, SPACE, FILTER))
    plan = dataclasses.replace(plan, sources=(source,))
    good, bad = measure(plan, source, (0, 1), [{}, {"sensor.sigma_hit": 5.0}])
    # The filter keeps to the reference for so long; one to which all poses look alike does not.
    assert good.error.shape == (2,)
    assert good.error.max() < 0.1
    assert bad.error.min() > 2 * good.error.max()
    assert np.isfinite(good.ms_per_scan)
