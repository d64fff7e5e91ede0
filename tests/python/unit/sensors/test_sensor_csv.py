"""CSV files of sensor measurements: names with units in, streams in our units out, bad lines named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.sensors import travelled_distance
from sfmcpp.sources.io.sensor_csv import left_out_columns, read_sensor_csv


def write(folder: Path, header: str, *lines: str) -> Path:
    path = folder / "sensors.csv"
    path.write_text("\n".join([header, *lines]) + "\n", encoding="utf-8")
    return path


def test_units_become_ours(tmp_path: Path) -> None:
    path = write(
        tmp_path,
        "t [ms],speed [km/h],wx [deg/s],wy [deg/s],wz [°/s],distance [km]",
        "1000,36,180,0,-90,0.001",
        "1100,72,0,90,0,0.002",
    )
    streams = read_sensor_csv(path)
    assert set(streams) == {"speed", "angular_rate", "distance"}
    np.testing.assert_allclose(streams["speed"].t_s, [1.0, 1.1])
    np.testing.assert_allclose(streams["speed"].values, [[10], [20]])
    np.testing.assert_allclose(streams["angular_rate"].values, np.pi * np.array([[1, 0, -0.5], [0, 0.5, 0]]))
    np.testing.assert_allclose(streams["distance"].values, [[1], [2]])


def test_names_are_known_in_any_case(tmp_path: Path) -> None:
    streams = read_sensor_csv(write(tmp_path, "Time (ms),Speed (m/s),X [m],Y [m],Z [m]", "0,1,2,3,4"))
    assert set(streams) == {"speed", "position"}


def test_sensors_of_different_rates_share_a_file(tmp_path: Path) -> None:
    lines = [
        f"{0.1 * i},{5.0},{'' if i % 5 else 0.5 * i},{'' if i % 5 else 0},{'' if i % 5 else 0}"
        for i in range(11)
    ]
    streams = read_sensor_csv(write(tmp_path, "t [s],speed [m/s],x [m],y [m],z [m]", *lines), max_gap_s=0.6)
    assert len(streams["speed"]) == 11
    np.testing.assert_allclose(streams["position"].t_s, [0.0, 0.5, 1.0])
    np.testing.assert_allclose(streams["position"].values[:, 0], [0.0, 2.5, 5.0])
    assert streams["position"].gaps() == ()


def test_position_and_quaternion_are_a_pose(tmp_path: Path) -> None:
    turns = Rotation.random(4, rng=np.random.default_rng(1))
    lines = [
        ",".join(map(repr, [0.1 * i, 0.5 * i, 1.0, 2.0, w, x, y, z]))
        for i, (x, y, z, w) in enumerate(turns.as_quat().tolist())
    ]
    path = write(tmp_path, "time [s],x [m],y [m],z [m],qw,qx,qy,qz", *lines)
    (stream,) = read_sensor_csv(path).values()
    assert stream.kind == "pose"
    np.testing.assert_allclose(stream.values[:, :3], [[0.5 * i, 1, 2] for i in range(4)])
    found = Rotation.from_rotvec(stream.values[:, 3:])
    np.testing.assert_allclose(found.as_matrix(), turns.as_matrix(), atol=1e-14)


def test_eurocs_imu_is_read_as_it_is(tmp_path: Path) -> None:
    header = "#timestamp [ns]," + ",".join(
        [f"w_RS_S_{a} [rad s^-1]" for a in "xyz"] + [f"a_RS_S_{a} [m s^-2]" for a in "xyz"]
    )
    path = write(
        tmp_path,
        header,
        "1403636579758555392,-0.099134701513277898,0.14730578886832138,0.02722713633111154,8.17,-0.21,-2.46",
        "1403636579763555584,-0.099134701513277898,0.14032447186034408,0.029321531433504733,8.03,-0.3,-2.4",
    )
    streams = read_sensor_csv(path, clock_offset_s=-1403636579.0)
    assert list(streams) == ["angular_rate"]
    np.testing.assert_allclose(streams["angular_rate"].t_s, [0.758555392, 0.763555584], atol=3e-7)
    np.testing.assert_allclose(streams["angular_rate"].values[1], [-0.0991347015, 0.140324472, 0.0293215314])


def test_satellite_fixes_and_the_clock_offset(tmp_path: Path) -> None:
    path = write(tmp_path, "t [s],lat [deg],lon [deg],alt [m]", "0,49.0,8.4,110", "1,49.0001,8.4,110")
    stream = read_sensor_csv(path, clock_offset_s=0.25)["geodetic"]
    np.testing.assert_allclose(stream.t_s, [0.25, 1.25])
    np.testing.assert_allclose(stream.values[1], [49.0001, 8.4, 110])


def test_columns_of_other_names_are_left_out_and_other_separators_read(tmp_path: Path) -> None:
    plain = read_sensor_csv(write(tmp_path, "t [s],speed [m/s]", "0,1.5", "0.5,2.5"))["speed"]
    for header, *lines in (
        ("t [s],temperature [C],speed [m/s],frame_id", "0,,1.5,base link", "0.5,21,2.5,"),
        ("t [s];speed [m/s]", "0;1.5", "0.5;2.5"),
        ("t [s];speed [m/s];state", "0;1,5;on, or so", "0,5;2,5;off"),
        ("t [s]\tspeed [m/s]", "0\t1.5", "0.5\t2.5"),
        (" t [s] | speed [m/s]", " 0 | 1.5", " 0.5 | 2.5"),
        ("sep=;", "t [s];speed [m/s]", "0;1,5", "0,5;2,5"),
    ):
        stream = read_sensor_csv(write(tmp_path, header, *lines))["speed"]
        np.testing.assert_array_equal(stream.t_s, plain.t_s)
        np.testing.assert_array_equal(stream.values, plain.values)


@pytest.mark.parametrize(
    ("lines", "header"),
    [
        (['"t [s]","speed [m/s]"', '"0","1.5"', '"0.5","2.5"'], 1),
        (["t [s],note,speed [m/s]", '0,"a, b",1.5', '0.5,"",2.5'], 1),
        (["t [s],speed [m/s],", "0,1.5,", "0.5,2.5,"], 1),
        (["t [s],speed [m/s]", "0,1.5,", "0.5,2.5"], 1),
        (["# a log, of a robot", "t [s],speed [m/s]", "0,1.5", "# restart", "0.5,2.5"], 2),
        (["# a log, of a robot", "# t [s],speed [m/s]", "0,1.5", "0.5,2.5"], 2),
    ],
)
def test_tables_are_read_as_programs_write_them(tmp_path: Path, lines: list[str], header: int) -> None:
    stream = read_sensor_csv(write(tmp_path, *lines))["speed"]
    np.testing.assert_array_equal(stream.t_s, [0.0, 0.5])
    np.testing.assert_array_equal(stream.values, [[1.5], [2.5]])
    with pytest.raises(DatasetError, match="holds no column 'absent'") as caught:
        read_sensor_csv(write(tmp_path, *lines), columns={"speed [m/s]": "absent"})
    assert caught.value.line == header


@pytest.mark.parametrize(
    ("unit", "metres_per_second"),
    [
        *(("KM/H", 1 / 3.6), ("kph", 1 / 3.6), ("cm/s", 0.01), ("mm/s", 0.001), ("m/sec", 1.0)),
        *(("mph", 0.44704), ("kn", 1852 / 3600), ("knots", 1852 / 3600), ("ft/s", 0.3048)),
    ],
)
def test_speeds_have_the_units_of_cars_and_boats(tmp_path: Path, unit: str, metres_per_second: float) -> None:
    stream = read_sensor_csv(write(tmp_path, f"t [sec],speed [{unit}]", "0,10", "1,20"))["speed"]
    np.testing.assert_allclose(stream.values.ravel(), np.array([10, 20]) * metres_per_second)


@pytest.mark.parametrize(
    ("unit", "seconds"),
    [
        *(("Seconds", 1.0), ("msec", 1e-3), ("milliseconds", 1e-3), ("nsec", 1e-9)),
        *(("\u00b5s", 1e-6), ("\u03bcs", 1e-6), ("usec", 1e-6), ("microseconds", 1e-6)),
    ],
)
def test_times_and_rates_have_units_of_several_spellings(tmp_path: Path, unit: str, seconds: float) -> None:
    path = write(tmp_path, f"t [{unit}],wx [dps],wy [degrees/s],wz [deg/sec]", "1,180,90,0", "3,0,0,90")
    stream = read_sensor_csv(path)["angular_rate"]
    np.testing.assert_allclose(stream.t_s, np.array([1, 3]) * seconds)
    np.testing.assert_allclose(stream.values, np.pi * np.array([[1, 0.5, 0], [0, 0, 0.5]]))


HEADER = "t [s],speed [m/s]"


@pytest.mark.parametrize(
    ("header", "lines", "line", "told"),
    [
        ("t [s],speed", ["0,1"], 1, r"column 'speed' names no unit: must be one of \[m/s\], \[km/h\]"),
        ("t [s],speed (ly)", ["0,1"], 1, r"'speed \(ly\)' has the unknown unit 'ly'"),
        ("Zeit (ms),Tempo (m/s)", ["0,1"], 1, r"'Zeit \(ms\)' is unknown: .*, with its unit: 't \[s\]'"),
        ("t [s],speed [rpm]", ["0,1"], 1, r"'speed \[rpm\]' has the unknown unit 'rpm'"),
        ("t_s,wheel", ["0,1"], 1, r"column 't_s' is unknown: .*--sensor-column 'NAME \[UNIT\]=t_s'"),
        ("t_s,speed [m/s]", ["0,1"], 1, r"lacks the column t of time: .*--sensor-column 't \[s\]=NAME'"),
        ("0.0,1.5", ["0.1,1.5"], 1, r"holds numbers: must name the columns, as 't \[s\],speed \[m/s\]'"),
        ("t [s],x [m],y [m]", ["0,1,2"], 1, "lacks the column z of position: write 0 there if heights"),
        ("t [s],vx [m/s]", ["0,1"], 1, "lacks the column vy, vz of velocity: .* is the column 'speed'"),
        ("t [s],sonar [m]", ["0,1"], 1, r"column 'sonar \[m\]' is unknown: must be one of t, speed"),
        ("t [s],speed [m/s],WX [rad/s]", ["0,1,1"], 1, "lacks the column wy, wz of angular_rate"),
        ("t [s];speed [m/s]", ["0;1,000"], 2, "the comma in '1,000' may be decimal or of thousands"),
        ("Time,X,Y,Z", ["0,1,2,3"], 1, "column 'Time' names no unit"),
        ("t [s],wx [rad/s]", ["0,1"], 1, "lacks the column wy, wz of angular_rate"),
        ("speed [m/s]", ["1"], 1, "lacks the column t of time"),
        ("t [s],speed [m/s],speed [km/h]", ["0,1,1"], 1, "columns named twice: speed"),
        (HEADER, ["0,1", "0.1"], 3, "holds 1 cells: must be 2; where commas are decimal"),
        (HEADER, ["0,1", "0,1,1,5"], 3, "holds 4 cells: must be 2; where commas are decimal"),
        (HEADER, ["0,1", "0.1,fast"], 3, "speed is 'fast': must be a finite number"),
        (HEADER, ["0,1", "0.1,1_0"], 3, "speed is '1_0': must be a finite number"),
        (HEADER, ["0,1", "0.1,inf"], 3, "speed is 'inf': must be a finite number, or none.*: an empty cell"),
        (HEADER, ["0,1", "", "inf,2"], 4, "t is 'inf'"),
        (HEADER, ["0,1", ",2"], 3, "t is ''"),
        (HEADER, ["0,1", "0.2,1", "0.1,1"], 4, "0.1.* s after 0.2.* s in line 3: time must increase"),
        (HEADER, ["0,1", "0.2,1", "0.2,2"], 4, "s in line 3: time must increase; .* keep one"),
        (HEADER, ["0,1", "0.1,300"], 3, "speed of 300 m/s.*km/h"),
        (HEADER, ["0,1", "", "0.1,", "0.2,300"], 5, "speed of 300 m/s at sample 1.*km/h"),
        (HEADER, [], None, "holds no measurements"),
        ("t [s],vx [m/s],vy [m/s],vz [m/s]", ["0,1,1,1", "1,2,,3"], 3, "only a part of velocity"),
        (
            "t [s],qw,qx,qy,qz",
            ["0,1,0,0,0", "1,2,0,0,0"],
            None,
            "quaternion at 1.0* s is .*: must have length 1",
        ),
        ("t [s],lat [deg],lon [deg]", ["0,1,1"], 1, "together: .* --sensor-column 'height .m.=0'"),
    ],
)
def test_a_bad_file_is_named_with_its_line(
    tmp_path: Path, header: str, lines: list[str], line: int | None, told: str
) -> None:
    path = write(tmp_path, header, *lines)
    with pytest.raises(DatasetError, match=told) as caught:
        read_sensor_csv(path)
    assert (caught.value.path, caught.value.line) == (str(path), line)


def test_a_missing_file_and_a_binary_one_are_named(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match=r"absent\.csv: no such file"):
        read_sensor_csv(tmp_path / "absent.csv")
    (tmp_path / "picture.csv").write_bytes(b"\x89PNG\xff\xfe")
    with pytest.raises(DatasetError, match=r"picture\.csv: is no UTF-8 text"):
        read_sensor_csv(tmp_path / "picture.csv")


def test_a_gap_in_a_file_is_bridged_or_not_as_in_any_stream(tmp_path: Path) -> None:
    lines = [f"{t:.1f},10" for t in (0.0, 0.1, 0.2, 0.3, 0.6, 0.7, 2.0, 2.1, 2.2)]
    stream = read_sensor_csv(write(tmp_path, HEADER, *lines))["speed"]
    assert travelled_distance(stream, 0.2, 0.7) == pytest.approx(5.0)
    assert travelled_distance(stream, 0.6, 2.1) is None


def test_units_may_stand_in_parentheses(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("t (ms),speed (km/h),state (of wheel)\n0,36,ok\n100,18,ok\n")
    stream = read_sensor_csv(path)["speed"]
    np.testing.assert_allclose(stream.t_s, [0, 0.1])
    np.testing.assert_allclose(stream.values.ravel(), [10, 5])


@pytest.mark.parametrize("height", ["altitude", "alt", "elevation", "height"])
def test_heights_have_the_names_that_receivers_give_them(tmp_path: Path, height: str) -> None:
    path = tmp_path / "gps.csv"
    path.write_text(f"timestamp [s],latitude [deg],lng [deg],{height} [m]\n0,48,11,500\n1,48,11.001,501\n")
    stream = read_sensor_csv(path)["geodetic"]
    np.testing.assert_allclose(stream.values[1], [48, 11.001, 501], rtol=1e-12)


OWN = {"t [ms]": "Time", "speed [km/h]": "Wheel", "wx [rad/s]": 0, "wy [rad/s]": "0", "wz [deg/s]": "Yaw"}


def test_columns_of_own_names_are_told_by_ours(tmp_path: Path) -> None:
    path = write(tmp_path, "Time;Wheel [rpm?];Yaw;t", "1000;36,0;180;x", "1100;72,0;;x")
    streams = read_sensor_csv(path, columns=OWN)
    np.testing.assert_allclose(streams["speed"].t_s, [1.0, 1.1])
    np.testing.assert_allclose(streams["speed"].values, [[10], [20]])
    np.testing.assert_allclose(streams["angular_rate"].values, [[0, 0, np.pi]])  # the other line has no rate


def test_names_of_ros_are_columns(tmp_path: Path) -> None:
    path = write(
        tmp_path, "%time,field.twist.twist.linear.x", "1403636579763555584,1", "1403636579863555584,2"
    )
    columns = {"t [ns]": "%time", "speed [m/s]": "field.twist.twist.linear.x"}
    stream = read_sensor_csv(path, columns=columns, clock_offset_s=-1403636579.0)["speed"]
    np.testing.assert_allclose(stream.t_s, [0.763555584, 0.863555584], atol=1e-6)


@pytest.mark.parametrize(
    ("columns", "told"),
    [
        ({"speed [km/h]": "wheel"}, "sensors.csv:1: holds no column 'wheel', which is to be 'speed"),
        ({"speed": "Wheel"}, "sensor_columns: column 'speed' names no unit"),
        ({"tempo [m/s]": "Wheel"}, "sensor_columns: column 'tempo .m/s.' is unknown"),
        ({"wx [rad/s]": 0}, "lacks the column wy, wz of angular_rate"),
        ({"t [s]": "Zeit", "speed [km/h]": np.nan}, "holds no column nan"),
        ({"ax [m/s^2]": "Wheel"}, "accelerations are not used"),
        ({"t [s]": 0}, "sensor_columns: 't .s.' = 0: must be a column, as times differ"),
        ({"t [s]": "Zeit", "speed [m/s]": None}, "'speed .m/s.' = None: must be a name or a number"),
        (
            {"t [s]": "Zeit", "speed [m/s]": "Wheel", "speed [km/h]": "t"},
            "'speed .m/s.' and 'speed .km/h.' are one column",
        ),
    ],
)
def test_own_names_that_cannot_be_are_refused(
    tmp_path: Path, columns: dict[str, str | float], told: str
) -> None:
    path = write(tmp_path, "Zeit,Wheel,t [s]", "1,2,3", "2,3,4")
    with pytest.raises((DatasetError, InvalidArgument), match=told):
        read_sensor_csv(path, columns=columns)


def test_columns_of_hemispheres_give_latitudes_and_longitudes_their_sign(tmp_path: Path) -> None:
    path = tmp_path / "gps.csv"
    lines = ("0;46,5;S;9,25;E;12", "1;46,6;S;9,26;E;12", "2;;;;;", "3;-46,7;S;9,27;E;12")
    path.write_text("t [s];lat [deg];N/S;lon [deg];E/W;height [m]\n" + "\n".join(lines) + "\n")
    positions = read_sensor_csv(path)["geodetic"].values
    assert positions.tolist() == [[-46.5, 9.25, 12.0], [-46.6, 9.26, 12.0], [-46.7, 9.27, 12.0]]
    assert left_out_columns(path) == []
    path.write_text("t [s],lat [deg],lat_ref,lon [deg],height [m]\n0,46,X,9,1\n1,46,N,9,1\n")
    with pytest.raises(DatasetError, match=r"gps\.csv:2: the hemisphere is 'X': must be N or S"):
        read_sensor_csv(path)
