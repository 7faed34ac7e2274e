"""Readings of a wall, from tables and from bags, and what is told of those that cannot be used."""

import gzip

import numpy as np
import pytest

from jaxslam.range_network.readings import Readings, read_readings

TABLE = "true_m,measured_m\n1.0,1.01\n1.0,1.03\n2.0,2.04\n"


@pytest.fixture
def table(tmp_path):
    """Writes a table and gives its path."""

    def write(text, encoding="utf-8"):
        path = tmp_path / "wall.csv"
        path.write_bytes(text if isinstance(text, bytes) else text.encode(encoding))
        return str(path)

    return write


def refusal(source, **flags) -> str:
    """What a source is refused with, one line after its path."""
    with pytest.raises(ValueError, match=": ") as error:
        read_readings(source, **flags)
    message = str(error.value)
    path = source if source.endswith(".csv") else source.rpartition(":")[0]
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
    return message[len(path) + 2 :]


def assert_is(readings, true, measured, num_lost=0):
    np.testing.assert_array_equal(readings.true, true)
    np.testing.assert_array_equal(readings.measured, measured)
    assert readings.num_lost == num_lost


@pytest.mark.parametrize(
    "text",
    [
        TABLE,
        "measured_m,true_m\n1.01,1.0\n1.03,1.0\n2.04,2.0\n",
        "﻿" + TABLE,
        "\n\n" + TABLE.replace("\n", "\n\n") + " , \n",
        'run,measured_m,note,true_m\n1,1.01,a,1\n2,1.03,"b, c",1\n3,2.04,,2\n',
        TABLE.replace("\n", "\r\n"),
        TABLE.replace("\n", "\r"),
        TABLE.removesuffix("\n"),
        " True_M , MEASURED_m \n 1.0 , 1.01 \n1.0,1.03\n2e0,+2.04\n",
        TABLE.replace("1.03", "1.03,and more"),
    ],
    ids=[
        "as written",
        "other order",
        "byte order mark",
        "blank lines",
        "extra columns",
        "windows",
        "old mac",
        "no end of line",
        "spaces and capitals",
        "a longer row",
    ],
)
def test_tables_that_say_the_same(table, text):
    assert_is(read_readings(table(text)), [1.0, 1.0, 2.0], [1.01, 1.03, 2.04])


def test_a_note_in_another_encoding_does_not_matter(table):
    text = TABLE.replace("measured_m", "measured_m,größe").replace("1.03", "1.03,größer")
    assert len(read_readings(table(text, "latin-1")).true) == 3


@pytest.mark.parametrize("lost", ["0", "", "nan", "NaN", "inf", "-inf", "0.0", "-1", "  "])
def test_lost_readings_are_counted_and_left_out(table, lost):
    text = TABLE + f"2.0,{lost}\n3.0,3.1\n3.0,{lost}\n"
    assert_is(read_readings(table(text)), [1, 1, 2, 3], [1.01, 1.03, 2.04, 3.1], num_lost=2)


def test_a_row_that_ends_early_is_a_lost_reading(table):
    assert_is(read_readings(table(TABLE + "2.0\n")), [1, 1, 2], [1.01, 1.03, 2.04], num_lost=1)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "empty; give the columns true_m and measured_m"),
        ("\n \n,\n", "empty; give the columns"),
        ("true_m,measured_m\n", "no readings below its first line"),
        ("true_m,measured_m\n\n,\n", "no readings below its first line"),
        (
            "distance,measured_m\n1,1\n",
            "no column true_m in its first line (distance, measured_m): give the columns true_m and",
        ),
        ("true_m,reading\n1,1\n", "no column measured_m in its first line (true_m, reading)"),
        ("a\n1\n", "no column true_m nor measured_m in its first line (a)"),
        ("1.0,1.01\n1.0,1.02\n", "no column true_m nor measured_m in its first line (1.0, 1.01)"),
        ("true_m;measured_m\n1;1\n", "no column true_m nor measured_m"),
        (TABLE + "2.0,far\n", "line 5: measured_m is 'far', which is not a number"),
        (TABLE + "\n\n2.0,1.9\ntwo,2.0\n", "line 8: true_m is 'two', which is not a number"),
        (TABLE + "2,0;2,01\n", "line 5: measured_m is '0;2', which is not a number"),
        (TABLE + "2_0,2.0\n", "line 5: true_m is '2_0', which is not a number"),
        (
            "true_m,measured_m,True_m\n1,1,2\n",
            "two columns true_m in its first line: remove one",
        ),
        (TABLE + ",2.0\n", "line 5: true_m is '', which is not a number"),
        (TABLE + "nan,2.0\n", "line 5: true_m is nan: give meters, more than 0"),
        (TABLE + "\ninf,2.0\n", "line 6: true_m is inf: give meters, more than 0"),
        (TABLE + "0,2.0\n", "line 5: true_m is 0: give meters, more than 0"),
        (TABLE + "-2.0,2.0\nnan,1\n", "line 5: true_m is -2: give meters, more than 0"),
        (TABLE + "2000,2.0\n", "line 5: true_m is 2000: are these millimeters? Give meters"),
        (
            "true_m,measured_m\n1.0,1010\n1.0,1020\n2.0,2.0\n",
            "readings of 1010 m: are these millimeters?",
        ),
        ("true_m,measured_m\n1000,1010\n2000,2020\n", "line 2: true_m is 1000: are these millimeters?"),
        ("true_m,measured_m\n1.0,0\n2.0,nan\n3.0,\n", "none of its 3 readings is a distance"),
    ],
    ids=str,
)
def test_tables_that_cannot_be_used(table, text, message):
    assert message in refusal(table(text))


