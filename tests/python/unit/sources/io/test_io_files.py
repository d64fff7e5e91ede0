"""Compression, atomic writing, the choice of a format, and what is no file at all."""

from __future__ import annotations

import bz2
import gzip
import lzma
import os
import time
from pathlib import Path

import numpy as np
import pytest

from io_helpers import assert_same_problem, random_problem, refusal
from sfmcpp import DatasetError, InvalidArgument, Problem
from sfmcpp.sources.io import colmap, convert, formats, read, write
from sfmcpp.sources.io.atomic import atomic_files, atomic_folder
from sfmcpp.sources.io.conversion_notes import amounts_in, changed_on_writing

COMPRESS = {".bz2": bz2.compress, ".gz": gzip.compress, ".xz": lzma.compress}
CONTENT = b"1 1 1\n0 0 1 2\n" + b"1\n" * 12


@pytest.fixture
def problem() -> Problem:
    """Small problem that every format can hold."""
    return random_problem(2, "bal", {"f": 900}, least=2)


@pytest.mark.parametrize("suffix", COMPRESS)
def test_compressed_streams_may_follow_each_other(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"x.txt{suffix}"
    path.write_bytes(COMPRESS[suffix](CONTENT[:9]) + COMPRESS[suffix](CONTENT[9:]))
    assert read(path).num_observations == 1


@pytest.mark.parametrize("suffix", COMPRESS)
@pytest.mark.parametrize(
    ("damage", "reason"),
    [
        (lambda data: data[:-1], "truncated: the {} data end before their end mark"),
        (lambda data: data + b"more", "garbage after the {} data|truncated"),
        (lambda data: b"no such thing", "not valid {} data"),
        (lambda data: data[:20] + bytes([data[20] ^ 255]) + data[21:], "not valid {} data|truncated"),
        (lambda data: b"", "the file is empty"),
    ],
)
def test_damaged_compression_is_refused(tmp_path: Path, suffix: str, damage: object, reason: str) -> None:
    path = tmp_path / f"x.txt{suffix}"
    path.write_bytes(damage(COMPRESS[suffix](CONTENT)))  # type: ignore[operator]
    error = refusal(path)
    with pytest.raises(DatasetError, match=reason.format(suffix)):
        raise error


@pytest.mark.parametrize("suffix", [".bz2", ".xz"])
def test_decompression_bombs_are_refused(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"x.txt{suffix}"
    path.write_bytes(COMPRESS[suffix](bytes(80 << 20)))
    assert "expands to more than" in str(refusal(path))


@pytest.mark.parametrize("name", ["x.txt.gz", "x.txt.bz2", "x.txt.xz", "x.npz"])
def test_the_same_problem_gives_the_same_bytes_at_another_time(
    tmp_path: Path, problem: Problem, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    for folder, now in (("one", 1e9), ("two", 1.5e9)):
        monkeypatch.setattr(time, "time", lambda now=now: now)
        (tmp_path / folder).mkdir()
        write(problem, tmp_path / folder / name)
    assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()


def test_failure_leaves_old_files_and_no_others(tmp_path: Path) -> None:
    old, new = tmp_path / "old", tmp_path / "new"
    old.write_text("kept")
    interruption = KeyboardInterrupt()

    def write_half() -> None:
        with atomic_files(old, new) as files:
            files[0].write(b"half")
            raise interruption

    with pytest.raises(KeyboardInterrupt):
        write_half()
    assert [path.name for path in tmp_path.iterdir()] == ["old"]
    assert old.read_text() == "kept"


def test_nothing_appears_before_the_end(tmp_path: Path) -> None:
    with atomic_files(tmp_path / "a", tmp_path / "b") as files:
        for file in files:
            file.write(b"content")
        assert not (tmp_path / "a").exists()
    assert [(tmp_path / name).read_bytes() for name in "ab"] == [b"content"] * 2
    assert len(list(tmp_path.iterdir())) == 2


def test_a_new_folder_is_removed_on_failure(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="stop"), atomic_folder(tmp_path / "new", ["a"]):
        raise ValueError("stop")
    assert list(tmp_path.iterdir()) == []


def test_links_are_followed_and_modes_follow_the_mask(tmp_path: Path, problem: Problem) -> None:
    (tmp_path / "link.txt").symlink_to(tmp_path / "target.txt")
    mask = os.umask(0o027)
    try:
        write(problem, tmp_path / "link.txt")
    finally:
        os.umask(mask)
    assert (tmp_path / "link.txt").is_symlink()
    assert (tmp_path / "target.txt").stat().st_mode & 0o777 == 0o640


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("folder.txt", "is a directory, a file is wanted"),
        ("missing/x.txt", "does not exist"),
        ("pipe.txt", "is not a regular file"),
        ("plain/x.txt", "does not exist|not a directory"),
        ("x" * 300 + ".txt", "file name too long"),
        ("x.unknown", "its name tells no format: must end in"),
        ("nul\0.txt", "a path cannot hold a NUL"),
    ],
)
def test_impossible_targets_are_refused(tmp_path: Path, problem: Problem, name: str, reason: str) -> None:
    (tmp_path / "folder.txt").mkdir()
    (tmp_path / "plain").write_text("")
    os.mkfifo(tmp_path / "pipe.txt")
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(DatasetError, match=reason):
        write(problem, tmp_path / name)
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("way", ["0", "sparse/0", "colmap/sparse/0"])
def test_who_gives_the_folder_of_a_project_is_told_where_its_model_is(
    way: str, tmp_path: Path, problem: Problem
) -> None:
    for folder in ("images", "sparse"):
        (tmp_path / folder).mkdir()
    (tmp_path / way).parent.mkdir(parents=True, exist_ok=True)
    write(problem, tmp_path / way)
    with pytest.raises(DatasetError, match=f"without a COLMAP model: .*; {tmp_path / way} is one$"):
        read(tmp_path)


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("missing.txt", "no such file or directory"),
        ("folder.txt", "is a directory, a file is wanted"),
        ("folder", "is a directory without a COLMAP model: it lacks cameras.bin"),
        ("pipe.txt", "is not a regular file"),
        ("x.unknown", "its name tells no format"),
        ("x.ply", "format ply can be written but not read"),
        ("images.txt", "is one file of a COLMAP model: give the folder that it is in"),
        ("points3D.bin", "is one file of a COLMAP model"),
        ("x" * 300, "file name too long"),
        ("nul\0.txt", "a path cannot hold a NUL"),
    ],
)
def test_impossible_sources_are_refused(tmp_path: Path, name: str, reason: str) -> None:
    for folder in ("folder", "folder.txt"):
        (tmp_path / folder).mkdir()
    for file in ("x.unknown", "x.ply", "images.txt", "points3D.bin"):
        (tmp_path / file).write_text("content")
    os.mkfifo(tmp_path / "pipe.txt")
    with pytest.raises(DatasetError, match=reason):
        read(tmp_path / name)


