"""The host's loop over a log: the same bytes as one scan over time, errors, warnings, what it reports."""

import dataclasses
import sys

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxslam.config.localization import LocalizationConfig
from jaxslam.config.thinning import Thinning
from jaxslam.core import se2
from jaxslam.core.flags import Flag
from jaxslam.core.names import MissingExtraError
from jaxslam.io.log import SensorLog
from jaxslam.matching import CorrelativeSearch
from jaxslam.pipeline.chunks import CHUNK, run_steps
from jaxslam.pipeline.inputs import PreparedScans, pair_scans
from jaxslam.pipeline.localize import localize_log
from jaxslam.pipeline.prepare import prepare_localization
from jaxslam.pipeline.run import RunResult, SlamError, Snapshot, run_log
from jaxslam.proposal import MatchedProposal
from jaxslam.slam import RBPF, trajectory
from jaxslam.xla.compiler import compiler_options
from tests.pipeline.drives import NUM_BEAMS, drive, small_filter

NUM_PARTICLES = 3
KEY = jax.random.key(7)
BLIND = [10, 11, 70]
"""Processed scans without a return, in both chunks."""


@pytest.fixture(scope="module")
def log() -> SensorLog:
    """Some 6 m of driving; the scans are closer together than the filter wants them."""
    return drive(0, 8.0, rate=20.0)


@pytest.fixture(scope="module")
def prepared(log) -> PreparedScans:
    return pair_scans(log, Thinning(0.06, 0.2))


@pytest.fixture(scope="module")
def slam(prepared) -> RBPF:
    search = CorrelativeSearch(num_translations=3, num_rotations=3)
    proposal = MatchedProposal(max_beams=NUM_BEAMS, search=search)
    return small_filter(prepared, proposal, num_particles=NUM_PARTICLES, threshold=0.5)


@pytest.fixture(scope="module")
def snapshots() -> list[Snapshot]:
    """Filled by `result`."""
    return []


@pytest.fixture(scope="module")
def result(slam, prepared, snapshots) -> RunResult:
    return run_log(slam, prepared, KEY, on_chunk=snapshots.append)


@pytest.fixture(scope="module")
def blind(prepared) -> PreparedScans:
    scan = prepared.inputs.scan
    dark = (scan.ranges.at[jnp.array(BLIND)].set(0.0), scan.valid.at[jnp.array(BLIND)].set(False))
    inputs = eqx.tree_at(lambda i: (i.scan.ranges, i.scan.valid), prepared.inputs, dark)
    return dataclasses.replace(prepared, inputs=inputs)


def test_the_log_fills_more_than_one_chunk_and_is_thinned(prepared):
    """What the other tests rely on."""
    assert CHUNK < len(prepared.stamps) < len(prepared.all_stamps)
    assert max(BLIND) < len(prepared.stamps)


def test_chunks_give_the_run_of_one_scan(slam, prepared, result):
    state = jax.jit(RBPF.init)(slam, KEY, jnp.asarray(prepared.pose0, jnp.float32))
    # Another code generator rounds in other places, as a loop of another length may.
    whole = jax.jit(run_steps, compiler_options=compiler_options())
    state, infos = whole(slam, prepared.inputs, KEY, state)
    best = jnp.argmax(state.log_weights)
    path = np.asarray(trajectory(infos, best), np.float64)
    np.testing.assert_allclose(result.trajectory, path, atol=1e-5)
    assert np.mean(result.log_odds != np.asarray(state.maps[best])) < 1e-3
    np.testing.assert_allclose(result.log_weights, state.log_weights, atol=1e-3)
    np.testing.assert_allclose(result.ess, infos.ess, rtol=1e-3)
    np.testing.assert_array_equal(result.resampled, infos.resampled)
    np.testing.assert_array_equal(result.flags, infos.flags)


def test_a_result_is_finite_and_has_its_shapes(prepared, result):
    steps = len(prepared.stamps)
    for values in (result.trajectory, result.all_poses, result.particles, result.log_weights, result.ess):
        assert np.isfinite(values).all()
    assert result.trajectory.shape == (steps, 3)
    assert result.ess.shape == result.flags.shape == result.resampled.shape == (steps,)
    assert result.particles.shape == (NUM_PARTICLES, 3)
    assert result.log_odds.shape == (result.grid.height, result.grid.width)
    assert result.log_odds.min() < 0 < result.log_odds.max()
    assert result.compile_s > 0
    assert result.ms_per_scan == pytest.approx(1e3 * result.run_s / steps)
    assert result.warnings == ()


