"""`sfmcpp.slam.run` and `sfmcpp.study.SlamReport` do from Python what `sfmcpp slam` does."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import sfmcpp
from cli_helpers import run as run_command
from cli_helpers import strict_json
from sfmcpp import slam, study
from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.geometry import so3
from sfmcpp.model import SensorStream, Trajectory
from sfmcpp.slam import SlamResult
from sfmcpp.sources.drives import Drive, open_drive
from sfmcpp.sources.frames import TrackSequence
from sfmcpp.sources.io.track_files import CameraTracks, write_tracks
from sfmcpp.study.evaluation import evaluate

FIRST_S, STEP_S = 100.0, 0.1
UTM_M = np.array([691_000.0, 5_334_000.0, 520.0])


def scene(num_cameras: int = 24) -> sfmcpp.Problem:
    length_m, points = 0.5 * num_cameras, 60 * num_cameras
    return sfmcpp.corridor_scene(num_cameras, points, length_m=length_m, pixel_sigma_px=0.3, seed=2)


def bend() -> sfmcpp.Problem:
    """The first corner of a street loop."""
    whole = sfmcpp.street_loop_scene(160, 8000, pixel_sigma_px=0.3, seed=2)
    first = whole.camera_index < 50
    arrays = (whole.camera_index[first], whole.point_index[first], whole.pixels[first])
    return sfmcpp.Problem("calibrated", whole.cameras[:50], whole.intrinsics[:50], whole.points, *arrays)


def times(problem: sfmcpp.Problem) -> np.ndarray:
    return FIRST_S + STEP_S * np.arange(problem.num_cameras)


@pytest.fixture
def files(tmp_path: Path) -> tuple[Path, Path]:
    """Tracks, and the speed beside them."""
    problem = scene()
    arrays = (problem.camera_index, problem.point_index, problem.pixels, problem.intrinsics[0])
    write_tracks(CameraTracks(times(problem), *arrays), tmp_path / "drive.csv")
    speed = problem.centres[1, 0] / STEP_S
    rows = [f"{99.5 + STEP_S * k:.1f},{speed}" for k in range(40)]
    (tmp_path / "speed.csv").write_text("\n".join(["t [s],speed [m/s]", *rows]) + "\n")
    return tmp_path / "drive.csv", tmp_path / "speed.csv"


def untimed(told: str) -> list[str]:
    """The lines of a run that are the same each time, without those on files."""
    return [line for line in told.splitlines() if not line.startswith(("seconds", "real time", "written"))]


def test_the_files_are_those_of_the_command_line_byte_for_byte(
    tmp_path: Path, files: tuple[Path, Path]
) -> None:
    drive, speed = files
    command = ("--sensor", "odometer", "--sensor-file", speed, "--weights", "ltn", "--seed", "3")
    told = run_command("slam", drive, *command, "-o", tmp_path / "shell")
    assert (told.returncode, told.stderr) == (0, "")
    found = study.SlamReport(slam.run(drive, ["odometer"], weights="ltn", seed=3, sensor_file=speed))
    written = found.write(tmp_path / "python")
    assert [path.name for path in written] == [
        Path(line.split()[1]).name for line in told.stdout.splitlines() if line.startswith("written")
    ]
    for path in sorted((tmp_path / "shell").rglob("*.*")):
        twin = tmp_path / "python" / path.relative_to(tmp_path / "shell")
        if path.name != "report.json":
            assert path.read_bytes() == twin.read_bytes(), path.name
    ours, theirs = (strict_json(tmp_path / name / "report.json") for name in ("python", "shell"))
    assert ours.keys() == theirs.keys()
    for name in ("input", "settings", "sensors", "totals", "metric", "warnings", "interrupted"):
        assert ours[name] == theirs[name]
    assert untimed(str(found)) == untimed(told.stdout)


def test_a_log_with_names_of_its_own_gives_the_same_run(tmp_path: Path, files: tuple[Path, Path]) -> None:
    drive, speed = files
    rows = [line.split(",") for line in speed.read_text().splitlines()[1:]]
    log = "\n".join(["%time;Speed;V", *(f"{float(t) * 1000!r};x;{v}" for t, v in rows)])
    (tmp_path / "log.csv").write_text(log)
    own = ("--sensor-column", "t [ms]=%time", "--sensor-column", "speed [m/s] = V")
    for file, names in ((speed, ()), (tmp_path / "log.csv", own)):
        command = ("slam", drive, "--sensor", "odometer", "--sensor-file", file, *names, "--seed", "1")
        assert run_command(*command, "-o", tmp_path / file.stem).returncode == 0
    first, second = ((tmp_path / name / "trajectory.txt").read_bytes() for name in ("speed", "log"))
    assert first == second


def test_columns_that_no_file_has_are_refused(files: tuple[Path, Path]) -> None:
    drive, _ = files
    with pytest.raises(InvalidArgument, match="sensor_columns: there is no sensor file"):
        open_drive(drive, sensor_columns={"speed [m/s]": "V"})
    with pytest.raises(InvalidArgument, match=r"sensor_columns: a KITTI drive \(.mat\) has no columns"):
        open_drive(drive, sensor_file="drive.mat", sensor_columns={"speed [m/s]": "V"})


def test_each_sensor_may_have_a_file_of_its_own(tmp_path: Path, files: tuple[Path, Path]) -> None:
    drive, speed = files
    rows = [f"{99.5 + STEP_S * k:.1f},0,0,0" for k in range(40)]
    rates = tmp_path / "rates.csv"
    rates.write_text("\n".join(["t [s],wx [rad/s],wy [rad/s],wz [rad/s]", *rows]) + "\n")
    opened = open_drive(drive, sensor_file=[speed, rates])
    assert opened.streams.keys() == {"speed", "angular_rate"}
    assert opened.sensor_files == (speed, rates)
    both = tmp_path / "both.csv"
    both.write_text("t [s],speed [m/s]\n99.5,1\n103.5,1\n")
    with pytest.raises(DatasetError, match=r"both.csv: holds speed, as another sensor file does"):
        open_drive(drive, sensor_file=[speed, both])
    with pytest.raises(InvalidArgument, match="sensor_columns: there are 2 sensor files: must be one"):
        open_drive(drive, sensor_file=[speed, rates], sensor_columns={"speed [m/s]": "V"})
    with pytest.raises(DatasetError, match=r"rates.csv: holds no position .*nor do the other sensor files"):
        opened.streams_of(["gps"])
    command = ("--sensor", "odometer", "--sensor", "imu", "--mounting", "camera")
    told = run_command(
        "slam", drive, *command, "--sensor-file", speed, "--sensor-file", rates, "-o", tmp_path / "out"
    )
    assert (told.returncode, told.stderr) == (0, "")


def test_of_several_files_the_one_at_fault_is_named(tmp_path: Path, files: tuple[Path, Path]) -> None:
    drive, speed = files
    rates = tmp_path / "rates.csv"

    def write_rates(start_s: float, rate: float) -> None:
        rows = [f"{start_s + STEP_S * k:.1f},0,0,{rate}" for k in range(40)]
        rates.write_text("\n".join(["t [s],wx [rad/s],wy [rad/s],wz [rad/s]", *rows]) + "\n")

    write_rates(500.0, 0.0)
    with pytest.raises(DatasetError, match="stream 'angular_rate' lasts from 500") as late:
        open_drive(drive, sensor_file=[speed, rates]).streams_of(["odometer", "imu"])
    assert late.value.path == str(rates)
    write_rates(99.5, 34.0)
    with pytest.raises(DatasetError, match=r"across for a second.* 'angular_rate' of rates\.csv") as fast:
        open_drive(drive, sensor_file=[speed, rates]).streams_of(["odometer", "imu"])
    assert fast.value.path == str(drive)


def test_the_input_serves_the_sensors_that_no_file_has(tmp_path: Path, data_dir: Path) -> None:
    drive = data_dir / "kitti_tracks/2011_09_26_drive_0001_sync_KLT.mat"
    own = open_drive(drive)
    speed = tmp_path / "speed.csv"
    values = np.linalg.norm(own.streams["velocity"].values, axis=1)
    rows = [f"{t:.6f},{v}" for t, v in zip(own.streams["velocity"].t_s, values, strict=True)]
    speed.write_text("\n".join(["t [s],speed [m/s]", *rows]) + "\n")
    opened = open_drive(drive, sensor_file=speed)
    # An odometer of velocities would go before one of speeds, but the user has given the latter.
    assert opened.streams.keys() == {"speed", "angular_rate"}
    assert [stream.kind for stream in opened.streams_of(["odometer", "imu"])] == ["speed", "angular_rate"]


def test_a_run_gives_the_map_and_ends_where_the_callback_says(files: tuple[Path, Path]) -> None:
    seen: list[int] = []

    def until_the_tenth(frame: int, result: SlamResult) -> bool:
        seen.append(frame)
        return frame < 9

    whole, part = slam.run(files[0]), slam.run(files[0], callback=until_the_tenth)
    assert (whole.frames, whole.interrupted, part.frames, part.interrupted) == (24, False, 10, True)
    assert seen == list(range(10))
    assert repr(whole.drive) == f"Drive({str(files[0])!r}: 24 frames)"
    assert repr(part).startswith(f"SlamRun({str(files[0])!r}: 10 frames, 10 poses, ")
    assert len(whole.trajectory()) == 24
    assert whole.world is not None
    assert whole.totals["points"] == np.count_nonzero(whole.world.known) > 0


def georeferenced(problem: sfmcpp.Problem) -> Drive:
    """A drive with GPS in UTM-like metres, its truth in a world of its own."""
    t_s = times(problem)
    noise = np.random.default_rng(0).normal(0, 0.3, problem.centres.shape)
    gps = SensorStream(t_s, problem.centres + UTM_M + noise, "position", "gps")
    turn = so3.exp(np.array([0.0, 0.0, 2.0]))
    truth = np.concatenate([turn @ problem.rotations, (problem.centres @ turn.T)[:, :, None]], axis=2)
    frames = TrackSequence(
        t_s, problem.camera_index, problem.point_index, problem.pixels, problem.intrinsics[0]
    )
    return Drive(Path("drive"), frames, Trajectory(t_s, truth), {"position": gps})


@pytest.mark.parametrize(("problem", "by"), [(scene(40), "poses"), (bend(), "positions")])
def test_a_georeferenced_run_is_measured_as_evaluate_measures_it(problem: sfmcpp.Problem, by: str) -> None:
    """By positions, which is how `evaluate` measures; a straight way takes orientations too."""
    drive = georeferenced(problem)
    found = study.SlamReport(slam.run(drive, ["gps"]))
    assert found.run.georeferenced
    middle = problem.centres.mean(axis=0) + UTM_M
    np.testing.assert_allclose(found.run.trajectory().centres.mean(axis=0), middle, atol=1.0)
    assert found.comparison is not None
    assert drive.truth is not None
    expected = evaluate(found.run.trajectory(), drive.truth, align_by=by)
    assert found.comparison.mean_3d_error_m == expected.mean_3d_error_m
    assert found.comparison.alignment.by == by
    assert found.drift is None
    assert "aligned to the whole trajectory" in str(found)


def test_degrees_under_the_names_of_metres_are_refused() -> None:
    drive = georeferenced(bend())
    metres = drive.streams["position"]
    degrees = replace(metres, values=[8.4, 49.0, 110.0] + (metres.values - UTM_M) / [73e3, 111e3, 1.0])
    with pytest.raises(InvalidArgument, match=r"x and y are 8\.4.* which look like degrees"):
        slam.run(replace(drive, streams={"position": degrees}), ["gps"])


def test_a_run_without_a_world_is_measured_as_evaluate_measures_it_and_by_its_drift() -> None:
    drive = georeferenced(bend())
    drifting = study.SlamReport(slam.run(drive))
    assert not drifting.run.georeferenced
    assert drifting.comparison is not None
    assert drifting.drift is not None
    assert drive.truth is not None
    expected = evaluate(drifting.run.trajectory(), drive.truth)
    assert drifting.comparison.mean_3d_error_m == expected.mean_3d_error_m < drifting.drift.mean_3d_error_m
    rows = dict(line.split(maxsplit=1) for line in str(drifting).splitlines())
    assert rows["drift"] == f"{drifting.drift.mean_3d_error_m:.4g} m, aligned to the first tenth, by poses"
    assert f"{expected.mean_3d_error_m:.4g} m of" in str(drifting)


def test_what_a_drive_lacks_is_named(files: tuple[Path, Path]) -> None:
    drive, speed = files
    with pytest.raises(InvalidArgument, match="sensor = 'radar': must be one of odometer, imu, ins, gps"):
        slam.run(drive, ["radar"])
    with pytest.raises(InvalidArgument, match="one is named twice"):
        slam.run(drive, ["odometer", "odometer"], sensor_file=speed)
    with pytest.raises(DatasetError, match=r"speed\.csv: holds no pose \(columns .*'ins' needs"):
        slam.run(drive, ["ins"], sensor_file=speed)
    with pytest.raises(DatasetError, match="camera, fps, corners: are for images"):
        open_drive(drive, camera=(700, 320, 240))
    opened = open_drive(drive, sensor_file=speed)
    late = replace(opened, streams={"speed": opened.streams["speed"].shifted(1e4)})
    with pytest.raises(DatasetError, match=r"speed\.csv: stream 'speed' lasts from"):
        slam.run(late, ["odometer"])
