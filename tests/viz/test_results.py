"""The picture of a run."""

import jax.numpy as jnp
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from jaxslam.grid import GridSpec
from jaxslam.pipeline.run import RunResult
from jaxslam.slam import StepInfo
from jaxslam.viz import plot_run


@pytest.fixture
def result() -> RunResult:
    """Four steps along a free row of cells with a wall above it, two particles."""
    log_odds = np.zeros((10, 40), np.int8)
    log_odds[4], log_odds[6] = -10, 60
    path = np.stack([np.linspace(1.0, 3.0, 4), np.full(4, 0.45), np.zeros(4)], axis=1)
    return RunResult(
        stamps=np.arange(4.0),
        trajectory=path,
        all_stamps=np.arange(4.0),
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
        ms_per_scan=1.0,
        warnings=(),
    )


def test_map_path_and_particles_lie_on_each_other(result):
    figure = Figure(figsize=(4, 3), dpi=50)
    FigureCanvasAgg(figure)
    ax = figure.subplots()
    assert plot_run(result, ax, label="mine") is ax
    # Known rows 4 to 6 of 10 cm and half a metre round them, as far as the map goes.
    assert ax.images[0].get_extent() == pytest.approx((0.0, 4.0, 0.0, 1.0))
    np.testing.assert_array_equal(ax.lines[0].get_xydata(), result.trajectory[:, :2])
    ticks, dots = ax.collections
    np.testing.assert_allclose(dots.get_offsets(), result.particles[:, :2])
    # The heavy particle is the darker one.
    assert dots.get_alpha()[0] > dots.get_alpha()[1]
    assert len(ticks.get_segments()) == 2
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["mine", "start", "end", "particles"]
    figure.canvas.draw()


def test_the_legend_can_be_left_to_the_figure(result):
    ax = Figure().subplots()
    plot_run(result, ax, legend=False)
    assert ax.get_legend() is None
