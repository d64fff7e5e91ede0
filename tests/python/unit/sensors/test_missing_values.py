"""Lines of a sensor file without a value, or twice, are left out and counted, as pandas would drop them."""

from __future__ import annotations

from io import StringIO
from pathlib import Path

import numpy as np
import pytest

from sfmcpp.errors import DatasetError
from sfmcpp.sensors import local_positions
from sfmcpp.slam.motion_sensors import Odometer
from sfmcpp.slam.sensor_faults import faults_of_streams
from sfmcpp.slam.sensor_suite import SensorSuite
from sfmcpp.sources.io.position_csv import read_position_csv
from sfmcpp.sources.io.sensor_csv import read_sensor_csv

WORDS = ["NaN", "nan", "-nan", "NA", "N/A", "<NA>", "null", "NULL", "None"]


def write(folder: Path, text: str) -> Path:
    path = folder / "log.csv"
    path.write_text(text)
    return path


@pytest.mark.parametrize("word", WORDS)
def test_a_word_for_no_value_leaves_its_line_out_as_pandas_does(tmp_path: Path, word: str) -> None:
    text = f"t [s],speed [m/s]\n0,1\n1,{word}\n2,3\n3,{word}\n4,5\n"
    pd = pytest.importorskip("pandas")
    of_pandas = pd.read_csv(StringIO(text)).dropna()
    speed = read_sensor_csv(write(tmp_path, text))["speed"]
    np.testing.assert_array_equal(np.column_stack([speed.t_s, speed.values]), of_pandas.to_numpy())
    assert speed.left_out == "2 lines without a value, first line 3"


def test_a_vector_with_a_part_missing_is_left_out_whole_and_other_sensors_stay(tmp_path: Path) -> None:
    header = "t [s],speed [m/s],wx [rad/s],wy [rad/s],wz [rad/s]"
    path = write(tmp_path, f"{header}\n0,1,0,0,.1\n1,1,0,NaN,.2\n2,1,0,0,.3\n")
    streams = read_sensor_csv(path)
    np.testing.assert_array_equal(streams["angular_rate"].t_s, [0, 2])
    np.testing.assert_array_equal(streams["speed"].t_s, [0, 1, 2])
    assert streams["angular_rate"].left_out == "1 line without a value, first line 3"
    assert streams["speed"].left_out == ""


def test_an_empty_part_of_a_vector_is_still_refused(tmp_path: Path) -> None:
    path = write(tmp_path, "t [s],vx [m/s],vy [m/s],vz [m/s]\n0,1,1,1\n1,1,,1\n")
    with pytest.raises(DatasetError, match=r"log\.csv:3: only a part of velocity"):
        read_sensor_csv(path)


def test_a_time_must_be_known(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match=r"log\.csv:3: t is 'NaN'"):
        read_sensor_csv(write(tmp_path, "t [s],speed [m/s]\n0,1\nNaN,1\n"))


def test_a_sensor_that_never_measured_leaves_the_others(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match=r"log\.csv: holds no measurements"):
        read_sensor_csv(write(tmp_path, "t [s],speed [m/s]\n0,NaN\n1,NA\n"))
    path = write(tmp_path, "t [s],speed [m/s],lat [deg],lon [deg],height [m]\n0,1,NaN,NaN,NaN\n1,1,,,\n")
    assert list(read_sensor_csv(path)) == ["speed"]


def test_lines_that_stand_there_twice_count_once(tmp_path: Path) -> None:
    text = "t [s],speed [m/s]\n0,1\n1,2\n1,2\n1,2\n2,2\n"
    speed = read_sensor_csv(write(tmp_path, text))["speed"]
    pd = pytest.importorskip("pandas")
    of_pandas = pd.read_csv(StringIO(text)).drop_duplicates()
    np.testing.assert_array_equal(np.column_stack([speed.t_s, speed.values]), of_pandas.to_numpy())
    assert speed.left_out == "2 lines like the one before, first line 4"


def test_sensors_may_have_lines_of_their_own_at_one_time(tmp_path: Path) -> None:
    header = "t [s],speed [m/s],wx [rad/s],wy [rad/s],wz [rad/s]"
    path = write(tmp_path, f"{header}\n0,1,,,\n0,,0,0,.1\n1,,0,0,.2\n.9,2,,,\n1.1,3,,,\n")
    streams = read_sensor_csv(path)
    np.testing.assert_array_equal(streams["speed"].t_s, [0, 0.9, 1.1])
    np.testing.assert_array_equal(streams["angular_rate"].t_s, [0, 1])
    assert all(stream.left_out == "" for stream in streams.values())


def test_a_run_warns_of_what_is_left_out(tmp_path: Path) -> None:
    speed = read_sensor_csv(write(tmp_path, "t [s],speed [m/s]\n0,1\n1,NaN\n2,1\n2,1\n3,1\n"))["speed"]
    told = faults_of_streams(SensorSuite([Odometer(speed.shifted(5.0))]))
    both = "1 line without a value, first line 3 and 1 line like the one before, first line 5"
    assert f"stream 'speed': left out {both}" in told


def test_positions_on_a_map_keep_what_is_told_of_them(tmp_path: Path) -> None:
    rows = "0,48,11,500\n1,nan,nan,nan\n2,48.0001,11,500\n"
    fixes = read_sensor_csv(write(tmp_path, f"t [s],lat [deg],lon [deg],height [m]\n{rows}"))["geodetic"]
    assert local_positions(fixes).left_out == fixes.left_out == "1 line without a value, first line 3"


def test_a_photo_without_a_position_may_say_so_in_words(tmp_path: Path) -> None:
    path = write(tmp_path, "name,lat,lon,height\na.jpg,48,11,500\nb.jpg,NaN,NaN,NaN\nc.jpg,48,11.001,500\n")
    assert list(read_position_csv(path).positions) == ["a.jpg", "c.jpg"]
    path.write_text("name,lat,lon,height\na.jpg,48,11,NaN\n")
    with pytest.raises(DatasetError, match=r"log\.csv:2: .*'NaN'"):
        read_position_csv(path)
