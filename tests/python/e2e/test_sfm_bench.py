"""`bench/sfm/compare.py`: two sides on one set of photos, played by programs whose results are known."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import sfmcpp
from bench_programs import BENCH, as_module
from sfmcpp.geometry.similarity import Similarity
from sfmcpp.sources.synthetic import circle_scene

AWAY = Similarity(0.25, np.eye(3)[[1, 2, 0]], np.array([3.0, 4.0, 5.0]))
SIDE = """
import json, pathlib, shutil, sys
job = json.loads(pathlib.Path(sys.argv[1]).read_text())
assert job["threads"] == 1 and len(job["names"]) == 8
folder = pathlib.Path(job["folder"])
shutil.copytree({model!r}, folder / "model", dirs_exist_ok=True)
seconds = dict(features={seconds}, matching=1.0, mapping=1.0)
(folder / "run.json").write_text(json.dumps(dict(models=[7, 2], seconds=seconds, matrix=job["matrix"])))
"""


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    """The program as a module."""
    pytest.importorskip("PIL")
    yield from as_module(monkeypatch, BENCH / "sfm", "compare")


def scene(count: int = 8) -> sfmcpp.Problem:
    problem = circle_scene(8, 40, camera_model="perspective", seed=3)
    problem.metadata.image_names = [f"{i}.jpg" for i in range(8)]
    return problem


def photo_set(folder: Path) -> Path:
    """Eight files that nobody opens, a matrix K, and true poses."""
    (folder / "images").mkdir(parents=True)
    for name in scene().metadata.image_names:
        (folder / "images" / name).write_bytes(b"")
    (folder / "images/K.txt").write_text("900 0 320\n0 900 240\n0 0 1\n")
    sfmcpp.write(scene(), folder / "truth")
    return folder


def one_camera_off(folder: Path) -> Path:
    """A model in another world whose camera 3 is half a metre from where it was."""
    problem = scene()
    problem.cameras[3, :, 3] += [0.3, 0.4, 0.0]
    problem.cameras[:] = AWAY.apply_to_poses(problem.cameras)
    problem.points[:] = AWAY.apply(problem.points)
    sfmcpp.write(problem, folder)
    return folder


def test_both_sides_are_run_measured_and_set_beside_each_other(
    bench: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import running

    models = {"colmap": one_camera_off(tmp_path / "off"), "sfmcpp": tmp_path / "photos/truth"}
    photos = photo_set(tmp_path / "photos")
    for side, seconds in (("colmap", 8.0), ("sfmcpp", 2.0)):
        (tmp_path / f"fake_{side}.py").write_text(SIDE.format(model=str(models[side]), seconds=seconds))
    monkeypatch.setattr(running, "SIDES", {side: f"fake_{side}" for side in models})
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setattr(bench, "limit_processors", lambda threads: None)
    out = tmp_path / "out"
    bench.main([str(photos), "--out", str(out), "--threads", "1"])
    theirs, ours = json.loads((out / "results.json").read_text())["rows"]
    assert (theirs["side"], ours["side"], ours["role"]) == ("colmap", "sfmcpp", "held out")
    assert (theirs["seconds_total"], ours["seconds_total"]) == (10.0, 4.0)
    assert ours["run"]["matrix"] == [[900, 0, 320], [0, 900, 240], [0, 0, 1]]
    assert ours["truth"]["centre_error"]["max"] < 1e-9
    assert 0.2 < theirs["truth"]["centre_error"]["max"] < 0.5
    assert theirs["reprojection_px"]["mean"] > 1
    table = (out / "table.md").read_text()
    assert "| 0.40 " in table
    assert "photos, colmap: 2 models of [7, 2] images" in table
    bench.main([str(photos), "--out", str(out), "--threads", "1", "--reuse", "colmap"])
    assert "colmap: measured in an earlier run" in (out / "table.md").read_text()


def test_a_side_that_fails_is_told_and_the_other_still_measured(
    bench: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import running

    photos = photo_set(tmp_path / "photos")
    (tmp_path / "fake_bad.py").write_text("raise SystemExit('no such luck')")
    (tmp_path / "fake_good.py").write_text(SIDE.format(model=str(photos / "truth"), seconds=1.0))
    monkeypatch.setattr(running, "SIDES", {"colmap": "fake_bad", "sfmcpp": "fake_good"})
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setattr(bench, "limit_processors", lambda threads: None)
    bench.main([str(photos), "--out", str(tmp_path / "out"), "--threads", "1", "--camera", "auto"])
    table = (tmp_path / "out/table.md").read_text()
    assert "photos-auto, colmap: FAILED: no such luck" in table
    assert "| 8 / 8 " in table
    assert json.loads((tmp_path / "out/sfmcpp/photos-auto.json").read_text())["run"]["matrix"] is None


def test_what_is_no_set_is_refused(
    bench: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for arguments, told in (
        (["nosuch"], "'nosuch' is no folder and no name of a set: fountain_p11"),
        ([str(tmp_path)], "no photos in"),
        ([str(tmp_path), "--only", "theia"], "no side theia"),
    ):
        with pytest.raises(SystemExit) as caught:
            bench.main(arguments)
        assert caught.value.code == 2
        assert told in capsys.readouterr().err


def test_positions_in_exif_become_metres_east_north_and_up(bench: ModuleType, tmp_path: Path) -> None:
    from PIL import Image

    import exif_positions

    places = {
        "a.jpg": (46.5, 91.25, 200.0),
        "b.jpg": (46.501, 91.25, 203.0),
        "c.jpg": (46.5, 91.251, 200.0),
    }
    for name, (north, west, height) in places.items():
        exif = Image.Exif()
        exif.get_ifd(exif_positions.GPS).update(
            {1: "N", 2: degrees(north), 3: "W", 4: degrees(west), 5: b"\x00", 6: height}
        )
        Image.new("RGB", (8, 8)).save(tmp_path / name, exif=exif)
    found = exif_positions.local_positions(tmp_path, sorted(places))
    # Radii of the ellipsoid of WGS84 at 46.5° north: 6,369,061 m along the meridian, 6,389,400 m across it.
    meridian = np.deg2rad(0.001) * (6369061 + 200)
    parallel = np.deg2rad(0.001) * (6389400 + 200) * np.cos(np.deg2rad(46.5))
    np.testing.assert_allclose(found["a.jpg"], 0, atol=1e-9)
    np.testing.assert_allclose(found["b.jpg"], [0, meridian, 3], atol=0.02)
    np.testing.assert_allclose(found["c.jpg"], [-parallel, 0, 0], atol=0.02)


def degrees(value: float) -> tuple[float, float, float]:
    """Degrees, minutes, seconds."""
    whole = int(value)
    minutes = int((value - whole) * 60)
    return float(whole), float(minutes), round(((value - whole) * 60 - minutes) * 60, 6)