def test_scans_between_the_processed_ones_follow_the_odometry(prepared, result):
    processed = np.searchsorted(prepared.all_index, prepared.scan_index)
    np.testing.assert_allclose(result.all_poses[processed], result.trajectory, atol=1e-9)
    np.testing.assert_array_equal(result.all_stamps, prepared.all_stamps)
    skipped = np.setdiff1d(np.arange(len(result.all_poses)), processed)
    last = processed[np.searchsorted(processed, skipped) - 1]
    moved = np.linalg.norm((result.all_poses[skipped] - result.all_poses[last])[:, :2], axis=1)
    driven = np.linalg.norm((prepared.all_odometry[skipped] - prepared.all_odometry[last])[:, :2], axis=1)
    assert driven.max() > 0.02
    # Led over to the next processed one: off by a share of what the filter corrected there, and no more.
    jumps = se2.relative(result.trajectory[:-1], result.trajectory[1:])
    wheels = se2.relative(prepared.all_odometry[processed][:-1], prepared.all_odometry[processed][1:])
    corrected = np.linalg.norm((jumps - wheels)[:, :2], axis=1).max()
    assert np.abs(moved - driven).max() <= corrected + 1e-9
    after = skipped > processed[-1]
    np.testing.assert_allclose(moved[after], driven[after], atol=1e-9)


def test_a_robot_is_localized_on_the_map_of_a_run_without_a_file(log, result):
    config = LocalizationConfig(max_particles=500).with_lidar("lds-01")
    localizer, scans = prepare_localization(log, result.occupancy(), config)
    start = tuple(float(value) for value in scans.pose0)
    localized = localize_log(localizer, scans, KEY, start, deviations=(0.1, 0.05))
    difference = localized.all_poses[-1] - result.all_poses[-1]
    # Two cells of the map: the localization also corrects what the filter with three particles got wrong.
    assert np.hypot(*difference[:2]) < 0.2


def test_a_watcher_sees_the_run_grow(prepared, result, snapshots):
    assert [len(snapshot.trajectory) for snapshot in snapshots] == [CHUNK, len(prepared.stamps)]
    np.testing.assert_array_equal(snapshots[-1].trajectory, result.trajectory)
    np.testing.assert_array_equal(snapshots[-1].log_odds, result.log_odds)
    assert (snapshots[0].log_odds != snapshots[-1].log_odds).any()


def test_scans_without_returns_are_warned_about(slam, blind, prepared):
    result = run_log(slam, blind, KEY)
    few = np.flatnonzero(result.flags & Flag.FEW_VALID_BEAMS)
    np.testing.assert_array_equal(few, BLIND)
    [warning] = result.warnings
    assert warning.startswith(f"3 of {len(prepared.stamps)} steps: scans had too few returns")
    assert np.isfinite(result.trajectory).all()


def test_a_map_that_is_too_small_is_an_error_that_says_where_and_what_to_do(slam, prepared):
    # The tour starts along +x: the map's right edge comes within the window's reach before the drive ends.
    right_edge = slam.grid.origin[0] + slam.grid.width * slam.grid.resolution
    too_far_left = prepared.odometry_bounds[1, 0] + 2.0 - right_edge
    origin = slam.grid.origin + jnp.asarray([too_far_left, 0.0], jnp.float32)
    moved = eqx.tree_at(lambda s: s.grid.origin, slam, origin)
    with pytest.raises(
        SlamError, match=r"edge of the map at scan \d+ \(t = .* s\): .*--map-margin"
    ) as caught:
        run_log(moved, prepared, KEY)
    assert "\n" not in str(caught.value)
    scan = int(str(caught.value).split("at scan ")[1].split()[0])
    assert scan in prepared.scan_index
    stamp = prepared.all_stamps[prepared.all_index == scan][0]
    assert f"t = {stamp:.3f} s" in str(caught.value)
    # For comparisons the run may go on, with a warning.
    result = run_log(moved, prepared, KEY, may_leave_map=True)
    assert len(result.trajectory) == len(prepared.stamps)
    assert any("edge of the map" in warning for warning in result.warnings)


def test_the_bar_names_the_compilation(slam, prepared, result, capsys):
    # `result` has compiled the program: the bar shows its first line all the same.
    run_log(slam, prepared, KEY, progress=True)
    shown = capsys.readouterr().err.replace("\r", "\n").splitlines()
    assert f"0/{len(prepared.stamps)}" in shown[1]
    assert shown[1].endswith("compiling]")
    assert f"{len(prepared.stamps)}/{len(prepared.stamps)}" in shown[-1]
    assert "compiling" not in shown[-1]


def test_without_tqdm_the_error_names_the_extra(slam, prepared, monkeypatch):
    monkeypatch.setitem(sys.modules, "tqdm", None)
    with pytest.raises(MissingExtraError, match=r"^tqdm is not installed: pip install 'jaxslam\[cli\]'$"):
        run_log(slam, prepared, KEY, progress=True)
