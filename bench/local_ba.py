"""The local adjustment of SLAM: how long a call takes, and where the time goes.

    python bench/local_ba.py [--repeats 300] [--profile]

Eight free keyframes, four fixed ones, 300 points and about 1,500 observations, adjusted as
`sfmcpp.slam` does after every keyframe. Each call has fresh copies of the same start.
"""

from __future__ import annotations

import argparse
import cProfile
import pstats
import statistics
import time

import numpy as np

import sfmcpp
from sfmcpp.ba import Summary

FREE, FIXED, POINTS, VIEWS = 8, 4, 300, 5


def local_problem(seed: int = 0) -> sfmcpp.Problem:
    """Keyframes along a street, each point seen by five consecutive ones; the newest pose is the worst."""
    random = np.random.default_rng(seed)
    count = FREE + FIXED
    cameras = np.zeros((count, 3, 4))
    cameras[:, :, :3] = np.eye(3)
    cameras[:, 2, 3] = np.arange(count)
    first = random.integers(0, count - VIEWS + 1, POINTS)
    points = np.stack(
        [random.uniform(-8, 8, POINTS), random.uniform(-3, 3, POINTS), first + random.uniform(8, 30, POINTS)],
        axis=1,
    )
    camera_index = (first[:, None] + np.arange(VIEWS)).ravel().astype(np.int32)
    point_index = np.repeat(np.arange(POINTS, dtype=np.int32), VIEWS)
    seen = points[point_index] - cameras[camera_index, :, 3]
    pixels = 700.0 * seen[:, :2] / seen[:, 2:] + random.normal(0.0, 0.5, (len(seen), 2))
    problem = sfmcpp.Problem(
        camera_model="calibrated",
        cameras=cameras,
        intrinsics=np.array([[700.0, 1.0, 0.0, 0.0, 0.0]]),
        intrinsics_index=np.zeros(count, np.int32),
        points=points,
        camera_index=camera_index,
        point_index=point_index,
        pixels=pixels,
        fixed_cameras=np.arange(count) < FIXED,
    )
    problem.cameras[FIXED:, :, 3] += random.normal(0.0, 0.01, (FREE, 3))
    problem.cameras[-1, :, 3] += random.normal(0.0, 0.05, 3)
    problem.points += random.normal(0.0, 0.05, points.shape)
    return problem


def adjust(problem: sfmcpp.Problem) -> Summary:
    """The call of `sfmcpp.slam.mapping`."""
    return sfmcpp.solve(
        problem,
        constraints=[],
        threads=1,
        loss="huber",
        loss_scale_px=2.0,
        max_iterations=10,
        function_tolerance=1e-4,
    )


def timed(problem: sfmcpp.Problem) -> tuple[float, Summary]:
    """Seconds of one call."""
    start = time.perf_counter()
    summary = adjust(problem)
    return time.perf_counter() - start, summary


def main() -> None:
    """Print the medians of many calls."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--repeats", type=int, default=300)
    parser.add_argument("--profile", action="store_true", help="what Python's part consists of")
    args = parser.parse_args()
    start = local_problem()
    copies = [start.copy() for _ in range(args.repeats)]
    if args.profile:
        with cProfile.Profile() as profile:
            for copy in copies:
                adjust(copy)
        pstats.Stats(profile).sort_stats("tottime").print_stats(12)
        return
    runs = [timed(copy) for copy in copies]
    seconds, summary = [run[0] for run in runs], runs[-1][1]
    whole = statistics.median(seconds)
    core = statistics.median(run.seconds_total for _, run in runs)
    setup = statistics.median(run.seconds_setup for _, run in runs)
    rms = f"{summary.initial_rms_px:.3f} → {summary.final_rms_px:.3f} px"
    print(f"{start.num_observations} observations, {start.num_points} points, {FREE} free keyframes")
    print(f"{len(summary.iterations) - 1} steps, RMS {rms}")
    print(f"call {1e3 * whole:.3f} ms (the first {1e3 * seconds[0]:.3f})")
    print(f"core {1e3 * core:.3f} ms, of it set-up {1e3 * setup:.3f}; Python {1e3 * (whole - core):.3f} ms")


if __name__ == "__main__":
    main()