def test_numbers_that_could_not_be_written_again_are_refused(tmp_path: Path, problem: Problem) -> None:
    write(problem, tmp_path / "model", format="colmap-text")
    points = tmp_path / "model" / "points3D.txt"
    lines = points.read_text().splitlines()
    words = lines[-1].split()
    points.write_text("\n".join([*lines[:-1], " ".join([words[0], "1e200", *words[2:]])]) + "\n")
    with pytest.raises(DatasetError, match=r"model: points\[.*, 0\] is 1e\+200: must be finite, at most"):
        read(tmp_path / "model")


@pytest.mark.parametrize("name", ["points", "pixels", "fixed_cameras", "camera_index"])
@pytest.mark.parametrize("target", ["x.npz", "x", "x.txt"])
def test_a_problem_whose_fields_do_not_fit_is_not_written(
    tmp_path: Path, problem: Problem, name: str, target: str
) -> None:
    setattr(problem, name, getattr(problem, name)[:-1].T[None])
    with pytest.raises(InvalidArgument, match=f"{name}: shape"):
        write(problem, tmp_path / target)
    assert not list(tmp_path.iterdir())


def test_failures_of_the_system_name_the_file(
    tmp_path: Path, problem: Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    write(problem, tmp_path / "x.txt")

    def denied(self: Path, *_: object, **__: object) -> bytes:
        raise PermissionError(13, "Permission denied", str(self))

    monkeypatch.setattr(Path, "open", denied)
    with pytest.raises(DatasetError, match=r"x\.txt: permission denied"):
        read(tmp_path / "x.txt")


def test_format_can_be_named_where_the_name_does_not_tell(tmp_path: Path, problem: Problem) -> None:
    write(problem, tmp_path / "data", format="bal")
    assert (tmp_path / "data").read_bytes().startswith(b"%d " % problem.num_cameras)
    assert_same_problem(read(tmp_path / "data", format="bal"), problem)
    with pytest.raises(InvalidArgument, match="format = 'xml': must be one of sba, bal"):
        read(tmp_path / "data", format="xml")


@pytest.mark.parametrize("suffix", COMPRESS)
def test_what_is_written_under_the_name_of_a_compressed_file_is_one(
    tmp_path: Path, problem: Problem, suffix: str
) -> None:
    for chosen in formats():
        target = tmp_path / f"{chosen.name}{suffix}"
        if chosen.writer is None or not chosen.suffixes:
            continue
        if chosen.name == "bal":
            write(problem, target, format=chosen.name)
            assert_same_problem(read(target, format=chosen.name), problem)
        else:
            with pytest.raises(DatasetError, match=f"format {chosen.name} is not written compressed"):
                write(problem, target, format=chosen.name)
            assert not target.exists()


def test_bal_is_recognised_under_a_name_like_sbas(tmp_path: Path) -> None:
    (tmp_path / "webcams.txt").write_bytes(CONTENT)
    assert read(tmp_path / "webcams.txt").metadata.source_format == "bal"


def test_names_choose_formats_whatever_their_case(tmp_path: Path, problem: Problem) -> None:
    for name, source_format in {"A.TXT": "bal", "b.OUT": "bundler", "c.Txt.GZ": "bal"}.items():
        write(problem, tmp_path / name)
        assert read(tmp_path / name).metadata.source_format == source_format


def test_every_readable_and_writable_format_passes_problems_on(tmp_path: Path, problem: Problem) -> None:
    problem.pixels[:] = np.round(np.random.default_rng(1).uniform(-300, 300, problem.pixels.shape), 3)
    write(problem, tmp_path / "start.txt")
    both = [f.name for f in formats() if f.readable and f.writable]
    both.remove("transforms")  # cameras alone
    both.remove("nvm")  # without distortion
    named = "alicevision bal bundler colmap-binary colmap-text g2o npz openmvg parts sba"
    assert sorted(both) == named.split()
    source, source_format = tmp_path / "start.txt", "bal"
    for name in [*both, "bal"]:
        target = tmp_path / f"by_{name}"
        convert(source, target, source_format=source_format, target_format=name)
        source, source_format = target, name
    # COLMAP counts pixels from the corner: half the width is added and taken away. AliceVision has focal
    # lengths in millimetres.
    again = read(source, format="bal")
    assert_same_problem(again, problem, pixels_atol=1e-12, intrinsics_rtol=4e-16)


@pytest.mark.parametrize("num_points", [0, 2])
def test_a_problem_without_cameras_is_read_as_it_was_written_or_refused(
    tmp_path: Path, num_points: int
) -> None:
    none, pixels = np.empty(0, np.int32), np.empty((0, 2))
    problem = Problem(
        "perspective", np.empty((0, 3, 4)), np.empty((0, 12)), np.zeros((num_points, 3)), none, none, pixels
    )
    for chosen in formats():
        target = tmp_path / chosen.name
        if chosen.reader is None or chosen.writer is None or chosen.name == "sba":
            continue
        if chosen.name == "g2o" and not num_points:
            with pytest.raises(DatasetError, match="without cameras and without points"):
                write(problem, target, format=chosen.name)
            assert not target.exists()
        else:
            write(problem, target, format=chosen.name)
            found = read(target, format=chosen.name)
            assert found.num_cameras == found.num_observations == 0
            assert found.num_points == (0 if chosen.name == "transforms" else num_points)


def test_what_formats_lack_has_a_name_that_is_known() -> None:
    known = amounts_in(random_problem(0, "bal", {"f": 900}))
    assert {name for format in formats() for name in format.lacks} <= set(known)


def test_names_that_colmap_cannot_read_from_text_are_told(problem: Problem, tmp_path: Path) -> None:
    for names, format, told in (
        (["b.jpg", "sub dir/a.jpg"], colmap.TEXT, True),
        (["b.jpg", "sub dir/a.jpg"], colmap.BINARY, False),
        (["b.jpg", "a.jpg"], colmap.TEXT, False),
    ):
        problem.metadata.image_names = names
        notes = list(changed_on_writing(problem, tmp_path, format))
        assert any("names of images with spaces" in note for note in notes) == told


@pytest.mark.parametrize("name", ["g2o", "nvm"])
def test_pixels_that_a_lens_takes_no_ray_to_are_told(name: str, tmp_path: Path) -> None:
    (format,) = (known for known in formats() if known.name == name)
    problem = random_problem(0, "bal", {"f": 900})
    problem.pixels[:] = 100.0
    problem.pixels[:3] = 700.0
    problem.intrinsics[:] = 900.0, -0.3, 0.0  # takes rays no farther than 632 px from the middle
    told = [note for note in changed_on_writing(problem, tmp_path, format) if "no inverse" in note]
    assert [note.partition(" are ")[0] for note in told] == [f"3 of {problem.num_observations} observations"]
    problem.pixels[:] = 100.0
    assert not any("no inverse" in note for note in changed_on_writing(problem, tmp_path, format))
