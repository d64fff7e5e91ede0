"""Systems that fail at any one of the calls that write files: old files stay whole, the fault is named."""

from __future__ import annotations

import errno
import io
import itertools
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sfmcpp
from sfmcpp import DatasetError, Problem
from sfmcpp.model import Trajectory
from sfmcpp.sources.io import atomic
from sfmcpp.sources.io.parts import write_parts
from sfmcpp.sources.io.trajectories import write_trajectory
from sfmcpp.study.report_files import UNFINISHED, write_report, write_steps

CODES = (errno.ENOSPC, errno.EIO, errno.EROFS)
WORDS = tuple(os.strerror(code).lower() for code in CODES)


class FailingSystem:
    """Calls of the operating system that change files; the one with a number, from zero, fails."""

    def __init__(self, patch: pytest.MonkeyPatch, number: int) -> None:
        self.left, self.failed = number, ""
        self._code = CODES[number % len(CODES)]
        for owner, name in (
            (os, "fsync"),
            (os, "open"),
            (Path, "replace"),
            (Path, "unlink"),
            (Path, "mkdir"),
        ):
            patch.setattr(owner, name, self._counted(name, getattr(owner, name)))
        patch.setattr(Path, "open", self._open_of(Path.open))

    def fail_in_turn(self, name: str) -> None:
        """Count a call, and fail if it is its turn."""
        self.left -= 1
        if self.left == -1:
            self.failed = name
            raise OSError(self._code, os.strerror(self._code))

    def _counted(self, name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        def counted(*arguments: Any, **options: Any) -> Any:
            self.fail_in_turn(name)
            return call(*arguments, **options)

        return counted

    def _open_of(self, real: Callable[..., Any]) -> Callable[..., Any]:
        system = self

        class Raw(io.FileIO):
            def write(self, data: Any) -> int:
                system.fail_in_turn("write")
                return super().write(data)

        def opened(path: Path, mode: str = "r", *arguments: Any, **options: Any) -> Any:
            system.fail_in_turn("open")
            if mode != "xb":
                return real(path, mode, *arguments, **options)
            return io.BufferedWriter(Raw(path, mode))

        return opened


def model(seed: int) -> Problem:
    scene = sfmcpp.circle_scene(4, 20, camera_model="bal", seed=seed)
    scene.intrinsics[:, 1:] = 0.0
    return scene


def trajectory(seed: int) -> Trajectory:
    cameras = np.tile(np.eye(3, 4), (5, 1, 1))
    return Trajectory(np.arange(5.0), cameras + np.array([0.0, 0.0, 0.0, seed]))


Writer = Callable[[int, Path], None]
WRITERS: dict[str, Writer] = {
    name: lambda seed, path: sfmcpp.write(model(seed), path)
    for name in (
        "a.txt",
        "a.txt.gz",
        "a.txt.bz2",
        "a.txt.xz",
        "a.out",
        "a.npz",
        "a.ply",
        "acams.txt",
        "model",
    )
}
WRITERS |= {
    "a.parts": lambda seed, path: write_parts(model(seed), path, 2),
    "report.json": lambda seed, path: write_report({"seed": seed}, path),
    "tum.txt": lambda seed, path: write_trajectory(trajectory(seed), path),
}


def content_of(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def is_left_over(path: str) -> bool:
    """Whether the next writer removes a file that could not be removed: nothing names it."""
    return ".sfmcpp-" in path or path.startswith(("a.parts/part-", "a.parts/cameras-"))


@pytest.mark.parametrize(
    ("name", "exists"),
    [*((name, True) for name in WRITERS), *((name, False) for name in ("a.npz", "model", "a.parts"))],
)
def test_what_cannot_be_written_leaves_what_was_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, exists: bool
) -> None:
    write = WRITERS[name]
    states = []
    for seed in (1, 2):
        (tmp_path / f"of {seed}").mkdir()
        write(seed, tmp_path / f"of {seed}" / name)
        states.append(content_of(tmp_path / f"of {seed}"))
    before, after = states if exists else ({}, states[1])
    assert before != after
    refused = 0
    for number in itertools.count():
        folder = tmp_path / f"try {number}"
        folder.mkdir()
        if exists:
            write(1, folder / name)
        with monkeypatch.context() as patch:
            system, refusal = FailingSystem(patch, number), None
            try:
                write(2, folder / name)
            except DatasetError as error:
                refusal = error
        if not system.failed:
            break
        if refusal is not None:
            assert Path(refusal.path).is_relative_to(folder)
            assert refusal.reason in WORDS
            refused += 1
        found, wanted = content_of(folder), after if refusal is None else before
        if system.failed == "unlink":
            found = {path: data for path, data in found.items() if path in wanted or not is_left_over(path)}
        assert found == wanted, system.failed
        atomic.remove_leftovers.cache_clear()
        write(2, folder / name)
        assert content_of(folder) == after
    assert refused >= 4


def test_the_other_files_of_a_run_are_written_and_its_folder_is_unfinished(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    steps = [(name, lambda path, write=WRITERS[name]: write(1, path)) for name in ("a.npz", "report.json")]
    for number in itertools.count():
        folder = tmp_path / str(number)
        with monkeypatch.context() as patch:
            system, message = FailingSystem(patch, number), ""
            try:
                write_steps(steps, folder)
            except DatasetError as error:
                message = str(error)
        if not system.failed:
            break
        found = {path for path in content_of(folder) if ".sfmcpp-" not in path} if folder.exists() else set()
        if not message:
            assert found == {"a.npz", "report.json"}
        elif found:
            missing = {"a.npz", "report.json"} - found
            assert UNFINISHED in found
            assert len(missing) <= 1 or found == {UNFINISHED}
            assert message.startswith(str(folder / "".join(missing if len(missing) == 1 else ())))
    assert number > 10
