"""Files appear complete or not at all, whatever fails and whoever is killed."""

from __future__ import annotations

import contextlib
import fcntl
import os
import pathlib
import resource
import stat
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any

import pytest

import sfmcpp
from sfmcpp import DatasetError, Problem
from sfmcpp.sources.io import atomic
from sfmcpp.sources.io.atomic import atomic_files, remove_leftovers


def model(seed: int) -> Problem:
    return sfmcpp.circle_scene(4, 20, seed=seed)


def content_of(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if not path.name.startswith(".")}


def in_a_child(action: Callable[[], None]) -> None:
    """Do something in a process that ends where it calls `os._exit`, as if killed."""
    child = os.fork()
    if child == 0:
        try:
            action()
        finally:
            os._exit(1)
    os.waitpid(child, 0)


def test_a_model_that_cannot_be_replaced_as_a_whole_is_left_as_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sfmcpp.write(model(1), tmp_path / "model")
    (tmp_path / "model" / "notes").write_text("kept")
    before, replace = content_of(tmp_path / "model"), Path.replace

    def fail_for_points(self: Path, target: Path) -> Path:
        if target.name == "points3D.bin" and "new" in self.name:
            raise OSError(5, "Input/output error")
        return replace(self, target)

    monkeypatch.setattr(Path, "replace", fail_for_points)
    with pytest.raises(DatasetError, match=r"points3D\.bin: input/output error"):
        sfmcpp.write(model(2), tmp_path / "model")
    assert content_of(tmp_path / "model") == before
    assert len(list((tmp_path / "model").iterdir())) == 4


@pytest.mark.parametrize("moves", range(7))
def test_a_model_whose_writer_is_killed_is_never_made_of_two(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, moves: int
) -> None:
    for name, seed in (("old", 1), ("new", 2), ("model", 1)):
        sfmcpp.write(model(seed), tmp_path / name)
    replace, done = Path.replace, []

    def die_after_some(self: Path, target: Path) -> Path:
        if len(done) == moves:
            os._exit(9)
        done.append(target)
        return replace(self, target)

    monkeypatch.setattr(Path, "replace", die_after_some)
    in_a_child(lambda: sfmcpp.write(model(2), tmp_path / "model"))
    found = content_of(tmp_path / "model")
    old, new = content_of(tmp_path / "old"), content_of(tmp_path / "new")
    assert found in (old, new) or set(found) < set(old)
    if set(found) < set(old):
        with pytest.raises(DatasetError, match=r"lacks|no format"):
            sfmcpp.read(tmp_path / "model")


def test_what_a_killed_process_leaves_is_swept_and_what_another_writes_is_not(tmp_path: Path) -> None:
    def die() -> None:
        with atomic_files(tmp_path / "a") as (file,):
            file.write(b"half")
            os._exit(9)

    in_a_child(die)
    assert len(list(tmp_path.iterdir())) == 1
    remove_leftovers.cache_clear()
    with atomic_files(tmp_path / "b") as (file,):
        file.write(b"whole")
        remove_leftovers.cache_clear()
        with atomic_files(tmp_path / "c"):
            pass
    assert sorted(path.name for path in tmp_path.iterdir()) == ["b", "c"]
    assert (tmp_path / "b").read_bytes() == b"whole"


def test_a_full_disk_is_an_error_of_the_file_that_leaves_nothing(tmp_path: Path) -> None:
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))
    try:
        with pytest.raises(DatasetError, match=r"full\.npz: file too large"):
            sfmcpp.write(model(1), tmp_path / "full.npz")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert list(tmp_path.iterdir()) == []


def test_a_name_as_long_as_can_be_is_written(tmp_path: Path) -> None:
    path = tmp_path / ("x" * 251 + ".npz")
    sfmcpp.write(model(1), path)
    assert sfmcpp.read(path).num_cameras == 4


def test_a_loop_of_links_is_refused(tmp_path: Path) -> None:
    (tmp_path / "loop.npz").symlink_to(tmp_path / "loop.npz")
    with pytest.raises(DatasetError, match=r"loop\.npz: too many levels of symbolic links"):
        sfmcpp.write(model(1), tmp_path / "loop.npz")
    assert [path.name for path in tmp_path.iterdir()] == ["loop.npz"]


def test_content_is_on_the_disk_before_it_has_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done, sync, replace = [], os.fsync, Path.replace
    monkeypatch.setattr(os, "fsync", lambda number: (done.append("sync"), sync(number)))
    monkeypatch.setattr(Path, "replace", lambda self, to: (done.append("name"), replace(self, to)))
    with atomic_files(tmp_path / "a"):
        pass
    assert done == ["sync", "name", "sync"]


