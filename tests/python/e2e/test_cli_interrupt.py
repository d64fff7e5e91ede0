"""Ctrl-C or SIGTERM on a long solve, at a terminal."""

from __future__ import annotations

import os
import pty
import re
import signal
import subprocess
import sys
import threading
import time
import weakref
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import pytest
from conftest import REPOSITORY

import sfmcpp
import sfmcpp.doctor
from cli_helpers import (
    COMMAND,
    TIMEOUT_S,
    noisy_circle,
    read_terminal,
    run,
    run_here,
    strict_json,
    write_noisy_circle,
)
from sfmcpp.cli.interrupts import (
    noted_interrupt,
    repeated_lost_interrupts,
    single_interrupt,
    stoppable,
    termination_as_ctrl_c,
)
from sfmcpp.study import covariance_files

# A row of the progress display after the start: the solve is then between two of its steps.
FIRST_STEP = re.compile(rb"\n\s+1\s+\d\.\d+e")
STEPS = re.compile(r"\n\s+(\d+)\s+\d\.\d+e")
# Gradient descent takes thousands of steps: who interrupts it gets a turn before it comes to its end.
ENDLESS = ("--method", "gradient-descent", "--function-tolerance", "0")


@pytest.fixture(scope="module")
def long_problem(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("long") / "start.npz"
    sfmcpp.write(noisy_circle(120, 4000, camera_model="bal"), path)
    return path


def _with_hangups() -> None:
    """As at a terminal, though the tests may be run under nohup."""
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


def interrupt_after_the_first_step(arguments: list[str | Path], *by: signal.Signals) -> tuple[int, str]:
    """Exit code, and all that was shown on a terminal, of a solve interrupted once it runs."""
    ours, theirs = pty.openpty()
    command = [*COMMAND, "solve", *map(str, arguments), *ENDLESS, "--max-iterations", "100000"]
    with subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=theirs, preexec_fn=_with_hangups
    ) as process:
        os.close(theirs)
        shown, interrupted, deadline = b"", False, time.monotonic() + TIMEOUT_S
        while (more := read_terminal(ours)) and time.monotonic() < deadline:
            shown += more
            if not interrupted and FIRST_STEP.search(shown):
                for number in by or (signal.SIGINT,):
                    process.send_signal(number)
                interrupted = True
        process.kill()
    os.close(ours)
    assert interrupted, shown
    return process.returncode, shown.decode()


@pytest.mark.parametrize(
    "by",
    [
        [signal.SIGINT],
        [signal.SIGTERM],
        [signal.SIGHUP],
        [signal.SIGTERM, signal.SIGHUP],  # a session that ends
        [signal.SIGINT] * 3,  # a terminal and two wrappers
    ],
)
def test_an_interrupted_solve_writes_its_best_state_and_report_and_says_so(
    long_problem: Path, tmp_path: Path, by: list[signal.Signals]
) -> None:
    output, report = tmp_path / "out.npz", tmp_path / "report.json"
    code, shown = interrupt_after_the_first_step([long_problem, "-o", output, "--report", report], *by)
    assert code == 130
    assert f"the best state so far is in {output}" in shown
    assert "Traceback" not in shown
    content = strict_json(report)
    assert content["termination"] == "interrupted"
    assert content["final_cost"] < content["initial_cost"]
    assert sfmcpp.cost(sfmcpp.read(output)) == pytest.approx(content["final_cost"], rel=1e-9)


def test_a_terminal_that_goes_away_takes_no_result_along(long_problem: Path, tmp_path: Path) -> None:
    output, report = tmp_path / "out.npz", tmp_path / "report.json"
    ours, theirs = pty.openpty()
    results = ["-o", output, "--report", report]
    limits = ["--function-tolerance", "0", "--max-iterations", "4"]
    command = [*COMMAND, "solve", *map(str, [long_problem, *results, *limits])]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=theirs) as process:
        os.close(theirs)
        read_terminal(ours)
        os.close(ours)
        assert process.wait(TIMEOUT_S) == 0
    assert sfmcpp.cost(sfmcpp.read(output)) == pytest.approx(strict_json(report)["final_cost"], rel=1e-9)


