"""What processes of MPI do in the tests of ranks.

``python -m mpi4py rank_cases.py CASE [ARGUMENT …] [, CASE [ARGUMENT …] …]``; a case that fails is named.
"""

from __future__ import annotations

import dataclasses
import os
import re
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import takewhile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI

import sfmcpp
from failing_ranks import Failing
from sfmcpp.ba.partition import partition_points
from sfmcpp.ba.parts import Part, part_of
from sfmcpp.ba.ranks import Ranks
from sfmcpp.cli import display
from sfmcpp.cli.main import main
from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.sources.io import atomic
from sfmcpp.sources.io import checkpoints as files_of_checkpoints
from sfmcpp.sources.io import parts as parts_files
from sfmcpp.sources.io.api import read_part, write_part
from sfmcpp.sources.io.atomic import atomic_files
from sfmcpp.sources.io.parts import write_parts

COMM = MPI.COMM_WORLD


def scene() -> sfmcpp.Problem:
    """A circle, away from its minimum."""
    truth = sfmcpp.circle_scene(8, 401, camera_model="bal", pixel_sigma_px=1.0, seed=1)
    return sfmcpp.perturb(truth, point_sigma_m=0.5, position_sigma_m=0.5, rotation_sigma_deg=5.0, seed=2)


def own_part(whole: sfmcpp.Problem) -> sfmcpp.Problem:
    return part_of(whole, np.flatnonzero(partition_points(whole, COMM.size) == COMM.rank)).problem


OPTIONS: dict[str, Any] = {"function_tolerance": 0.0, "max_iterations": 10, "threads": 1}


def steps_of_the_whole(camera_model: str, method: str, line_search: str = "none") -> None:
    """Ten steps cost what those of one process do; cut by the solve or before it, with the same bits."""
    less_rounding = {"initial_damping": 1e-4, "acceleration": "none"} if method == "lm-nielsen" else {}
    how: Any = {"method": method, "line_search": line_search, **less_rounding}
    start = sfmcpp.as_projective(scene()) if camera_model == "projective" else scene()
    alone, given, brought = start.copy(), start.copy(), own_part(start)
    expected = sfmcpp.solve(alone, **how, **OPTIONS)
    found = sfmcpp.solve(given if COMM.rank == 0 else None, **how, comm=COMM, **OPTIONS)
    repeated = sfmcpp.solve(brought, **how, comm=COMM, **OPTIONS)
    of_whole, of_given, of_brought = ([i.cost for i in s.iterations] for s in (expected, found, repeated))
    # Rounding decides when a step at the minimum is no longer one.
    both = min(len(of_whole), len(of_given))
    assert both > 6
    np.testing.assert_allclose(of_given[:both], of_whole[:both], rtol=1e-9)
    assert of_given == of_brought
    if COMM.rank == 0:
        np.testing.assert_allclose(given.points, alone.points, rtol=1e-6, atol=1e-6)
        assert np.array_equal(given.cameras, brought.cameras)


def preconditioners() -> None:
    """Blocks between cameras help as they do in one process, with the same bits in every run."""
    truth = sfmcpp.city_blocks_scene(60, seed=1)
    start = sfmcpp.perturb(truth, position_sigma_m=0.2, seed=2)

    def iterations(problem: sfmcpp.Problem | None, **how: Any) -> list[sfmcpp.Iteration]:
        how = {"linear_solver": "iterative", "max_iterations": 2, "threads": 1, **how}
        return sfmcpp.solve(problem, **how).iterations

    for name in ("clusters", "two-levels"):
        solved: Any = {"preconditioner": name, "pcg_tolerance": 1e-8}
        alone = iterations(start.copy(), **solved)
        given = iterations(start.copy() if COMM.rank == 0 else None, comm=COMM, **solved)
        brought = iterations(own_part(start), comm=COMM, **solved)
        assert [i.cost for i in given] == [i.cost for i in brought]
        np.testing.assert_allclose([i.cost for i in given], [i.cost for i in alone], rtol=1e-7)
        # How often residuals are corrected in double precision below that is up to rounding.
        met_at_once: Any = {"preconditioner": name, "pcg_tolerance": 1e-4}
        alone, given = (
            iterations(problem, **comm, **met_at_once)
            for problem, comm in ((start.copy(), {}), (own_part(start), {"comm": COMM}))
        )
        counts = [[i.linear_solver_iterations for i in steps] for steps in (given, alone)]
        np.testing.assert_allclose(*counts, rtol=0.1)


