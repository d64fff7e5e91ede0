"""`sfmcpp slam` with sensor files that cannot be used or have gaps, and on different numbers of threads."""

from __future__ import annotations

import os
import re
import subprocess
from pathlib import Path

import numpy as np
import pytest

import sfmcpp
from cli_helpers import COMMAND, TIMEOUT_S, strict_json
from sfmcpp.cli.main import main
from sfmcpp.sensors import east_north_up, geodetic_of
from sfmcpp.sources.io.track_files import CameraTracks, write_tracks

FIRST_S, STEP_S = 100.0, 0.1
SPEED = "t [s],speed [m/s]"
RATES = "t [s],wx [rad/s],wy [rad/s],wz [rad/s]"
ALIEN = "t [s],wheel [m/s],x [m],y [m],z [m]"
BOTH = f"{SPEED},wx [rad/s],wy [rad/s],wz [rad/s]"
PLACES = f"{SPEED},x [m],y [m],z [m]"
TEXTS = ("trajectory.txt", "keyframes.txt", "points.ply")


def write_drive(path: Path, num_cameras: int = 30, sigma_px: float = 0.5) -> sfmcpp.Problem:
    """A walk down a corridor at five metres a second, an image every tenth of a second."""
    exact = sfmcpp.corridor_scene(
        num_cameras, 60 * num_cameras, length_m=0.5 * num_cameras, pixel_sigma_px=sigma_px, seed=2
    )
    scene, _ = sfmcpp.add_outliers(exact, 0.05, seed=1)
    t_s = FIRST_S + STEP_S * np.arange(num_cameras)
    tracks = CameraTracks(t_s, scene.camera_index, scene.point_index, scene.pixels, scene.intrinsics[0])
    write_tracks(tracks, path)
    return scene


def write_sensors(path: Path, header: str, rows: list[str]) -> Path:
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


def every_tenth(cells: str, seconds: float = 4.0, start_s: float = 99.5) -> list[str]:
    """The same measurements every tenth of a second."""
    return [f"{start_s + 0.1 * k:.1f},{cells}" for k in range(round(10 * seconds))]


def going(speed: str) -> list[str]:
    """A body that goes along x at five metres a second, and says so by its positions."""
    return [f"{99.5 + 0.1 * k:.1f},{speed},{0.5 * k},0,0" for k in range(120)]


