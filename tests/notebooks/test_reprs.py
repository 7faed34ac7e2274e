"""How a notebook shows the value at the end of a cell: one line, a picture, not pages of arrays."""

import dataclasses
from pathlib import Path
from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest
from matplotlib.figure import Figure

from jaxslam.config.slam import SlamConfig
from jaxslam.config.thinning import Thinning
from jaxslam.core.flags import Flag
from jaxslam.core.trajectory import Trajectory
from jaxslam.fusion import FusedMotion
from jaxslam.grid import KnownMap
from jaxslam.io import OccupancyMap
from jaxslam.io.log import FixTrack, ImuTrack, JointTrack, OdometryTrack, ScanTrack, SensorLog
from jaxslam.localization import AMCLInfo, Cluster
from jaxslam.pipeline.build import build_slam
from jaxslam.pipeline.inputs import pair_scans
from jaxslam.pipeline.localize import Cloud, LocalizationResult
from jaxslam.pipeline.run import RunResult, Snapshot
from jaxslam.slam import StepInfo

STAMPS = 100.0 + 0.5 * np.arange(500)
POSES = np.stack([0.01 * np.arange(500), 0.004 * np.arange(500), np.zeros(500)], axis=1)
MATRIX = np.zeros((500, 3))
ODOMETRY = OdometryTrack(STAMPS, POSES, MATRIX, "odom")
IMU = ImuTrack(STAMPS[:300], np.zeros((300, 4)), MATRIX[:300], MATRIX[:300], np.eye(3), True, "imu/data")
JOINTS = JointTrack(STAMPS[:7], ("left", "right"), np.zeros((7, 2)), np.zeros((7, 2)), "joint_states")
FIXES = FixTrack(STAMPS[:0], MATRIX[:0], "fix")
SCANS = ScanTrack(
    STAMPS[:400],
    np.ones((400, 36), np.float32),
    np.full(400, 36),
    np.zeros(400),
    np.full(400, 0.1),
    0.1,
    5.0,
    np.zeros(3),
    True,
    "FLASER",
)
LOG = SensorLog(Path("logs/a.log"), odometry=ODOMETRY, scans=SCANS)
# Steps of 1.08 cm: every fourth scan is processed.
SCANS_100 = pair_scans(LOG, Thinning(min_translation=0.04))


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (ODOMETRY, "OdometryTrack(500 poses on odom, 249.5 s)"),
        (IMU, "ImuTrack(300 readings on imu/data, 149.5 s)"),
        (JOINTS, "JointTrack(7 readings on joint_states, 3.0 s, left, right)"),
        (FIXES, "FixTrack(0 fixes on fix)"),
        (Trajectory(STAMPS, POSES), "Trajectory(500 poses, 5.4 m, 249.5 s)"),
        (Trajectory(STAMPS[:0], POSES[:0]), "Trajectory(0 poses, 0.0 m, 0.0 s)"),
        (SCANS, "ScanTrack(400 scans on FLASER, 199.5 s, 36 beams)"),
        (LOG, f"SensorLog({Path('logs/a.log')}: 400 scans, 500 odometry poses)"),
        (
            dataclasses.replace(LOG, imu=IMU, joints=JOINTS, fixes=FIXES, warnings=("one", "two")),
            f"SensorLog({Path('logs/a.log')}: 400 scans, 500 odometry poses, 300 IMU readings, "
            "7 joint readings, 0 fixes, 2 warnings)",
        ),
        (SensorLog(Path("empty")), "SensorLog(empty: nothing)"),
    ],
    ids=lambda value: type(value).__name__,
)
def test_a_log_and_its_tracks_are_counted(value, shown):
    assert repr(value) == shown


def test_prepared_scans_count_scans_and_measure_the_odometry():
    scans = pair_scans(LOG, Thinning(min_translation=0.1))
    # Steps of 1.08 cm: every tenth is the first over 10 cm.
    assert repr(scans) == "PreparedScans(40 of 400 scans of 36 beams, odometry within 5.0 × 2.0 m)"


def test_clouds_and_snapshots_count_particles_and_scans():
    cloud = Cloud(POSES[:3], POSES[:20], np.full(20, 0.05), 101.0)
    assert repr(cloud) == "Cloud(20 particles after 3 scans)"
    snapshot = Snapshot(np.zeros((4, 4), np.int8), POSES[:6], POSES[:2])
    assert repr(snapshot) == "Snapshot(2 particles after 6 scans)"


