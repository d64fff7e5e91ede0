"""Checks of a solved problem: termination, variances, other minima nearby."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from sfmcpp.ba import LinearModel, SolveOptions, Summary, adjust
from sfmcpp.doctor.case import TRIAL_CAMERAS, TRIAL_OBSERVATIONS, Case
from sfmcpp.doctor.finding import Finding
from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry.similarity import fit_similarity
from sfmcpp.model import Problem
from sfmcpp.model.arrays import FloatArray, IndexArray
from sfmcpp.sources.synthetic import perturb

_ENDED_WELL = ("converged",)
# Costs this near to each other are equal to what iterations leave.
_SAME_COST = 1e-3
# A minimum as good as this one is a rival: noise alone moves χ² of M residuals by √(2/M).
_RIVAL_COST = 1e-2
# Aligned centres this far apart, in extents of the scene, are another shape.
_OTHER_SHAPE = 0.1
_SEEDS = (0, 1, 2)


def solution(case: Case) -> Iterator[Finding]:
    """Check the termination of a solve, its variances and other minima nearby."""
    if case.summary is None:
        return
    yield from _termination_finding(case.summary)
    if case.problem.num_observations > TRIAL_OBSERVATIONS or case.problem.num_cameras > TRIAL_CAMERAS:
        case.skipped.append(
            f"variances and other minima: not computed above {TRIAL_CAMERAS:,} cameras or "
            f"{TRIAL_OBSERVATIONS:,} observations"
        )
        return
    try:
        yield from _worst_cameras(case, case.summary)
        yield from _other_basins(case, case.summary)
    except InvalidArgument as error:
        case.skipped.append(f"variances and other minima: {error}")


def _termination_finding(summary: Summary) -> Iterator[Finding]:
    if summary.termination not in _ENDED_WELL:
        yield Finding(
            "not-converged",
            "warning",
            f"the solve ended without convergence ({summary.termination.replace('_', ' ')}): "
            f"{summary.message}",
            "allow more iterations (sfmcpp solve --max-iterations), or use another method or a better "
            "initial state",
        )


def _worst_cameras(case: Case, summary: Summary) -> Iterator[Finding]:
    problem = case.problem
    seen = np.flatnonzero((case.views_of_cameras > 0) & ~problem.fixed_cameras).astype(np.int32)
    if not len(seen):
        return
    model = LinearModel(problem, case.constraints, SolveOptions())
    sigmas = _sigmas_of_centres(model, seen) * _noise_ratio(case, summary, model)
    extent = float(np.median(np.linalg.norm(problem.points - np.median(problem.points, axis=0), axis=1)))
    worst = np.argsort(-sigmas, kind="stable")[:3]
    listed = ", ".join(f"{case.name_of_camera(int(seen[k]))} ±{sigmas[k]:.2g}" for k in worst)
    loose = bool(sigmas[worst[0]] > extent)
    yield Finding(
        "uncertain-cameras" if loose else "worst-cameras",
        "warning" if loose else "note",
        f"the least certain centres are those of cameras {listed} (half of the points are within "
        f"{extent:.2g})",
        "match these images with more other images" if loose else "nothing to do",
        cameras=tuple(int(k) for k in seen[worst]),
        measures={"worst_sigma": float(sigmas[worst[0]]), "extent": extent},
    )


def _noise_ratio(case: Case, summary: Summary, model: LinearModel) -> float:
    """Standard deviation of the residuals over the stated one, as their redundancy has it."""
    problem = case.problem
    residuals = 2 * problem.num_observations
    determined = model.num_determined
    if case.constraints:  # which determine some of the parameters, nobody can say how many
        cameras, points = (len(np.unique(index)) for index in (problem.camera_index, problem.point_index))
        determined = 6 * cameras + 3 * points
    return float(summary.final_rms_px * np.sqrt(residuals / max(residuals - determined, 1)))


def _sigmas_of_centres(model: LinearModel, cameras: IndexArray) -> FloatArray:
    """(c,) standard deviations of centres, in the frame of the cameras as far as none is given."""
    of_centres = model.covariance(cameras=cameras).cameras[:, 3:6, 3:6]
    return np.asarray(np.sqrt(np.maximum(np.trace(of_centres, axis1=1, axis2=2), 0)))


def _other_basins(case: Case, summary: Summary) -> Iterator[Finding]:
    """Solve again from states around, and from the scene turned inside out along the line of sight."""
    problem = case.problem
    cost = _adjusted_from(problem, case, summary)[1]
    for name, start in _perturbed_starts(problem):
        candidate, other = _adjusted_from(start, case, summary)
        if other < (1 - _SAME_COST) * cost:
            yield Finding(
                "better-basin",
                "warning",
                f"this is a local minimum: a solve from {name} ends at a cost {1 - other / cost:.1%} lower",
                "solve from that state, or from a better initial estimate",
                measures={"cost": cost, "other_cost": other},
            )
            return
        if other < (1 + _RIVAL_COST) * cost and _shape_differs(problem, candidate):
            yield Finding(
                "rival-basin",
                "warning",
                f"the shape is ambiguous: a solve from {name} ends at another shape of similar cost "
                f"({other / cost - 1:+.2%})",
                "add views, longer baselines or positions",
                measures={"cost": cost, "other_cost": other},
            )
            return


def _adjusted_from(start: Problem, case: Case, summary: Summary) -> tuple[Problem, float]:
    moved = start.copy()
    scale = summary.loss_scale_px if summary.loss != "squared" else 1.0
    options = SolveOptions(loss=summary.loss, loss_scale_px=scale)
    return moved, adjust(moved, case.constraints, options).require_uninterrupted().final_cost


def _perturbed_starts(problem: Problem) -> Iterator[tuple[str, Problem]]:
    offsets = problem.points - np.median(problem.points, axis=0)
    size = 0.05 * float(np.median(np.linalg.norm(offsets, axis=1)))
    yield "the depth-reversed scene", depth_reversed(problem)
    for seed in _SEEDS:
        moved = perturb(
            problem,
            point_sigma_m=size,
            position_sigma_m=size,
            rotation_sigma_deg=2.0,
            focal_sigma=0.05,
            seed=seed,
        )
        yield f"a state perturbed by 5 % of the scene (seed {seed})", moved


def depth_reversed(problem: Problem) -> Problem:
    """The scene mirrored across the mean line of sight, and cameras turned to see it as before.

    It is the other solution of images with little perspective (Koenderink and van Doorn, Affine structure
    from motion, 1991): ``R ← M R diag(1, 1, −1)`` with the mirror M, and the middle of the points stays
    where it is in every camera; of rigs the frames are where their cameras have it in the mean.
    """
    axis = problem.rotations[:, :, 2].sum(axis=0)
    axis = axis / (np.linalg.norm(axis) or 1.0)
    mirror = np.eye(3) - 2 * np.outer(axis, axis) / max(axis @ axis, 1e-300)
    middle = np.median(problem.points, axis=0)
    rotations = mirror @ problem.rotations * np.array([1.0, 1.0, -1.0])
    in_camera = np.einsum("cji,cj->ci", problem.rotations, middle - problem.centres)
    centres = middle - np.einsum("cij,cj->ci", rotations, in_camera)
    free = ~problem.fixed_cameras[:, None, None]
    cameras = np.concatenate([rotations, centres[:, :, None]], axis=2)
    if problem.rigs is not None:
        cameras = problem.rigs.rigid(cameras)
    points = middle + (problem.points - middle) @ mirror
    return replace(
        problem,
        cameras=np.where(free, cameras, problem.cameras),
        points=np.where(problem.fixed_points[:, None], problem.points, points),
    )


def _shape_differs(first: Problem, second: Problem) -> bool:
    """Whether the points, aligned by a similarity, lie elsewhere."""
    seen = np.unique(first.point_index)
    aligned = fit_similarity(second.points[seen], first.points[seen]).apply(second.points[seen])
    distances = np.linalg.norm(aligned - first.points[seen], axis=1)
    extent = np.median(np.linalg.norm(first.points[seen] - np.median(first.points[seen], axis=0), axis=1))
    return bool(np.median(distances) > _OTHER_SHAPE * extent)
