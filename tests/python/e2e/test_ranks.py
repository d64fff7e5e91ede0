"""Processes of MPI that solve one problem together: the answer of one, and an end where one of them fails."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent
TESTS = HERE.parent
MPIEXEC = Path(sys.executable).parent / "mpiexec"
TIMEOUT_S = 240

pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("mpi4py") is None or not MPIEXEC.exists(),
    reason="no mpi4py with an mpiexec beside Python: pip install sfmcpp[mpi]",
)


def on_ranks(count: int, *arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """Run a program of Python on several ranks, each with one thread of the libraries below NumPy."""
    command = [MPIEXEC, "-n", str(count), sys.executable, "-m", "mpi4py", *arguments]
    return subprocess.run(
        [*map(str, command)],
        capture_output=True,
        text=True,
        timeout=TIMEOUT_S,
        cwd=HERE,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
    )


def case(count: int, *arguments: object) -> subprocess.CompletedProcess[str]:
    return on_ranks(count, "rank_cases.py", *map(str, arguments))


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
    "unit/ba/test_point_steps.py",
    "unit/weighting/test_weight_selection.py",
)
METHODS = ("bindings/test_methods.py", "bindings/test_projective.py")
LEFT_OUT = "interrupt or scipy or other_threads or trade_off or median or folds"


@pytest.mark.parametrize(("count", "files", "least"), [(2, SOLVING + METHODS, 250), (3, METHODS, 80)])
def test_the_tests_that_solve_pass_on_several_ranks(
    count: int, files: tuple[str, ...], least: int, tmp_path: Path
) -> None:
    arguments = f"-p under_ranks -p no:cacheprovider -q --basetemp {tmp_path / 'ranks'}".split()
    result = on_ranks(
        count, "-m", "pytest", *arguments, "-k", f"not ({LEFT_OUT})", *(TESTS / name for name in files)
    )
    require_success(result)
    assert int(result.stdout.split(" passed")[0].split()[-1]) >= least


@pytest.mark.parametrize("count", [2, 3])
@pytest.mark.parametrize("how", ["bal lm-nielsen", "projective lm-nielsen", "bal conjugate-gradient"])
def test_steps_are_those_of_one_process(how: str, count: int) -> None:
    require_success(case(count, "steps_of_the_whole", *how.split()))


@pytest.mark.parametrize("count", [2, 3])
def test_what_one_rank_gets_wrong_all_refuse(count: int) -> None:
    require_success(case(count, "refusals"))


@pytest.mark.parametrize("name", ["callback_that_fails", "interrupt"])
@pytest.mark.parametrize("rank", [0, 1])
def test_what_one_rank_meets_all_heed(name: str, rank: int) -> None:
    require_success(case(2, name, rank))


# At the first collective, while parts are sent, and within the solve.
@pytest.mark.parametrize("successes", [0, 4, 20, 60])
@pytest.mark.parametrize(("kind", "rank", "said"), [("memory", 1, "no room"), ("death", 0, "")])
def test_a_rank_that_fails_ends_all(kind: str, rank: int, said: str, successes: int) -> None:
    result = case(2, "fault", kind, rank, successes)
    assert result.returncode != 0
    assert "not reached" not in result.stdout
    assert said in result.stderr