def test_one_who_replaces_several_files_waits_for_another(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for seed, name in ((1, "model"), (2, "other"), (3, "third")):
        sfmcpp.write(model(seed), tmp_path / name)
    replace, children = Path.replace, []

    def replace_while_another_writes(self: Path, target: Path) -> Path:
        if not children:
            children.append(os.fork())
            if children == [0]:
                monkeypatch.setattr(Path, "replace", replace)
                sfmcpp.write(model(3), tmp_path / "model")
                os._exit(0)
            time.sleep(0.5)
        return replace(self, target)

    monkeypatch.setattr(Path, "replace", replace_while_another_writes)
    sfmcpp.write(model(2), tmp_path / "model")
    assert content_of(tmp_path / "model") in (content_of(tmp_path / "other"), content_of(tmp_path / "third"))
    assert os.waitpid(children[0], 0)[1] == 0
    assert content_of(tmp_path / "model") == content_of(tmp_path / "third")


def test_a_file_that_another_process_takes_for_left_over_is_made_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lock, swept = fcntl.flock, []

    def lock_after_another_has_swept(file: Any, how: int) -> None:
        made = [path for path in tmp_path.iterdir() if path.name.startswith(".sfmcpp-new-")]
        if made and len(swept) < 2:
            swept.append(made[0])
            made[0].unlink()
        lock(file, how)

    monkeypatch.setattr(fcntl, "flock", lock_after_another_has_swept)
    with atomic_files(tmp_path / "a") as (file,):
        file.write(b"whole")
    assert len(swept) == 2
    assert (tmp_path / "a").read_bytes() == b"whole"
    assert len(list(tmp_path.iterdir())) == 1


@pytest.mark.parametrize("mode", [0o600, 0o664, 0o640])
def test_a_file_that_is_replaced_hands_on_its_permissions(tmp_path: Path, mode: int) -> None:
    (tmp_path / "a.npz").write_text("old")
    (tmp_path / "a.npz").chmod(mode)
    sfmcpp.write(model(1), tmp_path / "a.npz")
    assert stat.S_IMODE((tmp_path / "a.npz").stat().st_mode) == mode


def test_a_read_only_file_is_not_replaced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a.npz").write_text("precious")
    monkeypatch.setattr(os, "access", lambda path, mode: mode != os.W_OK)  # root may write all files
    with pytest.raises(DatasetError, match=r"a\.npz: permission denied: the file that is there is read-only"):
        sfmcpp.write(model(1), tmp_path / "a.npz")
    assert (tmp_path / "a.npz").read_text() == "precious"
    sfmcpp.write(model(1), tmp_path / "b.npz")


# As an interactive session keeps the last error, with all that its functions had in hand.
KEPT: list[BaseException] = []
WATCHED = {module.__file__ for module in (atomic, contextlib, pathlib)}


def is_interrupted(action: Callable[[], None], calls: int) -> bool:
    """Whether Ctrl-C ends something, which comes after so many calls for the module under test.

    There, and at the end of a loop's body, the interpreter looks for signals.
    """
    left = calls

    def count(frame: FrameType, event: str, argument: object) -> None:
        nonlocal left
        if frame.f_code.co_filename in WATCHED and event in ("call", "c_return"):
            left -= 1
            if left < 0:
                sys.setprofile(None)
                raise KeyboardInterrupt

    before = sys.getprofile()
    sys.setprofile(count)
    try:
        action()
    except KeyboardInterrupt as interrupt:
        KEPT[:] = [interrupt]
        return True
    finally:
        sys.setprofile(before)
    return False


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # files that are left open
def test_files_that_ctrl_c_meets_anywhere_are_all_old_or_all_new(tmp_path: Path) -> None:
    names = ("a", "b")

    def write(content: bytes) -> None:
        with atomic_files(*(tmp_path / name for name in names), durable=False) as files:
            for file in files:
                file.write(content)

    calls, found = 0, []
    while True:
        for name in names:
            (tmp_path / name).write_bytes(b"old")
        if not is_interrupted(lambda: write(b"new"), calls):
            break
        found.append(content_of(tmp_path))
        calls += 1
    assert {tuple(sorted(contents.items())) for contents in found} == {
        (("a", content), ("b", content)) for content in (b"old", b"new")
    }
