import io

import jax.numpy as jnp
import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.axes import Axes

from jaxslam.core.types import LidarScan
from jaxslam.viz import plot_map, plot_particles, plot_scan, plot_trajectory, plot_walls


def rendered(ax: Axes, dpi: float = 50) -> np.ndarray:
    """Gray values of the saved picture, without frame, ticks and margins."""
    ax.set_axis_off()
    ax.set_position((0, 0, 1, 1))
    ax.figure.set_dpi(dpi)
    canvas = ax.figure.canvas
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].mean(axis=-1)


def grid_map() -> np.ndarray:
    """A free square with one-cell walls every 37 cells, in unknown space."""
    probability = np.full((1000, 1000), 0.5)
    probability[100:900, 200:1000] = 0.02
    probability[100:900:37, 200:1000] = 0.98
    return probability


def test_map_extent_is_the_known_part_in_meters(ax):
    assert plot_map(grid_map(), 0.05, np.array([-10.0, 5.0]), ax, margin_m=0.5) is ax
    # Rows 100–900 and columns 200–1000 of 5 cm, half a meter of margin where the map has it.
    assert ax.images[0].get_extent() == pytest.approx((-0.5, 40.0, 9.5, 50.5))
    assert ax.get_xlim() == pytest.approx((-0.5, 40.0))
    assert (ax.get_xlabel(), ax.get_ylabel(), ax.get_aspect()) == ("x (m)", "y (m)", 1.0)


