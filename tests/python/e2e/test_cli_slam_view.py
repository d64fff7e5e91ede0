"""What `sfmcpp slam` shows of a run: a page with --view, which changes no result, and a line of progress."""

from __future__ import annotations

import io
import re
import signal
import subprocess
import sys
from pathlib import Path
from urllib.request import urlopen

import numpy as np
import pytest
from rich.console import Console

import sfmcpp
from cli_helpers import COMMAND, TIMEOUT_S, is_one_error_line, run
from sfmcpp import slam
from sfmcpp.cli import slam_run
from sfmcpp.sources.io.track_files import CameraTracks, write_tracks


@pytest.fixture
def drive(tmp_path: Path) -> Path:
    scene = sfmcpp.corridor_scene(30, 1800, length_m=15.0, seed=2)
    t_s = 0.1 * np.arange(scene.num_cameras)
    tracks = CameraTracks(t_s, scene.camera_index, scene.point_index, scene.pixels, scene.intrinsics[0])
    write_tracks(tracks, tmp_path / "drive.csv")
    return tmp_path / "drive.csv"


def test_the_page_stays_after_the_run_until_ctrl_c(drive: Path, tmp_path: Path) -> None:
    pytest.importorskip("viser", reason="viser is not installed: pip install 'sfmcpp[view]'")
    command = [*COMMAND, "slam", str(drive), "--view", "-o", str(tmp_path / "out")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        said = process.stderr.readline()
        match = re.fullmatch(r"sfmcpp: live map: (http://localhost:\d+)\n", said)
        assert match is not None, said
        assert process.stderr.readline() == "sfmcpp: the page stays open until Ctrl-C\n"
        with urlopen(match[1]) as answer:
            assert b"<html" in answer.read()
        process.send_signal(signal.SIGINT)
        output, complaints = process.communicate(timeout=TIMEOUT_S)
    assert (process.returncode, complaints) == (0, "")
    # Its results are those of a run that nobody watches, and nothing else is printed.
    assert run("slam", drive, "--quiet", "-o", tmp_path / "unseen").returncode == 0
    for name in ("trajectory.txt", "keyframes.txt", "points.ply"):
        assert (tmp_path / "out" / name).read_bytes() == (tmp_path / "unseen" / name).read_bytes()
    assert output.startswith("input           ")
    assert "viser" not in output


# Interrupts the command as soon as it has said until when the page stays.
QUICK_READER = """
import os, signal, sys
from sfmcpp.cli import slam_run
from sfmcpp.cli.main import main

said = slam_run.print_note

def tell(text):
    said(text)
    if text.endswith("until Ctrl-C"):
        os.kill(os.getpid(), signal.SIGINT)

slam_run.print_note = tell
sys.exit(main())
"""


def test_ctrl_c_ends_the_page_as_soon_as_it_is_offered(drive: Path, tmp_path: Path) -> None:
    pytest.importorskip("viser", reason="viser is not installed: pip install 'sfmcpp[view]'")
    command = [sys.executable, "-c", QUICK_READER, "slam", str(drive), "--view", "-o", str(tmp_path / "out")]
    result = subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT_S)
    assert (result.returncode, result.stderr.count("interrupted")) == (0, 0)
    assert result.stderr.endswith("sfmcpp: the page stays open until Ctrl-C\n")


def test_a_missing_viser_is_told_before_anything_is_read(drive: Path, tmp_path: Path) -> None:
    code = "import sys; sys.modules['viser'] = None; from sfmcpp.cli.main import main; sys.exit(main())"
    command = [sys.executable, "-c", code, "slam", str(drive), "--view", "-o", str(tmp_path / "out")]
    result = subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT_S)
    assert result.returncode == 2
    assert is_one_error_line(result)
    assert "view: needs viser: pip install 'sfmcpp[view]'" in result.stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("frames", [(0, 1, 2), (2, 0, 1, 2)])
def test_what_follows_the_last_frame_is_shown(
    frames: tuple[int, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    """It may take minutes; then the frames may come once more."""
    shown = io.StringIO()
    terminal = Console(file=shown, force_terminal=True, width=120)
    monkeypatch.setattr(slam_run, "progress_is_seen", lambda: True)
    monkeypatch.setattr(slam_run, "stderr_console", lambda: terminal)
    with slam_run._shown_progress(3, quiet=False) as show:
        for frame in frames:
            show(frame, slam.SlamResult())
    *_, last = shown.getvalue().split("frame 3/3")
    assert "the whole map is adjusted and checked" in last
    assert ("once more" in last) == (frames[0] == 2)
