import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.legend import Legend

from jaxslam.viz import plot_errors, plot_ess
from jaxslam.viz.style import add_legend

TIMES = np.array([0.0, 1.0, 2.0])


def band_of(ax: Axes) -> tuple[list[float], list[float]]:
    """Lowest and highest value of the band at each of `TIMES`."""
    vertices = ax.collections[0].get_paths()[0].vertices
    heights = [vertices[np.isclose(vertices[:, 0], time), 1] for time in TIMES]
    return [h.min() for h in heights], [h.max() for h in heights]


def test_one_run_is_a_line_without_a_band(ax):
    assert plot_errors(TIMES, np.array([0.1, 0.2, 0.3]), ax=ax) is ax
    np.testing.assert_array_equal(ax.lines[0].get_xydata(), [[0, 0.1], [1, 0.2], [2, 0.3]])
    assert len(ax.collections) == 0
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("time (s)", "position error (m)")
    assert ax.get_legend() is None


def test_seeds_become_a_mean_and_a_band_of_one_deviation(ax):
    errors = np.array([[1.0, 2.0, 0.0], [3.0, 2.0, 4.0]])
    plot_errors(TIMES, errors, ax=ax, label="15 particles")
    np.testing.assert_allclose(ax.lines[0].get_ydata(), [2, 2, 2])
    low, high = band_of(ax)
    # Deviations 1, 0 and 2.
    np.testing.assert_allclose(low, [1, 2, 0])
    np.testing.assert_allclose(high, [3, 2, 4])
    assert ax.get_legend().get_texts()[0].get_text() == "15 particles"


def test_headings_are_drawn_in_degrees_with_the_given_band(ax):
    plot_errors(TIMES, np.deg2rad([-1.0, 0, 2]), np.deg2rad([1.0, 1, 1]), ax, quantity="heading")
    np.testing.assert_allclose(ax.lines[0].get_ydata(), [-1, 0, 2], atol=1e-12)
    low, high = band_of(ax)
    np.testing.assert_allclose(low, [-2, -1, 1])
    np.testing.assert_allclose(high, [0, 1, 3])
    assert ax.get_ylabel() == "heading error (°)"


def test_a_band_of_distances_stops_at_zero(ax):
    plot_errors(TIMES, np.array([0.1, 1.0, 1.0]), np.array([0.5, 0.5, 0.5]), ax)
    assert band_of(ax)[0] == pytest.approx([0.0, 0.5, 0.5])


def test_lost_seeds_are_left_out_and_gaps_stay_gaps(ax):
    errors = np.array([[1.0, np.nan, np.nan], [3.0, 2.0, np.nan]])
    plot_errors(TIMES, errors, ax=ax)
    np.testing.assert_array_equal(ax.lines[0].get_ydata(), [2, 2, np.nan])
    ax.figure.canvas.draw()


@pytest.mark.parametrize(
    ("errors", "band", "quantity", "message"),
    [
        (np.zeros(2), None, "position", r"shape \(2,\) for 3 stamps"),
        (np.zeros((2, 2, 3)), None, "position", r"shape \(2, 2, 3\)"),
        (np.zeros(3), np.zeros(2), "position", r"band has shape \(2,\)"),
    ],
)
def test_bad_errors_are_one_clear_line(ax, errors, band, quantity, message):
    with pytest.raises(ValueError, match=message):
        plot_errors(TIMES, errors, band, ax, quantity=quantity)


def test_ess_shows_threshold_and_resampled_steps(ax):
    ess = np.array([30.0, 20.0, 12.0, 30.0])
    assert plot_ess(ess, 30, np.array([False, False, True, False]), ax) is ax
    line, threshold, marks = ax.lines
    np.testing.assert_array_equal(line.get_ydata(), ess)
    np.testing.assert_array_equal(threshold.get_ydata(), [15, 15])
    np.testing.assert_array_equal(marks.get_xdata(), [2])
    assert ax.get_ylim()[0] == 0
    assert ax.get_ylim()[1] > 30
    assert ax.get_xlabel() == "step"
    assert ax.get_ylabel() == "effective sample size (of 30)"


def test_marks_that_are_not_there_do_not_take_up_room():
    """The picture of a run that never resampled has no empty margin."""
    rooms = []
    for resampled in (None, np.array([False, False])):
        figure = Figure(figsize=(8, 6), dpi=50)
        canvas = FigureCanvasAgg(figure)
        ax = figure.subplots()
        plot_ess(np.array([30.0, 29.0]), 30, resampled, ax)
        rooms.append(ax.get_tightbbox(canvas.get_renderer()).bounds)
    assert ax.lines[-1].get_label() == "resampled (0)"
    assert rooms[1] == pytest.approx(rooms[0])


def test_bad_ess_is_one_clear_line(ax):
    with pytest.raises(ValueError, match="1 resampled flags for 2 steps"):
        plot_ess(np.ones(2), 30, np.array([True]), ax)
    with pytest.raises(ValueError, match="num_particles is 0"):
        plot_ess(np.ones(2), 0, ax=ax)


@pytest.mark.parametrize(("count", "place"), [(100, "best"), (20_000, "upper left")])
def test_a_legend_is_not_looked_a_place_for_among_many_points(count, place):
    """matplotlib warns of what that costs, on a busy machine only."""
    ax = Figure().subplots()
    ax.plot(np.zeros(count), np.zeros(count), ".", label="readings")
    add_legend(ax)
    assert ax.get_legend()._loc == Legend.codes[place]


def test_nothing_with_a_label_has_no_legend():
    ax = Figure().subplots()
    ax.plot([0.0, 1.0], [0.0, 1.0])
    add_legend(ax)
    assert ax.get_legend() is None
