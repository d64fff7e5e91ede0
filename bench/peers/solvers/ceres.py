"""Ceres through the driver in `ceres_driver/`: every Schur solver it has, with its faster settings."""

from __future__ import annotations

import itertools
import subprocess
from pathlib import Path

import numpy as np

from harness.bal_file import State
from harness.protocol import Job, Peer, Variant

SOURCE_FOLDER = Path(__file__).resolve().parents[1] / "ceres_driver"
SCHUR_SOLVERS = {
    "dense": {"linear_solver": "DENSE_SCHUR"},
    "sparse": {"linear_solver": "SPARSE_SCHUR"},
    "iterative": {"linear_solver": "ITERATIVE_SCHUR", "explicit_schur": "0"},
    "iterative explicit S": {"linear_solver": "ITERATIVE_SCHUR", "explicit_schur": "1"},
    "iterative clusters": {"linear_solver": "ITERATIVE_SCHUR", "preconditioner": "CLUSTER_JACOBI"},
    "iterative cluster trees": {
        "linear_solver": "ITERATIVE_SCHUR",
        "preconditioner": "CLUSTER_TRIDIAGONAL",
    },
}


class Ceres(Peer):
    """LM with Ceres' defaults, points eliminated first."""

    name = "ceres"
    title = "Ceres"
    is_python = False

    def __init__(self) -> None:
        self.driver = Path("ceres_driver")

    def missing(self, build_folder: Path) -> str | None:
        """Build the driver; the reason is what CMake or the compiler said."""
        folder = build_folder / "ceres_driver"
        self.driver = folder / "ceres_driver"
        configure = ["cmake", "-S", str(SOURCE_FOLDER), "-B", str(folder), "-DCMAKE_BUILD_TYPE=Release"]
        for command in (configure, ["cmake", "--build", str(folder)]):
            try:
                done = subprocess.run(command, capture_output=True, text=True, check=False)
            except FileNotFoundError as error:
                return str(error)
            if done.returncode:
                return f"its driver does not build: {_first_error(done.stderr or done.stdout)}"
        return None

    def variants(self, threads: int) -> list[Variant]:
        """Both kinds of Jacobian, one or all threads, and as many of OpenBLAS where it is used."""
        return [
            Variant(label, {**base, **dict(extra), "jacobian": jacobian, "threads": count}, _blas(blas))
            for label, base in SCHUR_SOLVERS.items()
            for jacobian, count in itertools.product(("analytic", "autodiff"), _counts(threads))
            for extra, blas in _linear_algebra(label, threads)
        ]

    def command(self, job: Job, variant: Variant) -> list[str]:
        """One call of the driver."""
        settings = {
            **variant.settings,
            "max_iterations": job.rule.max_iterations,
            "function_tolerance": job.rule.function_tolerance,
            "max_seconds": job.rule.max_seconds,
        }
        outputs = [str(job.folder / "outcome.json"), str(job.folder / "state.f64")]
        return [str(self.driver), str(job.bal_path), *outputs, *(f"{k}={v}" for k, v in settings.items())]

    def final_state(self, job: Job) -> State:
        """The driver writes raw doubles: cameras, then points."""
        with job.bal_path.open() as file:
            num_cameras = int(file.readline().split()[0])
        values = np.fromfile(job.folder / "state.f64")
        cameras, points = np.split(values, [9 * num_cameras])
        return State.from_parameters(cameras.reshape(-1, 9), points.reshape(-1, 3))


def _counts(threads: int) -> list[str]:
    return [str(n) for n in sorted({1, threads}, reverse=True)]


def _linear_algebra(label: str, threads: int) -> list[tuple[tuple[tuple[str, str], ...], str]]:
    """(settings, BLAS threads) worth trying: only LAPACK and CHOLMOD call BLAS."""
    if label == "dense":
        lapack = [((("dense_library", "LAPACK"),), blas) for blas in _counts(threads)]
        return [*lapack, ((("dense_library", "EIGEN"),), "1")]
    return [((), blas) for blas in (_counts(threads) if label == "sparse" else ["1"])]


def _blas(threads: str) -> dict[str, str]:
    return {"OPENBLAS_NUM_THREADS": threads}


def _first_error(text: str) -> str:
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    errors = [line for line in lines if "rror" in line or "Could not find" in line]
    return " ".join((errors or lines or ["no message"])[:2])


PEER = Ceres()
