"""Connections between cameras: unobserved points, separate parts, hinges, weak cameras."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from sfmcpp.doctor.case import Case
from sfmcpp.doctor.finding import Finding, named_points, numbers
from sfmcpp.model import ConstraintGroup, Problem, ResidualGroup, Rigs, constraint_kind
from sfmcpp.model.arrays import IndexArray
from sfmcpp.model.residual_group import Group
from sfmcpp.wording import counted, first_few

# Three points determine a similarity, or a pose; one wrong among k is told from the others if the k − 1 that
# are left still have one to spare: k = 3 + 2.
POINTS_TO_TELL_AN_OUTLIER = 5
_POINTS_OF_A_SIMILARITY = 3
_ROTATION = (3, 3)


def connections(case: Case) -> Iterator[Finding]:
    """Find parts that share no point, parts that share too few, and cameras that see too few."""
    labels = parts(case)
    yield from _separate_parts(case, labels)
    yield from _hinges(case, labels)
    yield from _weak_cameras(case)
    yield from _unobserving_cameras(case)


def parts(case: Case) -> NDArray[np.int64]:
    """(C,) part of each camera, the one of most observations first; −1 for cameras that see nothing.

    Cameras that are fixed, tied by a constraint to a place in the world or to each other, or of one rigid
    frame are of one part, and so are parts that fixed points hold in the world.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    count = case.problem.num_cameras
    ties = np.array(_relative_constraints(case), dtype=np.int64).reshape(-1, 2)
    joined = coo_matrix((np.ones(len(ties), dtype=np.int32), (ties[:, 0], ties[:, 1])), shape=(count, count))
    _, labels = connected_components(case.common_points + joined, directed=False)
    held = held_by_points(case.problem, labels.astype(np.int64))
    held[labels[_placed_cameras(case)]] = True
    if held.any():
        labels = np.where(held[labels], np.argmax(held), labels)
    return _labels_by_weight(labels.astype(np.int64), case.views_of_cameras)