def same_bits() -> None:
    """Conjugate gradients, linear or not, have the bits of one process, however points are divided."""
    truth = sfmcpp.city_blocks_scene(60, seed=1)
    city = sfmcpp.perturb(truth, position_sigma_m=0.3, point_sigma_m=0.3, seed=2)
    pairs = np.stack([np.arange(38), np.arange(20, 58)], axis=1)  # of cameras that lie far apart
    distances = np.linalg.norm(truth.centres[pairs[:, 1]] - truth.centres[pairs[:, 0]], axis=1)
    between = sfmcpp.ConstraintGroup("scale", pairs, distances, sigma=0.01)
    ways: tuple[dict[str, Any], ...] = (
        {"preconditioner": "clusters"},
        {"preconditioner": "schur-jacobi", "precision": "single"},
        {"preconditioner": "clusters", "loss": "huber", "method": "dog-leg"},
        {"preconditioner": "two-levels", "pcg_tolerance": 1e-8},
        {"preconditioner": "clusters", "pcg_tolerance": 1e-8, "precision": "single"},
        {"preconditioner": "two-levels", "constraints": [between]},
        {"line_search": "g-als"},
    )
    nonlinear: dict[str, Any] = {"method": "conjugate-gradient", "line_search": "t-als"}
    # Four steps have hundreds of products with S, each of which may differ.
    for start, how in (
        *((city, {"linear_solver": "iterative", "max_iterations": 4, **how}) for how in ways),
        (scene(), nonlinear),
        (sfmcpp.as_projective(scene()), nonlinear),
    ):
        alone, mine = start.copy(), own_part(start)
        how = OPTIONS | how
        costs = [i.cost for i in sfmcpp.solve(alone, **how).iterations]
        assert [i.cost for i in sfmcpp.solve(mine, comm=COMM, **how).iterations] == costs
        assert np.array_equal(mine.cameras, alone.cameras)
        assert np.array_equal(mine.points, own_part(alone).points)


def parts_of_files(folder: str) -> None:
    """Each rank reads its part of a file, the one that the cut of the whole gives it, and none reads all."""
    ranks, path = Ranks(COMM), Path(folder)
    whole = sfmcpp.circle_scene(40, 1_500, camera_model="bal", seed=1)
    whole = whole.with_observations(np.random.default_rng(3).permutation(whole.num_observations))
    whole.sigma_px = np.linspace(0.5, 2.0, whole.num_observations)
    files = {name: path / name for name in ("stored.npz", "packed.npz", "plain.txt", "text.parts")}
    if COMM.rank == 0:
        sfmcpp.write(whole, files["stored.npz"])
        with np.load(files["stored.npz"]) as archive:
            np.savez_compressed(files["packed.npz"], **archive)
        sfmcpp.write(whole, files["plain.txt"])
        numbers = files["plain.txt"].read_bytes().split()  # in lines that tell nothing
        files["plain.txt"].write_bytes(b"".join(n + b"\n "[len(n) % 2 :] for n in numbers))
        write_parts(whole, files["text.parts"], COMM.size)
    COMM.barrier()
    partition_points(whole, COMM.size)  # loads SciPy, which is reading, too
    for name, file in files.items():
        before = bytes_read()
        part = read_part(file, ranks)
        share = (bytes_read() - before) / sum(
            f.stat().st_size for f in (file, *file.glob("*")) if f.is_file()
        )
        assert name == "packed.npz" or share < 1.2 / COMM.size, (name, share)
        read = sfmcpp.read(file)
        assert_same_part(part, part_of(read, np.flatnonzero(partition_points(read, COMM.size) == COMM.rank)))
        write_part(part, path / "out.parts", ranks)
        write_part(part, path / "out.npz", ranks)
        COMM.barrier()
        for out in ("out.parts", "out.npz"):
            assert_same_part(part_of(sfmcpp.read(path / out), part.point_numbers), part)
        COMM.barrier()


def slow_locks(folder: str) -> None:
    """A file that one rank has made and not yet locked is not taken by another for one that was left."""
    part, path = part_of(scene(), np.flatnonzero(np.arange(401) % COMM.size == COMM.rank)), Path(folder)
    name, call = ("flock", atomic.fcntl.flock) if COMM.rank == 0 else ("digest", parts_files.digest)

    def slow(*arguments: Any) -> Any:
        time.sleep(0.5 if COMM.rank == 0 else 0.2)
        return call(*arguments)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(atomic.fcntl if COMM.rank == 0 else parts_files, name, slow)
        write_part(part, path / "out.parts", Ranks(COMM))
    assert len(sfmcpp.read(path / "out.parts").points) == 401


def bytes_read() -> int:
    """What this process has read of files so far [bytes]."""
    return int(Path("/proc/self/io").read_text().split()[1])


def assert_same_part(part: Part, other: Part) -> None:
    """Assert that all arrays have the same bits."""
    for name in (
        f.name for f in dataclasses.fields(sfmcpp.Problem) if f.name not in ("camera_model", "metadata")
    ):
        np.testing.assert_array_equal(getattr(part.problem, name), getattr(other.problem, name), err_msg=name)
    np.testing.assert_array_equal(part.point_numbers, other.point_numbers)
    np.testing.assert_array_equal(part.observation_numbers, other.observation_numbers)


