"""`sfmcpp slam`: a folder of results that read back, the same every time, and one line for what cannot be."""

from __future__ import annotations

import json
import os
import pty
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sfmcpp
from cli_helpers import COMMAND, TIMEOUT_S, is_one_error_line, read_terminal, run, run_here, strict_json
from sfmcpp import CheckpointFolder, slam
from sfmcpp.geometry.similarity import fit_pose_similarity
from sfmcpp.sources.io.track_files import CameraTracks, write_tracks
from sfmcpp.sources.io.trajectories import read_trajectory

TEXTS = ["keyframes.txt", "trajectory.txt"]
FILES = sorted([*TEXTS, "model", "points.ply", "report.json", "trajectory.png", "view.html"])
MODEL = [f"{name}.{suffix}" for name in ("cameras", "images", "points3D") for suffix in ("bin", "txt")]
STEP_S = 0.1
OUT = ("-o", "out")
ODOMETER = ("--sensor", "odometer", "--sensor-file", "s.csv")


def corridor(num_cameras: int = 40, sigma_px: float = 0.0) -> sfmcpp.Problem:
    return sfmcpp.corridor_scene(
        num_cameras, 60 * num_cameras, length_m=0.5 * num_cameras, pixel_sigma_px=sigma_px, seed=2
    )


def write_drive(path: Path, scene: sfmcpp.Problem) -> Path:
    t_s = 100.0 + STEP_S * np.arange(scene.num_cameras)
    write_tracks(
        CameraTracks(t_s, scene.camera_index, scene.point_index, scene.pixels, scene.intrinsics[0]), path
    )
    return path


def without_times(report: Path) -> dict[str, Any]:
    """The report without what the clock says."""
    content = strict_json(report)
    for name in ("fps", "seconds", "real_time_factor", "seconds_read", "peak_memory_bytes"):
        assert content.pop(name) > 0
    for keyframe in content["keyframes"]:
        assert min(keyframe.pop("milliseconds").values()) >= 0
    return content


