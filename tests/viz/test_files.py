import base64
import io
import re
import time

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image

from jaxslam.viz import MapFrame, MapLayer, animate_inline, animate_map, save_map_picture

ORIGIN = np.array([-1.0, 2.0])


def room(height: int = 80, width: int = 120) -> np.ndarray:
    """A free room with one-cell walls in unknown space."""
    probability = np.full((height + 20, width + 20), 0.5)
    probability[10:-10, 10:-10] = 0.02
    probability[[10, -11], 10:-10] = 0.98
    probability[10:-10, [10, -11]] = 0.98
    return probability


POSES = np.stack([np.linspace(0, 3, 40), np.linspace(3, 5, 40), np.full(40, 0.6)], axis=1)


def pixels_of(path) -> np.ndarray:
    with Image.open(path) as image:
        return np.asarray(image.convert("RGB")).astype(int)


def has_color(pixels: np.ndarray, color: tuple[int, int, int], slack: int = 12) -> bool:
    return bool((np.abs(pixels - color).max(axis=-1) <= slack).any())


BLUE, VERMILLION, PURPLE = (0, 114, 178), (213, 94, 0), (204, 121, 167)


def test_picture_holds_map_path_and_particles(tmp_path):
    path = tmp_path / "map.png"
    cloud = POSES[-1] + np.random.default_rng(0).normal(0, 0.3, (30, 3))
    save_map_picture(path, room(), 0.05, ORIGIN, poses=POSES, particles=cloud)
    pixels = pixels_of(path)
    for color in (BLUE, PURPLE, (0, 0, 0), (255, 255, 255)):
        assert has_color(pixels, color)
    assert not has_color(pixels, VERMILLION)


def test_truth_gets_a_panel_of_the_same_extent(tmp_path, monkeypatch):
    saved: list[Figure] = []
    original = Figure.savefig

    def savefig(self, *arguments, **options):
        saved.append(self)
        return original(self, *arguments, **options)

    monkeypatch.setattr(Figure, "savefig", savefig)
    truth = MapLayer(room(120, 200), 0.05, ORIGIN - 1, POSES + 0.1)
    save_map_picture(tmp_path / "map.png", room(), 0.05, ORIGIN, poses=POSES, truth=truth)
    estimate_panel, truth_panel = saved[0].axes
    assert estimate_panel.get_xlim() == truth_panel.get_xlim()
    assert estimate_panel.get_ylim() == truth_panel.get_ylim()
    # Columns 0–220 of the truth from x = −2 m, rows 0–140 from y = 1 m: both margins are 10 cells.
    assert estimate_panel.get_xlim() == pytest.approx((-2.0, 9.0))
    assert estimate_panel.get_ylim() == pytest.approx((1.0, 8.0))
    boxes = [panel.get_window_extent() for panel in saved[0].axes]
    assert (boxes[0].width, boxes[0].height) == pytest.approx((boxes[1].width, boxes[1].height))
    assert (truth_panel.get_title(), truth_panel.get_ylabel()) == ("truth", "")
    # Estimate panel: both paths; truth panel: the true one only.
    assert (len(estimate_panel.lines), len(truth_panel.lines)) == (6, 3)
    assert has_color(pixels_of(tmp_path / "map.png"), VERMILLION)


def test_a_reference_is_drawn_over_the_estimate(tmp_path):
    path = tmp_path / "map.png"
    save_map_picture(path, room(), 0.05, ORIGIN, poses=POSES, truth=POSES + 0.2)
    assert has_color(pixels_of(path), BLUE)
    assert has_color(pixels_of(path), VERMILLION)


def test_pictures_leave_no_pyplot_figure_behind(tmp_path):
    import matplotlib.pyplot as plt

    before = plt.get_fignums()
    save_map_picture(tmp_path / "map.png", room(), 0.05, ORIGIN)
    assert plt.get_fignums() == before


@pytest.mark.parametrize("suffix", ["pdf", "svg"])
def test_vector_formats_are_written(tmp_path, suffix):
    path = tmp_path / f"map.{suffix}"
    save_map_picture(path, room(), 0.05, ORIGIN, poses=POSES)
    assert path.stat().st_size > 1000


def test_empty_map_and_single_pose_are_drawn(tmp_path):
    path = tmp_path / "map.png"
    save_map_picture(path, np.zeros((40, 40), np.int8), 0.05, ORIGIN, poses=POSES[:1])
    assert has_color(pixels_of(path), BLUE)


def test_bad_picture_input_is_one_clear_line(tmp_path):
    with pytest.raises(ValueError, match="none of the 2 poses is finite"):
        save_map_picture(tmp_path / "a.png", room(), 0.05, ORIGIN, poses=np.full((2, 3), np.nan))
    with pytest.raises(ValueError, match="resolution is -1"):
        save_map_picture(tmp_path / "a.png", room(), -1.0, ORIGIN)
    assert list(tmp_path.iterdir()) == []


def growing(count: int, shape=(600, 800)):
    """A room that is discovered from left to right by a moving robot."""
    rng = np.random.default_rng(0)
    full = np.full(shape, 1, np.uint8)
    full[[40, -41]] = 255
    full[:, 100::90] = 255
    for index in range(count):
        levels = np.zeros_like(full)
        seen = (index + 1) * shape[1] // count
        levels[40:-40, :seen] = full[40:-40, :seen]
        x = ORIGIN[0] + 0.05 * seen * np.linspace(0, 0.9, index + 1)
        poses = np.stack([x, np.full_like(x, 17.0), np.zeros_like(x)], axis=1)
        yield MapFrame(levels, poses, poses[-1] + rng.normal(0, 0.4, (30, 3)), f"t = {index} s")


