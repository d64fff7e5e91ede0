"""COLMAP's bundle adjustment through pycolmap: a reconstruction in memory with RADIAL cameras.

COLMAP gives an observation behind its camera a residual of zero (objective "in-front").
It has no callback in Python, so the trace is what Ceres prints: costs to seven digits, seconds to three.
"""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, BinaryIO

import numpy as np

from harness.bal_file import BalProblem, FloatArray, State, rotation_matrices
from harness.in_process import InProcessPeer, Solution
from harness.protocol import Job, Objective, StoppingRule, Variant

COLMAP_FROM_BAL = np.diag([1.0, -1.0, -1.0])
IMAGE_SIZE_PX = 4096
ITERATION_LINE = re.compile(r"^\s*\d+\s+\d\.\d+e[+-]\d+\s", re.MULTILINE)


class Colmap(InProcessPeer):
    """pycolmap's Ceres bundle adjuster with the common stopping rule."""

    name = "pycolmap"
    title = "pycolmap"
    package = "pycolmap"
    objective = Objective.IN_FRONT

    def variants(self, threads: int) -> list[Variant]:
        """Each Schur solver, with one or all threads."""
        return [
            Variant("", {"linear_solver": solver, "threads": str(count)})
            for solver in ("DENSE_SCHUR", "SPARSE_SCHUR", "ITERATIVE_SCHUR")
            for count in sorted({1, threads}, reverse=True)
        ]

    def prepare(self, problem: BalProblem, job: Job, settings: dict[str, str]) -> Callable[[], Solution]:
        """Build the reconstruction and the adjuster (and with it the Ceres problem)."""
        import pycolmap

        reconstruction = build_reconstruction(problem)
        config = pycolmap.BundleAdjustmentConfig()
        for image_id in reconstruction.images:
            config.add_image(image_id)
        options = make_options(job.rule, settings)
        adjuster = pycolmap.create_default_ceres_bundle_adjuster(options, config, reconstruction)

        def solve() -> Solution:
            with captured_stdout() as output:
                result: Any = adjuster.solve()
                output.seek(0)
                progress = output.read().decode()
            summary = result.ceres_summary
            return Solution(
                trace=parse_trace(progress, summary.initial_cost, summary.final_cost),
                own_cost=summary.final_cost,
                message=summary.message,
                final_state=lambda: read_state(reconstruction),
            )

        return solve


def build_reconstruction(problem: BalProblem) -> Any:
    """A pycolmap.Reconstruction: one RADIAL camera per image, principal point at 0, y downwards."""
    import pycolmap

    reconstruction = pycolmap.Reconstruction()
    slots = np.zeros(len(problem.pixels), dtype=np.int64)
    rotations = COLMAP_FROM_BAL @ rotation_matrices(problem.cameras[:, :3])
    translations = problem.cameras[:, 3:6] @ COLMAP_FROM_BAL
    for camera, (focal, k1, k2) in enumerate(problem.cameras[:, 6:]):
        seen = np.flatnonzero(problem.camera_index == camera)
        slots[seen] = np.arange(len(seen))
        _add_camera(reconstruction, camera + 1, [focal, 0.0, 0.0, k1, k2])
        pose = pycolmap.Rigid3d(pycolmap.Rotation3d(rotations[camera]), translations[camera])
        keypoints = problem.pixels[seen] * [1.0, -1.0]
        image = pycolmap.Image(f"{camera}", keypoints, camera_id=camera + 1, image_id=camera + 1)
        reconstruction.add_image_with_trivial_frame(image, pose)
    _add_points(reconstruction, problem, slots)
    return reconstruction


def _add_camera(reconstruction: Any, camera_id: int, params: list[float]) -> None:
    import pycolmap

    camera = pycolmap.Camera(
        camera_id=camera_id, model="RADIAL", width=IMAGE_SIZE_PX, height=IMAGE_SIZE_PX, params=params
    )
    reconstruction.add_camera_with_trivial_rig(camera)


def _add_points(reconstruction: Any, problem: BalProblem, slots: np.ndarray[Any, Any]) -> None:
    import pycolmap

    by_point = np.argsort(problem.point_index, kind="stable")
    ends = np.cumsum(np.bincount(problem.point_index, minlength=len(problem.points)))[:-1]
    for point, seen in zip(problem.points, np.split(by_point, ends), strict=True):
        track = [pycolmap.TrackElement(int(problem.camera_index[m]) + 1, int(slots[m])) for m in seen]
        reconstruction.add_point3D(point, pycolmap.Track(track))


def make_options(rule: StoppingRule, settings: dict[str, str]) -> Any:
    """COLMAP's options with the common rule and without its own choice of solver and threads."""
    import pycolmap

    options = pycolmap.BundleAdjustmentOptions()
    options.print_summary = False
    options.ceres.auto_select_solver_type = False
    options.ceres.min_num_residuals_for_cpu_multi_threading = 0
    solver = options.ceres.solver_options
    solver.linear_solver_type = type(solver.linear_solver_type).__members__[settings["linear_solver"]]
    solver.preconditioner_type = type(solver.preconditioner_type).__members__["SCHUR_JACOBI"]
    solver.num_threads = int(settings["threads"])
    solver.max_num_iterations = rule.max_iterations
    solver.max_solver_time_in_seconds = rule.max_seconds
    solver.function_tolerance = rule.function_tolerance
    solver.gradient_tolerance = solver.parameter_tolerance = 0.0
    solver.logging_type = type(solver.logging_type).__members__["PER_MINIMIZER_ITERATION"]
    solver.minimizer_progress_to_stdout = True
    return options


@contextmanager
def captured_stdout() -> Iterator[BinaryIO]:
    """A file that receives what C++ writes to standard output within the block."""
    saved = os.dup(1)
    with tempfile.TemporaryFile() as output:
        os.dup2(output.fileno(), 1)
        try:
            yield output
        finally:
            os.dup2(saved, 1)
            os.close(saved)


def parse_trace(text: str, initial_cost: float, final_cost: float) -> list[tuple[float, float]]:
    """(seconds, accepted cost) from Ceres' progress table: columns 1 cost, 2 cost change, 9 total time.

    A refused step shows its own, higher cost; the accepted one stays. Ceres' exact costs replace the
    printed ones at both ends.
    """
    rows = [line.split() for line in text.splitlines() if ITERATION_LINE.match(line)]
    costs = np.minimum.accumulate([float(row[1]) for row in rows])
    costs[0] = initial_cost
    return [(float(row[9]), max(float(cost), final_cost)) for row, cost in zip(rows, costs, strict=True)]


def read_state(reconstruction: Any) -> State:
    """The reconstruction back in BAL's frames."""
    images = [reconstruction.images[i] for i in sorted(reconstruction.images)]
    poses: FloatArray = np.array([image.cam_from_world().matrix() for image in images])
    poses = COLMAP_FROM_BAL @ poses
    params = np.array([image.camera.params for image in images])
    points = np.array([reconstruction.points3D[i].xyz for i in sorted(reconstruction.points3D)])
    return State(poses[:, :, :3], poses[:, :, 3], params[:, [0, 3, 4]], points)


PEER = Colmap()