@pytest.mark.parametrize(
    ("agreed", "shown", "warned"),
    [
        (slice(0, 0), "not converged", ", 1 warnings"),
        (slice(6, 100), "converged after 12 s", ""),
        (slice(6, 50), "converged after 12 s, lost at the end", ", 1 warnings"),
    ],
)
def test_a_localization_says_whether_it_converged(agreed, shown, warned):
    converged = np.zeros(100, bool)
    converged[agreed] = True
    none = jnp.zeros(100, bool)
    counts, numbers = jnp.zeros(100, jnp.int32), jnp.zeros(100)
    infos = AMCLInfo(
        estimate=Cluster(jnp.zeros((100, 3)), jnp.zeros((100, 3, 3)), numbers),
        num_particles=counts,
        num_random=counts,
        ess=numbers,
        resampled=none,
        converged=jnp.asarray(converged),
        lost=none,
        match_score=numbers,
        flags=counts,
    )
    free = np.ones((60, 120), bool)
    free[0] = False
    result = LocalizationResult(
        scans=SCANS_100,
        map=KnownMap.from_map(OccupancyMap(~free, free, 0.1, np.zeros(3))),
        scored_beams=36,
        estimates=POSES[:100],
        covariances=np.zeros((100, 3, 3)),
        all_poses=POSES[:400],
        particles=POSES[:20],
        weights=np.full(20, 0.05),
        infos=infos,
        odometry=POSES[:100],
        compile_s=1.0,
        run_s=0.25,
    )
    expected = f"100 scans, {shown}, 20 particles at the end, 2.5 ms per scan{warned}"
    assert repr(result) == f"LocalizationResult({expected})"
    assert_shows_itself(result, "100 processed of 400", "20 at the end")
    walls = np.array([[0.0, 0.0, 12.0, 0.0]])
    truth = SimpleNamespace(stamps=STAMPS[:100], poses=POSES[:100] + 0.5, walls=walls)
    if not agreed.stop:
        with pytest.raises(ValueError, match="the particles never agreed"):
            result.error(truth)
    else:
        # Half a meter in x and in y, in the frame of the map, from the seventh processed scan on.
        error = result.error(truth)
        assert (error.n, error.rmse_m) == (100 - 24, pytest.approx(np.sqrt(0.5)))
        assert result.error(truth, align="se2").rmse_m == pytest.approx(0.0, abs=1e-9)
    ax = result.plot(Figure().subplots(), truth=truth)
    names = [text.get_text() for text in ax.get_legend().get_texts()]
    assert {"true path", "true walls", "last scan", "particles"} <= set(names)
    dashed = next(line for line in ax.lines if line.get_label() == "true path")
    np.testing.assert_allclose(dashed.get_xydata(), truth.poses[:, :2])


def test_scans_with_fused_odometry_say_so():
    fused = FusedMotion(
        STAMPS[:2], POSES[:2], MATRIX[:2], MATRIX[:2], np.zeros((2, 3, 3)), {"odometry": 3, "imu": 9}, {}
    )
    scans = pair_scans(LOG, Thinning())
    plain = repr(scans)
    assert repr(dataclasses.replace(scans, fused=fused)) == f"{plain[:-1]}, fused with 9 IMU readings)"


def test_a_result_says_scans_particles_map_and_speed():
    config = SlamConfig(num_particles=3).with_lidar("sick")
    slam = build_slam(config, np.array([[0.0, 0.0], [4.0, 2.0]]))
    infos = StepInfo(
        poses=jnp.zeros((100, 3, 3)),
        log_weights=jnp.zeros((100, 3)),
        ancestors=jnp.zeros((100, 3), jnp.int32),
        ess=jnp.zeros(100),
        resampled=jnp.zeros(100, bool),
        flags=jnp.zeros(100, jnp.int32),
    )
    result = RunResult(
        scans=SCANS_100,
        trajectory=POSES[:100],
        all_poses=POSES[:400],
        log_odds=np.ones((20, 30), np.int8),
        grid=slam.grid,
        particles=MATRIX[:3],
        log_weights=np.zeros(3, np.float32),
        infos=infos,
        compile_s=1.0,
        run_s=0.45,
    )
    shown = "100 scans, 3 particles, map 30 × 20 cells of 0.05 m, 4.5 ms per scan"
    assert repr(result) == f"RunResult({shown})"
    assert_shows_itself(result, "100 processed of 400", "1.5 × 1.0 m")
    infos = dataclasses.replace(infos, flags=jnp.full(100, Flag.FEW_VALID_BEAMS.value, jnp.int32))
    assert repr(dataclasses.replace(result, infos=infos)) == f"RunResult({shown}, 1 warnings)"


def assert_shows_itself(result, *figures):
    """Assert that a result has a picture, and HTML with the picture and these figures."""
    assert result._repr_png_().startswith(b"\x89PNG")
    shown = result._repr_html_()
    assert "data:image/png;base64," in shown
    for figure in figures:
        assert figure in shown
