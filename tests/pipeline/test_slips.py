"""Common slips at the main functions end in one line that says what to give.

The checks of types that the tests switch on would answer first, so the slips are made in a process without.
"""

import subprocess
import sys

import pytest

PREPARATION = """
import jax, jax.numpy as jnp, numpy as np
import jaxslam
from jaxslam.proposal import AbstractProposal

class Bare(AbstractProposal):
    def sample(self, key, pose, context):
        return pose

class Sized(AbstractProposal):
    num: int = 4
    def sample(self, key, pose, context):
        return jnp.zeros(self.num)

SlamConfig, key = jaxslam.SlamConfig, jax.random.key(0)
keys = jax.random.split(key, 2)
log, truth = jaxslam.sim.drive("hall_small", duration=3, key=key)
slam, scans = jaxslam.prepare(log, SlamConfig(num_particles=2).with_lidar("sick"))
bare, _ = jaxslam.prepare(log, SlamConfig(num_particles=2, proposal=Bare()).with_lidar("sick"))
room = jaxslam.io.OccupancyMap(np.eye(9) > 0, np.eye(9) < 1, 0.5, np.zeros(3))
amcl, _ = jaxslam.prepare_localization(log, room, jaxslam.LocalizationConfig(max_particles=50))
"""
SLIPS = {
    'jaxslam.prepare("csail.clf.gz")': "prepare: log is of type str: give the log from jaxslam.read_log",
    'jaxslam.prepare(log, {"num_particles": 4})': "prepare: config is of type dict: give a SlamConfig, such",
    "jaxslam.prepare(log, SlamConfig(proposal=Sized()))": "Sized.num is a size or a choice, but not static: "
    "declare it as equinox.field(static=True, default=4)",
    'jaxslam.prepare_localization(log, "room.yaml")': "prepare_localization: map is of type str: give the",
    "jaxslam.run_log(scans, slam, key)": "run_log: slam is of type PreparedScans: give slam and scans, as in",
    "jaxslam.run_log(slam, log, key)": "run_log: scans is of type SensorLog: give slam and scans, as in",
    "jaxslam.run_log(slam, scans, key=0)": "run_log: key is 0: give jax.random.key(0)",
    "jaxslam.run_log(slam, scans, keys)": "run_log: key is key<fry>[2]: give jax.random.key(0)",
    "jaxslam.run_log(bare, scans, key)": "Bare: sample must return a jaxslam.proposal.Prop",
    "jaxslam.localize_log(slam, scans, key)": "localize_log: amcl is of type RBPF: give amcl and scans",
    "jaxslam.localize_log(amcl, scans, 3)": "localize_log: key is 3: give jax.random.key(0)",
    "jaxslam.run_many(slam, log, keys)": "run_many: scans is of type SensorLog: give slam and scans, as in",
    "jaxslam.run_many(slam, scans, keys=[0, 1])": "run_many: keys are [0, 1]: give jax.random.split(",
    "jaxslam.run_many(slam, scans, keys=key)": "run_many: keys are key<fry>[]: give jax.random.split(",
    "jaxslam.sim.drive(key=1)": "drive: key is 1: give jax.random.key(0)",
    'SlamConfig(num_particles="4")': "num_particles is '4': give a whole number",
    "jaxslam.LocalizationConfig(max_particles=2.5)": "max_particles is 2.5: give a whole number",
    "jaxslam.sim.drive(duration=3, key=jax.random.PRNGKey(0))": "nothing",
}


@pytest.fixture(scope="module")
def answers() -> dict[str, str]:
    program = f"""{PREPARATION}
for slip in {list(SLIPS)}:
    try:
        eval(slip)
        print("nothing")
    except (TypeError, ValueError) as error:
        print(error)
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    return dict(zip(SLIPS, done.stdout.splitlines(), strict=True))


@pytest.mark.parametrize("slip", SLIPS)
def test_a_slip_is_answered_in_one_line(answers, slip):
    assert answers[slip].startswith(SLIPS[slip])
