"""Positions of images from CSV."""

from __future__ import annotations

from pathlib import Path

import pytest

from sfmcpp.errors import DatasetError
from sfmcpp.sources.io.position_csv import read_position_csv


def written(folder: Path, text: str) -> Path:
    path = folder / "gps.csv"
    path.write_text(text)
    return path


def test_columns_are_found_by_name_in_any_order(tmp_path: Path) -> None:
    text = "Height [m],Image,Longitude (deg),LAT,note\n12.5,a.jpg,9.25,-46.5,x\n,b.jpg,,,\n"
    found = read_position_csv(written(tmp_path, text))
    assert found.geodetic
    assert found.positions == {"a.jpg": (-46.5, 9.25, 12.5)}


def test_metric_positions(tmp_path: Path) -> None:
    found = read_position_csv(written(tmp_path, "name,x,y,z\na,1,2,3\n"))
    assert not found.geodetic
    assert found.positions == {"a": (1.0, 2.0, 3.0)}


def test_names_with_commas_are_quoted_and_other_encodings_refused(tmp_path: Path) -> None:
    quoted = written(tmp_path, 'name,x,y,z\n"a, b.jpg",1,2,3\n')
    assert read_position_csv(quoted).positions == {"a, b.jpg": (1.0, 2.0, 3.0)}
    quoted.write_bytes("name,x,y,z\nHöhe.jpg,1,2,3\n".encode("latin-1"))
    with pytest.raises(DatasetError, match="is no UTF-8 text"):
        read_position_csv(quoted)


@pytest.mark.parametrize(
    "columns", ["sigma_n,sigma_e,sigma_u", "sigma_lat,sigma_lon,sigma_height", "Sigma_Y [m],sigma_x,sigma_z"]
)
def test_standard_deviations_are_along_the_axes_of_the_world(tmp_path: Path, columns: str) -> None:
    text = f"name,lat,lon,height,{columns}\na,1,2,3,0.2,0.1,0.4\nb,,,,,,\n"
    assert read_position_csv(written(tmp_path, text)).sigmas == {"a": (0.1, 0.2, 0.4)}


def test_horizontal_and_vertical_deviations(tmp_path: Path) -> None:
    text = "name,x,y,z,sigma_horizontal,sigma_vertical\na,1,2,3,0.1,0.4\n"
    assert read_position_csv(written(tmp_path, text)).sigmas == {"a": (0.1, 0.1, 0.4)}


def test_images_without_names_are_numbered_by_index_or_line(tmp_path: Path) -> None:
    by_index = read_position_csv(written(tmp_path, "index,x,y,z\n4,1,2,3\n0,,,\n"), numbered=True)
    assert by_index.by_number
    assert by_index.positions == {"4": (1.0, 2.0, 3.0)}
    by_line = read_position_csv(written(tmp_path, "x,y,z\n1,2,3\n,,\n7,8,9\n"), numbered=True)
    assert by_line.positions == {"0": (1.0, 2.0, 3.0), "2": (7.0, 8.0, 9.0)}


@pytest.mark.parametrize(
    ("text", "line", "reason"),
    [
        ("", None, "is empty"),
        ("name,lat,lon\na,1,2\n", 1, "must have name and lat, lon, height"),
        ("name,lat,lon,alt\na,1,2,3\nb,1,x,3\n", 3, "lon is 'x': must be a finite number"),
        ("name,lat,lon,alt\na,1,2,inf\n", 2, "alt is 'inf': must be a finite number"),
        ("name,lat,lon,alt\na,100,2,3\n", 2, "out of range, or swapped"),
        ("name,lat,lon,alt\na,1,2,3\na,1,2,3\n", 3, "'a' stands there twice"),
        ("index,x,y,z\n0,1,2,3\n", 1, "must have name and"),
        (
            "name,x,y,z,sigma_x\na,1,2,3,1\n",
            1,
            "its standard deviations are sigma_x: must be",
        ),
        ("name,x,y,z,sigma_x,sigma_y,sigma_z\na,1,2,3,1,,1\n", 2, "sigma_y is '': must be a finite number"),
        ("name,x,y,z,sigma_x,sigma_y,sigma_z\na,1,2,3,1,0,1\n", 2, "standard deviation 0: must be positive"),
    ],
)
def test_what_is_wrong_is_named_with_its_line(
    tmp_path: Path, text: str, line: int | None, reason: str
) -> None:
    path = written(tmp_path, text)
    with pytest.raises(DatasetError) as caught:
        read_position_csv(path)
    assert Path(caught.value.path) == path
    assert caught.value.line == line
    assert reason in caught.value.reason
