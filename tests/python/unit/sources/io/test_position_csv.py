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
    ("text", "line", "reason"),
    [
        ("", None, "is empty"),
        ("name,lat,lon\na,1,2\n", 1, "must have name and lat, lon, height"),
        ("name,lat,lon,alt\na,1,2,3\nb,1,x,3\n", 3, "lon is 'x': must be a finite number"),
        ("name,lat,lon,alt\na,1,2,inf\n", 2, "alt is 'inf': must be a finite number"),
        ("name,lat,lon,alt\na,100,2,3\n", 2, "out of range, or swapped"),
        ("name,lat,lon,alt\na,1,2,3\na,1,2,3\n", 3, "'a' stands there twice"),
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
