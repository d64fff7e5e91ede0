"""Files of ground control points: the table and OpenDroneMap's list."""

from __future__ import annotations

from pathlib import Path

import pytest

from sfmcpp.errors import DatasetError
from sfmcpp.sources.io.control_points import Mark, read_control_points

TABLE = """name,x,y,z,image,u,v,sigma,check
gate,412.3,88.1,12.5,a.jpg,100.5,200,0.02,0
gate,412.3,88.1,12.5,b.jpg,110,210.25,0.02,
roof,400,90,20,a.jpg,300,400,0.03,1
"""
LIST = """EPSG:32632
691500.5 5334500.25 520 100 200 a.jpg gate
691500.5 5334500.25 520 110 210 b.jpg gate extra words

691510 5334505 521 300 400 a.jpg
691510 5334505 521 310 410 b.jpg
"""


def written(folder: Path, text: str, name: str = "gcp.csv") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def test_a_table_has_a_line_for_each_mark(tmp_path: Path) -> None:
    found = read_control_points(written(tmp_path, TABLE))
    assert found.names == ["gate", "roof"]
    assert found.positions == [(412.3, 88.1, 12.5), (400.0, 90.0, 20.0)]
    assert not found.geodetic
    assert found.sigmas_m == [(0.02,) * 3, (0.03,) * 3]
    assert found.checks == {1}
    expected = [(0, "a.jpg", 100.5, 200.0), (0, "b.jpg", 110.0, 210.25), (1, "a.jpg", 300.0, 400.0)]
    assert found.marks == [Mark(point, image, (u, v)) for point, image, u, v in expected]


@pytest.mark.parametrize(
    ("header", "line"),
    [
        ("label;lat;lon;height;photo;px;py", "gate;46,5;-91,25;198,5;a.jpg;10,5;20,5"),
        (
            "Point name,Latitude,Longitude,Altitude,Image name,Pixel x,Pixel y",
            "gate,46.5,-91.25,198.5,a.jpg,10.5,20.5",
        ),
    ],
)
def test_other_names_and_decimal_commas_are_known(tmp_path: Path, header: str, line: str) -> None:
    found = read_control_points(written(tmp_path, f"{header}\n{line}\n"))
    assert found.geodetic
    assert found.positions == [(46.5, -91.25, 198.5)]
    assert found.marks == [Mark(0, "a.jpg", (10.5, 20.5))]
    assert found.sigmas_m is None


def test_names_of_pixels_are_not_taken_for_axes(tmp_path: Path) -> None:
    found = read_control_points(written(tmp_path, "name,x,y,height,image,u,v\ngate,1,2,3,a.jpg,10,20\n"))
    assert found.positions == [(1.0, 2.0, 3.0)]


def test_the_list_of_opendronemap_is_read(tmp_path: Path) -> None:
    found = read_control_points(written(tmp_path, LIST, "gcp_list.txt"))
    assert found.names == ["gate", "(691510, 5334505, 521)"]
    assert found.positions[0] == (691500.5, 5334500.25, 520.0)
    assert not found.geodetic
    assert [mark.point for mark in found.marks] == [0, 0, 1, 1]


@pytest.mark.parametrize("projection", ["EPSG:4326", "WGS84", "+proj=longlat +datum=WGS84"])
def test_longitude_comes_first_in_the_list(tmp_path: Path, projection: str) -> None:
    found = read_control_points(written(tmp_path, f"{projection}\n-91.99 46.84 198.5 1 2 a.jpg gate\n"))
    assert found.geodetic
    assert found.positions == [(46.84, -91.99, 198.5)]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty"),
        ("name,x,y,z,image,u,v\n", "holds no mark"),
        ("name,x,y,z,image,u\n", r":1: its columns are .*must have name, x, y, z or lat, lon"),
        ("name,image,u,v\ngate,a.jpg,1,2\n", r":1: its columns"),
        (TABLE.replace("b.jpg,110", "b.jpg,north"), r":3: u is 'north': must be a finite number"),
        (TABLE.replace("12.5,b.jpg", "12.6,b.jpg"), r":3: point 'gate' is told otherwise: must be as in"),
        (TABLE.replace("b.jpg", "a.jpg"), r":3: point 'gate' is marked twice in 'a.jpg'"),
        (TABLE.replace("0.03,1", "0.03,perhaps"), r":4: check is 'perhaps': must be 1 or 0"),
        (TABLE.replace("0.03,1", "0,1"), r":4: standard deviation 0: must be positive"),
        ("EPSG:32632\n1 2 3 4 5\n", r":2: the line holds 5 words: must be x y z u v image"),
        ("EPSG:4326\n46.84 -91.99 198.5 1 2 a.jpg\n", r":2: longitude 46.84°, latitude -91.99°: out"),
        ("EPSG:32632\n1 2 nan 4 5 a.jpg\n", r":2: z is 'nan': must be a finite number"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named_with_its_line(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(DatasetError, match=message):
        read_control_points(written(tmp_path, text))
