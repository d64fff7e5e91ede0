"""`sfmcpp reconstruct`: what is asked for reaches the reconstruction, and its end is told as promised."""

from __future__ import annotations

import io
import os
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sfmcpp
import sfmcpp.cli.reconstruct_run
from cli_helpers import strict_json
from sfm_runs import NO_MATCH, finished_run, gps_outcome, run_without_model
from sfmcpp.cli.console import ExitCode
from sfmcpp.cli.display import shown_stages
from sfmcpp.cli.main import main
from sfmcpp.errors import DatasetError
from sfmcpp.sensors import geodetic_of
from sfmcpp.sfm import SfmRun

FILES = ["model", "points.ply", "report.html", "report.json", "timings.json", "transforms.json", "view.html"]
Ended = Callable[..., SfmRun]


@pytest.fixture
def photos(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of photos in the folder where commands run; K.txt, gps.csv and masks beside it."""
    monkeypatch.chdir(tmp_path)
    for folder in ("photos", "masks"):
        (tmp_path / folder).mkdir()
    for name in ("K.txt", "gps.csv"):
        (tmp_path / name).write_text("1")
    return tmp_path / "photos"


def ending(monkeypatch: pytest.MonkeyPatch, run: SfmRun | Ended) -> dict[str, Any]:
    """Let every reconstruction end with a run; what it was asked for."""
    asked: dict[str, Any] = {}

    def reconstruct(source: Path, **options: Any) -> SfmRun:
        asked.update(options, source=source)
        return run if isinstance(run, SfmRun) else run(**options)

    monkeypatch.setattr(sfmcpp.cli.reconstruct_run, "reconstruct", reconstruct)
    return asked


def complete_run(**changes: Any) -> SfmRun:
    run = finished_run(**changes)
    del run.images["broken.jpg"]
    return run


def test_the_defaults_ask_for_an_automatic_reconstruction(
    photos: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = ending(monkeypatch, complete_run())
    assert main(["reconstruct", "photos", "-o", "new/out"]) == 0
    assert callable(asked.pop("progress"))
    assert asked == {
        "source": Path("photos"),
        "method": "incremental",
        "camera": "auto",
        "camera_model": "auto",
        "shared_camera": "auto",
        "matcher": "auto",
        "masks": None,
        "gps": "auto",
        "subpixel": True,
        "seed": 0,
        "threads": None,
        "cache": Path("new/out/cache"),
    }
    assert sorted(path.name for path in Path("new/out").iterdir()) == FILES
    shown = capsys.readouterr()
    assert "images          8 of 8 in the model" in shown.out
    assert f"written         {Path('new/out/view.html')}" in shown.out
    assert shown.err == ""


def test_every_option_reaches_the_reconstruction(photos: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = ending(monkeypatch, complete_run())
    words = "--method batch --camera K.txt --camera-model radial --shared-camera folder --matcher spatial"
    words += " --masks masks --gps gps.csv --no-subpixel --seed 7 --threads 3 --resume --quiet"
    assert main(["reconstruct", "photos", "-o", "out", *words.split()]) == 0
    expected = {
        "method": "batch",
        "camera": Path("K.txt"),
        "camera_model": "radial",
        "shared_camera": "folder",
        "matcher": "spatial",
        "masks": Path("masks"),
        "gps": Path("gps.csv"),
        "seed": 7,
        "threads": 3,
    }
    assert {name: asked[name] for name in expected} == expected


def test_positions_are_written_where_gps_says(photos: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = complete_run()
    run.gps = gps_outcome(run, 3)
    ending(monkeypatch, run)
    assert main(["reconstruct", "photos", "-o", "out", "--positions-out", "p.geojson"]) == 0
    assert run.model is not None
    told = strict_json(Path("p.geojson"))["features"]
    assert [feature["properties"]["name"] for feature in told] == list(run.model.image_names)
    places = np.array([feature["geometry"]["coordinates"] for feature in told])[:, [1, 0, 2]]
    np.testing.assert_allclose(places, geodetic_of(run.model.poses[:, :, 3], run.gps.origin))
    assert sfmcpp.read("out/model").metadata.extra["origin_geodetic"].tolist() == run.gps.origin.tolist()


def test_positions_may_lie_in_the_folder_that_is_made(photos: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = complete_run()
    run.gps = gps_outcome(run, 3)
    ending(monkeypatch, run)
    assert main(["reconstruct", "photos", "-o", "new/out", "--positions-out", "new/out/p.csv"]) == 0
    assert run.model is not None
    assert len(Path("new/out/p.csv").read_text().splitlines()) == 1 + len(run.model.image_names)


def test_where_positions_are_of_no_use_the_model_is_written_without(
    photos: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    run = complete_run()
    run.gps_failure = "gps: 4 images of the model have a position, 5 are needed"
    ending(monkeypatch, run)
    words = "reconstruct photos -o out --gps exif --positions-out p.csv --quiet"
    assert main(words.split()) == 2
    assert capsys.readouterr().err == (
        "sfmcpp: error: --gps: 4 images of the model have a position, 5 are needed; "
        "out has the model, without positions\n"
    )
    assert sfmcpp.read("out/model").num_cameras == run.num_registered
    assert not Path("p.csv").exists()  # it would be in no world, and no metres


@pytest.mark.parametrize(("text", "value"), [("exif", "exif"), ("auto", "auto"), ("1234.5", 1234.5)])
def test_a_camera_is_a_word_or_a_focal_length(
    photos: Path, monkeypatch: pytest.MonkeyPatch, text: str, value: object
) -> None:
    asked = ending(monkeypatch, complete_run())
    assert main(["reconstruct", "photos", "-o", "out", "--camera", text]) == 0
    assert asked["camera"] == value


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("--camera absent.txt", "'absent.txt': must be auto, exif, a focal length in pixels or a file"),
        ("--camera -5", "'-5': a focal length must be positive"),
        ("--camera nan", "'nan': a focal length must be positive"),
        ("--gps absent.csv", "'absent.csv': must be auto, exif, none or a file"),
        ("--positions-out p.kml", "p.kml: the name of a file of positions must end in .csv, .geojson"),
        ("--positions-out none/p.csv", "the folder 'none' does not exist"),
        ("--masks absent", "'absent': is no folder"),
        ("--method magic", "'magic' is unknown; choose one of incremental, batch"),
        ("--matcher best", "'best' is unknown; choose one of auto, exhaustive, sequential, spatial"),
        ("--shared-camera two", "'two' is unknown; choose one of auto, one, folder, each"),
        ("--camera-model fisheye", "'fisheye' is unknown; choose one of auto, simple-pinhole"),
        ("--seed -1", "'--seed'"),
        ("-o K.txt", "K.txt: is a file, a folder is wanted"),
        ("-o -", "-: nothing is written to the standard output, a folder is wanted"),
    ],
)
def test_bad_usage_is_one_line_and_runs_nothing(
    photos: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], words: str, told: str
) -> None:
    asked = ending(monkeypatch, complete_run())
    assert main(["reconstruct", "photos", "-o", "out", *words.split()]) == 2
    shown = capsys.readouterr()
    assert told in shown.err
    assert (shown.out, len(shown.err.splitlines())) == ("", 1)
    assert asked == {}
    assert not Path("out").exists()


@pytest.mark.parametrize(
    ("name", "told"),
    [("model", "is a file, a folder is wanted"), ("report.json/", "is a directory, a file is wanted")],
)
def test_results_whose_names_are_taken_are_refused_before_the_work(
    photos: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], name: str, told: str
) -> None:
    taken = Path("out") / name
    (taken if name.endswith("/") else taken.parent).mkdir(parents=True)
    if not name.endswith("/"):
        taken.write_text("")
    asked = ending(monkeypatch, complete_run())
    assert main(["reconstruct", "photos", "-o", "out"]) == 2
    assert f"{taken}: {told}" in capsys.readouterr().err
    assert asked == {}


@pytest.mark.parametrize("resume", [False, True])
def test_resume_keeps_what_an_earlier_run_has_computed(
    photos: Path, monkeypatch: pytest.MonkeyPatch, resume: bool
) -> None:
    ending(monkeypatch, complete_run())
    kept, other = Path("out/cache/features") / ("0a" * 20), Path("out/cache/features/mine.txt")
    kept.parent.mkdir(parents=True)
    kept.touch()
    other.touch()
    assert main(["reconstruct", "photos", "-o", "out", *["--resume"] * resume]) == 0
    assert kept.exists() == resume
    assert other.exists()


def test_a_missing_library_is_told_with_what_installs_it(
    photos: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def lacking(**options: Any) -> SfmRun:
        raise ModuleNotFoundError("photos need cv2: pip install 'sfmcpp[vision]'", name="cv2")

    ending(monkeypatch, lacking)
    assert main(["reconstruct", "photos", "-o", "out"]) == 2
    assert capsys.readouterr().err == "sfmcpp: error: photos need cv2: pip install 'sfmcpp[vision]'\n"


def test_a_bad_input_leaves_no_folder(
    photos: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refuse(**options: Any) -> SfmRun:
        raise DatasetError("photos", "holds no image")

    ending(monkeypatch, refuse)
    assert main(["reconstruct", "photos", "-o", "out/deep"]) == 2
    assert capsys.readouterr().err == "sfmcpp: error: photos: holds no image\n"
    assert not Path("out").exists()


def test_without_a_model_there_is_no_result_and_the_reasons_are_told(
    photos: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    ending(monkeypatch, run_without_model())
    assert main(["reconstruct", "photos", "-o", "out"]) == 3
    shown = capsys.readouterr()
    assert shown.out == ""
    assert shown.err.startswith("sfmcpp: error: photos: no model: none of 4 images could be registered (")
    assert NO_MATCH in shown.err
    assert len(shown.err.splitlines()) == 1
    assert sorted(path.name for path in Path("out").iterdir()) == [
        "report.html",
        "report.json",
        "timings.json",
    ]


def test_without_a_model_its_warnings_are_told_too(
    photos: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    run = run_without_model()
    run.warnings = ["2 photos are of kinds not read here", "no model: the camera only turned"]
    ending(monkeypatch, run)
    assert main(["reconstruct", "photos", "-o", "out"]) == 3
    warning, error = capsys.readouterr().err.splitlines()
    assert warning == "sfmcpp: warning: 2 photos are of kinds not read here"
    assert error.endswith("; the camera only turned; see out/report.html")
    assert main(["reconstruct", "photos", "-o", "out", "--quiet"]) == 3
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_a_run_without_a_model_leaves_that_of_an_earlier_one_with_its_report(
    photos: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    ending(monkeypatch, complete_run())
    assert main(["reconstruct", "photos", "-o", "out"]) == 0
    before = {path: path.read_bytes() for path in Path("out").rglob("*") if path.is_file()}
    ending(monkeypatch, run_without_model())
    assert main(["reconstruct", "photos", "-o", "out"]) == 3
    assert capsys.readouterr().err.endswith("; out keeps the model of an earlier run\n")
    assert {path: path.read_bytes() for path in Path("out").rglob("*") if path.is_file()} == before


@pytest.mark.parametrize("quiet", [False, True])
def test_a_partial_model_is_named_as_such(
    photos: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], quiet: bool
) -> None:
    ending(monkeypatch, finished_run(left_out=(2,)))
    assert main(["reconstruct", "photos", "-o", "out", *["--quiet"] * quiet]) == 0
    shown = capsys.readouterr()
    if quiet:
        assert (shown.out, shown.err) == ("", "")
    else:
        assert shown.err.startswith("sfmcpp: warning: partial model: 7 of 9 images are in the model (")
        assert "set/photo 0002.jpg" in shown.err
    assert strict_json(Path("out/report.json"))["counts"]["registered"] == 7


def test_ctrl_c_asks_the_reconstruction_to_end_and_keeps_what_there_is(
    photos: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(progress: Callable[[str, int, int], bool], **options: Any) -> SfmRun:
        assert progress("features", 1, 8) is False
        os.kill(os.getpid(), signal.SIGINT)
        assert progress("features", 2, 8) is True
        return complete_run(interrupted=True)

    ending(monkeypatch, interrupted)
    assert main(["reconstruct", "photos", "-o", "out"]) == 130
    shown = capsys.readouterr()
    assert (
        shown.err
        == "sfmcpp: interrupted with 8 of 8 images in the model, written to out; continue with --resume\n"
    )
    assert sorted(path.name for path in Path("out").iterdir()) == FILES
    assert strict_json(Path("out/report.json"))["interrupted"] is True


def test_an_interruption_before_there_is_a_model_is_told(
    photos: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    run = run_without_model()
    run.interrupted = True
    ending(monkeypatch, run)
    assert main(["reconstruct", "photos", "-o", "out"]) == 130
    assert "interrupted before a model was found" in capsys.readouterr().err


def test_an_interruption_of_the_matching_says_how_to_go_on(
    photos: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(**options: Any) -> SfmRun:
        raise KeyboardInterrupt

    ending(monkeypatch, interrupted)
    assert main(["reconstruct", "photos", "-o", "out"]) == 130
    assert "out keeps what was computed: continue with --resume" in capsys.readouterr().err


def test_the_second_ctrl_c_ends_at_once(photos: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def endless(**options: Any) -> SfmRun:
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.6)
        os.kill(os.getpid(), signal.SIGINT)
        raise AssertionError("still running")

    ending(monkeypatch, endless)
    assert main(["reconstruct", "photos", "-o", "out"]) == ExitCode.INTERRUPTED
    assert not Path("out").exists()


def test_view_opens_the_page_of_the_model(
    photos: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    opened: list[str] = []

    def open_page(uri: str) -> bool:
        opened.append(uri)
        return False

    monkeypatch.setattr("webbrowser.open", open_page)
    ending(monkeypatch, complete_run())
    assert main(["reconstruct", "photos", "-o", "out", "--view"]) == 0
    assert opened == [(photos.parent / "out/view.html").as_uri()]
    assert "no browser could be opened; open out/view.html to see the model" in capsys.readouterr().err


class Terminal(io.StringIO):
    """Text that a terminal would show."""

    def isatty(self) -> bool:
        return True


def test_each_stage_is_shown_with_what_is_done_of_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(sys, "stderr", Terminal())
    with shown_stages(quiet=False) as show:
        show("features", 0, 0)
        show("features", 3, 11)
        show("features", 11, 11)
        show("matching", 20, 55)
    text = sys.stderr.getvalue()  # type: ignore[attr-defined]
    for part in ("features", "11/11", "matching", "20/55"):
        assert part in text
    monkeypatch.setattr(sys, "stderr", Terminal())
    with shown_stages(quiet=True) as show:
        show("features", 3, 11)
    assert sys.stderr.getvalue() == ""  # type: ignore[attr-defined]
