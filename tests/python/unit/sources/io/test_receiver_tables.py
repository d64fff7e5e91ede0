"""Tables of receivers: DJI's MRK and RTKLIB's pos."""

from __future__ import annotations

from pathlib import Path

import pytest

from sfmcpp.errors import DatasetError
from sfmcpp.sources.io.position_csv import read_position_csv

MRK = """\
1\t375717.060870\t[2041]\t   -24,N\t    -4,E\t   192,V\t22.53932039,Lat\t113.95798969,Lon\t45.322,Ellh\t0.013410, 0.015044, 0.035204\t50,Q
3\t375720.270164\t[2041]\t   -19,N\t     7,E\t   194,V\t-22.53933001,Lat\t-113.95790012,Lon\t45.401,Ellh\t1.250000, 1.500000, 3.100000\t16,Q
4\t375723.270164\t[2041]\t     0,N\t     0,E\t     0,V\t0.00000000,Lat\t0.00000000,Lon\t0.000,Ellh\t0.000000, 0.000000, 0.000000\t0,Q
"""  # noqa: E501
POS = """\
% program   : RTKLIB ver.2.4.3
%
% (lat/lon/height=WGS84/ellipsoidal,Q=1:fix,2:float,3:sbas,4:dgps,5:single,6:ppp,ns=# of satellites)
%  GPST                  latitude(deg) longitude(deg)  height(m)   Q  ns   sdn(m)   sde(m)   sdu(m)  age(s)  ratio
2019/06/08 08:03:55.500   47.060012345   -1.350412345    84.1230   1  12   0.0050   0.0040   0.0120   0.50    9.9
2019/06/08 08:03:57.500   47.060022345   -1.350422345    84.2230   2  11   0.1050   0.1040   0.3120   0.50    1.1
"""  # noqa: E501


def written(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text)
    return path


def test_an_mrk_names_photos_by_number_and_has_no_position_without_a_solution(tmp_path: Path) -> None:
    found = read_position_csv(written(tmp_path, "100_0004_Timestamp.MRK", MRK))
    assert found.positions == {
        "1": (22.53932039, 113.95798969, 45.322),
        "3": (-22.53933001, -113.95790012, 45.401),
    }
    # The file has north first.
    assert found.sigmas == {"1": (0.015044, 0.01341, 0.035204), "3": (1.5, 1.25, 3.1)}
    assert (found.geodetic, found.named_by) == (True, "photo number")


def test_longitude_may_come_before_latitude_in_an_mrk(tmp_path: Path) -> None:
    first = MRK.splitlines()[0].replace(
        "22.53932039,Lat\t113.95798969,Lon", "113.95798969,Lon\t22.53932039,Lat"
    )
    found = read_position_csv(
        written(tmp_path, "a.MRK", f"{MRK.splitlines()[1].replace('3', '7', 1)}\n{first}\n")
    )
    assert found.positions["1"] == (22.53932039, 113.95798969, 45.322)


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ("3\t3757", "1\t3757", ":2: photo 1 stands there twice"),
        ("-22.53933001", "-92.53933001", r":2: latitude -92\.5393°, longitude -113\.958°: out of range"),
        ("1.250000,", "-1.25,", r":2: standard deviation -1\.25: must be positive"),
        ("45.401", "high", ":2: height is 'high': must be a finite number"),
        ("16,Q", "", ":2: .*must have a photo number, Lat, Lon, Ellh"),
    ],
)
def test_what_is_wrong_in_an_mrk_is_named_with_its_line(
    tmp_path: Path, old: str, new: str, reason: str
) -> None:
    path = written(tmp_path, "a.MRK", MRK.replace(old, new, 1))
    with pytest.raises(DatasetError, match=reason):
        read_position_csv(path)


def test_an_mrk_of_a_receiver_without_any_solution_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="no photo with a position"):
        read_position_csv(written(tmp_path, "a.MRK", MRK.replace("50,Q", "0,Q").replace("16,Q", "0,Q")))


@pytest.mark.parametrize("separator", [" ", ",", ";", "\t"])
def test_a_pos_has_positions_in_the_order_of_its_lines(tmp_path: Path, separator: str) -> None:
    *comments, titles, first, second = POS.splitlines()
    rows = ["% " + separator.join(titles[1:].split())]
    rows += [separator.join(row.split()).replace(separator, " ", 1) for row in (first, second)]
    found = read_position_csv(written(tmp_path, "events.pos", "\n".join([*comments, *rows])))
    assert found.positions == {
        "0": (47.060012345, -1.350412345, 84.123),
        "1": (47.060022345, -1.350422345, 84.223),
    }
    assert found.sigmas == {"0": (0.004, 0.005, 0.012), "1": (0.104, 0.105, 0.312)}
    assert (found.geodetic, found.named_by) == (True, "order")


def test_a_pos_may_have_weeks_and_seconds_and_no_deviations(tmp_path: Path) -> None:
    text = (
        "%  GPST       latitude(deg) longitude(deg)  height(m)   Q  ns\n2056 547435.500 47.0 -1.3 84.1 1 12\n"
    )
    found = read_position_csv(written(tmp_path, "a.pos", text))
    assert (found.positions, found.sigmas) == ({"0": (47.0, -1.3, 84.1)}, None)


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ("latitude(deg)", "latitude(d'\")", r"must name the columns latitude\(deg\).*Lat/Lon/Height"),
        ("latitude(deg) longitude(deg)  height(m)", "x-ecef(m) y-ecef(m) z-ecef(m)", "must name the col"),
        (
            "84.2230   2  11   0.1050   0.1040   0.3120   0.50    1.1",
            "84.2",
            ":6: the line holds 5 cells",
        ),
        ("0.3120", "0.0000", ":6: standard deviation 0: must be positive"),
        ("47.060022345", "", ":6: the line holds 11 cells: must be 12"),
    ],
)
def test_what_is_wrong_in_a_pos_is_named(tmp_path: Path, old: str, new: str, reason: str) -> None:
    with pytest.raises(DatasetError, match=reason):
        read_position_csv(written(tmp_path, "a.pos", POS.replace(old, new, 1)))
