"""Positions of images to files."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from sfmcpp.errors import DatasetError
from sfmcpp.sources.io.named_positions import NamedPositions
from sfmcpp.sources.io.position_csv import read_position_csv
from sfmcpp.sources.io.position_files import GivenPositions, write_positions

NAMED = NamedPositions({"a, b.jpg": (46.123456789012345, 9.25, 12.5), "Höhe.jpg": (46.5, -9.25, 0.1)}, True)


@pytest.mark.parametrize("geodetic", [True, False])
def test_a_csv_is_read_back_to_the_last_digit(tmp_path: Path, geodetic: bool) -> None:
    named = NamedPositions(NAMED.positions, geodetic)
    write_positions(tmp_path / "p.csv", named)
    assert read_position_csv(tmp_path / "p.csv") == named


def test_names_that_look_like_comments_or_hold_quotes_are_read_back(tmp_path: Path) -> None:
    names = ["#1.jpg", '# "2".jpg', 'a "b".jpg', "3;4.jpg"]
    named = NamedPositions({name: (46.5, 9.25, float(k)) for k, name in enumerate(names)}, True)
    write_positions(tmp_path / "p.csv", named, GivenPositions({"#1.jpg": 8.5}, ["3;4.jpg"]))
    assert read_position_csv(tmp_path / "p.csv") == named


def test_geojson_has_the_longitude_first(tmp_path: Path) -> None:
    write_positions(tmp_path / "p.geojson", NAMED)
    content = json.loads((tmp_path / "p.geojson").read_text())
    assert content["type"] == "FeatureCollection"
    assert content["features"][1] == {
        "type": "Feature",
        "geometry": {"type": "Point", "coordinates": [-9.25, 46.5, 0.1]},
        "properties": {"name": "Höhe.jpg"},
    }


def test_accuracies_residuals_and_what_was_left_out_are_told(tmp_path: Path) -> None:
    named = NamedPositions(NAMED.positions, True, {"a, b.jpg": (0.1, 0.2, 0.3), "Höhe.jpg": (1.0, 2.0, 3.0)})
    given = GivenPositions({"Höhe.jpg": 8.5}, ["Höhe.jpg"])
    write_positions(tmp_path / "p.csv", named, given)
    header, first, second = (tmp_path / "p.csv").read_text().splitlines()
    assert header == "name,lat,lon,height,sigma_e,sigma_n,sigma_u,residual,left_out"
    assert first.endswith(",0.1,0.2,0.3,,0")
    assert second.endswith(",1.0,2.0,3.0,8.5,1")
    assert read_position_csv(tmp_path / "p.csv") == named
    write_positions(tmp_path / "p.geojson", named, given)
    properties = json.loads((tmp_path / "p.geojson").read_text())["features"][0]["properties"]
    sigmas = {"sigma_e": 0.1, "sigma_n": 0.2, "sigma_u": 0.3}
    assert properties == {"name": "a, b.jpg", **sigmas, "residual": None, "left_out": False}


def test_what_cannot_be_written_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match=r"must end in \.csv, \.geojson"):
        write_positions(tmp_path / "p.kml", NAMED)
    with pytest.raises(DatasetError, match="GeoJSON holds latitudes"):
        write_positions(tmp_path / "p.geojson", NamedPositions(NAMED.positions, False))
    with pytest.raises(DatasetError, match="does not exist"):
        write_positions(tmp_path / "missing" / "p.csv", NAMED)