@pytest.mark.parametrize(
    ("sensor", "header", "rows", "told"),
    [
        (
            "odometer",
            SPEED,
            ["100,5", "100.1,5", "100.1,6"],
            "s.csv:4: speed at 100.1.* after 100.1.* in line 3: time must increase; .* keep one",
        ),
        (
            "odometer",
            SPEED,
            ["100,5", "100.2,5", "100.1,5"],
            "s.csv:4: speed at 100.1.* after 100.2.* in line 3: time must increase",
        ),
        ("odometer", SPEED, ["100,5", "100.1,inf"], "s.csv:3: speed is 'inf': must be a finite number"),
        ("odometer", SPEED, ["100,5", "nan,5"], "s.csv:3: t is 'nan': must be a finite number"),
        ("odometer", SPEED, ["100,5", "100.1,fast"], "s.csv:3: speed is 'fast': must be a finite number"),
        ("odometer", SPEED, ["100,5", "100.1,130"], "s.csv:3: .*speed of 130 m/s .* at most 100 m/s; .*km/h"),
        ("odometer", SPEED, ["100,5", "100.1,1e308"], "s.csv:3: .*speed of inf m/s .* at most 100 m/s"),
        ("imu", RATES, ["100,0,0,1", "100.1,0,0,40"], "s.csv:3: .*angular rate of 40 rad/s .* degrees/s"),
        ("imu", RATES, ["100,0,0,1", "100.1,0,,1"], "s.csv:3: only a part of angular_rate"),
        ("odometer", "t [s],speed", ["100,5"], "s.csv:1: column 'speed' names no unit"),
        ("odometer", ALIEN, ["100,5,1,1,1"], r"s.csv: holds no .* names are unknown: .wheel \[m/s\].$"),
        (
            "odometer",
            SPEED,
            every_tenth("5", start_s=0.0),
            "s.csv: stream 'speed' lasts from 0.000 .* must overlap.* clock offset of 100.0* s \\(--clock-",
        ),
        (
            "odometer",
            PLACES,
            going("18"),
            "s.csv: .*'speed': its ways are 3.6 times those of .*'position'.*km/h",
        ),
        (
            "imu",
            BOTH,
            every_tenth("5,0,0,9"),
            "s.csv: .*'speed' at 5 m/s .* 45 m/s² across .* km/h or degrees/s",
        ),
    ],
)
def test_a_stream_that_cannot_be_is_one_line_and_writes_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], sensor: str, header: str, rows: list[str], told: str
) -> None:
    write_drive(tmp_path / "drive.csv", 4)
    sensors = write_sensors(tmp_path / "s.csv", header, rows)
    command = ["slam", str(tmp_path / "drive.csv"), "-o", str(tmp_path / "out"), "--sensor", sensor]
    assert main([*command, "--sensor-file", str(sensors)]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert len(said.err.splitlines()) == 1
    assert said.err.startswith("sfmcpp: error: ")
    assert re.search(told, said.err)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("option", "value", "told"),
    [
        ("--weights", "fixed:1e300", "fixed:1e300': the weight must be a number from 0 to 1e\\+100"),
        ("--weights", "fixed:-1", "fixed:-1': the weight must be a number from 0"),
        ("--sensor-sigma", "odometer=1e300", "--sensor-sigma odometer=1e\\+300: must be at most 1e\\+100"),
        ("--sensor-sigma", "odometer=1e-300", "--sensor-sigma odometer=1e-300: must be at least 1e-100"),
        ("--sensor-sigma", "odometer=0", "--sensor-sigma odometer=0.0: must be finite and positive"),
        ("--sensor-sigma", "odometer=0.02+101%", "--sensor-sigma odometer=1.01: must be between 0 and 1"),
        ("--sensor-sigma", "odometer=0+1%", "--sensor-sigma odometer=0.0: must be finite and positive"),
        ("--sensor-sigma", "odometer=0.02+%", "'odometer=0.02\\+%': must be NAME=SIGMA"),
    ],
)
def test_weights_and_sigmas_beyond_numbers_are_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], option: str, value: str, told: str
) -> None:
    write_drive(tmp_path / "drive.csv", 4)
    sensors = write_sensors(tmp_path / "s.csv", SPEED, every_tenth("5"))
    command = ["slam", str(tmp_path / "drive.csv"), "-o", str(tmp_path / "out"), "--sensor", "odometer"]
    assert main([*command, "--sensor-file", str(sensors), option, value]) == 2
    said = capsys.readouterr().err
    assert len(said.splitlines()) == 1
    assert re.search(told, said)
    assert not (tmp_path / "out").exists()


def test_stamps_of_another_clock_are_moved_by_what_is_given(tmp_path: Path) -> None:
    write_drive(tmp_path / "drive.csv")
    for name, start_s in (("same", 99.5), ("other", 50.0)):
        write_sensors(tmp_path / f"{name}.csv", SPEED, every_tenth("5", 6.0, start_s))
    for name, extra in (("same", []), ("other", ["--clock-offset", "49.5"])):
        told = ["--sensor", "odometer", "--sensor-file", str(tmp_path / f"{name}.csv"), *extra, "--quiet"]
        assert main(["slam", str(tmp_path / "drive.csv"), "-o", str(tmp_path / name), *told]) == 0
    assert (tmp_path / "same/trajectory.txt").read_bytes() == (tmp_path / "other/trajectory.txt").read_bytes()


