"""Solves that are stopped, killed or refused, and go on from their checkpoints."""

from __future__ import annotations

import json
import math
import os
import resource
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sfmcpp
from cli_helpers import COMMAND, TIMEOUT_S, is_one_error_line, noisy_circle, run_here, write_noisy_circle
from sfmcpp import CheckpointFolder, ConstraintGroup, DatasetError, Problem, ResidualGroup, Summary
from sfmcpp.sources.io.checkpoints import _sealed

REPOSITORY = Path(__file__).resolve().parents[3]
TIMES = ("seconds", "seconds_setup", "seconds_total")


def stop_after(count: int) -> Callable[[sfmcpp.Iteration], bool]:
    return lambda iteration: iteration.iteration < count


def timeless(summary: Summary) -> dict[str, Any]:
    """All that a summary says but times."""
    told = {name: value for name, value in summary.to_dict().items() if name not in TIMES}
    told["iterations"] = [{k: v for k, v in row.items() if k not in TIMES} for row in told["iterations"]]
    for forecast in told["linear_solver_forecast"]:
        del forecast["seconds"]
    return told


def stopped(folder: Path, count: int = 3, **options: Any) -> CheckpointFolder:
    """The checkpoints of a solve that was stopped after some iterations."""
    kept = CheckpointFolder(folder, every_s=0.0)
    sfmcpp.solve(noisy_circle(), checkpoint=kept, callback=stop_after(count), **options)
    return kept


def assert_same_end(one: Problem, other: Problem) -> None:
    for name in ("cameras", "intrinsics", "points"):
        assert getattr(one, name).tobytes() == getattr(other, name).tobytes(), name


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"method": "dog-leg", "loss": "huber", "loss_scale_px": "auto"},
        {"method": "lm", "line_search": "t-als", "line_search_on_rejection": True},
        {"method": "conjugate-gradient"},
        {"linear_solver": "iterative", "precision": "single"},
    ],
    ids=lambda options: options.get("method", "default"),
)
def test_a_solve_that_was_stopped_goes_on_to_the_same_bytes(tmp_path: Path, options: dict[str, Any]) -> None:
    options = {**options, "function_tolerance": 1e-12, "max_iterations": 12}
    whole, problem = noisy_circle(), noisy_circle()
    expected = sfmcpp.solve(whole, **options)
    kept = stopped(tmp_path / "kept", **options)
    heard: list[int] = []
    summary = sfmcpp.solve(
        problem,
        checkpoint=kept,
        resume=kept,
        callback=lambda iteration: heard.append(iteration.iteration),
        **{**options, "threads": 2},
    )
    assert_same_end(problem, whole)
    assert summary.options["threads"] == 2
    alike = replace(summary, threads=expected.threads, options={**summary.options, "threads": 0})
    assert timeless(alike) == timeless(replace(expected, options={**expected.options, "threads": 0}))
    assert heard == [iteration.iteration for iteration in expected.iterations[4:]]


def test_constraints_and_chosen_weights_go_on(tmp_path: Path) -> None:
    def arguments() -> tuple[Problem, dict[str, Any]]:
        problem = noisy_circle()
        group = ConstraintGroup("position", np.arange(6), problem.cameras[:, :, 3].copy(), name="gps")
        return problem, {"constraints": [group], "weight": "variance", "function_tolerance": 1e-12}

    whole, options = arguments()
    expected = sfmcpp.solve(whole, **options)
    kept = CheckpointFolder(tmp_path / "kept")
    problem, options = arguments()
    sfmcpp.solve(problem, checkpoint=kept, callback=stop_after(2), **options)
    problem, options = arguments()
    summary = sfmcpp.solve(problem, resume=kept, **options)
    assert_same_end(problem, whole)
    assert summary.constraint_costs == expected.constraint_costs
    problem, options = arguments()
    options["constraints"][0].values[0] += 1
    with pytest.raises(DatasetError, match="another problem: constraints 'gps'"):
        sfmcpp.solve(problem, resume=kept, **options)


def own_residuals(problem: Problem, offset_m: float = 0.0) -> ResidualGroup:
    """Heights of cameras and of points by a function."""
    heights = problem.cameras[:6, 2, 3].copy() + offset_m

    def barometer(poses: np.ndarray, points: np.ndarray) -> np.ndarray:
        return np.stack([poses[:, 2, 3] - heights, points[:, 2] - 1.0], axis=1) / 0.2

    return ResidualGroup(barometer, np.arange(6), points=np.arange(6))


