"""Tracks files: what is written reads back to the bit, and a bad line is named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sfmcpp.errors import DatasetError
from sfmcpp.sources.io.track_files import CameraTracks, read_tracks, write_tracks

HEAD = "# sfmcpp tracks\n# intrinsics: f=700.5 aspect=1.01 cx=320 cy=240.25 skew=0.5\nt_s,frame,track,u,v\n"


def write(folder: Path, text: str) -> Path:
    path = folder / "tracks.csv"
    path.write_text(text, encoding="utf-8", newline="")
    return path


def random_tracks() -> CameraTracks:
    """Five frames, the third and the last of them blind, at awkward numbers."""
    rng = np.random.default_rng(4)
    frames = np.array([0, 0, 1, 3, 3, 3], dtype=np.int32)
    tracks = np.array([4, 2, 4, 900_000, 2, 0], dtype=np.int32)
    t_s = 1317384506.4 + np.cumsum(rng.uniform(0.01, 0.2, 5))
    return CameraTracks(t_s, frames, tracks, rng.normal(0, 1e3, (6, 2)), rng.uniform(0.5, 900, 5))


def assert_same(one: CameraTracks, other: CameraTracks) -> None:
    for name in ("t_s", "frame_index", "track_index", "pixels", "intrinsics"):
        found = getattr(one, name)
        np.testing.assert_array_equal(found, getattr(other, name), strict=True)


@pytest.mark.parametrize("name", ["tracks.csv", "tracks.txt.gz", "tracks.xz", "tracks.bz2"])
def test_what_is_written_reads_back_to_the_bit(tmp_path: Path, name: str) -> None:
    tracks = random_tracks()
    write_tracks(tracks, tmp_path / name)
    assert_same(read_tracks(tmp_path / name), tracks)
    assert [path.name for path in tmp_path.iterdir()] == [name]


def test_the_described_format_is_read(tmp_path: Path) -> None:
    text = HEAD + "# a comment\n0.5,1,,,\n\n0.25, 0,17 ,320.25,2e2\r\n0.25,0,3,-1,.5\n"
    tracks = read_tracks(write(tmp_path, text))
    np.testing.assert_array_equal(tracks.intrinsics, [700.5, 1.01, 320, 240.25, 0.5])
    np.testing.assert_array_equal(tracks.t_s, [0.25, 0.5])
    assert tracks.frame_index.tolist() == [0, 0]
    assert tracks.track_index.tolist() == [17, 3]
    np.testing.assert_array_equal(tracks.pixels, [[320.25, 200], [-1, 0.5]])


def test_square_pixels_without_skew_need_not_be_told(tmp_path: Path) -> None:
    text = "# intrinsics: cy=3 f=1 cx=2\nt_s,frame,track,u,v\n0,0,0,1,2\n"
    np.testing.assert_array_equal(read_tracks(write(tmp_path, text)).intrinsics, [1, 1, 2, 3, 0])


def test_frames_that_see_nothing_are_frames(tmp_path: Path) -> None:
    tracks = read_tracks(write(tmp_path, HEAD + "0,0,,,\n1,1,,,\n"))
    assert (len(tracks.t_s), tracks.pixels.shape) == (2, (0, 2))


@pytest.mark.parametrize(
    ("rows", "line", "told"),
    [
        ("0,0,1,2,3\n0,0,2,5\n", 5, "neither t_s,frame,track,u,v nor"),
        ("0,0,1,2,3\n\n0,0,2,5,6,7\n", 6, "neither t_s,frame,track,u,v nor"),
        ("0,0,1,,3\n", 4, "neither t_s,frame,track,u,v nor"),
        ("0,,1,,\n", 4, "neither t_s,frame,track,u,v nor"),
        ("0,0,1,2 3,4\n", 4, "neither t_s,frame,track,u,v nor"),
        ("0,0,1,2,3\n0,0,2,x,3\n", 5, "'x' is not a finite number"),
        ("0,0,1,2,3\n0,0,2,nan,3\n", 5, "not a finite number"),
        ("0,0,1,2,3\n0,0,-2,1,3\n", 5, "track -2: must be an integer from 0"),
        ("0,0,1.5,2,3\n", 4, "track 1.5: must be an integer from 0"),
        ("0,-1,1,2,3\n", 4, "frame -1: must be an integer from 0"),
        ("0,0,1,2,3\n1,2,1,2,3\n", 5, "frame 1 is missing"),
        ("0,1,1,2,3\n", 4, "frame 0 is missing"),
        ("0,0,1,2,3\n0.5,0,2,2,3\n", 5, "frame 0 is at 0.5 s and at 0.0 s"),
        ("0,0,1,2,3\n2,1,,,\n2,2,1,2,3\n", 6, "frame 2 is at 2.0 s, the one before at 2.0 s"),
        ("0,0,1,2,3\n1,1,1,2,3\n0,0,1,5,6\n", 6, "frame 0 sees track 1 twice"),
    ],
)
def test_a_line_that_breaks_a_rule_is_named(tmp_path: Path, rows: str, line: int, told: str) -> None:
    path = write(tmp_path, HEAD + rows)
    with pytest.raises(DatasetError) as caught:
        read_tracks(path)
    assert (caught.value.path, caught.value.line) == (str(path), line)
    assert told in caught.value.reason


@pytest.mark.parametrize(
    ("text", "line", "told"),
    [
        ("t_s,frame,track,u,v\n0,0,0,1,2\n", 1, "lacks the line '# intrinsics:"),
        ("#\n# intrinsics: f=1 cx=2\nt_s,frame,track,u,v\n", 2, "the intrinsics lack cy"),
        ("# intrinsics: f=1 cx=2 cy=3 k1=0.1\nt_s,frame,track,u,v\n", 1, "'k1=0.1': must be NAME=NUMBER"),
        ("# intrinsics: f=1 cx=two cy=3\nt_s,frame,track,u,v\n", 1, "'cx=two': must be NAME=NUMBER"),
        ("# intrinsics: f=7_00 cx=2 cy=3\nt_s,frame,track,u,v\n", 1, "'f=7_00': must be NAME=NUMBER"),
        ("# intrinsics: f=inf cx=2 cy=3\nt_s,frame,track,u,v\n", 1, "'f=inf': must be NAME=NUMBER"),
        ("# intrinsics: f=-1 cx=2 cy=3\nt_s,frame,track,u,v\n", 1, "f=-1.0 aspect=1.0: must be positive"),
        (HEAD + "# intrinsics: f=1 cx=2 cy=3\n", 2, "given twice"),
        ("# intrinsics: f=1 cx=2 cy=3\n0,0,0,1,2\n", 1, "lacks the line of column names"),
    ],
)
def test_a_header_that_breaks_a_rule_is_named(tmp_path: Path, text: str, line: int, told: str) -> None:
    path = write(tmp_path, text)
    with pytest.raises(DatasetError) as caught:
        read_tracks(path)
    assert caught.value.line == line
    assert told in caught.value.reason


@pytest.mark.parametrize(("text", "told"), [(HEAD, "holds no frames"), ("", "the file is empty")])
def test_a_file_without_frames_is_refused(tmp_path: Path, text: str, told: str) -> None:
    with pytest.raises(DatasetError, match=told):
        read_tracks(write(tmp_path, text))


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match=r"absent\.csv: no such file"):
        read_tracks(tmp_path / "absent.csv")