def names_in(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_every_file_is_there_and_reads_back_as_the_drive(tmp_path: Path) -> None:
    scene = corridor()
    source, folder = write_drive(tmp_path / "drive.csv", scene), tmp_path / "new/out"
    result = run("slam", source, "-o", folder)
    assert (result.returncode, result.stderr) == (0, "")
    assert names_in(folder) == FILES
    assert names_in(folder / "model") == MODEL
    trajectory, keyframes = (read_trajectory(folder / name) for name in reversed(TEXTS))
    np.testing.assert_array_equal(trajectory.t_s, 100.0 + STEP_S * np.arange(40))
    aligned = fit_pose_similarity(trajectory.poses, scene.cameras).apply_to_poses(trajectory.poses)
    np.testing.assert_allclose(aligned, scene.cameras, atol=1e-4)
    content = strict_json(folder / "report.json")
    assert content["totals"]["frames"] == content["totals"]["poses"] == 40
    assert content["totals"]["keyframes"] == len(keyframes)
    assert content["totals"]["lost"] == 0
    assert content["message"] == ""
    assert f"{len(keyframes)} keyframes" in result.stdout
    assert f"written         {folder / 'view.html'}" in result.stdout


def test_the_model_is_the_map_in_both_formats(tmp_path: Path) -> None:
    folder = tmp_path / "out"
    assert run_here("slam", write_drive(tmp_path / "drive.csv", corridor()), "-o", folder).returncode == 0
    binary = sfmcpp.read(folder / "model")
    for path in (folder / "model").glob("*.bin"):
        path.unlink()
    text = sfmcpp.read(folder / "model")
    keyframes = read_trajectory(folder / "keyframes.txt")
    content = strict_json(folder / "report.json")
    for model in (binary, text):
        np.testing.assert_allclose(model.cameras, keyframes.poses, atol=1e-12)
        assert model.num_points == content["totals"]["points"]
        assert np.bincount(model.point_index).min() >= 2
        # The drive has no noise: all that the model holds fits to a fraction of a pixel.
        assert np.abs(sfmcpp.residuals(model)).max() < 1e-3
    header = (folder / "points.ply").read_bytes().split(b"end_header")[0]
    assert b"element vertex %d" % (binary.num_points + binary.num_cameras) in header


def test_the_same_seed_gives_the_same_files(tmp_path: Path) -> None:
    noisy, _ = sfmcpp.add_outliers(corridor(30, 0.5), 0.05, seed=1)
    source = write_drive(tmp_path / "drive.csv", noisy)
    for name in ("a", "b"):
        assert run("slam", source, "--seed", "5", "--quiet", "-o", tmp_path / name).returncode == 0
    for path in sorted((tmp_path / "a").rglob("*.*")):
        twin = tmp_path / "b" / path.relative_to(tmp_path / "a")
        if path.name == "report.json":
            assert without_times(path) == without_times(twin)
        else:
            assert path.read_bytes() == twin.read_bytes(), path.name


def test_quiet_says_nothing_and_results_replace_older_ones(tmp_path: Path) -> None:
    source, folder = write_drive(tmp_path / "drive.csv", corridor(20)), tmp_path / "out"
    folder.mkdir()
    (folder / "trajectory.txt").write_text("older")
    (folder / "mine.txt").write_text("not to be touched")
    result = run("slam", source, "--quiet", "-o", folder)
    assert (result.returncode, result.stdout, result.stderr) == (0, "", "")
    assert names_in(folder) == sorted([*FILES, "mine.txt"])
    assert len(read_trajectory(folder / "trajectory.txt")) == 20
    assert (folder / "mine.txt").read_text() == "not to be touched"


def test_the_window_and_the_seed_reach_the_report(tmp_path: Path) -> None:
    source = write_drive(tmp_path / "drive.csv", corridor(20))
    assert run_here("slam", source, "-o", tmp_path / "out", "--window", "5", "--seed", "7").returncode == 0
    settings = strict_json(tmp_path / "out/report.json")["settings"]
    assert (settings["window"], settings["seed"]) == (5, 7)


def test_a_file_of_sensors_in_place_of_tracks_is_told_where_it_goes(tmp_path: Path) -> None:
    (tmp_path / "s.csv").write_text("t [s],speed [m/s]\n100,5\n101,5\n")
    result = run_here("slam", tmp_path / "s.csv", "-o", tmp_path / "out")
    assert is_one_error_line(result)
    assert "of a tracks file; sensors go into --sensor-file" in result.stderr


def test_a_standing_camera_is_told_and_leaves_a_report_only(tmp_path: Path) -> None:
    scene = corridor(20)
    first = scene.camera_index == 0
    tracks, pixels = scene.point_index[first], scene.pixels[first]
    count = len(tracks)
    frames, again = np.repeat(np.arange(10, dtype=np.int32), count), np.tile(tracks, 10)
    standing = CameraTracks(0.1 * np.arange(10), frames, again, np.tile(pixels, (10, 1)), scene.intrinsics[0])
    write_tracks(standing, tmp_path / "standing.csv")
    result = run_here("slam", tmp_path / "standing.csv", "-o", tmp_path / "out")
    assert result.returncode == 3
    assert is_one_error_line(result)
    assert f"{tmp_path / 'standing.csv'}: no map could be started: the image moves" in result.stderr
    assert names_in(tmp_path / "out") == ["report.json"]
    content = strict_json(tmp_path / "out/report.json")
    assert content["message"].startswith("the image moves")
    assert content["totals"] == {
        "frames": 10, "poses": 0, "bridged": 0, "lost": 0, "keyframes": 0, "points": 0
    }  # fmt: skip


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["drive.csv"], "'-o'"),
        (["absent.csv", *OUT], "absent.csv: no such file"),
        (["absent.mat", *OUT], "absent.mat: no such file"),
        (["photos", *OUT], "photos: holds no image: must have files named .png"),
        (["trip", *OUT], "trip: holds no image: did you mean trip/image_l?"),
        (["clip.mp4", *OUT], "clip.mp4: no such file"),
        (["photo.png", *OUT], "photo.png: is a single picture: give a folder of images"),
        (["drive.csv", *OUT, "--fps", "10"], "camera, fps, corners: are for images"),
        (["drive.csv", *OUT, "--stereo"], "stereo: only KITTI drives (.mat) and images have"),
        (["drive.csv", *OUT, "--baseline", "0.5"], "right, baseline_m: are for images"),
        (["drive.csv", *OUT, "--corners", "harris"], "camera, fps, corners: are for images"),
        (["drive.csv", *OUT, "--corners", "fast"], "'fast' is unknown; choose one of shi-tomasi, harris"),
        (["drive.csv", *OUT, "--camera", "700,0,600"], "camera, fps, corners: are for images"),
        (
            ["drive.csv", *OUT, "--camera", "700,600"],
            "'700,600': must be a file, f,cx,cy or f,aspect,cx,cy,skew",
        ),
        (["drive.csv", *OUT, "--fps", "0"], "0.0: must be positive"),
        (["broken.csv", *OUT], "broken.csv:4: 'x' is not a finite number"),
        (["drive.csv", "-o", "broken.csv"], "broken.csv: is a file, a folder is wanted"),
        (["drive.csv", *OUT, "--sensor", "radar"], "'radar' is unknown; choose one of odometer, imu"),
        (["drive.csv", *OUT, "--sensor", "gps"], "--sensor 'gps': the input holds no position"),
        (["drive.csv", *OUT, "--sensor", "imu", "--sensor", "imu"], "'imu' is named twice"),
        (["drive.csv", *OUT, "--sensor", "odometer"], "the input holds no distance or speed or velocity"),
        (["drive.csv", *OUT, "--sensor-file", "s.csv"], "--sensor-file: no --sensor is named"),
        (["drive.csv", *OUT, "--sensor", "imu", "--sensor-file", "s.csv"], "s.csv: holds no angular_rate"),
        (["drive.csv", *OUT, *ODOMETER, "--weights", "best"], "--weights 'best': must be one of loo"),
        (["drive.csv", *OUT, *ODOMETER, "--weights", "fixed:-1"], "--weights 'fixed:-1'"),
        (["drive.csv", *OUT, *ODOMETER, "--sensor-sigma", "odometer"], "'odometer': must be NAME=SIGMA"),
        (["drive.csv", *OUT, *ODOMETER, "--sensor-sigma", "odometer=-1"], "--sensor-sigma odometer=-1"),
        (["drive.csv", *OUT, *ODOMETER, "--sensor-sigma", "imu=1"], "--sensor-sigma: 'imu' is none of the"),
        (["drive.csv", *OUT, "--sensor-sigma", "imu=1"], "--sensor-sigma: 'imu' is none of the"),
        (["drive.csv", *OUT, "--sensor-column", "vx [m/s]=v"], "--sensor-column: there is no sensor file"),
        (["drive.csv", *OUT, *ODOMETER, "--clock-offset", "nan"], "--clock-offset nan: must be finite"),
        (["drive.csv", *OUT, "--weights", "loo"], "'loo': there is no --sensor to weigh"),
        (["drive.csv", *OUT, "--window", "1"], "--window 1: must be at least 2"),
    ],
)
def test_bad_usage_and_bad_input_are_one_line_and_write_nothing(
    tmp_path: Path, arguments: list[str], told: str
) -> None:
    write_drive(tmp_path / "drive.csv", corridor(4))
    head = (tmp_path / "drive.csv").read_text().split("\n")[:3]
    (tmp_path / "broken.csv").write_text("\n".join([*head, "0,0,0,x,1"]) + "\n")
    (tmp_path / "s.csv").write_text("t [s],speed [m/s]\n100,5\n101,5\n")
    (tmp_path / "photos").mkdir()
    (tmp_path / "trip/image_l").mkdir(parents=True)
    (tmp_path / "trip/empty").mkdir()
    (tmp_path / "trip/image_l/0.png").touch()
    before = names_in(tmp_path)
    result = run_here("slam", *arguments, cwd=tmp_path)
    assert result.returncode == 2
    assert is_one_error_line(result)
    assert told in result.stderr
    assert names_in(tmp_path) == before