def test_what_a_sensor_may_be_off_bounds_its_weight(tmp_path: Path) -> None:
    write_drive(tmp_path / "drive.csv")
    sensors = str(write_sensors(tmp_path / "s.csv", SPEED, every_tenth("5", 6.0)))
    medians = {}
    for sigma in ("0.01", "0.1", "0.01+0%", "0.01+20%"):
        told = ["--sensor", "odometer", "--sensor-file", sensors, "--sensor-sigma", f"odometer={sigma}"]
        assert main(["slam", str(tmp_path / "drive.csv"), "-o", str(tmp_path / sigma), *told, "--quiet"]) == 0
        keyframes = strict_json(tmp_path / sigma / "report.json")["keyframes"]
        medians[sigma] = np.median([k["weights"]["odometer"] for k in keyframes if k["weights"]])
    assert medians["0.01"] > 2 * medians["0.1"] > 0
    assert medians["0.01+0%"] > medians["0.01"] > 2 * medians["0.01+20%"] > 0


@pytest.mark.parametrize(("header", "bridged"), [("t [s],distance [m]", False), (SPEED, True)])
def test_in_a_gap_a_speed_is_interpolated_and_a_way_constrains_nothing(
    tmp_path: Path, header: str, bridged: bool
) -> None:
    write_drive(tmp_path / "drive.csv")
    times_s = [99.5 + 0.1 * k for k in range(40)]
    rows = [
        f"{t_s:.1f},{5 if bridged else 5 * (t_s - 99.5):.9g}" for t_s in times_s if not 101.01 < t_s < 101.99
    ]
    sensors = write_sensors(tmp_path / "s.csv", header, rows)
    command = ["slam", str(tmp_path / "drive.csv"), "-o", str(tmp_path / "out"), "--quiet"]
    assert main([*command, "--sensor", "odometer", "--sensor-file", str(sensors)]) == 0
    report = strict_json(tmp_path / "out/report.json")
    assert report["totals"]["poses"] == 30
    inside = [k["weights"] for k in report["keyframes"] if 101.0 < k["t_s"] < 102.0]
    assert len(inside) > 1  # the first ones start the map
    assert any(inside) == bridged
    assert any("interpolated over gaps" in warning for warning in report["warnings"]) == bridged


def run_on(cpus: set[int], threads: str, arguments: list[str]) -> None:
    """Run the command with that many processors and threads."""
    environment = os.environ | {"OMP_NUM_THREADS": threads, "OPENBLAS_NUM_THREADS": threads}
    subprocess.run(
        [*COMMAND, "slam", *arguments, "--quiet"],
        check=True,
        timeout=TIMEOUT_S,
        env=environment,
        preexec_fn=lambda: os.sched_setaffinity(0, cpus),
    )


def results_of(folder: Path) -> dict[str, bytes]:
    """Every byte of the results that hold no times of the run."""
    files = [*map(folder.joinpath, TEXTS), *(folder / "model").iterdir()]
    return {path.name: path.read_bytes() for path in files}


def require_same_results(folder: Path, arguments: list[str]) -> None:
    cpus = sorted(os.sched_getaffinity(0))
    for name, count in (("one", 1), ("two", 2)):
        run_on(set(cpus[:count]), str(count), [*arguments, "-o", str(folder / name)])
    one, two = (results_of(folder / name) for name in ("one", "two"))
    assert len(one) == 9
    assert one.keys() == two.keys()
    assert [name for name in one if one[name] != two[name]] == []


