"""Times in ISO 8601 are seconds since 1970 wherever times are read."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sfmcpp.errors import DatasetError
from sfmcpp.sources.frame_times import times_of_images
from sfmcpp.sources.io.iso_times import seconds_of_iso
from sfmcpp.sources.io.sensor_csv import read_sensor_csv
from sfmcpp.sources.vision import open_frames

START = np.datetime64("2011-09-26T13:02:25.964389445")
STAMPS = [START + np.timedelta64(103_608_000 * k, "ns") for k in range(3)]
KITTI = [str(stamp).replace("T", " ") for stamp in STAMPS]
SECONDS = np.array([stamp.astype("datetime64[ns]").astype(np.int64) for stamp in STAMPS]) * 1e-9


@pytest.mark.parametrize(
    ("text", "of_numpy"),
    [
        ("2011-09-26 13:02:25.964389445", "2011-09-26T13:02:25.964389445"),
        ("2024-05-01T10:00:00Z", "2024-05-01T10:00:00"),
        ("2024-05-01T12:00:00.25+02:00", "2024-05-01T10:00:00.25"),
        ("2024-02-29 23:30:00,5-0130", "2024-03-01T01:00:00.5"),
        (" 2024-05-01 10:00:00 UTC", "2024-05-01T10:00:00"),
        ("1969-12-31T23:59:59.5", "1969-12-31T23:59:59.5"),
    ],
)
def test_a_time_is_that_of_numpy(text: str, of_numpy: str) -> None:
    wanted = np.datetime64(of_numpy, "ns").astype(np.int64) * 1e-9
    assert seconds_of_iso(text) == pytest.approx(wanted, rel=0, abs=3e-7)


@pytest.mark.parametrize(
    "text",
    [
        *("", "12.5", "2024-05-01", "2023-02-29 10:00:00", "2024-05-01 25:00:00", "x"),
        *("0001-01-01 00:00:00+05:00", "9999-12-31 23:59:59-05:00"),  # outside of the calendar at Greenwich
    ],
)
def test_another_text_is_none(text: str) -> None:
    assert seconds_of_iso(text) is None


@pytest.mark.parametrize("header", ["time", "timestamp", "t", "T [s]", "Timestamp"])
@pytest.mark.parametrize(("separator", "comma"), [(",", "."), (";", ",")])
def test_a_log_may_have_them(tmp_path: Path, header: str, separator: str, comma: str) -> None:
    rows = [f"{stamp}{separator}{k}.5".replace(".", comma) for k, stamp in enumerate(KITTI)]
    (tmp_path / "log.csv").write_text("\n".join([f"{header}{separator}speed [m/s]", *rows]))
    speed = read_sensor_csv(tmp_path / "log.csv")["speed"]
    np.testing.assert_allclose(speed.t_s, SECONDS, rtol=0, atol=3e-7)
    np.testing.assert_array_equal(speed.values[:, 0], [0.5, 1.5, 2.5])


def test_numbers_still_need_a_unit(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("time,speed [m/s]\n1,2\n2,2\n")
    with pytest.raises(DatasetError, match=r"log\.csv:1: column 'time' names no unit"):
        read_sensor_csv(tmp_path / "log.csv")


def images(place: Path, count: int) -> Path:
    cv2 = pytest.importorskip("cv2", reason="OpenCV is not installed: pip install 'sfmcpp[vision]'")
    (place / "data").mkdir()
    for number in range(count):
        cv2.imwrite(str(place / "data" / f"{number:010d}.png"), np.zeros((4, 4), np.uint8))
    return place / "data"


@pytest.mark.parametrize("name", ["timestamps.txt", "times.txt"])
def test_images_of_kittis_raw_drives_have_their_times(tmp_path: Path, name: str) -> None:
    folder = images(tmp_path, 3)
    (tmp_path / name).write_text("\n".join(KITTI) + "\n")
    time_of, assumed_fps, _ = times_of_images(open_frames(folder), None, None)
    assert assumed_fps is None
    np.testing.assert_allclose([time_of(k) for k in range(3)], SECONDS, rtol=0, atol=3e-7)


def test_another_list_of_that_name_is_left_alone(tmp_path: Path) -> None:
    folder = images(tmp_path, 3)
    (tmp_path / "timestamps.txt").write_text("1 0.5 a\n2 0.6 b\n")
    assert times_of_images(open_frames(folder), None, None)[1] == 10.0


@pytest.mark.parametrize(
    ("lines", "told"),
    [
        ([KITTI[0], "12.5", KITTI[2]], r"times\.txt:2: '12.5' is no time in ISO 8601 as those before"),
        ([KITTI[0], KITTI[1], KITTI[1]], r"times\.txt:3: time 2011-.*: must be later than the one before"),
        (KITTI[:2], r"times\.txt: holds 2 times for 3 images"),
    ],
)
def test_what_is_wrong_among_them_is_named(tmp_path: Path, lines: list[str], told: str) -> None:
    folder = images(tmp_path, 3)
    (tmp_path / "times.txt").write_text("\n".join(lines))
    with pytest.raises(DatasetError, match=told):
        times_of_images(open_frames(folder), None, None)