def test_own_residuals_go_on_and_are_known_by_what_they_say_of_the_start(tmp_path: Path) -> None:
    whole, problem, kept = noisy_circle(), noisy_circle(), CheckpointFolder(tmp_path / "kept")
    options: dict[str, Any] = {"function_tolerance": 1e-12, "max_iterations": 12}
    expected = sfmcpp.solve(whole, constraints=[own_residuals(whole)], **options)
    group = own_residuals(problem)
    sfmcpp.solve(noisy_circle(), constraints=[group], checkpoint=kept, callback=stop_after(2), **options)
    group = own_residuals(problem)
    summary = sfmcpp.solve(problem, constraints=[group], resume=kept, **options)
    assert_same_end(problem, whole)
    assert summary.constraint_costs == expected.constraint_costs
    with pytest.raises(DatasetError, match="another problem: constraints 'barometer'"):
        sfmcpp.solve(noisy_circle(), constraints=[own_residuals(whole, 0.1)], resume=kept, **options)


def test_limits_count_the_whole_run_and_may_be_raised(tmp_path: Path) -> None:
    kept = CheckpointFolder(tmp_path / "kept")
    first = sfmcpp.solve(noisy_circle(), checkpoint=kept, max_iterations=2)
    assert first.termination == "max_iterations"
    again = sfmcpp.solve(noisy_circle(), resume=kept, max_iterations=2)
    assert timeless(again) == timeless(first)
    more = sfmcpp.solve(noisy_circle(), resume=kept, max_iterations=4)
    assert [i.iteration for i in more.iterations] == list(range(5))
    assert more.seconds_total > first.iterations[-1].seconds
    none_left = sfmcpp.solve(noisy_circle(), resume=kept, max_seconds=1e-9)
    assert (none_left.termination, len(none_left.iterations)) == ("max_seconds", 3)


def test_what_is_not_the_same_run_is_refused_by_name(tmp_path: Path) -> None:
    kept = stopped(tmp_path / "kept")
    moved, other = noisy_circle(), noisy_circle()
    moved.points += 1e-9
    other.pixels[0, 0] += 1
    fewer = noisy_circle(5)
    for problem, told in ((moved, "points"), (other, "pixels"), (fewer, "camera_index, cameras")):
        before = problem.copy()
        with pytest.raises(DatasetError, match=f"of another problem: {told}"):
            sfmcpp.solve(problem, resume=kept)
        assert_same_end(problem, before)
    with pytest.raises(DatasetError, match=r"other options: loss = 'squared', this is 'huber'"):
        sfmcpp.solve(noisy_circle(), resume=kept, loss="huber")


@pytest.mark.parametrize("name", ["__version__", "INSTRUCTION_SET"])
def test_another_version_and_instruction_set_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    kept = stopped(tmp_path / "kept")
    then = getattr(sfmcpp._core, name)
    monkeypatch.setattr(sfmcpp._core, name, "another")
    noun = "version" if "version" in name else "instruction set"
    with pytest.raises(DatasetError, match=f"of another {noun}: '{then}', this is 'another'"):
        sfmcpp.solve(noisy_circle(), resume=kept)


def test_the_older_file_stands_in_for_a_damaged_one_and_it_is_said(tmp_path: Path) -> None:
    kept = stopped(tmp_path / "kept", 4)
    newest = Path(kept.load().path)
    newest.write_bytes(newest.read_bytes()[:-1])
    whole, problem = noisy_circle(), noisy_circle()
    sfmcpp.solve(whole)
    summary = sfmcpp.solve(problem, resume=CheckpointFolder(tmp_path / "kept"), checkpoint=kept)
    assert_same_end(problem, whole)
    (warning,) = summary.warnings
    assert str(newest) in warning
    assert "truncated" in warning