def test_animation_has_every_frame_and_is_quick_and_small(tmp_path):
    path = tmp_path / "map.gif"
    started = time.perf_counter()
    animate_map(path, growing(60), 0.05, ORIGIN)
    elapsed = time.perf_counter() - started
    with Image.open(path) as image:
        assert (image.n_frames, image.info["loop"]) == (60, 0)
        durations = []
        for index in range(60):
            image.seek(index)
            durations.append(image.info["duration"])
        last = np.asarray(image.convert("RGB")).astype(int)
    assert durations == [80] * 59 + [2000]
    # Known part 520 × 800 cells, 2 rows of margin on each side; 560 pixels across; the footer.
    assert last.shape == (round(524 * 560 / 800) + 26, 560, 3)
    for color in (BLUE, PURPLE, (0, 0, 0)):
        assert has_color(last, color, slack=0)
    assert path.stat().st_size < 400_000
    # A guard against falling back to a figure per frame (tens of seconds); it takes about 1 s.
    assert elapsed < 20


def test_thin_walls_survive_in_the_animation(tmp_path):
    path = tmp_path / "map.gif"
    animate_map(path, growing(2), 0.05, ORIGIN, max_side=200)
    with Image.open(path) as image:
        image.seek(1)
        row = np.asarray(image.convert("L"))[20]
    # Walls stand at columns 100, 190, …, 730.
    assert int((np.diff(np.concatenate([[255], row]).astype(int)) < -100).sum()) == 8


def test_row_zero_is_at_the_bottom_and_poses_fit_the_map(tmp_path):
    levels = np.full((100, 100), 1, np.uint8)
    levels[:10] = 255
    pose = np.array([[ORIGIN[0] + 4.0, ORIGIN[1] + 1.5, 0.0]])
    animate_map(tmp_path / "a.gif", [MapFrame(levels, pose, pose)], 0.05, ORIGIN, max_side=500)
    pixels = pixels_of(tmp_path / "a.gif")[:500]
    assert (pixels[460:500, :400] == 0).all()
    blue = np.argwhere(np.abs(pixels - BLUE).max(axis=-1) == 0)
    # 5 px per cell: x = 80 cells, y = 30 cells up; the heading tick reaches 9 px to the right.
    assert blue[:, 0].mean() == pytest.approx(500 - 150, abs=2)
    assert blue[:, 1].max() == pytest.approx(400 + 9, abs=2)


def test_empty_maps_and_lost_poses_do_not_crash(tmp_path):
    nothing = np.zeros((30, 40), np.int8)
    lost = np.full((1, 3), np.nan)
    animate_map(tmp_path / "a.gif", [MapFrame(nothing, lost, lost)], 0.05, ORIGIN)
    assert pixels_of(tmp_path / "a.gif").size > 0


def test_frames_are_read_one_at_a_time(tmp_path):
    alive: list[int] = []

    class Tracked(np.ndarray):
        def __del__(self):
            alive.append(-1)

    def frames():
        for frame in growing(10, shape=(120, 160)):
            # Created so far minus freed so far: at most the one being handed over and the last.
            assert len(alive) >= frames.made - 2
            frames.made += 1
            yield MapFrame(frame.occupancy.view(Tracked), frame.poses, frame.particles)

    frames.made = 0
    animate_map(tmp_path / "a.gif", frames(), 0.05, ORIGIN)
    assert frames.made == 10


def test_an_animation_for_a_notebook_is_the_file_inside_a_picture_element(tmp_path):
    animate_map(tmp_path / "a.gif", growing(5, shape=(120, 160)), 0.05, ORIGIN, max_side=80)
    inline = animate_inline(growing(5, shape=(120, 160)), 0.05, ORIGIN, max_side=80)
    assert inline.gif == (tmp_path / "a.gif").read_bytes()
    assert re.fullmatch(r"InlineAnimation\(5 frames, \d+ kB\)", repr(inline))
    [source] = re.findall(r'<img src="data:image/gif;base64,([^"]+)"', inline._repr_html_())
    with Image.open(io.BytesIO(base64.b64decode(source))) as image:
        assert image.n_frames == 5
    with pytest.raises(ValueError, match="there are no frames"):
        animate_inline([], 0.05, ORIGIN)


def test_bad_frames_are_one_clear_line(tmp_path):
    one = MapFrame(np.zeros((30, 40), np.int8), POSES, POSES)
    other = MapFrame(np.zeros((31, 40), np.int8), POSES, POSES)
    with pytest.raises(ValueError, match="there are no frames"):
        animate_map(tmp_path / "a.gif", [], 0.05, ORIGIN)
    with pytest.raises(ValueError, match=r"frame 1 has a map of shape \(31, 40\)"):
        animate_map(tmp_path / "a.gif", [one, other], 0.05, ORIGIN)
    with pytest.raises(ValueError, match=r"does not end in \.gif"):
        animate_map(tmp_path / "a.mp4", [one], 0.05, ORIGIN)