def test_what_an_extra_would_install_is_told_by_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_drive(tmp_path / "drive.csv", corridor())
    monkeypatch.setitem(sys.modules, "poselib", None)
    result = run_here("slam", "drive.csv", *OUT, cwd=tmp_path)
    assert result.returncode == 2
    assert is_one_error_line(result)
    assert result.stderr.endswith("need poselib: pip install 'sfmcpp[vision]'\n")


@pytest.mark.parametrize(
    ("column", "told"),
    [
        ("speed", "'speed': must be NAME [UNIT]=OWN NAME"),
        (
            "speed [m/s]=V",
            "s.csv:1: holds no column 'V', which is to be 'speed [m/s]': it holds t [s], speed",
        ),
    ],
)
def test_columns_that_are_not_there_are_one_line(tmp_path: Path, column: str, told: str) -> None:
    write_drive(tmp_path / "drive.csv", corridor(4))
    (tmp_path / "s.csv").write_text("t [s],speed [m/s]\n100,5\n101,5\n")
    result = run_here("slam", "drive.csv", *OUT, *ODOMETER, "--sensor-column", column, cwd=tmp_path)
    assert result.returncode == 2
    assert is_one_error_line(result)
    assert told in result.stderr


def test_results_whose_names_are_taken_are_refused_before_the_work(tmp_path: Path) -> None:
    write_drive(tmp_path / "drive.csv", corridor(4))
    for taken in ("points.ply", "weights.png"):
        folder = tmp_path / f"out_{taken}"
        (folder / taken).mkdir(parents=True)
        result = run_here("slam", "drive.csv", "-o", folder.name, cwd=tmp_path)
        assert result.returncode == 2
        assert is_one_error_line(result)
        assert f"{taken}: is a directory, a file is wanted" in result.stderr
        assert names_in(folder) == [taken]