def bad_files(folder: str) -> None:
    """What is wrong with a file all say, with the line that has it."""
    path = Path(folder) / "x.txt"
    good = b"2 3 2\n0 0 1.5 2\n1 2 1 2\n" + b"1\n" * 27
    damaged = {
        good.replace(b"1.5", b"1.5x"): "x.txt:2: '1.5x' is not a finite number",
        good.replace(b"1 2 1", b"1 3 1"): "x.txt:3: point index 3: must be an integer from 0 to 2",
        good[:-2]: "truncated: 2 cameras, 3 points, 2 observations take 38 numbers, the file has 37",
        good.replace(b"1 2 1 2", b"0 0 1 2"): "x.txt:3: observes the same point by the same camera as line 2",
    }
    for content, reason in damaged.items():
        COMM.barrier()
        if COMM.rank == 0:
            path.write_bytes(content)
        COMM.barrier()
        with pytest.raises(DatasetError, match=re.escape(reason)):
            read_part(path, Ranks(COMM))
    if COMM.rank == 0:
        write_parts(scene(), path.with_suffix(".parts"), 1)
    COMM.barrier()
    with pytest.raises(DatasetError, match=f"has 1 parts for {COMM.size} ranks"):
        read_part(path.with_suffix(".parts"), Ranks(COMM))


def weights_of_parts() -> None:
    """Where each rank brings its part, weights are those of the whole."""
    centres = scene().centres + np.random.default_rng(5).normal(size=(8, 3))

    def weighted(problem: sfmcpp.Problem, **comm: Any) -> sfmcpp.Summary:
        groups = [sfmcpp.ConstraintGroup("position", np.arange(8), centres)]
        return sfmcpp.solve(problem, constraints=groups, weight="variance", **comm)

    of_parts, of_whole = weighted(own_part(scene()), comm=COMM), weighted(scene())
    [chosen], [expected] = of_parts.group_weights, of_whole.group_weights
    assert chosen.weight == pytest.approx(expected.weight, rel=1e-6)
    assert of_parts.final_cost == pytest.approx(of_whole.final_cost, rel=1e-9)


def refused(message: str, problem: sfmcpp.Problem | None, **arguments: Any) -> None:
    """All ranks refuse a call, with the same reason."""
    with pytest.raises(InvalidArgument, match=re.escape(message)):
        sfmcpp.solve(problem, comm=COMM, **arguments)


def refusals() -> None:
    """What one rank alone gets wrong is refused by all, and they can go on."""
    part, last = own_part(scene()), COMM.rank == COMM.size - 1
    refused("max_iterations: differs between ranks 0 and ", part, max_iterations=3 + last)
    refused("max_iterations = -1", part, max_iterations=-1 if last else 3)
    refused("problem = None on rank 0", None if COMM.rank == 0 else part)
    refused("problem = 3: must be a Problem", 3 if last else part)  # type: ignore[arg-type]
    broken = own_part(scene())
    broken.points[2, 0] = np.nan if last else 0.0
    refused("points[2] = nan: must be finite", broken)
    moved = own_part(scene())
    moved.cameras[0, 0, 3] += last
    refused(f"cameras: differs between ranks 0 and {COMM.size - 1}", moved)
    refused("problem: ranks 0 and 1 have the same points and observations", scene())
    whole = scene() if COMM.rank == 0 else None
    if whole is not None:
        whole.point_index[7] = 5000
    refused("point_index[7] = 5000: must be in [0, 401)", whole)
    assert sfmcpp.solve(part, comm=COMM).converged


def callback_that_fails(rank: int) -> None:
    """What the callback of one rank raises, all raise, after the best state has been written."""

    def callback(iteration: sfmcpp.Iteration) -> None:
        if iteration.iteration == 2:
            raise ZeroDivisionError("in the callback")

    whole = scene() if COMM.rank == 0 else None
    start = None if whole is None else whole.copy()
    with pytest.raises(ZeroDivisionError, match="in the callback"):
        sfmcpp.solve(whole, comm=COMM, callback=callback if COMM.rank == rank else None)
    if whole is not None and start is not None:
        assert sfmcpp.cost(whole) < 0.5 * sfmcpp.cost(start)


def interrupt(rank: int) -> None:
    """Ctrl-C that one rank meets ends the solve of all, with the best state."""

    def callback(iteration: sfmcpp.Iteration) -> None:
        if COMM.rank == rank and iteration.iteration == 2:
            signal.raise_signal(signal.SIGINT)

    summary = sfmcpp.solve(scene() if COMM.rank == 0 else None, comm=COMM, callback=callback)
    assert summary.termination == "interrupted"
    assert [i.iteration for i in summary.iterations] == [0, 1, 2]


