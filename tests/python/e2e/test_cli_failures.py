"""What goes wrong: one line, the right exit code, nothing half done, and nothing found out too late."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import sfmcpp
from cli_helpers import (
    COMMAND,
    TIMEOUT_S,
    is_one_error_line,
    noisy_circle,
    run,
    run_here,
    strict_json,
    write_noisy_circle,
)


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ([], "Missing command"),
        (["frobnicate"], "'frobnicate'"),
        (["solve"], "INPUT"),
        (["solve", "a.txt", "--frobnicate"], "--frobnicate"),
        (["solve", "a.txt", "--method", "newton"], "'newton' is unknown; choose one of lm"),
        (["solve", "a.txt", "--line-search", "golden"], "'golden' is unknown; choose one of none, g-als"),
        (["solve", "a.txt", "--line-search-iterations", "-1"], "--line-search-iterations -1"),
        (["solve", "a.txt", "--camera-model", "fisheye"], "'fisheye' is unknown; choose one of projective"),
        (
            ["solve", "a.txt", "--method", "gradient-descent", "--linear-solver", "dense"],
            "--linear-solver 'dense' with --method 'gradient-descent'",
        ),
        (["solve", "a.txt", "--linear-solver", "qr"], "'qr' is unknown; choose one of auto"),
        (["solve", "a.txt", "--loss", "l1"], "'l1' is unknown; choose one of squared"),
        (["solve", "a.txt", "--gauge", "loose"], "'loose' is unknown"),
        (["solve", "a.txt", "--loss-scale-px", "wide"], "'wide' is neither a number"),
        (["solve", "a.txt", "--max-iterations", "many"], "'--max-iterations': 'many'"),
        (["solve", "a.txt", "--max-iterations", "3.5"], "'--max-iterations': '3.5'"),
        (["solve", "a.txt", "--function-tolerance", "tiny"], "'--function-tolerance': 'tiny'"),
        (["solve", "a.txt", "--max-iterations", "-3"], "--max-iterations -3: must be at least 0"),
        (["solve", "a.txt", "--max-seconds", "nan"], "--max-seconds nan"),
        (["solve", "a.txt", "--refine", "f,"], "'f,' holds an empty name"),
        (["convert", "a.txt"], "OUT"),
        (["solve", "a.txt", "-o"], "'-o' requires an argument (see 'sfmcpp solve --help')"),
        (["solve", ""], "''"),
        (["solve", "a.txt", "--output="], "'--output='"),
        (["solve", "a.txt", "b.txt"], "(b.txt); an output is given by its option: -o PATH (see"),
        (["doctor", "a.txt", "b.txt"], "unexpected extra argument(s) (b.txt) (see"),  # it has no -o
        (["solve", "a.txt", "-max-iterations", "3"], "-m; did you mean --max-iterations? (see"),
        (["solve", "a.txt", "-max-iterations=3"], "-m; did you mean --max-iterations? (see"),
        (["solve", "a.txt", "-O", "b.txt"], "No such option: -O (see"),
        (["slam", "a", "--calib", "K.txt"], "--calib; did you mean --camera? (see"),
        (["slam", "a", "--imu", "a.csv"], "--imu; did you mean --sensor imu? (see"),
        (["solve", "a.txt", "-j", "4"], "-j; did you mean --threads? (see"),
        (["solve", "a.txt", "--robust", "huber"], "--robust; did you mean --loss? (see"),
        (["reconstruct", "--image_path", "a"], "--image_path; the input is given without an option (see"),
        (["--quiet", "solve", "a.txt"], "--quiet; options come after the name of a command (see"),
        (["--solve", "a.txt"], "--solve; commands have no hyphens: solve (see"),
        ([__file__], f"; a command comes before the input, such as 'sfmcpp info {__file__}' (see"),
    ],
)
def test_bad_usage_is_one_line_before_any_file_is_looked_at(arguments: list[str], told: str) -> None:
    result = run_here(*arguments)
    assert result.returncode == 2
    assert is_one_error_line(result)
    assert told in result.stderr


@pytest.mark.parametrize("value", ["x" * 100_000, "of words " * 10_000])
def test_of_a_long_value_the_ends_are_told(value: str) -> None:
    for option, told in (
        ("--loss", "is unknown; choose one of squared"),
        ("--max-iterations", "solve --help"),
    ):
        refused = run_here("solve", "a.txt", option, value)
        assert refused.returncode == 2
        assert is_one_error_line(refused)
        assert f"{option}': '{value[:100]}" in refused.stderr
        assert told in refused.stderr
        assert len(refused.stderr) < 3000
    missing = run_here("solve", f"{'d' * 200}/{'e' * 200}/none.txt")
    assert f"{'d' * 200}/{'e' * 200}/none.txt: no such file" in missing.stderr


def test_the_file_and_the_line_at_fault_are_named(tmp_path: Path) -> None:
    source = tmp_path / "bad.txt"
    source.write_text("1 1 1\n0 0 1.0 2.0\n" + "0\n" * 8 + "x\n" + "0\n" * 3)
    result = run_here("solve", source, "-o", tmp_path / "out.txt")
    assert result.returncode == 2
    assert is_one_error_line(result)
    assert result.stderr.startswith(f"sfmcpp: error: {source}:11: ")
    assert list(tmp_path.iterdir()) == [source]


def test_a_missing_input_is_named(tmp_path: Path) -> None:
    result = run_here("solve", tmp_path / "absent.txt")
    assert result.returncode == 2
    assert is_one_error_line(result)
    assert f"{tmp_path / 'absent.txt'}: " in result.stderr


@pytest.mark.parametrize("command", ["solve", "doctor"])
@pytest.mark.parametrize(
    ("name", "other"),
    [
        ("photos", "it lacks cameras.bin, images.bin, points3D.bin; sfmcpp reconstruct makes a model of the"),
        ("photos/a.jpg", "; sfmcpp reconstruct makes a model of a folder of photos"),
        ("drive.mat", "; sfmcpp slam reads videos and drives"),
        ("drive.mp4", "; sfmcpp slam reads videos and drives"),
        ("drive.bag", "; sfmcpp bag makes files for sfmcpp slam of a bag"),
    ],
)
def test_the_command_for_what_is_no_problem_is_named(
    command: str, name: str, other: str, tmp_path: Path
) -> None:
    (tmp_path / "photos").mkdir()
    for file in ("photos/a.jpg", "drive.mat", "drive.mp4", "drive.bag"):
        (tmp_path / file).write_bytes(b"\0")
    result = run_here(command, name, cwd=tmp_path)
    assert result.returncode == 2
    assert is_one_error_line(result)
    assert other in result.stderr
    missing = run_here(command, "absent.bag", cwd=tmp_path)
    assert missing.stderr == "sfmcpp: error: absent.bag: no such file or directory\n"


def test_a_problem_that_cannot_be_solved_is_named_with_its_file(tmp_path: Path) -> None:
    problem = noisy_circle()
    for name in ("camera_index", "point_index", "pixels"):
        setattr(problem, name, getattr(problem, name)[:4])
    source = tmp_path / "few.npz"
    sfmcpp.write(problem, source)
    result = run_here("solve", source, "-o", tmp_path / "out.npz", "--report", tmp_path / "report.json")
    assert result.returncode == 2
    assert is_one_error_line(result)
    assert result.stderr.startswith(f"sfmcpp: error: {source}: ")
    assert list(tmp_path.iterdir()) == [source]


@pytest.mark.parametrize(
    ("option", "name", "told"),
    [
        ("-o", "out.unknown", "no format"),
        ("-o", "absent/out.npz", "does not exist"),
        ("-o", "folder.npz", "is a directory"),
        ("--report", "absent/report.json", "does not exist"),
        ("--report", "folder.npz", "is a directory"),
        ("--report", "start.npz", "named twice"),
        ("--plot", "out.gif", ".png, .svg, .pdf"),
        ("--plot", "absent/out.png", "does not exist"),
    ],
)
def test_a_target_that_cannot_be_written_is_refused_before_the_input_is_read(
    tmp_path: Path, option: str, name: str, told: str
) -> None:
    source = tmp_path / "start.npz"
    source.write_bytes(b"not a problem: reading it would fail with another message")
    (tmp_path / "folder.npz").mkdir()
    result = run_here("solve", source, option, tmp_path / name)
    assert result.returncode == 2
    assert is_one_error_line(result)
    assert result.stderr.startswith(f"sfmcpp: error: {tmp_path / name}: ")
    assert told in result.stderr
    assert sorted(path.name for path in tmp_path.iterdir()) == ["folder.npz", "start.npz"]


@pytest.mark.parametrize(
    "command", [["solve", "start.npz"], ["evaluate", "start.npz", "--truth", "start.npz"]]
)
def test_a_report_to_the_standard_output_is_refused(tmp_path: Path, command: list[str]) -> None:
    write_noisy_circle(tmp_path)
    result = run_here(*command, "--report", "-", cwd=tmp_path)
    assert result.returncode == 2
    assert result.stderr == "sfmcpp: error: -: nothing is written to the standard output, a file is wanted\n"
    assert [path.name for path in tmp_path.iterdir()] == ["start.npz"]


@pytest.mark.parametrize(
    "command", [["solve", "start.npz", "-o", "model"], ["convert", "start.npz", "model"]]
)
def test_a_colmap_model_with_rigs_is_not_replaced_by_one_without_and_no_work_is_done_in_vain(
    tmp_path: Path, command: list[str]
) -> None:
    model = tmp_path / "model"
    write_noisy_circle(tmp_path)
    sfmcpp.write(noisy_circle(), model)
    (model / "frames.bin").write_bytes(b"")
    before = {path.name: path.read_bytes() for path in model.iterdir()}
    result = run_here(*command, cwd=tmp_path)
    assert (result.returncode, result.stdout) == (2, "")
    assert is_one_error_line(result)
    assert "frames.bin: the model that is there would be replaced" in result.stderr
    assert before == {path.name: path.read_bytes() for path in model.iterdir()}


def test_intrinsics_that_the_format_cannot_hold_once_refined_are_refused_before_the_solve(
    tmp_path: Path,
) -> None:
    sfmcpp.write(noisy_circle(camera_model="perspective"), tmp_path / "model")
    source, target, report = (tmp_path / name for name in ("model", "refined", "report.json"))
    asked = ("--refine", "f,k4", "--report", report)
    result = run_here("solve", source, "-o", target, *asked)
    assert result.returncode == 2
    assert is_one_error_line(result)
    assert f"{target}: " in result.stderr
    assert "k4" in result.stderr
    assert list(tmp_path.iterdir()) == [source]
    assert run_here("solve", source, "-o", target, "--refine", "f,k1,k2").returncode == 0


def test_a_result_that_its_format_cannot_hold_is_refused_before_the_solve(tmp_path: Path) -> None:
    problem = noisy_circle(camera_model="perspective")
    problem.intrinsics[:, problem.intrinsic_names.index("k5")] = 1e-9
    source, report = tmp_path / "start.npz", tmp_path / "report.json"
    sfmcpp.write(problem, source)
    result = run_here("solve", source, "-o", tmp_path / "out.txt", "--report", report)
    assert result.returncode == 2
    assert is_one_error_line(result)
    assert f"{tmp_path / 'out.txt'}: " in result.stderr
    assert "k5" in result.stderr
    assert list(tmp_path.iterdir()) == [source]


def test_a_wish_that_the_camera_model_does_not_have_names_the_file(tmp_path: Path) -> None:
    source = write_noisy_circle(tmp_path, camera_model="bal")
    result = run_here("solve", source, "--refine", "k9")
    assert result.returncode == 2
    assert is_one_error_line(result)
    assert f"{source}: " in result.stderr
    assert "'k9'" in result.stderr


def test_a_numerical_failure_still_writes_a_strict_report_and_the_state(tmp_path: Path) -> None:
    problem = noisy_circle()
    problem.points[0] = problem.centres[problem.camera_index[problem.point_index == 0][0]]
    source, output, report = (tmp_path / name for name in ("start.npz", "out.npz", "report.json"))
    sfmcpp.write(problem, source)
    result = run_here("solve", source, "-o", output, "--report", report, "--quiet")
    assert result.returncode == 3
    assert is_one_error_line(result)
    content = strict_json(report)
    assert (content["termination"], content["final_cost"]) == ("numerical_failure", None)
    assert (sfmcpp.read(output).points == problem.points).all()


def test_a_closed_stdout_or_stderr_does_not_stop_a_solve(tmp_path: Path) -> None:
    source = write_noisy_circle(tmp_path)
    for closed in (">&-", "2>&-", ">&- 2>&-"):
        output = tmp_path / "out.npz"
        script = f'"$0" -m sfmcpp solve "$1" -o "$2" {closed}'
        done = subprocess.run(
            ["bash", "-c", script, COMMAND[0], source, output], capture_output=True, timeout=TIMEOUT_S
        )
        assert (done.returncode, done.stderr) == (0, b""), closed
        assert sfmcpp.cost(sfmcpp.read(output)) < sfmcpp.cost(sfmcpp.read(source)) / 100
        output.unlink()


LOGGING_LIBRARY = """
import logging, sys
from sfmcpp.cli import demo
from sfmcpp.cli.main import main