@pytest.mark.parametrize(
    "content",
    [bytes(200_000), b'true_m,"measured_m\n' + b"1.0,1.01\n" * 20_000],
    ids=["zeros", "open quote"],
)
def test_a_file_that_is_no_table_at_all(table, content):
    """More in one field than Python's reader takes."""
    refusal(table(content))


def exchanged(num_readings, num_distances):
    """A table with its columns exchanged: what was read stands where the distances should."""
    rng = np.random.default_rng(0)
    distances = np.repeat(np.linspace(0.5, 3.0, num_distances), num_readings)
    rows = zip(distances + rng.normal(0.0, 0.02, len(distances)), distances, strict=True)
    return "true_m,measured_m\n" + "".join(f"{read:.4f},{true:g}\n" for read, true in rows)


def test_exchanged_columns_are_told(table):
    message = refusal(table(exchanged(50, 4)))
    assert message.startswith("true_m has ")
    assert "and measured_m 4, but a wall has few distances and many readings" in message
    assert message.endswith("are the columns exchanged?")


def test_exchanged_columns_with_a_lost_reading_are_told(table):
    """A lost one is 0, which no distance can be."""
    assert "line 6: true_m is 0: give meters" in refusal(table(TABLE + "1.0,1.02\n0,1.0\n"))
    assert "are the columns exchanged?" in refusal(table(exchanged(50, 4) + "0,1.0\n"))


def test_a_table_with_few_readings_is_not_taken_for_exchanged(table):
    text = "true_m,measured_m\n" + "".join(f"{d / 10},{d / 10 + 0.01}\n" for d in range(5, 25))
    assert len(read_readings(table(text)).distances) == 20
    # Nor is a lidar that reads whole millimeters and scatters by few.
    few = "true_m,measured_m\n" + "".join(f"{d},{d + 0.001 * (i % 3)}\n" for d in (1, 2) for i in range(99))
    assert len(read_readings(table(few)).distances) == 2


@pytest.mark.parametrize("source", ["wall.mcap", "wall", "wall.mcap:near", "wall.txt:"])
def test_a_log_needs_the_distance(source):
    with pytest.raises(ValueError, match=r"give a table as FILE\.csv") as error:
        read_readings(source)
    assert str(error.value).startswith(f"{source}: ")
    assert str(error.value).endswith(f"as {source}:1.5")


def test_files_that_are_not_there(tmp_path):
    with pytest.raises(FileNotFoundError):
        read_readings(str(tmp_path / "missing.csv"))
    with pytest.raises(ValueError, match="no such file"):
        read_readings(str(tmp_path / "missing.mcap:1.0"))


@pytest.mark.parametrize("distance", ["0", "-1", "nan", "inf", "1000"])
def test_walls_that_are_nowhere(tmp_path, distance):
    said = refusal(f"{tmp_path}/wall.mcap:{distance}")
    assert said == f"distance of the wall is {float(distance):g} m: give more than 0 and less than 500"


