"""Processes of MPI that solve one problem together: the answer of one, and an end where one of them fails."""

from __future__ import annotations

import importlib.util
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from conftest import TIMEOUT_S

import sfmcpp
from cli_helpers import is_one_error_line, run_here, strict_json, write_noisy_circle
from sfmcpp.cli import reading_apart
from sfmcpp.sources.synthetic import corridor_scene, perturb

HERE = Path(__file__).parent
TESTS = HERE.parent
MPIEXEC = Path(sys.executable).parent / "mpiexec"

pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("mpi4py") is None or not MPIEXEC.exists(),
    reason="no mpi4py with an mpiexec beside Python: pip install sfmcpp[mpi]",
)


# Each with one thread of the libraries below NumPy.
ENVIRONMENT = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}


def on_ranks(count: int, *arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """Run Python on several ranks."""
    command = [MPIEXEC, "-n", str(count), sys.executable, *arguments]
    return subprocess.run(
        [*map(str, command)], capture_output=True, text=True, timeout=TIMEOUT_S, cwd=HERE, env=ENVIRONMENT
    )


def cases(count: int, *several: tuple[object, ...]) -> subprocess.CompletedProcess[str]:
    """Cases with their arguments, one after the other: to start processes takes longer than most cases do."""
    words = [str(word) for one in several for word in (*one, ",")]
    return on_ranks(count, "-m", "mpi4py", "rank_cases.py", *words)


def solve_file(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """Run the command line on two ranks."""
    return on_ranks(2, "-m", "sfmcpp", "solve", *arguments)


def require_success(result: subprocess.CompletedProcess[str]) -> None:
    assert result.returncode == 0, result.stdout[-5000:] + result.stderr[-5000:]


# All tests that solve, but for those of signals and of times, those that take long for other reasons (many
# fits, those of SciPy), and where a thread of one process changes what another solves.
SOLVING = (
    "bindings/test_constraints.py",
    "bindings/test_constraint_refusals.py",
    "bindings/test_covariances.py",
    "bindings/test_options.py",
    "bindings/test_solve.py",
    "unit/ba/test_intrinsic_steps.py",
    "unit/ba/test_point_steps.py",
    "unit/weighting/test_weight_selection.py",
)
METHODS = ("bindings/test_methods.py", "bindings/test_projective.py")
RIGS = ("unit/ba/test_rigs.py", "unit/ba/test_free_sensors.py")
LEFT_OUT = "interrupt or scipy or other_threads or trade_off or median or folds"


# No code tells two ranks from three, and steps of several methods on two are compared below.
@pytest.mark.parametrize(("count", "files", "least"), [(2, SOLVING + RIGS, 330), (3, METHODS, 85)])
def test_the_tests_that_solve_pass_on_several_ranks(
    count: int, files: tuple[str, ...], least: int, tmp_path: Path
) -> None:
    arguments = f"-p under_ranks -p no:cacheprovider -q --basetemp {tmp_path / 'ranks'}".split()
    result = on_ranks(
        count,
        "-m",
        "mpi4py",
        "-m",
        "pytest",
        *arguments,
        "-k",
        f"not ({LEFT_OUT})",
        *(TESTS / name for name in files),
    )
    require_success(result)
    assert int(result.stdout.split(" passed")[0].split()[-1]) >= least


@pytest.mark.parametrize(
    ("count", "ways"),
    [
        (2, ("bal lm-nielsen", "projective lm-nielsen", "bal conjugate-gradient", "projective lm t-als")),
        (3, ("bal lm-nielsen", "projective lm-nielsen", "bal lm g-als")),
    ],
)
def test_steps_are_those_of_one_process(count: int, ways: tuple[str, ...]) -> None:
    require_success(cases(count, *(("steps_of_the_whole", *way.split()) for way in ways)))


@pytest.mark.parametrize("count", [2, 3])
def test_conjugate_gradients_are_those_of_one_process(count: int) -> None:
    require_success(cases(count, ("preconditioners",), ("same_bits",)))


@pytest.mark.parametrize(
    ("name", "count"), [("parts_of_files", 2), ("parts_of_files", 4), ("bad_files", 3), ("slow_locks", 2)]
)
def test_each_rank_reads_its_part_of_a_file(name: str, count: int, tmp_path: Path) -> None:
    require_success(cases(count, (name, tmp_path)))


@pytest.mark.parametrize("count", [2, 3])
def test_checkpoints_of_all_ranks_are_taken_up_together(count: int, tmp_path: Path) -> None:
    require_success(cases(count, ("checkpoints", tmp_path)))


def test_a_killed_command_goes_on_from_what_all_ranks_have_saved(tmp_path: Path) -> None:
    source, kept = write_noisy_circle(tmp_path, camera_model="bal"), tmp_path / "kept"
    words = [source, "--function-tolerance", "0", "--max-iterations", "6"]
    require_success(solve_file(*words, "-o", tmp_path / "whole.npz"))
    words = [*words, "--checkpoint", kept, "--checkpoint-every", "0"]
    assert on_ranks(2, "rank_cases.py", "command_killed_at", "4", "1", *words).returncode != 0
    require_success(solve_file(*words, "--resume", kept, "-o", tmp_path / "again.npz"))
    assert (tmp_path / "again.npz").read_bytes() == (tmp_path / "whole.npz").read_bytes()
    alone = run_here("solve", source, "--resume", kept)
    assert "holds the checkpoints of 2 ranks" in alone.stderr


def test_weights_are_chosen_where_each_rank_brings_its_part() -> None:
    require_success(cases(3, ("weights_of_parts",)))


def test_parts_need_not_be_problems_by_themselves() -> None:
    require_success(on_ranks(3, "-m", "mpi4py", "ranks_of_little.py"))


@pytest.mark.parametrize("count", [2, 3])
def test_what_one_rank_gets_wrong_all_refuse(count: int) -> None:
    require_success(cases(count, ("refusals",)))


def test_what_one_rank_meets_all_heed() -> None:
    met = [(name, rank) for name in ("callback_that_fails", "interrupt") for rank in (0, 1)]
    require_success(cases(2, *met))


# At the first collective, while parts are sent, and within the solve.
@pytest.mark.parametrize("successes", [0, 4, 20, 60])
@pytest.mark.parametrize(("kind", "rank", "said"), [("memory", 1, "no room"), ("death", 0, "")])
def test_a_rank_that_fails_ends_all(kind: str, rank: int, said: str, successes: int) -> None:
    result = cases(2, ("fault", kind, rank, successes))
    assert result.returncode != 0
    assert "not reached" not in result.stdout
    assert said in result.stderr


def test_the_command_line_solves_on_all_ranks_and_one_of_them_speaks(tmp_path: Path) -> None:
    source = write_noisy_circle(tmp_path, camera_model="bal")
    output, report = tmp_path / "out.npz", tmp_path / "report.json"
    result = solve_file(source, "-o", output, "--report", report, "--refine", "f")
    assert (result.returncode, result.stderr) == (0, "")
    assert result.stdout.count("termination") == 1
    content = strict_json(report)
    assert sfmcpp.cost(sfmcpp.read(output)) == pytest.approx(content["final_cost"], rel=1e-9)
    whole = sfmcpp.read(source).set_free_intrinsics("f")
    steps = [i.cost for i in sfmcpp.solve(whole).iterations]
    np.testing.assert_allclose([i["cost"] for i in content["iterations"]], steps, rtol=1e-9)
    loads = content["ranks"]
    assert sum(load["points"] for load in loads) == whole.num_points
    assert sum(load["observations"] for load in loads) == whole.num_observations
    assert all(load["seconds_computing"] > 0 and load["seconds_waiting"] > 0 for load in loads)
    assert 0 < sum(i["bytes_sent"] for i in content["iterations"]) <= loads[0]["bytes_sent"]
    assert len(content["peak_memory_bytes_of_ranks"]) == 2


@pytest.mark.parametrize(("name", "loaded"), [("whole.parts", [[], []]), ("whole.npz", [["scipy"], []])])
def test_a_rank_loads_no_library_that_it_does_not_need(
    name: str, loaded: list[list[str]], tmp_path: Path
) -> None:
    """A rank pays for what it loads; SciPy orders the cameras of a whole file, for all ranks on one."""
    sfmcpp.write(sfmcpp.circle_scene(8, 400, camera_model="bal"), tmp_path / name)
    result = on_ranks(2, "rank_cases.py", "libraries_of_command", tmp_path / name)
    require_success(result)
    assert result.stdout.strip() == str(loaded)


@pytest.mark.parametrize(("fate", "code"), [("sleeps", 3), ("is killed", 2), ("fails", 2)])
def test_a_child_that_does_not_read_the_arguments_ends_nothing_or_all(
    fate: str, code: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What it does not read within its time the rank reads itself."""
    rank = os.getpid()

    def read() -> int:
        if os.getpid() == rank:
            return 3
        if fate == "is killed":
            os.kill(os.getpid(), signal.SIGKILL)
        if fate == "sleeps":
            time.sleep(TIMEOUT_S)
        raise RuntimeError

    monkeypatch.setattr(reading_apart, "_PATIENCE_S", 0.5 if fate == "sleeps" else TIMEOUT_S)
    assert reading_apart.solve_as_read_apart(read) == code


@pytest.mark.parametrize("solver", ["dense", "sparse"])
def test_of_the_reduced_matrix_only_what_is_not_zero_is_sent(solver: str, tmp_path: Path) -> None:
    """In a corridor a camera shares points with some neighbours."""
    problem = corridor_scene(num_cameras=60, num_points=800, length_m=60.0, camera_model="bal")
    source, report = tmp_path / "corridor.npz", tmp_path / "report.json"
    sfmcpp.write(perturb(problem, seed=0, point_sigma_m=0.05), source)
    sees = np.zeros((problem.num_points, problem.num_cameras), dtype=int)
    sees[problem.point_index, problem.camera_index] = 1
    blocks = np.count_nonzero(np.tril(sees.T @ sees))
    arguments = ("--linear-solver", solver, "--max-iterations", "2", "--report", report)
    require_success(solve_file(source, "-o", tmp_path / "out.npz", *arguments))
    step = strict_json(report)["iterations"][1]
    beside = 12 * 8 * 9 * problem.num_cameras  # vectors, and diagonal blocks for the damping
    assert 0 < step["bytes_sent"] < 8 * 81 * blocks + beside
    assert blocks < 0.3 * problem.num_cameras**2 / 2


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (("--max-iterations", "-1"), "--max-iterations -1"),  # before the input is read
        (("--camera-model", "projective", "--gauge", "fixed"), "camera_model = 'projective'"),  # by the core
    ],
)
def test_what_is_wrong_is_said_once(arguments: tuple[str, ...], reason: str, tmp_path: Path) -> None:
    result = solve_file(write_noisy_circle(tmp_path), *arguments)
    assert result.returncode == 2
    assert is_one_error_line(result), result.stderr
    assert reason in result.stderr


@pytest.mark.parametrize(
    ("others", "named"),
    [
        (("solve", "IN", "-o", "out.npz"), "targets of the command"),  # which only some would write
        (("solve", "IN", "--max-iterations", "3"), "options of the command"),
        (("convert", "IN", "out.parts"), "command"),
    ],
)
def test_ranks_that_were_given_other_commands_do_not_wait_for_each_other(
    others: tuple[str, ...], named: str, tmp_path: Path
) -> None:
    source = write_noisy_circle(tmp_path)
    paths = {"IN": str(source), **{name: str(tmp_path / name) for name in ("out.npz", "out.parts")}}
    mine = [sys.executable, "-m", "sfmcpp", "solve", str(source)]
    theirs = [*mine[:3], *(paths.get(a, a) for a in others)]
    result = subprocess.run(
        [str(MPIEXEC), "-n", "1", *mine, ":", "-n", "1", *theirs],
        capture_output=True,
        text=True,
        timeout=TIMEOUT_S,
        env=ENVIRONMENT,
    )
    assert result.returncode == 2
    assert is_one_error_line(result), result.stderr
    assert f"{named}: differs between ranks 0 and 1, must be the same on all" in result.stderr
    assert not (tmp_path / "out.npz").exists()


def test_each_rank_may_have_its_own_number_of_threads(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "sfmcpp", "solve", str(write_noisy_circle(tmp_path)), "--threads"]
    result = subprocess.run(
        [str(MPIEXEC), "-n", "1", *command, "1", ":", "-n", "1", *command, "2"],
        capture_output=True,
        text=True,
        timeout=TIMEOUT_S,
        env=ENVIRONMENT,
    )
    require_success(result)


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("solve", "a.npz", "--frobnicate"), "sfmcpp: error: No such option: --frobnicate"),
        (("convert", "a.npz"), "sfmcpp: error: Missing argument 'OUT'"),
        (("solve", ""), "sfmcpp: error: argument ''"),
        (("slov", "a.npz"), "sfmcpp: error: No such command 'slov'"),
        (("--version",), "sfmcpp 0."),
        (("solve", "--help"), "Usage: sfmcpp solve"),
        (("demo", "-o", "folder"), "The demo is in "),
    ],
)
def test_what_all_processes_would_say_is_said_once(
    arguments: tuple[str, ...], told: str, tmp_path: Path
) -> None:
    """Before MPI is asked which of them is the first, too."""
    given = [str(tmp_path / a) if a == "folder" else a for a in arguments]
    result = on_ranks(2, "-m", "sfmcpp", *given)
    assert result.returncode == (2 if "error" in told else 0)
    assert (result.stdout + result.stderr).count(told) == 1


def test_what_is_no_work_of_all_each_process_says(tmp_path: Path) -> None:
    result = on_ranks(2, "-m", "sfmcpp", "info", write_noisy_circle(tmp_path))
    require_success(result)
    assert result.stdout.count("observations    ") == 2


def test_processes_that_cannot_reach_each_other_are_told(tmp_path: Path) -> None:
    result = subprocess.run(
        [sys.executable, "-m", "sfmcpp", "solve", write_noisy_circle(tmp_path)],
        capture_output=True,
        text=True,
        timeout=TIMEOUT_S,
        env={**ENVIRONMENT, "OMPI_COMM_WORLD_SIZE": "2", "PYTHONWARNINGS": "ignore"},
    )
    assert result.returncode == 2
    assert "2 processes were started, and each is alone" in result.stderr


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_to_the_launcher_ends_all_with_the_best_state(tmp_path: Path, number: int) -> None:
    source, output = write_noisy_circle(tmp_path), tmp_path / "out.npz"
    command = [MPIEXEC, "-n", "2", sys.executable, "rank_cases.py", "endless_command", source, output]
    with subprocess.Popen(
        [*map(str, command)], env=ENVIRONMENT, cwd=HERE, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
    ) as process:
        assert process.stderr is not None
        while process.stderr.readline().strip() not in (b"step 2", b""):
            pass
        process.send_signal(number)
        _, said = process.communicate(timeout=TIMEOUT_S)
    assert process.returncode == 130
    # MPICH's launcher may drop what is said after SIGTERM.
    assert number == signal.SIGTERM or b"the best state so far is in" in said
    assert sfmcpp.cost(sfmcpp.read(output)) < sfmcpp.cost(sfmcpp.read(source))