def checkpoints(folder: str) -> None:
    """A run goes on from the newest checkpoint that all ranks have whole, with the same bits."""
    last = COMM.rank == COMM.size - 1

    def run(problem: sfmcpp.Problem, *, until: int = 99, **kept: sfmcpp.CheckpointFolder) -> sfmcpp.Summary:
        return sfmcpp.solve(problem, comm=COMM, callback=lambda i: i.iteration < until, **kept, **OPTIONS)

    def kept(name: str) -> sfmcpp.CheckpointFolder:
        return sfmcpp.CheckpointFolder(Path(folder) / name, every_s=0.0)

    def assert_goes_on(name: str) -> None:
        again = own_part(scene())
        summary = run(again, resume=kept(name), checkpoint=kept(name))
        assert [i.cost for i in summary.iterations] == [i.cost for i in of_one_run.iterations]
        assert np.array_equal(again.points, alone.points)

    alone = own_part(scene())
    of_one_run = run(alone)
    run(own_part(scene()), until=3, checkpoint=kept("stopped"))
    if last:  # as if the machine had lost its power while it saved
        Path(kept(f"stopped/rank-{COMM.rank:04d}").load().path).write_bytes(b"half of it")
    assert_goes_on("stopped")

    with pytest.MonkeyPatch.context() as patch:
        if last:
            patch.setattr(files_of_checkpoints, "atomic_files", failing_after(3))
        summary = run(own_part(scene()), until=5, checkpoint=kept("full"))
    assert summary.warnings[-1] == "no checkpoint: disk: full"
    assert_goes_on("full")
    with pytest.raises(DatasetError, match=r"is a checkpoint of rank, ranks \[0, [23]\], this is None"):
        sfmcpp.solve(own_part(scene()), resume=kept("stopped/rank-0000"), **OPTIONS)
    with pytest.raises(DatasetError, match=f"of {COMM.size} ranks, this is one process"):
        sfmcpp.solve(own_part(scene()), resume=kept("stopped"), **OPTIONS)
    moved = own_part(scene())
    moved.points += 1.0 * last
    with pytest.raises(DatasetError, match="is a checkpoint of another problem: points differ"):
        run(moved, resume=kept("stopped"))


def failing_after(count: int) -> Callable[..., Any]:
    """A disk that is full after some files."""
    left = iter(range(count))

    def written(*paths: Path) -> Any:
        if next(left, None) is None:
            raise DatasetError("disk", "full")
        return atomic_files(*paths)

    return written


def fault(kind: str, rank: int, successes: int) -> None:
    """One rank fails at a collective, and no other may wait for it for ever."""
    failure = {"memory": MemoryError("no room"), "death": None}[kind]
    comm = Failing(successes, failure) if COMM.rank == rank else COMM
    sfmcpp.solve(scene() if COMM.rank == 0 else None, comm=comm, **OPTIONS)  # type: ignore[arg-type]
    print("not reached")


def command_killed_at(iteration: int, rank: int, *words: str) -> None:
    """A solve of the command line of which one rank is killed after an iteration."""

    @contextmanager
    def killing(*, quiet: bool) -> Iterator[Callable[[sfmcpp.Iteration], None]]:
        def listen(step: sfmcpp.Iteration) -> None:
            if step.iteration == iteration and COMM.rank == rank:
                os.kill(os.getpid(), signal.SIGKILL)

        yield listen

    display.shown_progress = killing  # type: ignore[assignment]
    sys.exit(main(["solve", *map(str, words)]))


def libraries_of_command(*words: str) -> None:
    """A solve of the command line, and which of the large libraries each rank has loaded for it."""
    assert main(["solve", *words, "--quiet"]) == 0
    large = {"cv2", "matplotlib", "PIL", "pydantic", "scipy", "typer"}
    loaded = COMM.gather(sorted(large & set(sys.modules)))
    if COMM.rank == 0:
        print(loaded)


def endless_command(source: str, output: str) -> None:
    """A solve of the command line that does not converge, and tells its steps on stderr."""

    @contextmanager
    def told(*, quiet: bool) -> Iterator[Callable[[sfmcpp.Iteration], None] | None]:
        yield None if quiet else lambda step: print("step", step.iteration, file=sys.stderr, flush=True)

    display.shown_progress = told
    endless = ["--method", "gradient-descent", "--function-tolerance", "0", "--gradient-tolerance", "0"]
    sys.exit(main(["solve", source, "-o", output, *endless, "--max-iterations", "99999999"]))


if __name__ == "__main__":
    words = iter(sys.argv[1:])
    while case := list(takewhile(lambda word: word != ",", words)):
        print("case", *case, file=sys.stderr)
        globals()[case[0]](*(int(a) if a.isdigit() else a for a in case[1:]))