def test_an_odometer_in_a_file_brings_the_map_to_metres(tmp_path: Path) -> None:
    scene = corridor()
    source = write_drive(tmp_path / "drive.csv", scene)
    speed = scene.centres[1, 0] / STEP_S
    rows = [f"{99.9 + STEP_S * k:.1f},{3.6 * speed}" for k in range(43)]
    (tmp_path / "speed.csv").write_text("\n".join(["t [s],speed [km/h]", *rows]))
    command = ("--sensor", "odometer", "--sensor-file", tmp_path / "speed.csv", "-o", tmp_path / "out")
    result = run_here("slam", source, *command)
    assert (result.returncode, result.stderr) == (0, "")
    assert "odometer; weights by loo, median odometer" in result.stdout
    assert names_in(tmp_path / "out") == sorted([*FILES, "trade_off.png", "weights.png"])
    weighed = [keyframe["weights"] for keyframe in strict_json(tmp_path / "out/report.json")["keyframes"]]
    assert {name for weights in weighed for name in weights} == {"odometer"}
    found = read_trajectory(tmp_path / "out/trajectory.txt")
    assert found.length_m == pytest.approx(np.ptp(scene.centres[:, 0]), rel=1e-3)


@pytest.mark.parametrize("by", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_run_keeps_what_there_is_and_says_so(tmp_path: Path, by: signal.Signals) -> None:
    source, folder = write_drive(tmp_path / "drive.csv", corridor(1200, 0.3)), tmp_path / "out"
    ours, theirs = pty.openpty()
    command = [*COMMAND, "slam", str(source), "-o", str(folder)]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=theirs) as process:
        os.close(theirs)
        shown, interrupted = b"", False
        while more := read_terminal(ours):
            shown += more
            if not interrupted and b"keyframes" in shown:
                process.send_signal(by)
                interrupted = True
        process.wait(TIMEOUT_S)
    os.close(ours)
    assert process.returncode == 130, shown.decode()
    assert f"results so far are in {folder}" in "".join(shown.decode().splitlines())
    assert b"Traceback" not in shown
    assert names_in(folder) == FILES
    content = strict_json(folder / "report.json")
    assert content["interrupted"] is True
    assert 0 < content["totals"]["frames"] < 1200
    poses = len(read_trajectory(folder / "trajectory.txt"))
    assert poses == content["totals"]["poses"] <= content["totals"]["frames"]


@pytest.mark.real
def test_a_real_drive_is_mapped_and_measured_against_its_truth(tmp_path: Path, data_dir: Path) -> None:
    drive = data_dir / "kitti_tracks/2011_09_26_drive_0001_sync_KLT.mat"
    folder = tmp_path / "out"
    result = run_here("slam", drive, "-o", folder)
    assert (result.returncode, result.stderr) == (0, "")
    assert names_in(folder) == sorted([*FILES, "scale.png"])
    content = strict_json(folder / "report.json")
    assert content["totals"]["frames"] == content["totals"]["poses"] == 108
    truth = content["truth"]
    # The drive is 107 m long; the scale drifts, but not by much on so short a way.
    assert content["drift"]["alignment"]["rule"] == "first:0.1"
    assert content["drift"]["mean_3d_error_m"] < 0.03 * truth["truth_length_m"]
    report = tmp_path / "evaluation.json"
    by_first = ("--align", "first:0.1", "--align-by", "poses")
    for told, options in ((truth, ()), (content["drift"], by_first)):
        command = ("evaluate", folder / "trajectory.txt", "--truth", drive, "--report", report, "--quiet")
        assert run_here(*command, *options).returncode == 0
        assert strict_json(report)["mean_3d_error_m"] == pytest.approx(told["mean_3d_error_m"], rel=1e-6)
        assert f"{told['mean_3d_error_m']:.4g} m" in result.stdout
    model = sfmcpp.read(folder / "model")
    assert np.sqrt(np.mean(sfmcpp.residuals(model) ** 2)) < 4.0
    page = (folder / "view.html").read_text()
    data = json.loads(page.split('id="scene">')[1].split("</script>")[0])
    assert dict(data["facts"])["keyframes"] == str(content["totals"]["keyframes"])
    assert data["truth"]


