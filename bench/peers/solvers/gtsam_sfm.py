"""GTSAM: general SfM factors with Cal3Bundler cameras, its Levenberg–Marquardt for SfM.

The gauge is free; damping takes care of it. GTSAM gives an observation behind its camera a residual of
zero (objective "in-front"). Its threads cannot be set from Python; the harness limits the processors.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from harness.bal_file import BalProblem, State
from harness.in_process import InProcessPeer, Solution
from harness.protocol import Job, Objective, StoppingRule, Variant

BAL_FROM_GTSAM = np.diag([1.0, -1.0, -1.0])


class Gtsam(InProcessPeer):
    """The loop of `optimize()`, one `iterate()` at a time, to see the cost of each."""

    name = "gtsam"
    title = "GTSAM"
    package = "gtsam"
    objective = Objective.IN_FRONT

    def variants(self, threads: int) -> list[Variant]:
        """Points eliminated first or all in one go, with GTSAM's own damping rule or the one like Ceres'."""
        return [
            Variant("", {"elimination": elimination, "damping": damping})
            for elimination in ("Schur", "Full")
            for damping in ("ceres", "legacy")
        ]

    def prepare(self, problem: BalProblem, job: Job, settings: dict[str, str]) -> Callable[[], Solution]:
        """Build graph and initial values; GTSAM reads the file itself."""
        import gtsam

        data = gtsam.SfmData.FromBalFile(str(job.bal_path))
        graph = data.generalSfmFactors(gtsam.noiseModel.Unit.Create(2))
        values = initial_values(data)
        params = make_params(job.rule, settings)

        def solve() -> Solution:
            began = time.perf_counter()
            optimizer = gtsam.SfmLevenbergMarquardtOptimizer(graph, values, params)
            trace, message = iterate(optimizer, job.rule, began)
            return Solution(trace, trace[-1][1], message, lambda: read_state(optimizer.values(), data))

        return solve


def initial_values(data: Any) -> Any:
    """gtsam.Values: camera i under key i, point j under P(j)."""
    import gtsam

    values = gtsam.Values()
    for i in range(data.numberCameras()):
        values.insert(i, data.camera(i))
    for j in range(data.numberTracks()):
        values.insert(gtsam.symbol("p", j), data.track(j).point3())
    return values


def make_params(rule: StoppingRule, settings: dict[str, str]) -> Any:
    """GTSAM's parameters; the harness' own loop applies the stopping rule."""
    import gtsam

    params = gtsam.SfmLevenbergMarquardtParams
    defaults = params.ceresDefaults() if settings["damping"] == "ceres" else params.legacyDefaults()
    defaults.setEliminationMode(getattr(gtsam.SfmEliminationMode, settings["elimination"]))
    defaults.setMaxIterations(rule.max_iterations)
    defaults.setRelativeErrorTol(rule.function_tolerance)
    defaults.setAbsoluteErrorTol(0.0)
    defaults.setErrorTol(0.0)
    return defaults


def iterate(optimizer: Any, rule: StoppingRule, began: float) -> tuple[list[tuple[float, float]], str]:
    """Iterate until the common rule holds; (trace, why it stopped)."""
    trace = [(time.perf_counter() - began, optimizer.error())]
    for _ in range(rule.max_iterations):
        optimizer.iterate()
        before, now = trace[-1][1], optimizer.error()
        trace.append((time.perf_counter() - began, now))
        if trace[-1][0] > rule.max_seconds:
            return trace, "time limit"
        if before - now <= rule.function_tolerance * before:
            return trace, "function tolerance"
    return trace, "maximal number of iterations"


def read_state(values: Any, data: Any) -> State:
    """The optimised values in BAL's frames."""
    import gtsam

    cameras = [values.atPinholeCameraCal3Bundler(i) for i in range(data.numberCameras())]
    points = [values.atPoint3(gtsam.symbol("p", j)) for j in range(data.numberTracks())]
    cam_from_world = np.array([camera.pose().inverse().matrix()[:3] for camera in cameras])
    poses = BAL_FROM_GTSAM @ cam_from_world
    intrinsics = [(c.calibration().fx(), c.calibration().k1(), c.calibration().k2()) for c in cameras]
    return State(poses[:, :, :3], poses[:, :, 3], np.array(intrinsics), np.array(points))


PEER = Gtsam()
