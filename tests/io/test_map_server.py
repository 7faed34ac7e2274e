"""map_server maps: a 3 × 2 golden, round trips, nav2's rules for pixels, bad files."""

import numpy as np
import pytest
from PIL import Image

from jaxslam.io import MapError, read_map, write_map

YAML = """image: a.pgm
resolution: 0.05
origin: [-1.0, 2.0, 0.0]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.196
"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "a.yaml").write_text(YAML)
    (tmp_path / "a.pgm").write_bytes(b"P5\n3 2\n255\n" + bytes([0, 254, 205, 254, 254, 0]))
    return tmp_path


def change(folder, old, new):
    text = (folder / "a.yaml").read_text()
    assert old in text
    (folder / "a.yaml").write_text(text.replace(old, new))
    return folder / "a.yaml"


def test_written_files_are_byte_for_byte_as_expected(tmp_path):
    # Row 0 has the lowest y: occupied, unknown, free; it is the last row of the image.
    probability = np.array([[0.9, np.nan, 0.1], [0.5, 0.2, 0.7]])
    write_map(tmp_path / "map.yaml", probability, 0.05, (-1.5, 2.0, 0.25))
    pixels = bytes([205, 254, 0, 0, 205, 254])
    assert (tmp_path / "map.pgm").read_bytes() == b"P5\n3 2\n255\n" + pixels
    assert (tmp_path / "map.yaml").read_text() == (
        "image: map.pgm\nmode: trinary\nresolution: 0.05\norigin: [-1.5, 2.0, 0.25]\n"
        "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.25\n"
    )


@pytest.mark.parametrize("name", ["map.yaml", "my map: 'no #1'.yaml", "1e3.yml", "no.yaml"])
def test_what_is_written_is_read_back(tmp_path, name):
    probability = np.random.default_rng(0).uniform(0, 1, (40, 30)).astype(np.float32)
    probability[::3] = np.nan
    write_map(tmp_path / name, probability, 0.1, (1.0, -2.0, 0.5))
    known = read_map(tmp_path / name)
    np.testing.assert_array_equal(known.occupied, np.nan_to_num(probability) > 0.65)
    np.testing.assert_array_equal(known.free, np.nan_to_num(probability, nan=1.0) < 0.25)
    assert known.resolution == 0.1
    assert known.origin.tolist() == [1.0, -2.0, 0.5]


def test_pillow_reads_what_is_written(tmp_path):
    write_map(tmp_path / "map.yaml", np.array([[0.0, 1.0], [np.nan, np.nan]]), 0.1)
    with Image.open(tmp_path / "map.pgm") as image:
        assert np.asarray(image).tolist() == [[205, 205], [254, 0]]


def test_a_map_with_more_pixels_than_pillow_allows_is_read_back(tmp_path, monkeypatch):
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 40)
    write_map(tmp_path / "map.yaml", np.eye(10), 0.1)
    assert read_map(tmp_path / "map.yaml").occupied.tolist() == np.eye(10, dtype=bool).tolist()
    # The limit still holds for files that are small for their number of pixels.
    assert Image.MAX_IMAGE_PIXELS == 40
    Image.fromarray(np.zeros((100, 100), np.uint8)).save(tmp_path / "map.pgm", format="PNG")
    with pytest.raises(MapError, match="10000 pixels"):
        read_map(tmp_path / "map.yaml")


def test_thresholds_can_be_chosen(tmp_path):
    write_map(tmp_path / "m.yaml", np.array([[0.22, 0.1]]), 0.1, free_threshold=0.196)
    assert read_map(tmp_path / "m.yaml").free.tolist() == [[False, True]]
    assert "free_thresh: 0.196" in (tmp_path / "m.yaml").read_text()


def test_a_map_is_read(folder):
    known = read_map(folder / "a.yaml")
    assert known.occupied.tolist() == [[False, False, True], [True, False, False]]
    assert known.free.tolist() == [[True, True, False], [False, True, False]]


def test_real_yaml_is_understood(folder):
    (folder / "a.yaml").write_text(
        "# saved by map_saver\nimage: 'a.pgm'   # beside\nresolution: 5.0e-02\norigin:\n  - -1\n"
        "  - 2.0\n  - 0.1\nnegate: false\noccupied_thresh: 0.65\nfree_thresh: 0.196\nextra: 1\n"
    )
    known = read_map(folder / "a.yaml")
    assert known.resolution == 0.05
    assert known.origin.tolist() == [-1.0, 2.0, 0.1]


def test_absolute_image_paths_are_used(folder, tmp_path_factory):
    other = tmp_path_factory.mktemp("other") / "b.yaml"
    other.write_text(YAML.replace("a.pgm", str(folder / "a.pgm")))
    assert read_map(other).occupied.any()


def test_the_savers_gray_is_unknown_whatever_the_threshold(folder):
    # 205 is 0.196 occupied: below nav2's default free_thresh of 0.25.
    path = change(folder, "free_thresh: 0.196", "free_thresh: 0.25")
    known = read_map(path)
    assert not known.free[1, 2]
    assert not known.occupied[1, 2]


def test_negate_turns_brightness_round(folder):
    known = read_map(change(folder, "negate: 0", "negate: 1"))
    assert known.occupied[0].tolist() == [True, True, False]
    assert known.free[0].tolist() == [False, False, True]


@pytest.mark.parametrize(
    "data",
    [
        b"P2\n# by hand\n3 2\n255\n0 254 205\n254 254 0\n",
        b"P2 3 2 # size\n255\n0 254 205 254 # inside\n254 0",
        b"P5 3 2 65535\n" + np.array([0, 65278, 52685, 65278, 65278, 0], dtype=">u2").tobytes(),
        b"P5\n# CREATOR: map_saver\n3 2\n255\n" + bytes([0, 254, 205, 254, 254, 0]) + b"tail",
    ],
)
def test_every_kind_of_pgm_is_the_same_map(folder, data):
    (folder / "a.pgm").write_bytes(data)
    known = read_map(folder / "a.yaml")
    assert known.occupied.tolist() == [[False, False, True], [True, False, False]]
    assert known.free.tolist() == [[True, True, False], [False, True, False]]


@pytest.mark.parametrize("mode", ["L", "RGB", "RGBA", "P", "I;16"])
def test_every_kind_of_png_is_the_same_map(folder, mode):
    gray = np.array([[0, 254, 205], [254, 254, 0]], dtype=np.uint8)
    if mode == "I;16":
        image = Image.fromarray(gray.astype(np.uint16) * 257)
        assert image.mode == mode
    else:
        image = Image.fromarray(gray).convert(mode)
    image.save(folder / "a.png")
    known = read_map(change(folder, "a.pgm", "a.png"))
    assert known.occupied.tolist() == [[False, False, True], [True, False, False]]
    assert known.free.tolist() == [[True, True, False], [False, True, False]]


def test_transparent_pixels(folder):
    pixels = np.zeros((1, 3, 4), dtype=np.uint8)
    pixels[0] = [[0, 0, 0, 255], [0, 0, 0, 0], [255, 255, 255, 0]]
    Image.fromarray(pixels).save(folder / "a.png")
    path = change(folder, "a.pgm", "a.png")
    # Averaged over r, g, b and alpha the occupancies are 3/4, 1 and 1/4.
    known = read_map(path)
    assert known.occupied.tolist() == [[True, True, False]]
    assert known.free.tolist() == [[False, False, False]]
    known = read_map(change(folder, "negate: 0", "negate: 0\nmode: scale"))
    assert known.occupied.tolist() == [[True, False, False]]
    assert known.free.tolist() == [[False, False, False]]


def test_raw_pixels_are_percent(folder):
    path = change(folder, "negate: 0", "negate: 0\nmode: raw")
    (folder / "a.pgm").write_bytes(b"P5\n5 1\n255\n" + bytes([0, 19, 50, 66, 255]))
    known = read_map(path)
    assert known.free.tolist() == [[True, True, False, False, False]]
    assert known.occupied.tolist() == [[False, False, False, True, False]]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("a.pgm", "b.pgm", r"a\.yaml: its image .*b\.pgm does not exist"),
        ("a.pgm", "''", "image is ''"),
        ("image: a.pgm\n", "", "missing keys: image"),
        ("free_thresh: 0.196\n", "", "missing keys: free_thresh"),
        ("0.05", "-0.05", "resolution is -0.05"),
        ("0.05", "0", "resolution is 0.0"),
        ("0.05", ".inf", "resolution is inf"),
        ("0.05", "fine", "resolution is 'fine'"),
        ("[-1.0, 2.0, 0.0]", "[-1.0, 2.0]", r"origin is \[-1.0, 2.0\]"),
        ("[-1.0, 2.0, 0.0]", "[-1.0, 2.0, east]", "origin is 'east'"),
        ("0.65", "0.1", "free_thresh 0.196 and occupied_thresh 0.1"),
        ("0.65", "1.5", "occupied_thresh 1.5"),
        ("negate: 0", "mode: fancy", "mode is 'fancy': expected one of trinary"),
        ("negate: 0", "negate: maybe", "negate is 'maybe'"),
        ("image: a.pgm", "- 1", "not valid yaml"),
    ],
)
def test_bad_yaml_is_one_line(folder, old, new, message):
    with pytest.raises(MapError, match=message) as error:
        read_map(change(folder, old, new))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"- 1\n- 2\n", "not a map"),
        (b"", "not a map"),
        (b"a: [1, 2\n", "not valid yaml"),
        (b"P5\n\xff\xfe", "not a text file"),
    ],
)
def test_what_is_no_map_is_an_error(tmp_path, content, message):
    (tmp_path / "a.yaml").write_bytes(content)
    with pytest.raises(MapError, match=message):
        read_map(tmp_path / "a.yaml")
    with pytest.raises(MapError, match="no such file"):
        read_map(tmp_path / "none.yaml")
    with pytest.raises(MapError, match="cannot be read"):
        read_map(tmp_path)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"P5\n3 2\n255\n\0\0\0", "cut short or damaged"),
        (b"P5\n3 2\n65535\n\0\0\0", "cut short or damaged"),
        (b"P2\n3 2\n255\n1 2 3", "cut short or damaged"),
        (b"P2\n3 2\n255\n1 2 x 4 5 6", "cut short or damaged"),
        (b"P5\n0 2\n255\n", "not an image"),
        (b"P5\n900000 900000\n255\n\0", "cut short or damaged: .*810000000000 pixels"),
        (b"P5\n3", "cut short or damaged: .*header"),
        (b"P5 # never ends", "cut short or damaged: .*header"),
        (b"", "not an image"),
        (b"text", "not an image"),
    ],
)
def test_bad_images_are_one_line(folder, content, message):
    (folder / "a.pgm").write_bytes(content)
    with pytest.raises(MapError, match=message) as error:
        read_map(folder / "a.yaml")
    assert "\n" not in str(error.value)


def test_a_cut_png_is_an_error(folder):
    noise = np.random.default_rng(0).integers(0, 255, (50, 50), dtype=np.uint8)
    Image.fromarray(noise).save(folder / "a.png")
    (folder / "a.png").write_bytes((folder / "a.png").read_bytes()[:1000])
    with pytest.raises(MapError, match="cut short or damaged"):
        read_map(change(folder, "a.pgm", "a.png"))


@pytest.mark.parametrize(
    ("name", "arguments", "message"),
    [
        ("m.pgm", {}, "end it in .yaml"),
        ("m.yaml", {"resolution": 0.0}, "resolution is 0.0"),
        ("m.yaml", {"resolution": np.nan}, "resolution is nan"),
        ("m.yaml", {"origin": (0.0, np.inf, 0.0)}, "origin is"),
        ("m.yaml", {"occupancy_probability": np.array([[2.0]])}, r"probability 2.0 is outside"),
        ("m.yaml", {"occupancy_probability": np.zeros((0, 3))}, "has no cells"),
        ("m.yaml", {"free_threshold": 0.7}, "free_thresh 0.7"),
    ],
)
def test_what_cannot_be_written_is_an_error(tmp_path, name, arguments, message):
    good = {"occupancy_probability": np.zeros((2, 2)), "resolution": 0.1}
    with pytest.raises(MapError, match=message):
        write_map(tmp_path / name, **{**good, **arguments})
    assert not list(tmp_path.iterdir())


def test_the_real_map(data_dir):
    known = read_map(data_dir / "maps" / "wean.yaml")
    assert known.occupied.shape == (800, 800)
    assert known.resolution == 0.1
    # Counted in the file: 20197 pixels of 0, 48479 of 254, the rest 205.
    assert known.occupied.sum() == 20197
    assert known.free.sum() == 48479