@pytest.mark.real
def test_the_sensors_of_a_real_drive_weigh_in_and_make_its_map_metric(tmp_path: Path, data_dir: Path) -> None:
    drive, folder = data_dir / "kitti_tracks/2011_09_26_drive_0001_sync_KLT.mat", tmp_path / "out"
    sensors = ("--sensor", "odometer", "--sensor", "imu", "--weights", "l-curve")
    assert run_here("slam", drive, "-o", folder, *sensors).returncode == 0
    content = strict_json(folder / "report.json")
    weighed = [keyframe["weights"] for keyframe in content["keyframes"]]
    assert {name for weights in weighed for name in weights} == {"odometer", "imu"}
    found, truth = read_trajectory(folder / "trajectory.txt"), read_trajectory(drive)
    start = slice(0, 30)
    lengths = [np.linalg.norm(np.diff(t.centres[start], axis=0), axis=1).sum() for t in (found, truth)]
    assert lengths[0] == pytest.approx(lengths[1], rel=0.05)


def test_a_run_that_was_stopped_goes_on_to_the_same_files(tmp_path: Path) -> None:
    source, kept = write_drive(tmp_path / "drive.csv", corridor(sigma_px=0.3)), tmp_path / "kept"
    whole, out = tmp_path / "whole", tmp_path / "out"
    assert run_here("slam", source, "-o", whole, "--quiet").returncode == 0
    slam.run(source, callback=lambda frame, _: frame < 25, checkpoint=CheckpointFolder(kept))
    words = ("--resume", kept, "--checkpoint", kept, "--checkpoint-every", "0")
    assert run_here("slam", source, "-o", out, "--quiet", *words).returncode == 0
    for name in (*TEXTS, "points.ply", *(f"model/{file}" for file in MODEL)):
        assert (out / name).read_bytes() == (whole / name).read_bytes(), name
    assert without_times(out / "report.json") == without_times(whole / "report.json")


def test_what_cannot_be_resumed_is_one_line_before_the_run(tmp_path: Path) -> None:
    source, kept = write_drive(tmp_path / "drive.csv", corridor()), tmp_path / "kept"
    slam.run(source, callback=lambda frame, _: frame < 5, checkpoint=CheckpointFolder(kept))
    for words, told in (
        (("--resume", tmp_path / "nothing"), "nothing: holds no checkpoint"),
        (("--resume", kept, "--window", "6"), "other options: window = 8, this is 6"),
        (("--checkpoint", kept), "earlier run: resume it, or remove them"),
    ):
        result = run_here("slam", source, "-o", tmp_path / "out", *words)
        assert (result.returncode, is_one_error_line(result)) == (2, True), result.stderr
        assert told in result.stderr
        assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--weight-bounds", "none"], "'none': there is no --sensor to weigh"),
        (["--clock-offset", "0.5"], "0.5: there is no --sensor with a clock"),
        (
            [*ODOMETER, "--sensor-sigma", "odometer=1", "--sensor-sigma", "odometer=2"],
            "'odometer' is named twice",
        ),
    ],
)
def test_options_without_effect_are_refused(tmp_path: Path, options: list[str], told: str) -> None:
    result = run_here("slam", write_drive(tmp_path / "drive.csv", corridor(4)), *OUT, *options, cwd=tmp_path)
    assert result.returncode == 2
    assert is_one_error_line(result)
    assert told in result.stderr
    assert names_in(tmp_path) == ["drive.csv"]