def test_the_number_of_threads_changes_no_byte(tmp_path: Path) -> None:
    scene = write_drive(tmp_path / "drive.csv", 26)
    rng = np.random.default_rng(0)
    cells = rng.normal([5, 0, 0, 0], [0.05, 0.01, 0.01, 0.01], (40, 4))
    rows = [f"{99.5 + 0.1 * k:.1f},{','.join(map(str, row))}" for k, row in enumerate(cells.tolist())]
    sensors = write_sensors(tmp_path / "s.csv", BOTH, rows)
    options = ["--sensor", "odometer", "--sensor", "imu", "--sensor-file", str(sensors), "--weights", "loo"]
    require_same_results(tmp_path, [str(tmp_path / "drive.csv"), *options])
    found = strict_json(tmp_path / "one/report.json")
    assert found["totals"]["poses"] == scene.num_cameras
    assert {name for keyframe in found["keyframes"] for name in keyframe["weights"]} == {"odometer", "imu"}


@pytest.mark.real
def test_the_number_of_threads_changes_no_byte_of_a_real_drive(tmp_path: Path, data_dir: Path) -> None:
    drive = data_dir / "kitti_tracks/2011_09_26_drive_0001_sync_KLT.mat"
    require_same_results(tmp_path, [str(drive), "--sensor", "odometer", "--sensor", "imu"])


@pytest.mark.parametrize("kind", ["gps", "ins"])
def test_positions_and_poses_put_the_trajectory_into_their_world(tmp_path: Path, kind: str) -> None:
    scene = write_drive(tmp_path / "drive.csv", 40)
    # The sensor sits on a vehicle that goes along x; its antenna is where the camera is.
    header = "t [s],x [m],y [m],z [m]" + (",rx [rad],ry [rad],rz [rad]" if kind == "ins" else "")
    at = scene.centres + np.array([100.0, -20.0, 5.0])
    cells = [",".join(map(repr, place.tolist())) + (",0,0,0" if kind == "ins" else "") for place in at]
    rows = [f"{FIRST_S + STEP_S * k:.1f},{cell}" for k, cell in enumerate(cells)]
    sensors = write_sensors(tmp_path / "s.csv", header, rows)
    command = ["slam", str(tmp_path / "drive.csv"), "-o", str(tmp_path / "out"), "--quiet", "--sensor", kind]
    assert main([*command, "--sensor-file", str(sensors), "--mounting", "forward"]) == 0
    report = strict_json(tmp_path / "out/report.json")
    assert report["metric"]
    found = np.loadtxt(tmp_path / "out/trajectory.txt")[:, 1:4]
    np.testing.assert_allclose(found, at, atol=0.25)


def test_a_map_of_latitudes_has_its_origin_in_the_middle_and_goes_back_to_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The first position is an outlier: it must not be the origin."""
    scene = write_drive(tmp_path / "drive.csv", 40)
    true = geodetic_of(scene.centres, [49.0, 8.4, 110.0])
    told = true.copy()
    told[0] += [1e-3, 1e-3, 50.0]
    rows = [f"{FIRST_S + STEP_S * k:.1f},{a!r},{b!r},{h!r}" for k, (a, b, h) in enumerate(told.tolist())]
    sensors = write_sensors(tmp_path / "s.csv", "t [s],lat [deg],lon [deg],height [m]", rows)
    command = ["slam", str(tmp_path / "drive.csv"), "-o", str(tmp_path / "out"), "--sensor", "gps"]
    assert main([*command, "--sensor-file", str(sensors), "--mounting", "forward"]) == 0
    origin = strict_json(tmp_path / "out/report.json")["origin"]
    place = [origin["latitude_deg"], origin["longitude_deg"], origin["height_m"]]
    np.testing.assert_allclose(east_north_up([place], true[len(true) // 2]), 0.0, atol=0.5)
    assert f"latitude_deg {place[0]:.10g}" in capsys.readouterr().out
    assert strict_json(tmp_path / "out/model/sfmcpp_origin.json") == origin
    centres = np.loadtxt(tmp_path / "out/trajectory.txt")[:, 1:4]
    found = east_north_up(geodetic_of(centres, place), [49.0, 8.4, 110.0])
    np.testing.assert_allclose(found[1:], scene.centres[1:], atol=0.25)
