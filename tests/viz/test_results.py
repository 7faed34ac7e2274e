"""The picture of a run."""

from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from jaxslam.core import se2
from jaxslam.grid import GridSpec
from jaxslam.io.log import OdometryTrack
from jaxslam.io.map_server import read_map
from jaxslam.pipeline.inputs import PreparedScans
from jaxslam.pipeline.run import RunResult
from jaxslam.sim.recording import Truth
from jaxslam.sim.worlds.halls import hall_small
from jaxslam.slam import StepInfo
from jaxslam.viz import plot_run
from jaxslam.viz.raster import UNKNOWN_GRAY
from tests.builders import inputs_of


@pytest.fixture
def result() -> RunResult:
    """Four steps along a free row of cells with a wall above it, two particles."""
    log_odds = np.zeros((10, 40), np.int8)
    log_odds[4], log_odds[6] = -10, 60
    path = np.stack([np.linspace(1.0, 3.0, 4), np.full(4, 0.45), np.zeros(4)], axis=1)
    stamps, index = np.arange(4.0), np.arange(4)
    inputs = inputs_of(np.zeros((4, 3)), np.ones((4, 5)))
    odometry = OdometryTrack(stamps, path, np.zeros((4, 3)), "odom")
    return RunResult(
        scans=PreparedScans(
            inputs, path[0], stamps, index, index, stamps, path, np.zeros((2, 2)), odometry, num_scans=4
        ),
        trajectory=path,
        all_poses=path,
        log_odds=log_odds,
        grid=GridSpec.covering(np.zeros(2), np.array([4.0, 1.0]), 0.1),
        particles=np.array([[3.0, 0.45, 0.0], [2.9, 0.5, 0.1]]),
        log_weights=np.log(np.array([0.9, 0.1], np.float32)),
        infos=StepInfo(
            poses=jnp.zeros((4, 2, 3)),
            log_weights=jnp.zeros((4, 2)),
            ancestors=jnp.zeros((4, 2), jnp.int32),
            ess=jnp.ones(4),
            resampled=jnp.zeros(4, bool),
            flags=jnp.zeros(4, jnp.int32),
        ),
        compile_s=1.0,
        run_s=1.0,
    )


def test_map_path_and_particles_lie_on_each_other(result, ax):
    assert plot_run(result, ax) is ax
    # Known rows 4 to 6 of 10 cm and half a meter round them, as far as the map goes.
    assert ax.images[0].get_extent() == pytest.approx((0.0, 4.0, 0.0, 1.0))
    np.testing.assert_array_equal(ax.lines[0].get_xydata(), result.trajectory[:, :2])
    ticks, dots = ax.collections
    np.testing.assert_allclose(dots.get_offsets(), result.particles[:, :2])
    # The heavy particle is the darker one.
    assert dots.get_alpha()[0] > dots.get_alpha()[1]
    assert len(ticks.get_segments()) == 2
    labels = [text.get_text() for text in ax.get_legend().get_texts()]
    assert labels == ["estimated path", "start", "end", "particles"]
    ax.figure.canvas.draw()


def test_a_result_draws_itself_with_the_truth(result):
    truth = Truth(result.stamps, result.trajectory + 0.01, hall_small()[0])
    ax = result.plot(Figure().subplots(), truth=truth)
    labels = ax.get_legend_handles_labels()[1]
    assert {"true path", "true walls", "estimated path"} <= set(labels)
    # Walls beyond the cropped map lie on the gray of unknown space.
    assert ax.get_facecolor() == pytest.approx((UNKNOWN_GRAY / 255,) * 3 + (1.0,))


def test_the_truth_of_another_frame_is_drawn_where_the_error_compares_it(result):
    """The truth lies 100 m away and turned by a quarter; a step to the side of 5 cm is the only error."""
    side = np.array([0.05, -0.05, -0.05, 0.05])
    poses = se2.compose(
        np.array([[100.0, 50.0, np.pi / 2]]), result.trajectory + np.pad(side[:, None], ((0, 0), (1, 1)))
    )
    walls = np.array([[100.0, 50.0, 100.0, 54.0]])
    truth = SimpleNamespace(stamps=result.stamps, poses=poses, walls=walls)
    error = result.error(truth)
    assert (error.rmse_m, error.mean_m, error.max_m) == pytest.approx((0.05, 0.05, 0.05))
    assert (error.rot_rmse_deg, error.n) == (pytest.approx(0.0, abs=1e-9), 4)
    ax = result.plot(Figure().subplots(), truth=truth)
    drawn = next(line for line in ax.lines if line.get_label() == "true path").get_xydata()
    np.testing.assert_allclose(drawn[:, 1] - result.trajectory[:, 1], side, atol=1e-9)
    wall = next(lines for lines in ax.collections if lines.get_label() == "true walls").get_segments()[0]
    np.testing.assert_allclose(wall, [[0.0, 0.0], [4.0, 0.0]], atol=1e-9)
    unmoved = result.plot(Figure().subplots(), truth=truth, align=False)
    drawn = next(line for line in unmoved.lines if line.get_label() == "true path").get_xydata()
    np.testing.assert_allclose(drawn, poses[:, :2])
    assert result.error(truth, align=False).rmse_m > 100.0
    assert result.error(truth, align="first_pose").max_m == pytest.approx(0.1)
    with pytest.raises(ValueError, match="0 of the 4 reference poses"):
        result.error(SimpleNamespace(stamps=result.stamps + 90.0, poses=poses))


def test_the_legend_covers_nothing_of_the_map(result):
    figure = Figure(figsize=(6, 5), layout="constrained")
    FigureCanvasAgg(figure)
    ax = result.plot(figure.subplots())
    figure.canvas.draw()
    legend, labels = ax.get_legend().get_window_extent(), ax.xaxis.get_tightbbox()
    assert 0 <= legend.y0 < legend.y1 <= labels.y0 < ax.bbox.y0


def test_a_result_shows_itself_in_a_notebook(result):
    page, png = result._repr_html_(), result._repr_png_()
    assert png.startswith(b"\x89PNG")
    assert "data:image/png;base64," in page
    for text in ("4 processed of 4", "250.00 ms per scan"):
        assert text in page


def test_a_result_saves_itself(result, tmp_path):
    picture = result.save(tmp_path / "new" / "run")
    assert picture == tmp_path / "new" / "run" / "map.png"
    names = {path.name for path in picture.parent.iterdir()}
    assert {"map.png", "map.yaml", "map.pgm", "trajectory.tum", "metrics.json", "run.json"} <= names
    saved = read_map(picture.with_name("map.yaml"))
    assert saved.occupied.sum() == 40
    # Cropped to what was seen, rows 4 to 6, and half a meter around as far as the map reaches.
    assert saved.occupied.shape == (10, 40)
    map = result.occupancy()
    np.testing.assert_array_equal(saved.occupied, map.occupied)
    np.testing.assert_array_equal(saved.free, map.free)
    np.testing.assert_array_equal(saved.origin, map.origin)
    assert saved.resolution == map.resolution
