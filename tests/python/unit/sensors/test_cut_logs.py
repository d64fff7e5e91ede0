"""Sensor files that end in the middle of a line: that line is left out and told of, and no other."""

from __future__ import annotations

from pathlib import Path

import pytest

from sfmcpp.errors import DatasetError
from sfmcpp.sources.io.sensor_csv import read_sensor_csv

HEADER = "t [s],speed [km/h],wx [deg/s],wy [deg/s],wz [deg/s]\n"
LINES = "".join(f"{k / 10:.2f},{36 + k / 10:.1f},0.1,0.2,-2.5\n" for k in range(5))
NOTE = "1 line cut off at the end of the file, first line 7"


def write(path: Path, text: str) -> Path:
    path.write_bytes(text.encode())
    return path


@pytest.mark.parametrize(
    "rest",
    ["0.5", "0.50,36.1,0", "0.50,36.1,0.1,0.2,", "0.50,36.1,0.1,0.2,-", "0.50,36.1,0.1,0.2,1e", "\0" * 99],
)
def test_the_line_that_was_cut_is_left_out_and_told_of(tmp_path: Path, rest: str) -> None:
    whole = read_sensor_csv(write(tmp_path / "whole.csv", HEADER + LINES))
    cut = read_sensor_csv(write(tmp_path / "cut.csv", HEADER + LINES + rest))
    assert {*cut} == {"speed", "angular_rate"}
    for kind, stream in cut.items():
        assert stream.left_out == NOTE
        assert stream.t_s.tobytes() == whole[kind].t_s.tobytes()
        assert stream.values.tobytes() == whole[kind].values.tobytes()


def test_a_line_before_zeros_is_not_whole(tmp_path: Path) -> None:
    """Nobody knows how much of its last number is missing."""
    cut = read_sensor_csv(write(tmp_path / "cut.csv", HEADER + LINES + "0.50,36.1,0.1,0.2,-2\0\0\0"))
    assert [len(stream.t_s) for stream in cut.values()] == [5, 5]
    assert cut["speed"].left_out == NOTE


def test_a_word_for_no_value_that_was_cut_is_none(tmp_path: Path) -> None:
    cut = read_sensor_csv(write(tmp_path / "cut.csv", HEADER + LINES + "0.50,36.1,0.1,0.2,nul"))
    assert len(cut["speed"].t_s) == 5


@pytest.mark.parametrize("end", ["", "\n"])
def test_a_whole_last_line_counts(tmp_path: Path, end: str) -> None:
    found = read_sensor_csv(write(tmp_path / "log.csv", HEADER + LINES + f"0.50,36.1,0.1,0.2,-2.5{end}"))
    assert [(len(stream.t_s), stream.left_out) for stream in found.values()] == [(6, ""), (6, "")]


def test_a_last_cell_may_be_empty_or_have_a_decimal_comma(tmp_path: Path) -> None:
    empty = read_sensor_csv(write(tmp_path / "a.csv", "t [s],note,speed [m/s]\n0,a,9\n1,b,"))
    assert (len(empty["speed"].t_s), empty["speed"].left_out) == (1, "")
    comma = read_sensor_csv(write(tmp_path / "b.csv", "t [s];speed [m/s]\n0,5;9,25\n1,5;9,75"))
    assert comma["speed"].values.ravel().tolist() == [9.25, 9.75]


@pytest.mark.parametrize(
    "text",
    [
        HEADER + LINES + "0.50,36.1,0\n",  # written so: its end is there
        HEADER + LINES + "0.50,36.1,0.1,0.2,fast",  # no number that was cut
        HEADER + LINES + "0.50,,0.1,0.2\n" + "0.60,36,0.1,0.2,-2.5",  # not the last line
        HEADER + "0.50,36.1,0",  # nothing else would be left
    ],
)
def test_other_lines_that_are_wrong_are_refused(tmp_path: Path, text: str) -> None:
    with pytest.raises(DatasetError, match=r"log\.csv:\d+: "):
        read_sensor_csv(write(tmp_path / "log.csv", text))
