"""``sfmcpp reconstruct`` on photos of places that are known: models against the truth, resuming, warnings."""

from __future__ import annotations

import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import sfmcpp
from cli_helpers import TIMEOUT_S, strict_json
from rendered import photos_of, reconstructed, registered, results
from sfmcpp.cli.main import main
from sfmcpp.model import Problem
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sensors import east_north_up, geodetic_of
from sfmcpp.sources.synthetic.photos import WORLD_ORIGIN

FEW = 6
# Ends as `kill -9` does, in the middle of the stage that is named first.
KILLED = """
import os, signal, sys
import sfmcpp.sfm
from sfmcpp.cli.main import main

reconstruct = sfmcpp.sfm.reconstruct

def dying(source, *, progress, **options):
    def tell(stage, done, total):
        if stage == sys.argv[1] and 2 * done >= total:
            os.kill(os.getpid(), signal.SIGKILL)
        return progress(stage, done, total)
    return reconstruct(source, progress=tell, **options)

sfmcpp.sfm.reconstruct = dying
sys.exit(main(["reconstruct", sys.argv[2], "-o", sys.argv[3], "--quiet", "--resume"]))
"""


@pytest.fixture(scope="module")
def field(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A few photos from a drone."""
    folder = tmp_path_factory.mktemp("field")
    photos_of("drone", folder / "photos", FEW)
    return folder / "photos"


@pytest.fixture(scope="module")
def model(field: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What one run on one thread makes of them."""
    out = tmp_path_factory.mktemp("field-model") / "out"
    code, report = reconstructed(field, out, "--threads", "1")
    assert (code, registered(report)) == (0, sorted(report["images"]))
    return out


def test_a_walk_round_a_house_against_the_truth(tmp_path: Path) -> None:
    truth = photos_of("courtyard", tmp_path / "photos", 20, image_size=(400, 300), distortion=(-0.12, 0.02))
    sfmcpp.write(truth, tmp_path / "truth")
    code, report = reconstructed(tmp_path / "photos", tmp_path / "out")
    assert (code, len(registered(report))) == (0, 20)
    # In one piece, though the photos on both sides of a corner of the house share little but the walls.
    assert (report["warnings"], report["counts"]["models"]) == ([], 1)
    camera = sfmcpp.read(tmp_path / "out/model").intrinsics[0]
    assert camera[0] == pytest.approx(truth.intrinsics[0, 0], rel=0.005)
    assert camera[5] == pytest.approx(truth.intrinsics[0, 5], abs=0.015)
    command = ["evaluate", str(tmp_path / "out"), "--truth", str(tmp_path / "truth"), "--quiet"]
    assert main([*command, "--report", str(tmp_path / "errors.json")]) == 0
    errors = strict_json(tmp_path / "errors.json")
    # Of a ring of 8 m; a pixel is 2 cm there.
    assert errors["centre_error"]["max"] < 0.02
    assert errors["rotation_error_deg"]["max"] < 0.15


def test_the_same_files_for_every_number_of_threads(field: Path, model: Path, tmp_path: Path) -> None:
    assert reconstructed(field, tmp_path / "out", "--threads", "2")[0] == 0
    once, again = results(model), results(tmp_path / "out")
    assert once.keys() == again.keys()
    assert {"model/images.bin", "transforms.json"} <= once.keys()
    for name in sorted(once):
        assert once[name] == again[name], name


def test_one_more_photo_costs_only_its_own_pairs(field: Path, tmp_path: Path) -> None:
    photos, out = tmp_path / "photos", tmp_path / "out"
    shutil.copytree(field, photos)
    last = photos / f"{FEW - 1:04d}.jpg"
    shutil.move(last, tmp_path / last.name)
    assert reconstructed(photos, out)[0] == 0
    kept = entries(out)
    shutil.move(tmp_path / last.name, last)
    assert reconstructed(photos, out, "--resume")[0] == 0
    now = entries(out)
    assert {path: now[path] for path in kept} == kept
    new = [path.parent.name for path in now.keys() - kept.keys()]
    assert {stage: new.count(stage) for stage in set(new)} == {
        "features": 1,
        "pairs": 1,  # the choice of all
        "matches": FEW - 1,
        "geometry": FEW - 1,
    }


def entries(out: Path) -> dict[Path, int]:
    """Files of a cache, and when they were written."""
    return {path: path.stat().st_mtime_ns for path in (out / "cache").glob("*/*")}


def test_a_run_killed_in_every_stage_and_resumed_ends_in_the_same_files(
    field: Path, model: Path, tmp_path: Path
) -> None:
    out, done = tmp_path / "out", []
    for stage in ("features", "matching", "geometry", "mapping"):
        command = [sys.executable, "-c", KILLED, stage, str(field), str(out)]
        ended = subprocess.run(command, capture_output=True, timeout=TIMEOUT_S)
        assert ended.returncode == -signal.SIGKILL, ended.stderr
        assert [path.name for path in out.iterdir()] == ["cache"]
        done.append(len(entries(out)))
    assert 0 < done[0] < done[1] < done[2] <= done[3]
    assert reconstructed(field, out, "--resume")[0] == 0
    once, resumed = results(model), results(out)
    assert once.keys() == resumed.keys()
    for name in sorted(once):
        assert once[name] == resumed[name], name


@pytest.mark.parametrize(
    ("place", "count", "size"), [("symmetric", 12, (640, 480)), ("double", 16, (480, 360))]
)
def test_sides_that_look_alike_are_warned_of(
    place: str, count: int, size: tuple[int, int], tmp_path: Path
) -> None:
    # Of smaller photos too few points are left: at 400 × 300 half of the seeds of "symmetric" are not told.
    photos_of(place, tmp_path / "photos", count, image_size=size)
    code, report = reconstructed(tmp_path / "photos", tmp_path / "out")
    told = [warning for warning in report["warnings"] if "repeated or symmetric structure" in warning]
    assert told, (code, registered(report), report["rms_px"], report["warnings"])


def test_wrong_positions_are_named_and_cost_nothing(tmp_path: Path) -> None:
    truth = photos_of(
        "drone", tmp_path / "photos", 16, gps_sigma_m=1.0, gps_outliers=3, gps_outlier_m=20.0, seed=2
    )
    outliers = truth.metadata.extra["gps_outliers"]
    code, report = reconstructed(tmp_path / "photos", tmp_path / "told", "--gps", "exif")
    assert (code, len(registered(report))) == (0, 16)
    assert sorted(report["gps"]["outliers"]) == outliers
    assert 0.5 < report["gps"]["sigma_m"] < 1.6
    correct = tmp_path / "correct.csv"
    given = geodetic_of(truth.metadata.extra["gps"], WORLD_ORIGIN)
    rows = zip(truth.metadata.image_names, given, strict=True)
    lines = [f"{name},{a:.10f},{b:.10f},{h:.5f}" for name, (a, b, h) in rows if name not in outliers]
    correct.write_text("\n".join(["name,lat,lon,height", *lines]) + "\n")
    shutil.copytree(tmp_path / "told/cache", tmp_path / "by-hand/cache")
    _, by_hand = reconstructed(tmp_path / "photos", tmp_path / "by-hand", "--resume", "--gps", str(correct))
    assert by_hand["gps"]["outliers"] == []
    with_outliers = world_error_m(tmp_path / "told", truth)
    assert with_outliers <= 1.05 * world_error_m(tmp_path / "by-hand", truth)
    assert with_outliers < 1.0


def world_error_m(out: Path, truth: Problem) -> float:
    """RMS distance of the centres of a georeferenced model from the true ones."""
    found = sfmcpp.read(out / "model")
    origin = np.array(list(strict_json(out / "report.json")["gps"]["origin"].values()))
    centres = east_north_up(geodetic_of(found.cameras[:, :, 3], origin), WORLD_ORIGIN)
    rows = [truth.metadata.image_names.index(name) for name in found.metadata.image_names]
    true: FloatArray = truth.cameras[rows, :, 3]
    return float(np.sqrt(((centres - true) ** 2).sum(axis=1).mean()))
