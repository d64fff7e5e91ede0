"""Gauge freedoms: the similarities of the world that change no residual."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from sfmcpp.ba import LinearModel, linearize
from sfmcpp.doctor.case import Case
from sfmcpp.doctor.finding import Finding
from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry.similarity import motions_of_positions
from sfmcpp.model import ConstraintGroup, Problem, Rigs
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.metadata import WorldOrigin
from sfmcpp.wording import counted

FREEDOMS = ("rotation x", "rotation y", "rotation z", "shift x", "shift y", "shift z", "scale")
_SCALE = FREEDOMS.index("scale")

# Part of its size up to which a response to a motion is rounding, as in the core's choice of a gauge.
_NEGLIGIBLE = 1e-6
# What holds a world in place, by kind of constraint: then no freedom is expected to be left.
_OF_THE_WORLD = ("position", "pose")
_NOTHING_HELD = "all 7 gauge freedoms are left: position, rotation and scale of the world are arbitrary"
# The Jacobian of one observation takes 200 bytes.
_MOST_OBSERVATIONS = 2_000_000
_AT_ONCE = 100_000


def gauge(case: Case) -> Iterator[Finding]:
    """Find which of the seven gauge freedoms are left, and whether that is expected."""
    problem = case.problem
    if not problem.is_metric:
        yield _freedom_note("the 15 gauge freedoms of a projective world are left", 15)
        return
    held = problem.fixed_cameras.any() or problem.fixed_points.any() or problem.rigs is not None
    if not (held or case.constraints):
        yield _of_an_origin() if WorldOrigin.of(problem.metadata) else _freedom_note(_NOTHING_HELD, 7)
        return
    if problem.num_observations > _MOST_OBSERVATIONS:
        case.skipped.append(f"gauge: not computed above {_MOST_OBSERVATIONS:,} observations")
        return
    try:
        motions = _free_motions(linearize(problem, constraints=case.constraints), problem)
    except InvalidArgument as error:
        case.skipped.append(f"gauge: {error}")
        return
    if len(motions):
        yield _freedoms_finding(case, motions)


def _freedom_note(what: str, count: int) -> Finding:
    advice = "nothing to do for a solve; for a defined world frame, fix two cameras or give positions"
    return Finding("gauge-freedoms", "note", what, advice, measures={"freedoms": float(count)})


def _of_an_origin() -> Finding:
    return Finding(
        "gauge-freedoms",
        "note",
        "the world frame comes from positions that are not part of the problem: a solve has all 7 gauge "
        "freedoms",
        "nothing to do; to keep a solve aligned to these positions, give them again (--gps)",
        measures={"freedoms": 7.0},
    )


def _freedoms_finding(case: Case, motions: FloatArray) -> Finding:
    expected = any(
        group.kind.startswith(_OF_THE_WORLD)
        for group in case.constraints
        if isinstance(group, ConstraintGroup) and group.weight > 0
    )
    expected = expected or int(case.problem.fixed_cameras.sum()) > 1
    names = [FREEDOMS[k] for k in np.flatnonzero((motions**2).sum(axis=0) > _NEGLIGIBLE)]
    return Finding(
        "gauge-freedoms",
        "warning" if expected else "note",
        f"{counted(len(motions), 'gauge freedom')} of 7 left despite fixed parameters, rigs and constraints: "
        f"{', '.join(names)}",
        "fix one more camera, or give a position off the line through the others"
        if expected
        else "nothing to do if this is intended",
        measures={"freedoms": float(len(motions))},
    )


def _free_motions(model: LinearModel, problem: Problem) -> FloatArray:
    """(k, 7) orthonormal similarities that move something and change no residual, to first order.

    They are the null space of ``(J T)ᵀ (J T)``: J is the Jacobian of observations and constraints, T the
    response of all that is free to the generators ``X ← X + ω × X + v + s X``, in units of the scene. Every
    group of rows counts by how much it would respond if its parts did not cancel: weights do not matter.

    Parameters
    ----------
    model : LinearModel
        In the free gauge, where all that is not fixed has a column.
    problem : Problem
        The state it was made at.
    """
    poses, anchors = _moving_poses(problem)
    of_cameras = np.zeros((*model.camera_columns.shape, 7))
    of_cameras[:, :3] = _rotation_responses(poses[:, :, :3])
    of_cameras[:, 3:6] = _motions_in_scene(problem, poses[:, :, 3])
    of_cameras[:, 3:6, _SCALE] += anchors
    if problem.rigs is not None and problem.rigs.free_sensors.any():
        of_cameras[:, -3:, _SCALE] = _sensor_lever_arms(problem.rigs)[problem.rigs.sensor_of_camera]
    of_points = _motions_in_scene(problem, problem.points)
    held = _held_by_observations(model, problem, of_cameras, of_points) + _held_by_rigs(problem)
    columns = model.camera_columns
    of_columns = np.zeros((model.num_columns, 7))
    of_columns[columns[columns >= 0]] = of_cameras[columns >= 0]
    free = model.point_columns >= 0
    of_columns[model.point_columns[free, None] + np.arange(3)] = of_points[free]
    for rows in (rows for rows in model.groups if rows.weight > 0):
        jacobian, answers = rows.jacobian(), of_columns[: rows.columns]
        held += _normalised_products(jacobian @ answers, np.asarray(abs(jacobian) @ abs(answers)))
    values, vectors = np.linalg.eigh(held)
    return _moving(np.asarray(vectors[:, values <= _NEGLIGIBLE**2].T), of_columns)


def _moving(motions: FloatArray, of_columns: FloatArray) -> FloatArray:
    """The motions (k, 7) that move a column: growing about the only camera moves none beside fixed points."""
    largest = np.abs(of_columns).max(axis=1, initial=0.0)
    moved = of_columns[largest > 0] / largest[largest > 0, None] @ motions.T
    sizes, vectors = np.linalg.eigh(moved.T @ moved)
    return np.asarray(vectors[:, sizes > _NEGLIGIBLE**2].T @ motions)


def _motions_in_scene(problem: Problem, positions: FloatArray) -> FloatArray:
    """(n, 3, 7) responses of positions to the similarities of `_free_motions`, in units of the scene."""
    middle = problem.centres.mean(axis=0)
    extent = np.linalg.norm(problem.centres - middle, axis=1).max() or 1.0
    return np.asarray(extent * motions_of_positions((positions - middle) / extent))


def _moving_poses(problem: Problem) -> tuple[FloatArray, FloatArray]:
    """(C, 3, 4) poses that the columns of cameras move, and (C, 3) from there to where they grow from.

    With rigs they are those of their frames, which grow from the origins of :func:`_sensor_lever_arms`.
    """
    if problem.rigs is None:
        return problem.cameras, np.zeros((problem.num_cameras, 3))
    rigs, sensors = problem.rigs, problem.rigs.sensor_of_camera
    poses = rigs.frames(problem.cameras)[rigs.frame_of_camera]
    origins = (rigs.sensors[:, :, 3] - _sensor_lever_arms(rigs))[sensors]
    return poses, np.asarray(np.einsum("cij,cj->ci", poses[:, :, :3], origins))


def _sensor_lever_arms(rigs: Rigs) -> FloatArray:
    """(S, 3) places of sensors from the origin of their rig."""
    places: FloatArray = rigs.sensors[:, :, 3]
    return np.asarray(places - places[rigs.origin_of_sensor()])


def _held_by_rigs(problem: Problem) -> FloatArray:
    """(7, 7) that sensors which stay keep their distances."""
    if problem.rigs is None:
        return np.zeros((7, 7))
    staying = _sensor_lever_arms(problem.rigs)[~problem.rigs.free_sensors]
    rows = np.linalg.norm(staying, axis=1)[:, None] * (np.arange(7) == _SCALE)
    return _normalised_products(rows, rows)


def _held_by_observations(
    model: LinearModel, problem: Problem, of_cameras: FloatArray, of_points: FloatArray
) -> FloatArray:
    """(7, 7) normalised ``(J T)ᵀ (J T)`` of observations; those of a free camera and point add nothing."""
    by_camera, by_point = model.blocks()
    fixed = problem.fixed_cameras[problem.camera_index] != problem.fixed_points[problem.point_index]
    moved, sizes = [np.zeros((0, 7))], [np.zeros((0, 7))]
    for rows in np.array_split(np.flatnonzero(fixed), max(1, np.count_nonzero(fixed) // _AT_ONCE)):
        camera = np.einsum("mrd,mdk->mrk", by_camera[rows], of_cameras[problem.camera_index[rows]])
        point = np.einsum("mrd,mdk->mrk", by_point[rows], of_points[problem.point_index[rows]])
        moved.append((camera + point).reshape(-1, 7))
        sizes.append((abs(camera) + abs(point)).reshape(-1, 7))
    return _normalised_products(np.concatenate(moved), np.concatenate(sizes))


def _normalised_products(moved: FloatArray, sizes: FloatArray) -> FloatArray:
    """(7, 7) products of responses (rows, 7), over the norms they would have if nothing cancelled."""
    norms = np.linalg.norm(sizes, axis=0)
    unit = moved / np.where(norms > 0, norms, 1.0)
    return np.asarray(unit.T @ unit)


def _rotation_responses(rotations: FloatArray) -> FloatArray:
    """(n, 3, 7) response of rotations, each in its own frame: ``Rᵀ ω``."""
    turned = np.zeros((len(rotations), 3, 7))
    turned[:, :, :3] = np.swapaxes(rotations, 1, 2)
    return turned