def test_an_interrupted_solve_without_an_output_says_that_nothing_is_kept(
    long_problem: Path, tmp_path: Path
) -> None:
    code, shown = interrupt_after_the_first_step([long_problem])
    assert code == 130
    assert "not kept" in shown
    assert list(tmp_path.iterdir()) == []


def test_an_interrupted_solve_with_checkpoints_goes_on_to_the_same_bytes(
    long_problem: Path, tmp_path: Path
) -> None:
    kept, out, whole = tmp_path / "kept", tmp_path / "out.npz", tmp_path / "whole.npz"
    code, shown = interrupt_after_the_first_step([long_problem, "--checkpoint", kept], signal.SIGTERM)
    assert code == 130
    assert f"continue with --resume {kept}" in shown
    last = max(int(row[1]) for row in STEPS.finditer(shown))
    limits = ("--quiet", *ENDLESS, "--max-iterations", str(last + 3))
    assert run("solve", long_problem, "-o", out, "--resume", kept, *limits).returncode == 0
    assert run("solve", long_problem, "-o", whole, *limits).returncode == 0
    assert out.read_bytes() == whole.read_bytes()


def test_a_time_limit_on_a_long_solve_stops_it_early(long_problem: Path, tmp_path: Path) -> None:
    report = tmp_path / "report.json"
    limit = ("--max-seconds", "0.2", "--function-tolerance", "0")
    assert run("solve", long_problem, "--report", report, *limit).returncode == 0
    content = strict_json(report)
    assert content["termination"] == "max_seconds"
    # Nothing starts after the limit: all but the last iteration ended before it.
    assert all(iteration["seconds"] < 0.2 for iteration in content["iterations"][:-1])


@pytest.mark.parametrize(
    ("module", "by"),
    [
        ("concurrent", signal.SIGINT),  # before signals are handled
        ("numpy", signal.SIGINT),
        ("numpy", signal.SIGTERM),
        ("typer", signal.SIGTERM),
    ],
)
def test_a_stop_while_modules_are_loaded_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, module: str, by: signal.Signals
) -> None:
    (tmp_path / f"{module}.py").write_text(f"import os, signal\nos.kill(os.getpid(), {int(by)})\n")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")]))
    result = run("--version")
    assert (result.returncode, result.stderr) == (130, "sfmcpp: interrupted\n")


@pytest.mark.parametrize(
    "failing",
    [
        "raise ImportError('initialization failed') from KeyboardInterrupt()",
        "raise RuntimeError('Error calling __set_name__') from KeyboardInterrupt()",
        "exec('raise KeyboardInterrupt')",
    ],
)
def test_a_stop_within_a_module_is_one_line_however_it_comes_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, failing: str
) -> None:
    (tmp_path / "typer.py").write_text(failing)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")]))
    result = run("--version")
    assert (result.returncode, result.stderr) == (130, "sfmcpp: interrupted\n")