log = logging.getLogger("matplotlib.font_manager")
demo.demo = lambda: log.warning("building the font cache") or log.error("no font") or 0
code = main(["demo"])
log.warning("said again")
sys.exit(code)
"""


def test_what_libraries_log_below_an_error_is_not_said() -> None:
    command = [sys.executable, "-c", LOGGING_LIBRARY]
    done = subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT_S)
    assert (done.returncode, done.stderr) == (0, "no font\nsaid again\n")


def test_a_reader_that_leaves_does_not_make_noise(tmp_path: Path) -> None:
    source, output = write_noisy_circle(tmp_path), tmp_path / "out.npz"
    script = 'set -o pipefail; "$0" -m sfmcpp solve "$1" -o "$2" | sleep 0'
    done = subprocess.run(
        ["bash", "-c", script, COMMAND[0], source, output], capture_output=True, timeout=TIMEOUT_S
    )
    assert (done.returncode, done.stderr) == (0, b"")
    assert output.exists()


@pytest.mark.parametrize("arguments", ["--help", "--version", "demo -o $0"])
def test_a_full_disk_under_stdout_is_one_line(tmp_path: Path, arguments: str) -> None:
    script = f'"$1" -m sfmcpp {arguments} >/dev/full'
    done = subprocess.run(
        ["bash", "-c", script, tmp_path, COMMAND[0]], capture_output=True, text=True, timeout=TIMEOUT_S
    )
    assert done.returncode == 2
    assert is_one_error_line(done)
    assert "standard output: No space left on device" in done.stderr


def test_an_encoding_without_the_table_s_characters_does_not_stop_a_solve(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONIOENCODING", "ascii")
    result = run("solve", write_noisy_circle(tmp_path))
    assert (result.returncode, result.stderr) == (0, "")
    assert "converged" in result.stdout


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a device of Linux")
def test_a_full_disk_behind_a_stream_is_named_and_changes_no_exit_code(tmp_path: Path) -> None:
    source, target = write_noisy_circle(tmp_path), tmp_path / "out.npz"
    with Path("/dev/full").open("w") as full:
        told = subprocess.run(
            [*COMMAND, "solve", source, "-o", target], stdout=full, stderr=subprocess.PIPE, text=True
        )
        untold = subprocess.run([*COMMAND, "solve", tmp_path / "none.npz"], stderr=full)
    assert told.stderr == "sfmcpp: error: standard output: No space left on device\n"
    assert (told.returncode, untold.returncode) == (2, 2)
    sfmcpp.read(target)


@pytest.mark.parametrize("number", ["", "no number", "-1"])
def test_an_environment_that_no_launcher_has_made_is_none(
    tmp_path: Path, number: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("PMI_SIZE", "PMI_RANK", "OMPI_COMM_WORLD_SIZE", "OMPI_COMM_WORLD_RANK"):
        monkeypatch.setenv(name, number)
    result = run_here("solve", write_noisy_circle(tmp_path), "-o", tmp_path / "out.npz")
    assert (result.returncode, result.stderr) == (0, "")
    assert "converged" in result.stdout


def test_help_that_nobody_reads_to_its_end_is_no_failure() -> None:
    reading, writing = os.pipe()
    os.close(reading)
    for words in (["--help"], ["solve", "--help"]):
        result = subprocess.run([*COMMAND, *words], stdout=writing, stderr=subprocess.PIPE, text=True)
        assert (result.returncode, result.stderr) == (0, "")
    os.close(writing)


def test_a_module_that_cannot_be_loaded_is_told_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "typer.py").write_text("raise ImportError('libblas.so: failed to map segment')\n")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")]))
    result = run("--version")
    assert result.returncode == 2
    assert is_one_error_line(result)
    assert "failed to map segment" in result.stderr


def test_a_limit_of_memory_is_told_by_the_option_of_the_command_line(tmp_path: Path) -> None:
    result = run_here("solve", write_noisy_circle(tmp_path), "--max-memory", "1KB")
    assert result.returncode == 2
    assert ": --max-memory 1000: the leanest, 'iterative', would need" in result.stderr