@pytest.mark.parametrize("dpi", [20, 31, 50, 97])
def test_thin_walls_survive_a_picture_with_fewer_pixels_than_cells(ax, dpi):
    plot_map(grid_map(), 0.05, np.zeros(2), ax, margin_m=0.0)
    picture = rendered(ax, dpi)
    assert max(picture.shape) < 800
    # Down a column of pixels every wall is one dark run, never lost or gray.
    dark = picture[:, picture.shape[1] // 2] < 30
    runs = int((np.diff(np.concatenate([[0], dark.astype(int)])) == 1).sum())
    assert runs == len(range(100, 900, 37))


def test_walls_survive_in_saved_files_of_any_dpi_without_a_prior_draw(ax):
    plot_map(grid_map(), 0.05, np.zeros(2), ax, margin_m=0.0)
    buffer = io.BytesIO()
    ax.figure.savefig(buffer, dpi=30, format="rgba")
    pixels = np.frombuffer(buffer.getvalue(), np.uint8).reshape(120, 120, 4)[..., 0]
    # Walls are 1.9 m apart, 93 px of axes hold 40 m: each of 22 walls must darken a row.
    middle = pixels[:, 62] < 30
    assert int((np.diff(np.concatenate([[0], middle.astype(int)])) == 1).sum()) >= 22


def test_zooming_in_shows_single_cells(ax):
    plot_map(grid_map(), 0.05, np.zeros(2), ax, margin_m=0.0)
    rendered(ax)
    ax.set_xlim(20.0, 20.5)
    ax.set_ylim(100 * 0.05 + 36 * 0.05, 100 * 0.05 + 46 * 0.05)
    picture = rendered(ax)
    # Ten cells in height, of which the second from the bottom is a wall.
    rows = picture[:, picture.shape[1] // 2] < 30
    assert rows.mean() == pytest.approx(0.1, abs=0.02)
    assert np.flatnonzero(rows).mean() / len(rows) == pytest.approx(0.85, abs=0.02)


def test_row_zero_is_at_the_bottom(ax):
    probability = np.full((4, 4), 0.01)
    probability[0] = 0.99
    plot_map(probability, 1.0, np.zeros(2), ax, margin_m=0.0)
    picture = rendered(ax)
    assert picture[-10].max() < 30
    assert picture[10].min() > 225


def test_an_unknown_map_is_drawn_whole_and_gray(ax):
    plot_map(np.zeros((30, 20), np.int8), 0.1, np.zeros(2), ax)
    assert ax.images[0].get_extent() == pytest.approx((0, 2, 0, 3))
    assert len(np.unique(rendered(ax)[50:-50, 90:-90])) == 1


def test_map_takes_what_the_filter_holds(ax):
    plot_map(jnp.full((5, 5), -20, jnp.int8), jnp.asarray(0.05), jnp.zeros(2), ax)
    assert ax.images[0].get_extent() == pytest.approx((0, 0.25, 0, 0.25))


def test_bad_resolution_is_one_clear_line(ax):
    with pytest.raises(ValueError, match="resolution is 0"):
        plot_map(grid_map(), 0.0, np.zeros(2), ax)


POSES = np.array([[0.0, 0, 0], [1, 2, 0.5], [3, 4, 1.0]])


def test_trajectory_has_line_start_end_and_legend(ax):
    assert plot_trajectory(POSES, ax, label="estimate") is ax
    path, start, end = ax.lines
    np.testing.assert_array_equal(path.get_xydata(), POSES[:, :2])
    np.testing.assert_array_equal(start.get_xydata(), POSES[:1, :2])
    np.testing.assert_array_equal(end.get_xydata(), POSES[-1:, :2])
    assert start.get_marker() != end.get_marker()
    texts = [text.get_text() for text in ax.get_legend().get_texts()]
    assert texts == ["estimate", "start", "end"]
    assert ax.get_xlabel() == "x (m)"


def test_a_second_trajectory_does_not_repeat_start_and_end(ax):
    plot_trajectory(POSES, ax, label="estimate")
    plot_trajectory(POSES + 1, ax, label="reference", linestyle="--")
    texts = [text.get_text() for text in ax.get_legend().get_texts()]
    assert texts == ["estimate", "start", "end", "reference"]


def test_trajectory_leaves_a_gap_at_a_nan_and_starts_after_it(ax):
    poses = np.concatenate([[[np.nan, 0, 0]], POSES, [[5.0, 5.0, np.nan]]])
    plot_trajectory(poses, ax)
    path, start, end = ax.lines
    assert np.isnan(path.get_xydata()[[0, 4]]).all()
    np.testing.assert_array_equal(start.get_xydata(), POSES[:1, :2])
    np.testing.assert_array_equal(end.get_xydata(), POSES[-1:, :2])
    rendered(ax)


def test_one_pose_is_a_point_and_none_is_an_error(ax):
    plot_trajectory(POSES[:1], ax)
    rendered(ax)
    for poses, count in ((POSES[:0], 0), (POSES * np.nan, 3)):
        with pytest.raises(ValueError, match=f"none of the {count} poses is finite"):
            plot_trajectory(poses, ax)


def test_particles_have_ticks_along_their_headings_and_fade_with_weight(ax):
    poses = np.array([[0.0, 0, 0], [1, 1, np.pi / 2], [np.nan, 0, 0]])
    plot_particles(poses, np.array([1.0, 0.25, 1.0]), ax, tick_m=0.5)
    ticks, dots = ax.collections
    first, second = ticks.get_segments()
    np.testing.assert_allclose(first, [[0, 0], [0.5, 0]], atol=1e-12)
    np.testing.assert_allclose(second, [[1, 1], [1, 1.5]], atol=1e-12)
    np.testing.assert_array_equal(dots.get_offsets(), poses[:2, :2])
    np.testing.assert_allclose(dots.get_alpha(), [1.0, 0.55])
    rendered(ax)


def test_particles_that_all_vanish_do_not_crash(ax):
    plot_particles(POSES * np.nan, ax=ax)
    assert len(ax.collections) == 0
    plot_particles(POSES, np.zeros(3), ax)
    assert len(ax.collections) == 2
    rendered(ax)


def test_bad_weights_are_one_clear_line(ax):
    with pytest.raises(ValueError, match="2 weights for 3 particles"):
        plot_particles(POSES, np.ones(2), ax)
    with pytest.raises(ValueError, match="not log-weights"):
        plot_particles(POSES, np.array([-1.0, -2.0, -3.0]), ax)


def test_scan_points_lie_where_the_beams_end(ax):
    scan = LidarScan(
        ranges=jnp.array([2.0, 0.0, 1.0]),
        valid=jnp.array([True, False, True]),
        angle_min=jnp.asarray(-jnp.pi / 2),
        angle_increment=jnp.asarray(jnp.pi / 2),
        pose_base_lidar=jnp.array([0.5, 0.0, 0.0]),
    )
    plot_scan(scan, np.array([1.0, 1.0, np.pi / 2]), ax)
    # Lidar at (1, 1.5) looking along +y: beams at −90° and +90° end 2 m right and 1 m left of it.
    points = ax.collections[0].get_offsets()
    np.testing.assert_allclose(points, [[3.0, 1.5], [0.0, 1.5]], atol=1e-6)
    np.testing.assert_allclose(ax.lines[0].get_xydata(), [[1.0, 1.5]], atol=1e-6)
    with pytest.raises(ValueError, match="pose_world_base is"):
        plot_scan(scan, np.array([np.nan, 0, 0]), ax)


def test_walls_are_lines_from_end_to_end(ax):
    segments = jnp.asarray([[0.0, 1.0, 4.0, 1.0], [4.0, 1.0, 4.0, 3.0]], jnp.float32)
    assert plot_walls(segments, ax) is ax
    [lines] = ax.collections
    np.testing.assert_array_equal(lines.get_segments(), [[[0, 1], [4, 1]], [[4, 1], [4, 3]]])
    assert (lines.get_label(), ax.get_xlabel(), ax.get_aspect()) == ("true walls", "x (m)", 1.0)
    # Alone on the axes they are all in sight.
    assert ax.get_xlim()[0] < 0.0 < 4.0 < ax.get_xlim()[1]
    with pytest.raises(ValueError, match="segment 1 is not finite"):
        plot_walls(segments.at[1, 2].set(np.nan), ax)


def test_without_axes_pyplots_current_ones_are_used_and_settings_stay():
    import matplotlib.pyplot as plt

    plt.switch_backend("Agg")
    before = dict(mpl.rcParams)
    figure, current = plt.subplots()
    assert plot_map(grid_map(), 0.05, np.zeros(2)) is current
    assert plot_trajectory(POSES) is current
    plt.close(figure)
    assert dict(mpl.rcParams) == before
