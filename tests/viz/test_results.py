"""The picture of a run."""

import jax.numpy as jnp
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from jaxslam.grid import GridSpec
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
    return RunResult(
        scans=PreparedScans(inputs, path[0], stamps, index, index, stamps, path, np.zeros((2, 2)), 4),
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
    assert labels == ["estimate", "start", "end", "particles"]
    ax.figure.canvas.draw()


def test_a_result_draws_itself_with_the_truth(result):
    truth = Truth(result.stamps, result.trajectory + 0.01, hall_small()[0])
    ax = result.plot(Figure().subplots(), truth=truth)
    labels = ax.get_legend_handles_labels()[1]
    assert {"truth", "true walls", "estimate"} <= set(labels)
    # Walls beyond the cropped map lie on the gray of unknown space.
    assert ax.get_facecolor() == pytest.approx((UNKNOWN_GRAY / 255,) * 3 + (1.0,))


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
