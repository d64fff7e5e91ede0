"""`sfmcpp info`: a few lines that say what is in a file of any kind that other commands read."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

import sfmcpp
from cli_helpers import is_one_error_line, noisy_circle, run_here
from sfmcpp.model.metadata import WorldOrigin
from sfmcpp.sources.io import sensor_csv
from sfmcpp.sources.io.track_files import CameraTracks, write_tracks
from sfmcpp.sources.io.trajectories import write_trajectory
from sfmcpp.sources.synthetic import vehicle_drive

READABLE = [known.name for known in sfmcpp.formats() if known.readable and known.writable]


def facts(path: Path) -> dict[str, str]:
    """Lines of the output by their first words."""
    result = run_here("info", path)
    assert (result.returncode, result.stderr) == (0, "")
    lines = [line.partition("  ") for line in result.stdout.splitlines()]
    return {name.strip(): value.strip() for name, _, value in lines}


def path_for(folder: Path, format: str) -> Path:
    known = next(known for known in sfmcpp.formats() if known.name == format)
    name = {"sba": "cams.txt", "transforms": "transforms.json", "parts": "scene.parts"}
    return folder / name.get(format, f"scene{known.suffixes[0] if known.suffixes else ''}")


@pytest.mark.parametrize("format", READABLE)
def test_every_format_that_is_read_is_told_with_its_size(tmp_path: Path, format: str) -> None:
    path = path_for(tmp_path, format)
    problem = noisy_circle(camera_model="calibrated" if format == "sba" else "bal")
    sfmcpp.write(problem, path, format=format)
    found, read = facts(path), sfmcpp.read(path)
    assert found["format"].startswith(f"{format.removesuffix('-text').removesuffix('-binary')}")
    assert found["cameras"].startswith(f"{read.num_cameras}, camera model {read.camera_model}")
    assert found["points"] == str(read.num_points)
    assert found["observations"].partition(":")[0] == str(read.num_observations)


def test_tracks_in_a_matlab_file_for_each_image_are_told(tmp_path: Path) -> None:
    for image, points in ((1, [1, 2, 5]), (2, [2, 5])):
        rows = [[0.0] * 6, *([point, 10.0 * point, 5.0, 0.0, 0.0, 0.0] for point in points)]
        savemat(tmp_path / f"Image{image}.mat", {"Image": np.array(rows)})
    found = facts(tmp_path)
    assert found["format"] == "tracks of uncalibrated images"
    assert (found["images"], found["tracks"], found["observations"]) == ("2", "3", "5")


def test_shared_and_free_intrinsics_world_rigs_and_masks_are_told(tmp_path: Path) -> None:
    problem = noisy_circle(camera_model="bal").with_shared_intrinsics()
    problem.set_free_intrinsics("f", "k1")
    problem.fixed_cameras[:2] = True
    problem.metadata.image_sizes = np.tile([640, 480], (problem.num_cameras, 1))
    WorldOrigin(np.array([48.0, 11.5, 500.0]), geodetic=True).put_into(problem.metadata)
    problem.sigma_px = np.full(problem.num_observations, 0.5)
    problem.rigs = sfmcpp.Rigs(np.tile(np.eye(3, 4), (2, 1, 1)), [0, 0, 1, 1, 2, 2], [0, 1] * 3)
    sfmcpp.write(problem, tmp_path / "scene.npz")
    found = facts(tmp_path / "scene.npz")
    f = f"{problem.intrinsics[0, 0]:.6g}"
    assert found["intrinsics"] == f"one row for all; free: f, k1; f = {f} px"
    assert found["image size"] == "640×480 px"
    assert found["world"].startswith("georeferenced, metres; origin at latitude_deg 48, longitude_deg 11.5")
    assert found["rigs"] == "3 frames of 2 sensors"
    assert found["fixed"] == "2 cameras, 0 points"
    assert found["also"] == "uncertainties of observations"


def test_sensor_files_tell_each_stream_its_rate_and_its_gaps(tmp_path: Path) -> None:
    rows = [f"{0.1 * k:.1f},36,,,,cold" for k in range(50) if not 20 <= k < 30]
    rows[::4] = [row.replace(",,,,", ",1,2,3,") for row in rows[::4]]
    (tmp_path / "log.csv").write_text(
        "t [s],speed [km/h],wx [deg/s],wy [deg/s],wz [deg/s],air\n" + "\n".join(rows)
    )
    found = facts(tmp_path / "log.csv")
    assert found["odometer"] == "speed: 40 in 4.900 s from 0.000 s on, 10 Hz, 1 gap"
    assert found["imu"].startswith("angular rate: 10 in 4.")
    assert found["left out"] == "columns of unknown names: air"


def test_control_points_are_told_from_positions_of_images(tmp_path: Path) -> None:
    (tmp_path / "gcp.csv").write_text(
        "name,x,y,z,image,u,v,check\na,1,2,3,1.jpg,4,5,0\na,1,2,3,2.jpg,4,5,0\nb,1,2,4,1.jpg,6,7,1\n"
    )
    found = facts(tmp_path / "gcp.csv")
    assert found["format"] == "ground control points and their marks"
    assert found["points"] == "2, 1 of them check points: x, y, z [m], without σ"
    assert found["marks"] == "3 in 2 images"
    (tmp_path / "geo.txt").write_text("EPSG:4326\n1.jpg -92 46.8 200\n")
    assert (
        facts(tmp_path / "geo.txt")["positions"]
        == "1: latitude, longitude, height, without standard deviations"
    )


def test_tracks_trajectories_and_positions_are_told_apart(tmp_path: Path) -> None:
    drive = vehicle_drive(60.0, frame_hz=5.0, seed=0)
    arrays = (drive.t_s, drive.frame_index, drive.track_index, drive.pixels, drive.intrinsics)
    for name in ("drive.csv", "drive.txt"):
        write_tracks(CameraTracks(*arrays), tmp_path / name)
        found = facts(tmp_path / name)
        assert found["format"] == "tracks of a calibrated camera"
        assert found["frames"].startswith(f"{len(drive.t_s)} in ")
        assert found["frames"].endswith(" 5 Hz")
        assert found["tracks"] == f"{np.max(drive.track_index) + 1:,}"
    write_trajectory(drive.truth, tmp_path / "poses.txt")
    assert facts(tmp_path / "poses.txt")["poses"].endswith(f"{drive.truth.length_m:.6g} long")
    (tmp_path / "gps.csv").write_text("name,lat,lon,height,accuracy\na.jpg,48,11,500,2\nb.jpg,48,12,500,2\n")
    told = facts(tmp_path / "gps.csv")["positions"]
    assert told == "2: latitude, longitude, height, with standard deviations"


def test_a_calibration_tells_its_cameras(tmp_path: Path) -> None:
    pytest.importorskip("yaml", reason="PyYAML is not installed: pip install 'sfmcpp[vision]'")
    file = tmp_path / "stereo.yml"
    file.write_text(
        "M1: [100, 0, 32, 0, 101, 24, 0, 0, 1]\nD1: [0.1, 0, 0, 0]\n"
        "M2: [1, 2, 3]\nP1: [90, 0, 30, 0, 0, 90, 20, 0, 0, 0, 1, 0]\n"
    )
    found = facts(file)
    assert found["format"] == "calibration"
    assert found["M1"] == "f = 100 px, aspect 1.01, principal point (32, 24) px, with distortion"
    assert found["M2"] == "refused: holds 3 numbers: must be 9, a matrix of 3×3"
    assert found["P1"] == "f = 90 px, aspect 1, principal point (30, 20) px"
    file.write_text("f: 3\n")
    result = run_here("info", file)
    assert result.returncode == 2
    assert is_one_error_line(result)
    assert "stereo.yml:1: holds no camera" in result.stderr


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("K.txt", "100 0 32\n0 101 24\n0 0 1\n"),
        ("mine.txt", "100 0 32\n0 101 24\n0 0 1\n"),
        ("calib.txt", "P0: 100 0 32 0 0 101 24 0 0 0 1 0\nP1: 100 0 32 -54 0 101 24 0 0 0 1 0\n"),
        ("calib.json", '{"mtx": [[100, 0, 32], [0, 101, 24], [0, 0, 1]]}'),
    ],
)
def test_calibrations_of_text_and_json_are_told(tmp_path: Path, name: str, text: str) -> None:
    pytest.importorskip("yaml", reason="PyYAML is not installed: pip install 'sfmcpp[vision]'")
    (tmp_path / name).write_text(text)
    found = facts(tmp_path / name)
    assert found.pop("format") == "calibration"
    assert found["camera" if name.endswith("txt") else "mtx"].startswith("f = 100 px, aspect 1.01, princ")


def test_tables_are_told_by_their_lines_where_their_name_tells_nothing(tmp_path: Path) -> None:
    log = "".join(f"{k}\t36\n" for k in range(5))
    tum = "".join(f"{k} {k} 0 0 0 0 0 1\n" for k in range(5))
    tracks = "".join(f"{image},{track},{track}.5,7.5\n" for image in range(3) for track in range(4))
    for name, text, kind in (
        ("log.tsv", f"t [s]\tspeed [m/s]\n{log}", "sensor file"),
        ("log.dat", f"t [s]\tspeed [m/s]\n{log}", "sensor file"),
        ("poses.tum", tum, "trajectory"),
        ("tracks.csv", tracks, "tracks of uncalibrated images"),
        ("positions.tsv", "name\tx\ty\tz\na.jpg\t1\t2\t3\n", "positions of images"),
    ):
        (tmp_path / name).write_text(text)
        assert facts(tmp_path / name)["format"] == kind
    for name, data in (("notes", b"no table\n"), ("model.bin", tum.encode() + b"\0")):
        (tmp_path / name).write_bytes(data)
        assert f"{name}: its name tells no format: must end in" in run_here("info", tmp_path / name).stderr


def test_a_folder_of_images_tells_size_times_and_camera(tmp_path: Path) -> None:
    cv2 = pytest.importorskip("cv2", reason="OpenCV is not installed: pip install 'sfmcpp[vision]'")
    for k in range(3):
        cv2.imwrite(str(tmp_path / f"{k}.png"), np.zeros((48, 64), dtype=np.uint8))
    assert facts(tmp_path)["times"] == "none with the images"
    (tmp_path / "times.txt").write_text("1.0\n1.5\n2.0\n")
    (tmp_path / "K.txt").write_text("100 0 32\n0 100 24\n0 0 1\n")
    found = facts(tmp_path)
    assert found["images"] == "3, the first of 64×48 px"
    assert found["times"] == "3 in 1.000 s from 1.000 s on, 2 Hz"
    assert found["camera"] == "f = 100 px, aspect 1, principal point (32, 24) px"
    assert found["EXIF"] == "focal length in 0, GPS in 0 of 3"


@pytest.mark.real
@pytest.mark.parametrize(
    ("path", "name", "value"),
    [
        ("bal/problem-49-7776-pre.txt.bz2", "observations", "31,843: 4.1 for a point, 650 for a camera"),
        ("kitti_tracks/2011_09_30_drive_0020_sync_KLT.mat", "tracks", "6,707"),
        ("drone_beach/images", "EXIF", "focal length in 18, GPS in 18 of 18"),
        ("dinosaur/viff.xy", "observations", "16,432"),
        ("kitti_clip/poses.txt", "poses", "51 without times, 59.8597 long"),
    ],
)
def test_real_files_have_the_numbers_that_are_known_of_them(
    data_dir: Path, path: str, name: str, value: str
) -> None:
    assert facts(data_dir / path)[name] == value


def test_a_bag_tells_its_topics(tmp_path: Path) -> None:
    from bag_writing import START_NS, messages_for, write_bag

    made = messages_for("mcap")
    recorded = [("/imu", made.imu(START_NS, (0, 0, 1)))]
    path = write_bag(tmp_path / "drive.mcap", made, recorded)
    result = run_here("info", path)
    assert result.stdout == run_here("bag", path).stdout.rpartition("\n\n")[0] + "\n"


@pytest.mark.parametrize(
    ("name", "text", "told"),
    [
        ("none.npz", None, "no such file or directory"),
        ("a.md", "# title\n", "its name tells no format"),
        ("log.csv", "t [s],speed [m/s]\n0,1\n1,fast\n", "log.csv:3: "),
        ("model.npz", "nothing", "model.npz: "),
    ],
)
def test_what_cannot_be_read_is_told_in_one_line(
    tmp_path: Path, name: str, text: str | None, told: str
) -> None:
    if text is not None:
        (tmp_path / name).write_text(text)
    result = run_here("info", tmp_path / name)
    assert result.returncode == 2
    assert is_one_error_line(result)
    assert told in result.stderr


def test_a_folder_of_folders_says_where_the_images_are(tmp_path: Path) -> None:
    (tmp_path / "drive" / "left").mkdir(parents=True)
    (tmp_path / "drive" / "left" / "0.png").touch()
    result = run_here("info", tmp_path / "drive")
    assert is_one_error_line(result)
    assert f"nor does it hold images: did you mean {tmp_path / 'drive' / 'left'}?" in result.stderr


def test_tracks_are_not_tried_as_a_sensor_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its cells as text would take gigabytes for tracks of an hour."""

    def read(_: Path) -> None:
        raise AssertionError("read as a sensor file")

    monkeypatch.setattr(sensor_csv, "read_sensor_csv", read)
    tracks = CameraTracks(
        np.zeros(1), *np.zeros((2, 1), np.int32), np.ones((1, 2)), np.array([500.0, 1, 0, 0, 0])
    )
    write_tracks(tracks, tmp_path / "tracks.csv")
    assert facts(tmp_path / "tracks.csv")["format"] == "tracks of a calibrated camera"