def test_no_byte_can_be_changed_or_left_out(tmp_path: Path) -> None:
    folder = tmp_path / "kept"
    kept = CheckpointFolder(folder)
    kept.begin()
    kept.save({"run": "test"}, lambda: {"x": np.arange(3.0)})
    path = folder / "checkpoint-a.npz"
    whole = path.read_bytes()
    for place in range(len(whole)):
        for content in (
            whole[:place] + bytes([whole[place] ^ (1 << place % 8)]) + whole[place + 1 :],
            whole[:place],
        ):
            path.write_bytes(content)
            with pytest.raises(DatasetError, match=r"checkpoint-a\.npz: "):
                kept.load()
    path.write_bytes(whole)
    np.testing.assert_array_equal(kept.load().arrays["x"], np.arange(3.0))
    np.testing.assert_array_equal(np.load(path)["x"], np.arange(3.0))


def test_a_number_that_is_none_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "checkpoint-a.npz"
    path.write_bytes(_sealed(path, {"sequence": math.inf, "facts": {}}, {}))
    with pytest.raises(DatasetError, match="is no checkpoint: metadata"):
        CheckpointFolder(tmp_path).load()


def test_a_folder_that_holds_another_run_or_none_is_refused(tmp_path: Path) -> None:
    kept = stopped(tmp_path / "kept")
    before = {path: path.read_bytes() for path in kept.path.iterdir()}
    with pytest.raises(DatasetError, match="earlier run: resume it, or remove them"):
        sfmcpp.solve(noisy_circle(), checkpoint=CheckpointFolder(kept.path))
    assert {path: path.read_bytes() for path in kept.path.iterdir()} == before
    with pytest.raises(DatasetError, match="nothing: holds no checkpoint"):
        sfmcpp.solve(noisy_circle(), resume=CheckpointFolder(tmp_path / "nothing"))
    with pytest.raises(sfmcpp.InvalidArgument, match="every_s = -1"):
        CheckpointFolder(tmp_path, every_s=-1)


def test_checkpoints_take_turns_and_only_when_they_are_due(tmp_path: Path) -> None:
    kept = CheckpointFolder(tmp_path / "kept", every_s=3600)
    sfmcpp.solve(noisy_circle(), checkpoint=kept)
    assert list(kept.path.iterdir()) == []
    stopped(tmp_path / "often", 4)
    names = sorted(path.name for path in (tmp_path / "often").iterdir())
    assert names == ["checkpoint-a.npz", "checkpoint-b.npz"]


def test_a_checkpoint_that_fails_leaves_the_solve_alone_and_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(number: int) -> None:
        raise OSError(28, "No space left on device")

    kept = CheckpointFolder(tmp_path / "kept", every_s=0)
    monkeypatch.setattr(os, "fsync", full)
    whole, problem = noisy_circle(), noisy_circle()
    sfmcpp.solve(whole)
    summary = sfmcpp.solve(problem, checkpoint=kept)
    assert_same_end(problem, whole)
    named = f"no checkpoint: {kept.path / 'checkpoint-a.npz'}: no space left on device"
    assert summary.warnings == [named]
    assert list(kept.path.iterdir()) == []


def test_a_checkpoint_for_which_there_is_no_memory_leaves_the_run_alone(tmp_path: Path) -> None:
    def too_large() -> dict[str, np.ndarray]:
        raise MemoryError

    kept = CheckpointFolder(tmp_path / "kept")
    kept.begin()
    kept.save({}, too_large)
    assert "does not fit in memory" in str(kept.failure)
    assert list(kept.path.iterdir()) == []


def test_the_command_stops_and_goes_on_to_the_same_files(tmp_path: Path) -> None:
    source = write_noisy_circle(tmp_path)
    out, whole, kept = tmp_path / "out.npz", tmp_path / "whole.npz", tmp_path / "kept"
    assert run_here("solve", source, "-o", whole, "--quiet").returncode == 0
    first = run_here("solve", source, "-o", out, "--quiet", "--checkpoint", kept, "--max-iterations", "2")
    assert (first.returncode, out.read_bytes() == whole.read_bytes()) == (0, False)
    report = tmp_path / "report.json"
    words = ("--checkpoint", kept, "--checkpoint-every", "0", "--resume", kept, "--report", report)
    assert run_here("solve", source, "-o", out, "--quiet", *words).returncode == 0
    assert out.read_bytes() == whole.read_bytes()
    assert json.loads(report.read_text())["iterations"][0]["iteration"] == 0


