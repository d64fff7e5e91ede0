"""Positions of images from CSV."""

from __future__ import annotations

from pathlib import Path

import pytest

from sfmcpp.errors import DatasetError
from sfmcpp.sources.io.position_columns import Triple
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


@pytest.mark.parametrize("encoding", ["utf-16-le", "utf-16-be"])
def test_utf_16_of_spreadsheets_is_refused_by_name(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "unicode.csv"
    path.write_bytes("\ufeffname,x,y,z\na,1,2,3\n".encode(encoding))
    with pytest.raises(DatasetError, match=r"unicode\.csv: is text in UTF-16: must be UTF-8"):
        read_position_csv(path)


def test_blanks_separate_where_the_header_has_nothing_else(tmp_path: Path) -> None:
    text = 'name  lat lon\u00a0 height\n  "a b.jpg" 1   2 3\nb.jpg 4 5 6\n'
    found = read_position_csv(written(tmp_path, text))
    assert found.geodetic
    assert found.positions == {"a b.jpg": (1.0, 2.0, 3.0), "b.jpg": (4.0, 5.0, 6.0)}


@pytest.mark.parametrize(
    ("beginning", "reason"),
    [
        ('<?xml version="1.0"?>\n<gpx version="1.1"/>\n', "is a track .GPX, KML, NMEA.* `exiftool -geotag"),
        ("$GPGGA,100000.00,4630.0,N,00730.0,E,4,12,0.8,500.0,M,48.0,M,,*5B\n", "is a track .GPX, KML, NMEA"),
        ('{"type": "FeatureCollection", "features": []}\n', "is JSON: must be a table, such as name,lat"),
        ("a.jpg 600000 5150000 500\nb.jpg 600010 5150000 500\n", ":1: the first line holds numbers .*header"),
    ],
)
def test_files_of_positions_that_are_no_tables_are_told_as_what_they_are(
    tmp_path: Path, beginning: str, reason: str
) -> None:
    with pytest.raises(DatasetError, match=reason):
        read_position_csv(written(tmp_path, beginning))


@pytest.mark.parametrize("first", ["sep=;", '"sep=;"', "SEP=;\r"])
def test_the_line_in_which_excel_tells_the_separator_is_none_of_the_table(tmp_path: Path, first: str) -> None:
    found = read_position_csv(written(tmp_path, f"{first}\nname;x;y;z\na.jpg;1,5;2;3\n"))
    assert found.positions == {"a.jpg": (1.5, 2.0, 3.0)}
    with pytest.raises(DatasetError, match=r":3: y is 'two'"):
        read_position_csv(written(tmp_path, f"{first}\nname;x;y;z\na.jpg;1;two;3\n"))


def test_bars_may_separate_cells(tmp_path: Path) -> None:
    found = read_position_csv(written(tmp_path, "name|lat|lon|height\na.jpg|1.5|2|3\n"))
    assert found.positions == {"a.jpg": (1.5, 2.0, 3.0)}


def test_lines_of_old_macs_end_with_cr(tmp_path: Path) -> None:
    path = written(tmp_path, "")
    path.write_bytes(b"name,x,y,z\ra,1,2,3\rb,4,5,6\r")
    assert read_position_csv(path).positions == {"a": (1.0, 2.0, 3.0), "b": (4.0, 5.0, 6.0)}


@pytest.mark.parametrize(
    "columns", ["sigma_n,sigma_e,sigma_u", "sigma_lat,sigma_lon,sigma_height", "Sigma_Y [m],sigma_x,sigma_z"]
)
def test_standard_deviations_are_along_the_axes_of_the_world(tmp_path: Path, columns: str) -> None:
    text = f"name,lat,lon,height,{columns}\na,1,2,3,0.2,0.1,0.4\nb,,,,,,\n"
    assert read_position_csv(written(tmp_path, text)).sigmas == {"a": (0.1, 0.2, 0.4)}


def test_horizontal_and_vertical_deviations(tmp_path: Path) -> None:
    text = "name,x,y,z,sigma_horizontal,sigma_vertical\na,1,2,3,0.1,0.4\n"
    assert read_position_csv(written(tmp_path, text)).sigmas == {"a": (0.1, 0.1, 0.4)}


@pytest.mark.parametrize(
    "title", ["sigma", "Accuracy (m)", "Position accuracy [m]", "std_dev", "gps_accuracy"]
)
def test_one_deviation_is_that_of_all_axes(tmp_path: Path, title: str) -> None:
    text = f"name,x,y,z,{title},HDOP,yaw accuracy\na,1,2,3,0.5,9,8\n"
    assert read_position_csv(written(tmp_path, text)).sigmas == {"a": (0.5, 0.5, 0.5)}


def test_images_without_names_are_numbered_by_index_or_line(tmp_path: Path) -> None:
    by_index = read_position_csv(written(tmp_path, "index,x,y,z\n4,1,2,3\n0,,,\n"), numbered=True)
    assert by_index.named_by == "index"
    assert by_index.positions == {"4": (1.0, 2.0, 3.0)}
    padded = written(tmp_path, "index,x,y,z\n004,1,2,3\n010,1,2,3\n")
    assert list(read_position_csv(padded, numbered=True).positions) == ["4", "10"]
    by_line = read_position_csv(written(tmp_path, "x,y,z\n1,2,3\n,,\n7,8,9\n"), numbered=True)
    assert by_line.positions == {"0": (1.0, 2.0, 3.0), "2": (7.0, 8.0, 9.0)}


@pytest.mark.parametrize(
    ("cells", "reason"),
    [
        ("1.5,1,2,3", "index is '1.5': must be the number of an image"),
        ("-1,1,2,3", "index is '-1': must be the number of an image"),
        ("1,1,2,3\n01,1,2,3", "'1' stands there twice"),
    ],
)
def test_an_index_is_a_whole_number_once(tmp_path: Path, cells: str, reason: str) -> None:
    with pytest.raises(DatasetError, match=reason):
        read_position_csv(written(tmp_path, f"index,x,y,z\n{cells}\n"), numbered=True)


def test_units_in_brackets_are_obeyed(tmp_path: Path) -> None:
    text = (
        "name,lat [rad],lon [deg],height [ft],sigma_horizontal [cm],sigma_vertical (mm)\na,0.5,9,100,3,50\n"
    )
    found = read_position_csv(written(tmp_path, text))
    assert found.positions["a"] == pytest.approx((28.6478898, 9.0, 30.48))
    assert found.sigmas == {"a": pytest.approx((0.03, 0.03, 0.05))}
    us_feet = read_position_csv(written(tmp_path, "name,x [us-ft],y [US ft],z [feet]\na,3937,7874,10\n"))
    assert us_feet.positions["a"] == pytest.approx((1200.0, 2400.0, 3.048))


LOG = """Photo{0}Latitude{0}Longitude{0}Ellipsoidal height (m){0}Std North (m){0}Std East (m){0}Std Up (m){0}Q
a.jpg{0}46{1}8426{0}-91{1}9945{0}198{1}297{0}0{1}020{0}0{1}030{0}0{1}050{0}FIX, float
"""


@pytest.mark.parametrize(("separator", "point"), [("\t", "."), (";", "."), (";", ","), ("\t", ",")])
def test_logs_of_receivers_are_read_as_they_are(tmp_path: Path, separator: str, point: str) -> None:
    found = read_position_csv(written(tmp_path, LOG.format(separator, point)))
    assert found.positions == {"a.jpg": (46.8426, -91.9945, 198.297)}
    assert found.sigmas == {"a.jpg": (0.03, 0.02, 0.05)}


@pytest.mark.parametrize(
    ("latitude", "longitude", "height", "position"),
    [
        (
            '46 deg 30\' 36.00"" S',
            '9 deg 15\' 0.00"" E',
            "198.5 m Above Sea Level",
            (-46.51, 9.25, 198.5),
        ),
        (
            '46 deg 30\' 36"" North',
            '0 deg 0\' 36.00"" West',
            "12 m Below Sea Level",
            (46.51, -0.01, -12.0),
        ),
    ],
)
def test_positions_are_read_as_exiftool_prints_them(
    tmp_path: Path, latitude: str, longitude: str, height: str, position: tuple[float, float, float]
) -> None:
    head = "SourceFile,GPSLatitude,GPSLongitude,GPSAltitude"
    found = read_position_csv(written(tmp_path, f'{head}\na,"{latitude}","{longitude}",{height}\n'))
    assert found.geodetic
    assert found.positions["a"] == pytest.approx(position, rel=1e-15)


@pytest.mark.parametrize(
    ("latitude", "longitude", "position"),
    [
        ("46.51 S", "9.25 East", (-46.51, 9.25, 2.0)),
        ("S46.51", "E 9.25°", (-46.51, 9.25, 2.0)),
        ("46°30'36''N", "0°0′36″W", (46.51, -0.01, 2.0)),
        ("46° 30.6' N", "009° 15.0' E", (46.51, 9.25, 2.0)),
    ],
)
def test_angles_with_their_hemisphere_are_read_as_people_write_them(
    tmp_path: Path, latitude: str, longitude: str, position: Triple
) -> None:
    found = read_position_csv(written(tmp_path, f"name;lat;lon;alt\na;{latitude};{longitude};2\n"))
    assert found.positions["a"] == pytest.approx(position, rel=1e-15)


@pytest.mark.parametrize(
    ("head", "cells", "position"),
    [
        ("GPSLatitudeRef,GPSLatitude,GPSLongitudeRef,GPSLongitude", "South,46.5,West,9.25", (-46.5, -9.25)),
        ("lat,N/S,lon,E/W", "46.5,s,9.25,E", (-46.5, 9.25)),
        ("Latitude,Latitude Direction,lng,lng_hemisphere", "46.5,N,9.25,W", (46.5, -9.25)),
        ("lat,lat_ref,lon,lon_ref", "-46.5,S,-9.25,W", (-46.5, -9.25)),
        ("lat,lat_ref,lon,lon_ref", "46.5,-46.0,9.25,-9.0", (46.5, 9.25)),
    ],
)
def test_columns_of_hemispheres_give_coordinates_their_sign(
    tmp_path: Path, head: str, cells: str, position: tuple[float, float]
) -> None:
    found = read_position_csv(written(tmp_path, f"name,{head},alt\na,{cells},3\n"))
    assert found.positions == {"a": (*position, 3.0)}


@pytest.mark.parametrize(
    ("cell", "height"),
    [("0", 12.0), ("1", -12.0), ("Below Sea Level", -12.0), ("Above Sea Level", 12.0), ("", 12.0)],
)
def test_a_column_tells_heights_below_the_sea(tmp_path: Path, cell: str, height: float) -> None:
    text = f"SourceFile,GPSLatitude,GPSLongitude,GPSAltitude,GPSAltitudeRef\na,31.5,35.5,12,{cell}\n"
    assert read_position_csv(written(tmp_path, text)).positions == {"a": (31.5, 35.5, height)}


@pytest.mark.parametrize(
    ("text", "position", "sigmas"),
    [
        ("SourceFile,GPSLatitude,GPSLongitude,GPSAltitude\na,1,2,3\n", (1.0, 2.0, 3.0), None),
        (
            "Image Name,Easting (m),Northing (m),Altitude,Ellipsoidal Height\na,1,2,9,3\n",
            (1.0, 2.0, 3.0),
            None,
        ),
        ("#Label,East,North,Height,Accuracy H,Accuracy V\na,1,2,3,4,5\n", (1.0, 2.0, 3.0), (4.0, 4.0, 5.0)),
        (
            '#CoordinateSystem: GEOGCS["WGS 84",AUTHORITY["EPSG","4326"]]\n'
            "#Label,X/Longitude,Y/Latitude,Z/Altitude,Accuracy_X/Y_(m),Accuracy_Z_(m),Yaw\n"
            "a,2,1,3,4,5,9\n# Total error,0,0,0\n",
            (1.0, 2.0, 3.0),
            (4.0, 4.0, 5.0),
        ),
        (
            "# CoordinateSystem: WGS 84 / UTM zone 32N (EPSG::32632)\n"
            "Label,X/Easting,Y/Northing,Z/Altitude,X/East_accuracy,Y/North_accuracy,Z/Altitude_accuracy\n"
            "a,1,2,3,4,5,6\n",
            (1.0, 2.0, 3.0),
            (4.0, 5.0, 6.0),
        ),
        (
            "#Label,X/East,Y/North,Z/Altitude,Error_(m),X_error,X_est,Accuracy_X/Y/Z_(m)\na,1,2,3,9,9,9,4\n",
            (1.0, 2.0, 3.0),
            (4.0, 4.0, 4.0),
        ),
        ("name,lat,lon,alt,sdn(m),sde(m),sdu(m)\na,1,2,3,4,5,6\n", (1.0, 2.0, 3.0), (5.0, 4.0, 6.0)),
        ("name,lat,lon,alt,hAcc,vAcc\na,1,2,3,4,5\n", (1.0, 2.0, 3.0), (4.0, 4.0, 5.0)),
        (
            "name,lat,lon,alt,Accuracy Horz [m],Accuracy Vert [m]\na,1,2,3,4,5\n",
            (1.0, 2.0, 3.0),
            (4.0, 4.0, 5.0),
        ),
        (
            "Name,Longitude,Latitude,Ellipsoidal height,Easting RMS,Northing RMS,Elevation RMS,Lateral RMS\n"
            "a,2,1,3,4,5,6,9\n",
            (1.0, 2.0, 3.0),
            (4.0, 5.0, 6.0),
        ),
        (
            "SourceFile,GPSLatitude,GPSLongitude,GPSAltitude,RtkStdLon,RtkStdLat,RtkStdHgt\na,1,2,3,4,5,6\n",
            (1.0, 2.0, 3.0),
            (4.0, 5.0, 6.0),
        ),
    ],
)
def test_common_names_of_columns_are_known(
    tmp_path: Path, text: str, position: Triple, sigmas: Triple | None
) -> None:
    found = read_position_csv(written(tmp_path, text))
    assert found.positions == {"a": position}
    assert found.sigmas == (None if sigmas is None else {"a": sigmas})


@pytest.mark.parametrize(
    ("columns", "unread"),
    [
        ("X_acc,Y_acc [m],Yaw_acc", ("X_acc", "Y_acc [m]")),
        ("GPSHPositioningError,RMS", ("GPSHPositioningError", "RMS")),
        ("sigma_x,sigma_y,sigma_z,X_acc", ()),
        ("accel_x,HDOP,yaw accuracy,Error_(m),X_error", ()),
    ],
)
def test_columns_that_seem_to_be_deviations_are_told_where_none_are_read(
    tmp_path: Path, columns: str, unread: tuple[str, ...]
) -> None:
    ones = ",1" * (columns.count(",") + 1)
    assert read_position_csv(written(tmp_path, f"name,x,y,z,{columns}\na,1,2,3{ones}\n")).unread == unread


@pytest.mark.parametrize(
    ("text", "line", "reason"),
    [
        ("name,lat,lon,height\n", None, "holds no position below its header"),
        ("", None, "is empty"),
        ("# Exported by a program\n", 1, "must have name and lat, lon, height"),
        ("IMG_1.JPG,46.1,-91.9,198.3\nIMG_2.JPG,46.2,-91.8,198.4\n", 1, "must be a header, such as name,lat"),
        ("name,lat,lon\na,1,2\n", 1, "must have name and lat, lon, height"),
        ("name,lat,lon,alt\na,1,2,3\nb,1,x,3\n", 3, "lon is 'x': must be a finite number"),
        ("name;lat;lon;alt\na;46 deg 30' 36\";9;1\n", 2, "must be a finite number"),
        ("name,lat,lon,alt\na,7 deg 0' 1\" E,46 deg 0' 1\" N,9\n", 2, "or an angle with N or S"),
        ("name;lat;lon;alt\na;46 deg 60' 36\" N;9;1\n", 2, "must be a finite number"),
        ("name,lat,lat_ref,lon,alt\na,-46,N,9,1\n", 2, "-46 is negative, and its hemisphere 'N'"),
        ("name,lat,lon,lon_ref,alt\na,46,9,,1\n", 2, "the hemisphere is '': must be E or W"),
        ("name,lat,lon,alt\na,4_6,2,1\n", 2, "lat is '4_6': must be a finite number"),
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
        ("name,lat,lon,height [furlong]\na,1,2,3\n", 1, "'height [furlong]' has the unknown unit 'furlong'"),
        ("name,lat,lon,height (MSL)\na,1,2,3\n", 1, "'height (MSL)' has the unknown unit 'MSL'"),
        ("name;x;y;z\na;1,250;2,500;3\n", 2, "the comma in '1,250' may be decimal or of thousands"),
        ("name;x;y;z\na;1,2;2.5;3\n", 2, "the comma in '1,2' may be decimal or of thousands"),
        (
            "name,lat,lon,alt\na,46,5,9,25,3,0\n",
            2,
            "the line holds 7 cells: must be 4; where commas are decimal",
        ),
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


def test_a_cell_that_is_too_long_is_told_with_its_line(tmp_path: Path) -> None:
    path = tmp_path / "gps.csv"
    path.write_text("name,lat,lon,height\na.jpg,46.5,9.25,12.5\n" + "1" * 200_000)
    with pytest.raises(DatasetError, match=r"gps\.csv:3: field larger than field limit"):
        read_position_csv(path)


GEO = """EPSG:4326
a.jpg -91.99 46.84 198.5 10 20 30 0.5 1.5
b.jpg -91.98 46.85 199 10 20 30 0.25 1
"""


def test_the_list_of_opendronemap_is_read(tmp_path: Path) -> None:
    path = tmp_path / "geo.txt"
    path.write_text(GEO)
    found = read_position_csv(path)
    assert found.positions == {"a.jpg": (46.84, -91.99, 198.5), "b.jpg": (46.85, -91.98, 199.0)}
    assert found.geodetic
    assert found.sigmas == {"a.jpg": (0.5, 0.5, 1.5), "b.jpg": (0.25, 0.25, 1.0)}
    path.write_text("EPSG:32615\na.jpg 500 600 20\n")
    metric = read_position_csv(path)
    assert metric.positions == {"a.jpg": (500.0, 600.0, 20.0)}
    assert not metric.geodetic
    assert metric.sigmas is None


def test_lines_of_a_geo_txt_that_begin_with_a_hash_are_comments(tmp_path: Path) -> None:
    path = tmp_path / "geo.txt"
    path.write_text("EPSG:32615\n# name x y z\n#left_out.jpg 1 2 3\na.jpg 500 600 20\n")
    assert read_position_csv(path).positions == {"a.jpg": (500.0, 600.0, 20.0)}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("EPSG:4326\n", "holds no position below its projection"),
        ("EPSG:4326\na.jpg 1 2\n", r":2: the line holds 3 words: must be a name, x, y, z"),
        ("EPSG:4326\na.jpg 46.84 -91.99 198\n", r":2: longitude 46.84°, latitude -91.99°: out of range"),
        (GEO.replace("b.jpg", "a.jpg"), r":3: 'a.jpg' stands there twice"),
        (GEO.replace("0.25 1", "0 1"), r":3: accuracy 0: must be positive"),
        (GEO.replace(" 10 20 30 0.25 1", ""), r"'b.jpg' has no accuracies: must be in all lines, or in none"),
        (GEO.replace("199", "high"), r":3: z is 'high': must be a finite number"),
    ],
)
def test_what_is_wrong_in_a_list_is_named_with_its_line(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "geo.txt"
    path.write_text(text)
    with pytest.raises(DatasetError, match=message):
        read_position_csv(path)