@pytest.fixture
def carmen(tmp_path):
    """Five scans of 181 beams from −90° to 90°: beam `i` reads 1 m + `i` cm, the front one not always."""
    path = tmp_path / "wall.clf.gz"
    lines = []
    for stamp in range(5):
        ranges = 1.0 + 0.01 * np.arange(181)
        ranges[90] = 81.83 if stamp == 2 else 1.9 + 0.001 * stamp
        text = " ".join(f"{value:.3f}" for value in ranges)
        lines.append(f"FLASER 181 {text} 0 0 0 0 0 0 {stamp}.0 sim {stamp}.0")
    with gzip.open(path, "wt") as stream:
        stream.write("\n".join(lines) + "\n")
    return str(path)


def test_the_front_beam_of_a_log(carmen):
    readings = read_readings(f"{carmen}:2.0")
    np.testing.assert_array_equal(readings.true, [2.0] * 4)
    np.testing.assert_allclose(readings.measured, [1.9, 1.901, 1.903, 1.904], rtol=1e-6)
    assert readings.num_lost == 1


@pytest.mark.parametrize(
    ("bearing", "expected"),
    [(np.pi / 2, 2.8), (-np.pi / 2, 1.0), (np.pi / 6, 2.2), (np.pi / 6 - 2 * np.pi, 2.2)],
)
def test_the_beam_at_a_bearing(carmen, bearing, expected):
    readings = read_readings(f"{carmen}:2.0", bearing=float(bearing))
    np.testing.assert_allclose(readings.measured, [expected] * 5, rtol=1e-6)


def test_a_bearing_without_a_beam(carmen):
    message = refusal(f"{carmen}:2.0", bearing=3.0)
    assert "no beam at a bearing of 3 rad: the nearest is 1.43 rad off" in message


@pytest.mark.parametrize("bearing", [np.nan, np.inf])
def test_a_bearing_that_is_none(carmen, bearing):
    assert "bearing" in refusal(f"{carmen}:2.0", bearing=float(bearing))


def test_a_log_without_scans(tmp_path):
    path = tmp_path / "wheels.log"
    path.write_text("\n".join(f"ODOM {i} 0 0 0 0 0 {i}.0 h {i}.0" for i in range(9)))
    assert refusal(f"{path}:2.0") == "no scan in it"


def test_a_log_in_which_no_wall_answers(tmp_path):
    path = tmp_path / "blind.log"
    path.write_text("\n".join(f"FLASER 3 9 81.83 9 0 0 0 0 0 0 {i}.0 sim {i}.0" for i in range(4)))
    assert refusal(f"{path}:2.0") == "none of its 4 readings is a distance"


def test_a_turtlebot_before_a_wall(data_dir):
    source = f"{data_dir / 'calibration' / 'turtlebot3_wall_1.0m.mcap'}:1.0"
    readings = read_readings(source)
    assert (readings.distances == 1.0).all()
    assert len(readings.true) == 109
    # Its own drift between sessions is a millimeter or two.
    assert readings.measured.mean() - 1.0 == pytest.approx(0.0038, abs=0.0005)
    assert 0.001 < readings.measured.std() < 0.02
    assert readings.num_lost > 0
    aside = read_readings(source, bearing=float(np.pi / 2))
    assert abs(aside.measured.mean() - readings.measured.mean()) > 0.05


def test_means_are_one_reading_for_each_distance():
    readings = Readings(np.array([2.0, 1.0, 2.0, 1.0, 1.0]), np.array([2.1, 1.0, 2.3, 1.1, 1.2]), 3)
    means = readings.means()
    assert_is(means, [1.0, 2.0], means.measured)
    np.testing.assert_allclose(means.measured, [1.1, 2.2], rtol=1e-12)
    np.testing.assert_array_equal(readings.distances, [1.0, 2.0])


def test_joined_readings_are_all_of_them():
    one = Readings(np.array([1.0, 1.0]), np.array([1.1, 1.2]), 3)
    two = Readings(np.array([0.5]), np.array([0.6]), 4)
    assert_is(Readings.joined([one, two]), [1.0, 1.0, 0.5], [1.1, 1.2, 0.6], num_lost=7)
    assert_is(Readings.joined([one]), one.true, one.measured, num_lost=3)


def test_where_chooses(table):
    readings = read_readings(table(TABLE))
    assert_is(readings.where(readings.true == 1.0), [1.0, 1.0], [1.01, 1.03])
