"""A filter that corrects its ranges is the same filter fed with scans that were corrected beforehand."""

import dataclasses

import chex
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxslam.config.dotted import update
from jaxslam.config.localization import LocalizationConfig
from jaxslam.core.flags import Flag
from jaxslam.core.types import StepInputs
from jaxslam.grid import GridSpec, OccupancyModel
from jaxslam.motion import OdometryMotion
from jaxslam.pipeline.build import build_localizer
from jaxslam.proposal import MotionProposal
from jaxslam.range_network import RangeNetwork
from jaxslam.resampling import AdaptiveResampling, SystematicResampler
from jaxslam.sensor import LikelihoodField
from jaxslam.slam import RBPF
from tests import builders
from tests.builders import hall_map
from tests.checks import jit_once

NUM_BEAMS, NUM_STEPS = 24, 2
START = jnp.array([9.0, 1.4, 0.3])
# These come back with nothing; the others read 1 to 3 m.
SILENT = np.arange(NUM_BEAMS) % 5 == 2


@pytest.fixture(scope="module")
def network() -> RangeNetwork:
    """One that makes everything longer; what did not come back as well, were it asked."""
    drawn = RangeNetwork.draw(jax.random.key(1), 8, 0.5, 3.0)
    bent = eqx.tree_at(
        lambda n: (n.weights_out, n.bias_out), drawn, (1.1 * drawn.weights_out, drawn.bias_out + 0.25)
    )
    assert (bent(jnp.linspace(0.0, 4.0, 50)) - jnp.linspace(0.0, 4.0, 50) > 0.05).all()
    return bent


@pytest.fixture(scope="module")
def rbpf() -> RBPF:
    return RBPF(
        grid=GridSpec.covering(np.array([4.0, -4.0]), np.array([14.0, 6.0]), 0.1),
        motion=OdometryMotion(),
        sensor=LikelihoodField(max_beams=NUM_BEAMS, independent_beams=0.5 * NUM_BEAMS),
        proposal=MotionProposal(),
        resampling=AdaptiveResampling(SystematicResampler(), 0.5),
        occupancy=OccupancyModel(),
        usable_range=3.2,
        num_particles=3,
        window_size=64,
    )


@pytest.fixture(scope="module")
def amcl():
    configuration = update(LocalizationConfig(), {"max_particles": 600, "min_particles": 50})
    return build_localizer(configuration, hall_map()[0])


def inputs_of(index: int) -> StepInputs:
    ranges = 1.0 + (np.arange(NUM_BEAMS) * (7 + 2 * index) % NUM_BEAMS) / 12
    delta = np.array([0.1, 0.0, 0.05]) * index
    return builders.inputs_of(delta, np.where(SILENT, 0.0, ranges), angle_min=-np.pi)


def begin(slam):
    if isinstance(slam, RBPF):
        return slam.init(jax.random.key(0), START)
    return slam.init(jax.random.key(0), START, jnp.diag(jnp.array([0.1, 0.1, 0.02])))


@jax.jit
def step(slam, key, state, inputs):
    return slam.step(key, state, inputs)


@jax.jit
def step_of_corrected(slam, network, key, state, inputs):
    """Corrects before the filter sees the scan; the same operations in one program, hence the same bits."""
    return slam.step(key, state, eqx.tree_at(lambda i: i.scan, inputs, network.correct(inputs.scan)))


def run(step, slam):
    state, infos = begin(slam), []
    for index in range(NUM_STEPS):
        state, info = step(slam, jax.random.key(10 + index), state, inputs_of(index))
        infos.append(info)
    return state, infos


def with_scans(change):
    """A step of scans that are changed on the host."""

    def changed(slam, key, state, inputs):
        return step(slam, key, state, eqx.tree_at(lambda i: i.scan, inputs, change(inputs.scan)))

    return changed


def numbers(tree) -> list[np.ndarray]:
    return [np.asarray(leaf) for leaf in jax.tree.leaves(tree)]


def same_bits(one, other) -> bool:
    pairs = zip(numbers(one), numbers(other), strict=True)
    return all(a.dtype == b.dtype and a.tobytes() == b.tobytes() for a, b in pairs)


@pytest.mark.parametrize("name", ["rbpf", "amcl"])
def test_the_same_as_with_scans_that_were_corrected_beforehand(name, network, request):
    plain = request.getfixturevalue(name)
    assert plain.range_network is None
    found = run(step, dataclasses.replace(plain, range_network=network))
    assert same_bits(found, run(lambda slam, *rest: step_of_corrected(slam, network, *rest), plain))

    def by_hand(scan):
        """What returned is corrected, and what did not stays at 0."""
        corrected = np.where(SILENT, np.float32(0.0), np.asarray(network(scan.ranges)))
        return eqx.tree_at(lambda s: s.ranges, scan, jnp.asarray(corrected))

    # In another program a correction may round its last bit otherwise.
    for correct in (network.correct, by_hand):
        _, infos = run(with_scans(correct), plain)
        chex.assert_trees_all_close(infos, found[1], rtol=1e-3, atol=1e-4)
    # It does make a difference, and so does a second correction.
    twice = with_scans(lambda scan: network.correct(network.correct(scan)))
    assert not same_bits(found, run(step, plain))
    for other in (run(step, plain), run(twice, plain)):
        weights = [np.asarray(infos[-1].ess) for _, infos in (found, other)]
        assert abs(weights[0] - weights[1]) > 1e-3


@pytest.mark.parametrize("name", ["rbpf", "amcl"])
def test_the_network_is_traced(name, network, request):
    """Another one of its size needs no other compilation."""
    plain, other = request.getfixturevalue(name), jax.tree.map(lambda leaf: 0.9 * leaf, network)
    counted, ess = jit_once(lambda slam, key, state, inputs: slam.step(key, state, inputs)), []
    for used in (network, other):
        # The first scan meets an empty map and says nothing; the second one does.
        _, infos = run(counted, dataclasses.replace(plain, range_network=used))
        ess.append(infos[-1].ess)
    assert abs(ess[0] - ess[1]) > 1e-3


def silent(inputs: StepInputs) -> StepInputs:
    scan = inputs.scan
    nothing = jnp.zeros_like(scan.ranges), jnp.zeros_like(scan.valid)
    return eqx.tree_at(lambda i: (i.scan.ranges, i.scan.valid), inputs, nothing)


def test_a_map_learns_nothing_of_beams_without_return(network, rbpf):
    correcting = dataclasses.replace(rbpf, range_network=network)
    state, _ = step(correcting, jax.random.key(1), begin(rbpf), silent(inputs_of(0)))
    assert not np.asarray(state.maps).any()
    state, _ = step(correcting, jax.random.key(1), begin(rbpf), inputs_of(0))
    assert np.asarray(state.maps).any()


def test_a_localization_counts_no_beam_without_return(network, amcl):
    correcting = dataclasses.replace(amcl, range_network=network)
    _, info = step(correcting, jax.random.key(1), begin(amcl), silent(inputs_of(0)))
    assert int(info.flags) & Flag.FEW_VALID_BEAMS.value
    _, info = step(correcting, jax.random.key(1), begin(amcl), inputs_of(0))
    assert not int(info.flags) & Flag.FEW_VALID_BEAMS.value