@pytest.mark.parametrize("killed_early", [False, True])
def test_one_command_serves_a_job_that_is_started_again(tmp_path: Path, killed_early: bool) -> None:
    source = write_noisy_circle(tmp_path)
    out, whole, kept = tmp_path / "out.npz", tmp_path / "whole.npz", tmp_path / "kept"
    assert run_here("solve", source, "-o", whole, "--quiet").returncode == 0
    if killed_early:
        kept.mkdir()
    job = ("solve", source, "-o", out, "--checkpoint", kept, "--resume", kept)
    first = run_here(*job, "--max-iterations", "2")
    assert first.stderr == f"sfmcpp: note: {kept}: holds no checkpoint yet, the run begins at its start\n"
    assert out.read_bytes() != whole.read_bytes()
    again = run_here(*job)
    assert (again.returncode, again.stderr) == (0, "")
    assert out.read_bytes() == whole.read_bytes()


def test_checkpoints_of_ranks_are_no_empty_folder(tmp_path: Path) -> None:
    kept = tmp_path / "kept"
    assert CheckpointFolder(kept).is_empty()
    (kept / "rank-0000").mkdir(parents=True)
    assert CheckpointFolder(kept).is_empty()
    (kept / "rank-0000" / "checkpoint-b.npz").write_text("")
    assert not CheckpointFolder(kept).is_empty()
    result = run_here("solve", write_noisy_circle(tmp_path), "--checkpoint", kept, "--resume", kept)
    assert (result.returncode, "holds the checkpoints of 1 ranks" in result.stderr) == (2, True)


def test_the_command_refuses_in_one_line_before_the_work(tmp_path: Path) -> None:
    source = write_noisy_circle(tmp_path)
    (tmp_path / "file").write_text("")
    for words, told in (
        (("--resume", tmp_path / "nothing"), "nothing: holds no checkpoint"),
        (("--checkpoint", tmp_path / "no" / "kept"), "kept: no such file or directory"),
        (("--checkpoint", tmp_path / "file"), "file: is a file, a folder is wanted"),
        (("--checkpoint", tmp_path / "kept", "-o", source), "would replace the input"),
        (("--checkpoint-every", "-1"), "--checkpoint-every"),
    ):
        result = run_here("solve", source, *words)
        assert result.returncode == 2
        assert is_one_error_line(result)
        assert told in result.stderr


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_read_only_folder_is_refused_before_the_work(tmp_path: Path) -> None:
    source, kept = write_noisy_circle(tmp_path), tmp_path / "kept"
    kept.mkdir(mode=0o500)
    result = run_here("solve", source, "--checkpoint", kept)
    assert (result.returncode, is_one_error_line(result)) == (2, True)


def test_a_folder_without_room_is_refused_before_the_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    usage = shutil.disk_usage(tmp_path)
    monkeypatch.setattr(shutil, "disk_usage", lambda path: usage._replace(free=100))
    with pytest.raises(DatasetError, match="has room for 100 bytes, a checkpoint takes"):
        sfmcpp.solve(noisy_circle(), checkpoint=CheckpointFolder(tmp_path / "kept"))


def test_a_disk_that_fills_costs_the_checkpoint_alone(tmp_path: Path) -> None:
    source = tmp_path / "start.npz"
    sfmcpp.write(noisy_circle(6, 60), source)
    report, kept = tmp_path / "report.json", tmp_path / "kept"
    words = ["solve", str(source), "--report", str(report), "--checkpoint", str(kept), "--quiet"]

    def limit() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (3000, 3000))

    command = [*COMMAND, *words, "--checkpoint-every", "0"]
    result = subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT_S, preexec_fn=limit)
    assert (result.returncode, is_one_error_line(result)) == (2, True)
    assert f"{kept / 'checkpoint-a.npz'}: file too large" in result.stderr


def test_killed_solves_go_on_to_the_same_bytes() -> None:
    tool = [sys.executable, str(REPOSITORY / "tools" / "kill_and_resume.py")]
    options = ["--kills", "2", "--seed", "3", "--points", "300"]
    result = subprocess.run([*tool, *options], capture_output=True, text=True, timeout=TIMEOUT_S)
    assert result.returncode == 0, result.stdout + result.stderr
    assert "0 complaints" in result.stdout