def test_a_stop_while_arguments_are_read_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def stop(self: object, *arguments: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("typer.core.TyperGroup.make_context", stop)
    result = run_here("solve", tmp_path / "in.npz")
    assert (result.returncode, result.stderr.strip()) == (130, "sfmcpp: interrupted")


def lose_an_interrupt() -> None:
    """One that falls into a callback, whose exceptions are ignored."""

    class Module:
        pass

    def interrupted(_: object) -> None:
        raise KeyboardInterrupt

    module = Module()
    reference = weakref.ref(module, interrupted)
    del module
    assert reference() is None


def test_an_interrupt_that_falls_into_a_callback_comes_again() -> None:
    with repeated_lost_interrupts():
        lose_an_interrupt()
        with pytest.raises(KeyboardInterrupt):
            time.sleep(TIMEOUT_S)


def test_an_interrupt_that_was_lost_comes_before_the_command_has_ended() -> None:
    with pytest.raises(KeyboardInterrupt), repeated_lost_interrupts():
        lose_an_interrupt()
    time.sleep(0.05)  # nothing comes any more


def stop_once_set(patch: pytest.MonkeyPatch, number: signal.Signals) -> None:
    """Let a stop come right after its handler is set the next time."""
    set_handler, sent = signal.signal, []

    def set_and_stop(which: signal.Signals, handler: Any) -> Any:
        before = set_handler(which, handler)
        if which == number and not sent:
            sent.append(which)
            signal.raise_signal(which)
        return before

    patch.setattr(signal, "signal", set_and_stop)


def handlers() -> list[Any]:
    return [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_stop_while_handlers_are_set_is_noted_and_the_next_one_ends_at_once(
    monkeypatch: pytest.MonkeyPatch, number: signal.Signals
) -> None:
    with termination_as_ctrl_c():
        before = handlers()
        stop_once_set(monkeypatch, number)
        with noted_interrupt() as asked_to_stop:
            assert asked_to_stop()
            assert handlers() == before
        assert handlers() == before


@pytest.mark.parametrize("held", [single_interrupt, termination_as_ctrl_c])
def test_handlers_are_restored_after_a_stop_while_they_are_set(
    monkeypatch: pytest.MonkeyPatch, held: Callable[[], AbstractContextManager[Any]]
) -> None:
    before = handlers()
    stop_once_set(monkeypatch, signal.SIGINT)
    with pytest.raises(KeyboardInterrupt), held():
        raise AssertionError("not stopped")
    assert handlers() == before


def test_a_timeout_of_what_is_computed_is_raised_as_it_is() -> None:
    def compute() -> None:
        raise TimeoutError("of its own")

    asked: list[int] = []
    with pytest.raises(TimeoutError, match="of its own"):
        stoppable(compute, lambda: asked.append(0) is None and len(asked) > 100)


@pytest.mark.parametrize(
    ("arguments", "owner", "name"),
    [
        (["solve", "-o", "out.npz", "--covariances", "sigmas.csv"], covariance_files.Covariances, "of"),
        (["doctor"], sfmcpp.doctor, "diagnose"),
        (["doctor", "--solve"], sfmcpp.doctor, "diagnose"),
    ],
)
def test_a_call_of_the_core_that_is_no_solve_is_left_at_a_stop(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str], owner: object, name: str
) -> None:
    source, ended, begun = write_noisy_circle(tmp_path), threading.Event(), threading.Event()

    def as_long_as_it_takes(*_: object, **__: object) -> None:
        begun.set()
        ended.wait(TIMEOUT_S)

    def stop() -> None:
        begun.wait()
        os.kill(os.getpid(), signal.SIGTERM)

    monkeypatch.setattr(owner, name, as_long_as_it_takes)
    stopping = threading.Thread(target=stop)
    stopping.start()
    started = time.monotonic()
    result = run_here(*arguments, source, cwd=tmp_path)
    ended.set()
    stopping.join()
    assert time.monotonic() - started < TIMEOUT_S / 4
    assert result.returncode == 130
    if "solve" in arguments:
        assert "interrupted: the covariances are not written, all else is" in result.stderr
        assert "sigmas.csv" not in result.stdout
        assert not (tmp_path / "sigmas.csv").exists()
        sfmcpp.read(tmp_path / "out.npz")


def test_solves_stopped_or_killed_at_random_moments_keep_what_they_say() -> None:
    tool = REPOSITORY / "tools" / "stop_at_random.py"
    told = subprocess.run(
        [sys.executable, tool, "6", "1"], capture_output=True, text=True, timeout=TIMEOUT_S, check=False
    )
    assert told.returncode == 0, told.stdout + told.stderr