def held_by_points(problem: Problem, groups: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Which groups, given for each camera, see enough fixed points to have a place in the world."""
    fixed = problem.fixed_points[problem.point_index]
    pairs = np.stack([groups[problem.camera_index[fixed]], problem.point_index[fixed]])
    seen = np.bincount(np.unique(pairs, axis=1)[0], minlength=groups.max(initial=-1) + 1)
    return np.asarray(seen >= _POINTS_OF_A_SIMILARITY)


def _relative_constraints(case: Case) -> list[tuple[int, int]]:
    """Pairs of cameras whose relative position does not rest on common points."""
    pairs: list[tuple[int, int]] = []
    for group, cameras in _groups_on_places(case):
        if (points := _points_of(group, cameras)) is not None:
            pairs += _edges_to_observers(case.problem, cameras, points)
        elif cameras.ndim == 2:
            pairs += [(int(a), int(b)) for a, b in cameras]
    held = _placed_cameras(case)
    return pairs + _edges_of_frames(case.problem.rigs) + [(int(held[0]), int(k)) for k in held[1:]]


def _placed_cameras(case: Case) -> NDArray[np.int64]:
    """Cameras that are fixed, or that a constraint ties to a place in the world."""
    placed: list[NDArray[np.integer]] = [np.flatnonzero(case.problem.fixed_cameras)]
    for group, cameras in _groups_on_places(case):
        if cameras.ndim == 1 and _points_of(group, cameras) is None:
            placed.append(cameras)
    return np.concatenate(placed).astype(np.int64)


def _groups_on_places(case: Case) -> Iterator[tuple[Group, IndexArray]]:
    """Groups of constraints that say where their cameras are."""
    for group in case.constraints:
        if group.weight > 0 and group.cameras is not None and _is_on_places(group):
            yield group, group.cameras


def _points_of(group: Group, cameras: IndexArray) -> IndexArray | None:
    """The points of a group that says where each of its cameras is beside one; None of another group."""
    return group.points if isinstance(group, ResidualGroup) and cameras.ndim == 1 else None


def _is_on_places(group: Group) -> bool:
    """Whether a group says where cameras are, not only how they are turned or what their intrinsics are."""
    if not isinstance(group, ConstraintGroup):
        return True
    kind = constraint_kind(group.kind)
    return kind.on_poses and kind.values != _ROTATION


def _edges_to_observers(problem: Problem, cameras: IndexArray, points: IndexArray) -> list[tuple[int, int]]:
    """Each camera with the first that observes the point; with itself where none does."""
    seen, rows = np.unique(problem.point_index, return_index=True)
    observers = np.full(problem.num_points, -1)
    observers[seen] = problem.camera_index[rows]
    others = np.where(observers[points] < 0, cameras, observers[points])
    return list(zip(cameras.tolist(), others.tolist(), strict=True))


def _edges_of_frames(rigs: Rigs | None) -> list[tuple[int, int]]:
    """Each camera with the first one of its frame."""
    if rigs is None:
        return []
    _, first, frames = np.unique(rigs.frame_of_camera, return_index=True, return_inverse=True)
    return [(int(first[frame]), camera) for camera, frame in enumerate(frames)]


def _labels_by_weight(labels: NDArray[np.int64], weights: NDArray[np.int64]) -> NDArray[np.int64]:
    """Labels renumbered, the heaviest first; −1 for what weighs nothing."""
    sizes = np.bincount(labels, weights)
    rank = np.empty(len(sizes), dtype=np.int64)
    rank[np.argsort(-sizes, kind="stable")] = np.arange(len(sizes))
    return np.where(weights > 0, rank[labels], -1)


def _separate_parts(case: Case, labels: NDArray[np.int64]) -> Iterator[Finding]:
    if labels.max(initial=-1) < 1:
        return
    others = numbers(np.flatnonzero(labels > 0))
    sizes = np.bincount(labels[labels >= 0])
    listed = first_few((f"{n:,}" for n in sizes), 6)
    yield Finding(
        "disconnected-parts",
        "warning",
        f"the cameras form {len(sizes):,} parts ({listed} cameras) that share no points: their relative "
        "position, rotation and scale are arbitrary (7 degrees of freedom per part)",
        "match images across the parts, or solve each one separately; --fix keeps the largest",
        case.named_cameras(others) + " outside the largest part",
        cameras=others,
        measures={"parts": float(len(sizes))},
    )


def _hinges(case: Case, labels: NDArray[np.int64]) -> Iterator[Finding]:
    """Groups of cameras that share, all together, too few points with the others of their part."""
    for cameras, shared in _weakly_tied_groups(case, labels):
        loose = shared < 3
        yield Finding(
            "weak-link",
            "warning",
            f"{counted(len(cameras), 'camera')} connected to the others by only {counted(shared, 'point')}"
            + (
                ": relative rotation or scale is undetermined"
                if loose
                else ": one wrong point distorts the model"
            ),
            f"match more images across the connection: {POINTS_TO_TELL_AN_OUTLIER} points reveal a wrong one",
            case.named_cameras(cameras),
            cameras=cameras,
            measures={"shared_points": float(shared)},
        )


def _weakly_tied_groups(case: Case, labels: NDArray[np.int64]) -> list[tuple[tuple[int, ...], int]]:
    """Cameras of each group that shares too few points with all others, and how many."""
    groups = _rigid_groups(case)
    ties = np.array(_relative_constraints(case), dtype=np.int64).reshape(-1, 2)
    held = held_by_points(case.problem, groups)
    found = []
    for part in range(labels.max(initial=-1) + 1):
        in_part, sizes = np.unique(groups[labels == part], return_counts=True)
        # The largest group is what the others hang on; single cameras are spoken of apart.
        for group in in_part[(sizes > 1) & (np.arange(len(sizes)) != np.argmax(sizes))]:
            members = groups == group
            shared = _points_shared(case, members)
            is_tied = held[group] or (members[ties[:, 0]] != members[ties[:, 1]]).any()
            if not is_tied and 0 < shared < POINTS_TO_TELL_AN_OUTLIER:
                found.append((numbers(np.flatnonzero(members)), shared))
    return found


def _rigid_groups(case: Case) -> NDArray[np.int64]:
    """(C,) group of each camera: cameras that share enough points are one, then groups that do, and so on."""
    from scipy.sparse import csr_matrix
    from scipy.sparse.csgraph import connected_components

    cameras = case.problem.num_cameras
    groups: NDArray[np.integer] = np.arange(cameras)
    common = case.common_points
    while True:
        strong = common.copy()
        strong.data = strong.data * (strong.data >= POINTS_TO_TELL_AN_OUTLIER)
        strong.eliminate_zeros()
        count, joined = connected_components(strong, directed=False)
        if count == len(joined):
            return groups.astype(np.int64)
        groups = joined[groups]
        members = csr_matrix((np.ones(cameras, dtype=np.int32), (groups, np.arange(cameras))))
        seen = (members @ case.incidence).tocsr()
        seen.data[:] = 1
        common = (seen @ seen.T).tocsr()


def _tied_cameras(case: Case) -> NDArray[np.bool_]:
    """(C,) which cameras are tied to others."""
    tied = np.zeros(case.problem.num_cameras, dtype=np.bool_)
    for one, other in _relative_constraints(case):
        if one != other:
            tied[[one, other]] = True
    return tied


def _points_shared(case: Case, inside: NDArray[np.bool_]) -> int:
    """How many points are observed both by cameras `inside` and by others."""
    seen = [np.asarray(case.incidence[side].sum(axis=0)).ravel() > 0 for side in (inside, ~inside)]
    return int(np.count_nonzero(seen[0] & seen[1]))


def _weak_cameras(case: Case) -> Iterator[Finding]:
    """Cameras with too few shared or fixed points to determine their pose and detect a wrong one."""
    problem = case.problem
    alone = problem.fixed_points & (case.views_of_points == 1)
    known = np.bincount(problem.camera_index[alone[problem.point_index]], minlength=problem.num_cameras)
    useful = np.asarray(case.incidence.sum(axis=1)).ravel() + known
    wanted = POINTS_TO_TELL_AN_OUTLIER + (_own_intrinsics(case) + 1) // 2
    free = ~problem.fixed_cameras & ~_tied_cameras(case) & (case.views_of_cameras > 0)
    weak = numbers(np.flatnonzero(free & (useful < wanted)))
    if weak:
        yield Finding(
            "weak-cameras",
            "warning",
            f"{counted(len(weak), 'camera')} with too few points that other cameras see: as few as "
            f"{useful[list(weak)].min()}, where {wanted[list(weak)].max()} determine the pose and reveal a "
            "wrong point",
            "match them with more images, fix them, or leave them out (Problem.with_cameras)",
            case.named_cameras(weak),
            cameras=weak,
        )


def _own_intrinsics(case: Case) -> NDArray[np.int64]:
    """(C,) free intrinsics of each camera that it shares with no other."""
    problem = case.problem
    users = np.bincount(problem.intrinsics_index, minlength=len(problem.intrinsics))
    own = np.where(users == 1, (~problem.fixed_intrinsics).sum(axis=1), 0)
    return np.asarray(own[problem.intrinsics_index], dtype=np.int64)


def _unobserving_cameras(case: Case) -> Iterator[Finding]:
    cameras = numbers(np.flatnonzero(case.views_of_cameras == 0))
    if cameras:
        yield Finding(
            "unobserving-cameras",
            "note",
            f"{counted(len(cameras), 'camera')} without observations: a solve does not change their poses",
            "nothing to do, or leave them out (Problem.with_cameras)",
            case.named_cameras(cameras),
            cameras=cameras,
        )
    for views, code, text in (
        (0, "unobserved-points", ("no observations", "a solve does not change them")),
        (1, "points-seen-once", ("only one observation", "only damping limits their depth")),
    ):
        points = numbers(np.flatnonzero((case.views_of_points == views) & ~case.problem.fixed_points))
        if points:
            yield Finding(
                code,
                "note",
                f"{counted(len(points), 'point')} ({len(points) / case.problem.num_points:.1%}) with "
                f"{text[0]}: {text[1]}",
                "leave them out (Problem.with_points): they contribute nothing to the cameras",
                named_points(case.problem, points),
                points=points,
            )
